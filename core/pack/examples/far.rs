//! `far PACK OUT BYTES`: the same pack, with everything behind its head moved on by so many bytes: a file of many gigabytes that
//! takes up no more disk space than before if the file system supports sparse files. For tests of offsets beyond 2^32.

use kilwa_pack::footer::Footer;
use kilwa_pack::{ENTRIES_PER_PAGE, PAGE_BYTES, Reader, SliceSource};
use std::error::Error;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};

/// Where a page keeps its checksum, and how long the hash at the end of the header is (FORMAT, sections 3 and 4).
const PAGE_SUM: std::ops::Range<usize> = 16..32;
const HEADER_SUM: usize = 32;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [pack, out, bytes] = args.as_slice() else { return Err("usage: far PACK OUT BYTES".into()) };
    let (whole, by): (Vec<u8>, u64) = (std::fs::read(pack)?, bytes.parse()?);
    let reader = Reader::open(SliceSource(whole.clone()))?;
    let (mut header, mut entries) = (reader.header().clone(), reader.entries().to_vec());
    let behind = header.other_pages;
    for entry in entries.iter_mut().filter(|e| e.offset >= behind) {
        entry.offset += by;
    }
    header.other_pages += by;
    header.file_bytes += by;
    let pages: Vec<Vec<u8>> = (0..)
        .zip(entries.chunks(ENTRIES_PER_PAGE))
        .map(|(n, page)| kilwa_pack::directory::write_page(page, n))
        .collect();
    let mut directory = blake3::Hasher::new();
    for page in &pages {
        directory.update(&page[PAGE_SUM]);
    }
    let head = header.to_bytes();
    let mut header_hash = [0; HEADER_SUM];
    header_hash.copy_from_slice(&head[head.len() - HEADER_SUM..]);
    let footer =
        Footer { file_bytes: header.file_bytes, header_hash, directory_hash: *directory.finalize().as_bytes() };

    let mut file = File::create(out)?;
    let (page0, behind) = (usize::try_from(header.first_page)?, usize::try_from(behind)?);
    file.write_all(&head)?;
    file.write_all(&whole[head.len()..page0])?;
    file.write_all(&pages[0])?;
    file.write_all(&whole[page0 + PAGE_BYTES..behind])?;
    file.seek(SeekFrom::Start(header.other_pages))?;
    for page in &pages[1..] {
        file.write_all(page)?;
    }
    let footer = footer.to_bytes();
    file.write_all(&whole[behind + (pages.len() - 1) * PAGE_BYTES..whole.len() - footer.len()])?;
    file.write_all(&footer)?;
    Ok(())
}

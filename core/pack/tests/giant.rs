//! A pack as large as one of 1.5 · 10^10 triangles: a sparse file of 50 GB that takes little space, because the bodies of its chunks are
//! holes. Counts and offsets need more than 32 bits, and some children are farther apart than the directory can state.

use crate::common::sparse::Sparse;
use kilwa_pack::cut::{Cut, coarse_triangles};
use kilwa_pack::directory::link_children;
use kilwa_pack::footer::{FOOTER_BYTES, Footer};
use kilwa_pack::writer::directory_hash;
use kilwa_pack::{
    Attributes, DirectoryEntry, ENTRIES_PER_PAGE, HEAD_BYTES, Header, PAGE_BYTES, PackWriter, PatchRange, Reader,
    Source, checksum, parse_head, verify,
};
use std::io::{Seek, SeekFrom, Write};

const ATTRIBUTES: Attributes = Attributes { colors: true, scalars: 0 };
/// Triangles of the finest level.
const TRIANGLES: u64 = 15_000_000_000;
/// Chunks of 2^20 triangles, 2.1 · 10^10 triangles in total: 158 directory pages.
const ENTRIES: u32 = 20_000;
const CHUNK_BYTES: u32 = 2_500_000;
/// An entry on the last page that a parent on page 0 can refer to, and one on the next page.
const LAST_STATED: u32 = 127 * 127 + 5;
const FIRST_UNSTATED: u32 = 128 * 127;

/// A binary tree in which the last entry, and the two entries around the limit, have a second parent on page 0.
fn parents_of(index: u32) -> Vec<u32> {
    let far = match index {
        FIRST_UNSTATED => Some(1),
        i if i + 1 == ENTRIES => Some(2),
        LAST_STATED => Some(3),
        _ => None,
    };
    std::iter::once(index / 2).chain(far).collect()
}

fn entries(last: &[u8], of_last: &kilwa_pack::Chunk) -> Vec<DirectoryEntry> {
    let hole = checksum(&vec![0; CHUNK_BYTES as usize]);
    let mut entries: Vec<DirectoryEntry> = (0..ENTRIES)
        .map(|index| {
            let level = if index == 0 { 0 } else { index.ilog2() as u8 };
            let (error, parents) =
                if index == 0 { (f32::INFINITY, vec![]) } else { (1.0 / f32::from(level + 1), parents_of(index)) };
            let made = crate::common::entry_of(of_last, last, level, error, &parents);
            if index + 1 == ENTRIES {
                return made;
            }
            DirectoryEntry { encoded_bytes: CHUNK_BYTES, triangles: 1 << 20, vertices: 1 << 19, checksum: hole, ..made }
        })
        .collect();
    link_children(&mut entries, |_| false);
    entries
}

/// Write header, metadata and directory with the project's own writer, then the last chunk and the footer; the rest are holes.
fn write(sparse: &Sparse, last: &[u8], entries: Vec<DirectoryEntry>) {
    let metadata = crate::common::metadata(ATTRIBUTES, TRIANGLES);
    let mut file = &sparse.file;
    let mut writer =
        PackWriter::begin(&mut file, crate::common::header(ATTRIBUTES, TRIANGLES), &metadata, entries).expect("begins");
    // Chunk 0 does not fit the head, so that all pages are written before it.
    writer.chunk(&vec![0; CHUNK_BYTES as usize]).expect("writes");
    drop(writer);
    let head = (&sparse).read_at(0, 256).expect("reads");
    let header = Header::parse(&head).expect("parses");
    let sums =
        (0..header.page_count()).map(|page| (&sparse).read_at(header.page_range(page).0 + 16, 16).expect("reads"));
    let footer = Footer {
        file_bytes: header.file_bytes,
        header_hash: head[224..].try_into().expect("32 bytes"),
        directory_hash: directory_hash(sums.map(|sum| sum.try_into().expect("16 bytes"))),
    };
    let at = header.file_bytes - FOOTER_BYTES as u64;
    file.seek(SeekFrom::Start(at - last.len() as u64)).expect("seeks");
    file.write_all(last).expect("writes");
    file.write_all(&footer.to_bytes()).expect("writes");
}

#[test]
fn a_pack_of_15_billion_triangles_is_opened_cut_and_read_to_its_end() {
    let chunk = crate::common::height_field(6, 1, 1, ATTRIBUTES);
    let last = kilwa_pack::chunk::encode(&chunk, ATTRIBUTES).expect("encodes");
    let sparse = Sparse::new("giant-pack");
    write(&sparse, &last, entries(&last, &chunk));

    let head = parse_head(&(&sparse).read_at(0, HEAD_BYTES as usize).expect("reads")).expect("the head is sound");
    assert_eq!((head.header.page_count(), head.entries.len()), (158, ENTRIES_PER_PAGE));
    let reader = Reader::open(&sparse).expect("opens");
    let (header, entries) = (reader.header(), reader.entries());
    assert_eq!((header.triangles, reader.metadata().triangles), (TRIANGLES, TRIANGLES));
    assert_eq!(header.stored_triangles, (u64::from(ENTRIES - 1) << 20) + 72);
    assert_eq!(header.stored_vertices, (u64::from(ENTRIES - 1) << 19) + 49);
    assert!(header.file_bytes > 49_900_000_000, "{} bytes", header.file_bytes);
    verify::directory(entries).expect("a sound directory");
    verify::order(header, entries).expect("in order");

    // Offsets: each chunk follows the one before, beyond 2^32 and beyond 2^35.
    let first = header.other_pages + 157 * PAGE_BYTES as u64;
    for (index, entry) in (0u64..).zip(entries) {
        assert_eq!(entry.offset, first + index * u64::from(CHUNK_BYTES));
    }
    assert!(entries.last().expect("the last").offset > 1 << 35);

    // Children: 127 pages apart is stated, 128 and 157 are not.
    let stated = entries[3].children.expect("stated");
    assert_eq!((stated.first, stated.count, stated.pages), (6, 3, 127));
    assert_eq!(stated.pages(), 0..=127);
    assert_eq!((entries[1].children, entries[2].children), (None, None));
    assert_eq!(entries[4].children.map(|c| (c.first, c.count)), Some((8, 2)));

    // Cuts count in 64 bits.
    let half = 1 << 19;
    let coarse = coarse_triangles(
        entries.len(),
        &(1..ENTRIES).map(|diamond| PatchRange { first: 0, count: half, diamond }).collect::<Vec<_>>(),
    );
    for limit in [5_000_000_000, u64::from(ENTRIES) << 20] {
        let cut = Cut::for_triangles(entries, &coarse, limit);
        let (gained, lost) = (cut.refined().map(|i| u64::from(entries[i as usize].triangles)).sum::<u64>(), {
            cut.refined().skip(1).map(|i| coarse[i as usize]).sum::<u64>()
        });
        let drawn = gained - lost;
        assert!(cut.is_valid(entries) && drawn <= limit && drawn > limit / 2 - (1 << 21), "{drawn} of {limit}");
    }

    // The last chunk, and one that is a hole.
    assert_eq!(reader.chunk(ENTRIES - 1).expect("decodes").canonical(), chunk.canonical());
    let refused = reader.chunk(ENTRIES - 2).expect_err("a hole is no chunk").to_string();
    assert!(refused.contains("chunk 19998"), "{refused}");
    assert!(reader.chunk(ENTRIES).is_err());
}

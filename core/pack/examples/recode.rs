//! Write a pack again with every chunk in the codec of this version: `recode PACK OUT`. The geometry is the same; checksums and
//! identity are not.

use kilwa_pack::chunk::encode;
use kilwa_pack::{PackWriter, Reader, SliceSource, checksum};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [from, to] = paths.as_slice() else { return Err("usage: recode PACK OUT".into()) };
    let reader = Reader::open(SliceSource(std::fs::read(from)?))?;
    let attributes = reader.header().attributes;
    let mut entries = reader.entries().to_vec();
    let mut chunks = Vec::with_capacity(entries.len());
    for (i, entry) in (0u32..).zip(&mut entries) {
        let bytes = encode(&reader.chunk(i)?, attributes)?;
        entry.encoded_bytes = u32::try_from(bytes.len())?;
        entry.checksum = checksum(&bytes);
        chunks.push(bytes);
    }
    let header = reader.header().clone().with_current_codec();
    let mut writer = PackWriter::begin(Vec::new(), header, reader.metadata(), entries)?;
    for bytes in &chunks {
        writer.chunk(bytes)?;
    }
    std::fs::write(to, writer.finish()?)?;
    Ok(())
}

//! The parts of a pack: how many triangles patches and chunks have, and how many stay at coarser levels because they could
//! not be simplified. From the directory and the tables that chunks begin with.

use crate::source::FileSource;
use anyhow::Context;
use kilwa_builder::Spread;
use kilwa_pack::cut::coarse_triangles;
use kilwa_pack::plural::counted;
use kilwa_pack::{DirectoryEntry, PatchRange, Reader, Source};
use serde::Serialize;

/// Bytes of a chunk that are read first: nearly all tables are shorter.
const START: u32 = 1024;

/// See the module.
#[derive(Debug, Serialize)]
pub(super) struct Patches {
    pub(super) patch_triangles: Spread,
    pub(super) chunk_triangles: Spread,
    /// Diamonds that kept more than nine tenths of their triangles, as the report of the build counts them.
    pub(super) stuck_diamonds: u64,
    /// Triangles in them.
    pub(super) stuck_triangles: u64,
}

/// Read them.
///
/// # Errors
/// Where a chunk does not begin with a table of its triangles.
pub(super) fn of(reader: &Reader<FileSource>) -> anyhow::Result<Patches> {
    let entries = reader.entries();
    let mut patches: Vec<PatchRange> = Vec::new();
    for (i, e) in entries.iter().enumerate() {
        let table = table(reader.source(), e).with_context(|| format!("chunk {i}"))?;
        anyhow::ensure!(
            table.iter().map(|p| u64::from(p.count)).sum::<u64>() == u64::from(e.triangles),
            "chunk {i} does not contain the {} that the directory states; run kilwa verify to see what else is damaged",
            counted(e.triangles, "triangle", "triangles")
        );
        patches.extend(table);
    }
    let coarse = coarse_triangles(entries.len(), &patches);
    let both = entries.iter().map(|e| u64::from(e.triangles)).zip(coarse).skip(1);
    let stuck: Vec<u64> = both.filter(|(fine, coarse)| coarse * 10 > fine * 9).map(|(_, coarse)| coarse).collect();
    Ok(Patches {
        patch_triangles: Spread::of(patches.iter().map(|p| u64::from(p.count))),
        chunk_triangles: Spread::of(entries.iter().map(|e| u64::from(e.triangles))),
        stuck_diamonds: stuck.len() as u64,
        stuck_triangles: stuck.iter().sum(),
    })
}

/// The table of one chunk; the whole chunk is read only where its table is long.
fn table(source: &FileSource, e: &DirectoryEntry) -> anyhow::Result<Vec<PatchRange>> {
    let start = source.read_at(e.offset, e.encoded_bytes.min(START) as usize)?;
    if let Ok(table) = kilwa_pack::chunk::patch_table(&start) {
        return Ok(table);
    }
    let whole = source.read_at(e.offset, e.encoded_bytes as usize)?;
    Ok(kilwa_pack::chunk::patch_table(&whole)?)
}

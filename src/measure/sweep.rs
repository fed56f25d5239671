//! Going over the finest surface of a pack, chunk by chunk, with all processors and bounded memory.
//!
//! Chunks are read in order and in batches; what each gives is joined in order, so that results do not depend on the number of
//! threads. Only chunks whose box passes are read; of those that hold no finest patch the bytes are checked, not decoded.

use crate::source::FileSource;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kilwa_geometry::{Aabb, LatticePoint};
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{NO_DIAMOND, PackError, Reader, Source};
use rayon::prelude::*;
use serde::Serialize;
use std::io::IsTerminal;

/// Chunks read at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;
/// From so many chunks on a person is told how far it is.
const TOLD: usize = 512;

/// What was read of the pack.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub(super) struct Read {
    /// Chunks whose bytes were read.
    pub(super) chunks: u64,
    /// Their bytes.
    pub(super) bytes: u64,
    /// Chunks of the whole pack.
    pub(super) of_chunks: u64,
    /// Bytes of the whole pack.
    pub(super) of_bytes: u64,
}

/// Hand every finest triangle of the chunks that pass `meets` to `add`; `join` gets the chunks' results in order.
///
/// # Errors
/// When a chunk cannot be read or is damaged.
pub(super) fn sweep<A: Send>(
    pack: &Reader<FileSource>,
    meets: impl Fn(&Aabb) -> bool,
    empty: impl Fn() -> A + Sync,
    add: impl Fn(&mut A, [LatticePoint; 3]) + Sync,
    mut join: impl FnMut(A),
) -> anyhow::Result<Read> {
    let entries = pack.entries();
    let wanted: Vec<u32> =
        (0u32..).zip(entries).filter(|(_, e)| !e.bounds.is_empty() && meets(&e.bounds)).map(|(i, _)| i).collect();
    let bytes_of = |i: &u32| entries.get(*i as usize).map_or(0, |e| u64::from(e.encoded_bytes));
    let read = Read {
        chunks: wanted.len() as u64,
        bytes: wanted.iter().map(bytes_of).sum(),
        of_chunks: entries.len() as u64,
        of_bytes: pack.header().file_bytes,
    };
    let bar = bar(wanted.len(), read.bytes);
    for batch in wanted.chunks(BATCH) {
        let results: Vec<anyhow::Result<Option<A>>> = batch.par_iter().map(|&i| one(pack, i, &empty, &add)).collect();
        for result in results {
            if let Some(a) = result? {
                join(a);
            }
        }
        bar.inc(batch.iter().map(bytes_of).sum());
    }
    bar.finish_and_clear();
    Ok(read)
}

fn one<A>(
    pack: &Reader<FileSource>,
    index: u32,
    empty: &impl Fn() -> A,
    add: &impl Fn(&mut A, [LatticePoint; 3]),
) -> anyhow::Result<Option<A>> {
    let Some(entry) = pack.entries().get(index as usize) else { return Ok(None) };
    let bytes = pack
        .source()
        .read_at(entry.offset, entry.encoded_bytes as usize)
        .with_context(|| format!("cannot read chunk {index}"))?;
    if kilwa_pack::checksum(&bytes) != entry.checksum {
        return Err(PackError::Checksum { what: format!("chunk {index}") }.into());
    }
    let patches = kilwa_pack::chunk::patch_table(&bytes)?;
    if patches.iter().all(|p| p.diamond != NO_DIAMOND) {
        return Ok(None);
    }
    let chunk = decode_checked(&bytes, index, entry, pack.header())?;
    let mut a = empty();
    for patch in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
        for t in patch.first..patch.first + patch.count {
            add(&mut a, chunk.mesh.corners(t as usize));
        }
    }
    Ok(Some(a))
}

/// A bar on stderr with the time left, where it takes long and somebody looks.
fn bar(chunks: usize, bytes: u64) -> ProgressBar {
    if chunks < TOLD || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(bytes), ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template("measuring {wide_bar} {percent:>3} %  {eta} left") {
        bar.set_style(style);
    }
    bar
}

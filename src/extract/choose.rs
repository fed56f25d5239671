//! Which diamonds are refined: the cut that answers `--max-error` or `--max-triangles`, and its certified error.

use super::region::Steps;
use crate::source::FileSource;
use anyhow::Context;
use kilwa_pack::cut::Cut;
use kilwa_pack::{Chunk, DirectoryEntry, PackError, PatchRange, Reader, Source};
use rayon::prelude::*;

/// Chunks read at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

/// A cut, and what it promises.
pub(super) struct Chosen {
    pub(super) cut: Cut,
    /// Certified error in metres of what is written, against the finest surface.
    pub(super) error: f32,
    /// Whether every triangle of the finest surface (in the box) is written.
    pub(super) is_finest: bool,
}

/// The cut for what was asked.
pub(super) fn choose(
    reader: &Reader<FileSource>,
    max_error: Option<f64>,
    max_triangles: Option<u64>,
    region: Option<&Steps>,
) -> anyhow::Result<Chosen> {
    let entries = reader.entries();
    let cut = match (max_error, max_triangles, region) {
        (Some(limit), _, _) => Cut::for_error(entries, limit),
        (None, None, _) => Cut::finest(entries),
        (None, Some(limit), None) => {
            let coarse = coarse_triangles(reader)?;
            Cut::for_triangles(entries, &coarse, limit)
        }
        (None, Some(limit), Some(region)) => {
            let (entries, coarse) = inside(reader, region)?;
            Cut::for_triangles(&entries, &coarse, limit)
        }
    };
    let shown = |i: u32, e: &DirectoryEntry| !cut.is_refined(i) && e.parents().any(|parent| cut.is_refined(parent));
    let near = |e: &DirectoryEntry| region.is_none_or(|region| region.meets_ball(&e.sphere));
    let coarse = || (0u32..).zip(entries).filter(|(i, e)| shown(*i, e) && near(e)).map(|(_, e)| e);
    let error = coarse().map(|e| e.error).fold(0.0, f32::max);
    let is_finest = coarse().next().is_none();
    Ok(Chosen { cut, error, is_finest })
}

/// What each refinement takes away stands in the patch tables of the chunks; the directory has what it adds.
fn coarse_triangles(reader: &Reader<FileSource>) -> anyhow::Result<Vec<u64>> {
    let entries = reader.entries();
    let mut sums = vec![0u64; entries.len()];
    for (i, e) in entries.iter().enumerate() {
        let bytes = reader
            .source()
            .read_at(e.offset, e.encoded_bytes as usize)
            .with_context(|| format!("cannot read chunk {i}"))?;
        if kilwa_pack::checksum(&bytes) != e.checksum {
            return Err(PackError::Checksum { what: format!("chunk {i}") }.into());
        }
        for patch in kilwa_pack::chunk::patch_table(&bytes)? {
            add(&mut sums, &patch, u64::from(patch.count));
        }
    }
    Ok(sums)
}

fn add(sums: &mut [u64], patch: &PatchRange, count: u64) {
    if let Some(sum) = sums.get_mut(patch.diamond as usize) {
        *sum += count;
    }
}

/// The directory as if there were only what lies in the box: triangles are those inside, and what lies outside has no
/// error. Spheres are saturated, so that an entry that meets the box has parents that do: errors stay in order.
fn inside(reader: &Reader<FileSource>, region: &Steps) -> anyhow::Result<(Vec<DirectoryEntry>, Vec<u64>)> {
    let mut entries = reader.entries().to_vec();
    let mut sums = vec![0u64; entries.len()];
    for entry in &mut entries {
        if !region.meets_ball(&entry.sphere) && entry.error.is_finite() {
            entry.error = 0.0;
        }
    }
    let near: Vec<u32> = (0u32..).zip(&entries).filter(|(_, e)| region.meets(&e.bounds)).map(|(i, _)| i).collect();
    for entry in &mut entries {
        entry.triangles = 0;
    }
    for batch in near.chunks(BATCH) {
        let chunks: Vec<Result<Chunk, PackError>> = batch.par_iter().map(|&i| reader.chunk(i)).collect();
        for (&i, chunk) in batch.iter().zip(chunks) {
            let chunk = chunk?;
            for patch in &chunk.patches {
                let triangles = patch.first as usize..(patch.first + patch.count) as usize;
                let count = triangles.filter(|&t| region.holds(chunk.mesh.corners(t))).count();
                entries[i as usize].triangles += count as u32;
                add(&mut sums, patch, count as u64);
            }
        }
    }
    Ok((entries, sums))
}

//! Which diamonds are refined: the cut that answers `--max-error` or `--max-triangles`, and its certified error.

use super::ExtractError;
use super::region::Steps;
use kilwa_pack::cut::Cut;
use kilwa_pack::{Chunk, DirectoryEntry, PackError, PatchRange, Reader, Source};
use rayon::prelude::*;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Chunks read at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

/// A cut has so many times the triangles that are asked for, and is simplified to them: the surface is closer to the original than
/// any cut of that number, whose chunks are of different levels (docs/decisions/0064-extraction-simplifies.md).
const OVERSAMPLING: u64 = 4;
/// A cut with fewer times that number, because the next finer chunk was too large, is looked for again among larger ones.
const TOO_FEW: u64 = 2;
/// How often, at most.
const ROUNDS: u32 = 8;

/// A cut, and what it promises.
pub(super) struct Chosen {
    pub(super) cut: Cut,
    /// Certified error in metres of the cut, against the finest surface.
    pub(super) error: f32,
    /// Whether every triangle of the finest surface (in the box) is in the cut.
    pub(super) is_finest: bool,
    /// What the cut is simplified to, where it has more triangles than were asked for.
    pub(super) reduction: Option<Reduction>,
}

/// A number of triangles to simplify to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reduction {
    /// Triangles of the cut (in the box).
    pub(super) from: u64,
    /// Triangles to keep at most.
    pub(super) to: u64,
    /// Triangles that are simplified at once.
    pub(super) window: usize,
}

/// The cut for what was asked.
pub(super) fn choose<S: Source + Sync>(
    reader: &Reader<S>,
    max_error: Option<f64>,
    max_triangles: Option<u64>,
    window: usize,
    region: Option<&Steps>,
) -> Result<Chosen, ExtractError> {
    let entries = reader.entries();
    let (cut, reduction) = match (max_error, max_triangles) {
        (Some(limit), _) => (Cut::for_error(entries, limit), None),
        (None, None) => (Cut::finest(entries), None),
        (None, Some(limit)) => for_triangles(reader, limit, window, region)?,
    };
    let shown = |i: u32, e: &DirectoryEntry| !cut.is_refined(i) && e.parents().any(|parent| cut.is_refined(parent));
    let near = |e: &DirectoryEntry| region.is_none_or(|region| region.meets_ball(&e.sphere));
    let coarse = || (0u32..).zip(entries).filter(|(i, e)| shown(*i, e) && near(e)).map(|(_, e)| e);
    let error = coarse().map(|e| e.error).fold(0.0, f32::max);
    let is_finest = coarse().next().is_none();
    Ok(Chosen { cut, error, is_finest, reduction })
}

/// A cut of some times as many triangles as `limit`, or the finest, and what it is to be simplified to.
fn for_triangles<S: Source + Sync>(
    reader: &Reader<S>,
    limit: u64,
    window: usize,
    region: Option<&Steps>,
) -> Result<(Cut, Option<Reduction>), ExtractError> {
    let limit = limit.max(1);
    if reader.header().is_of_points() {
        // Squares that stand for points cannot be simplified.
        return Ok((of_whole(reader, limit, &mut HashMap::new())?.0, None));
    }
    let inside = region.map(|region| inside(reader, region)).transpose()?;
    let mut known = HashMap::new();
    let mut round = 0;
    loop {
        let most = limit.saturating_mul(OVERSAMPLING << round);
        let (cut, from) = if let Some((entries, coarse)) = &inside {
            let cut = Cut::for_triangles(entries, coarse, most);
            let from = triangles(&cut, entries, coarse);
            (cut, from)
        } else {
            of_whole(reader, most, &mut known)?
        };
        let is_finest = cut.refined().count() == reader.entries().len();
        round += 1;
        if from >= limit.saturating_mul(TOO_FEW) || is_finest || round == ROUNDS {
            let reduction = (from > limit).then_some(Reduction { from, to: limit, window });
            return Ok((cut, reduction));
        }
    }
}

/// A cut of the whole model of at most this many triangles, and how many it has. `known` keeps the patches that were read.
fn of_whole<S: Source>(
    reader: &Reader<S>,
    most: u64,
    known: &mut HashMap<u32, Vec<PatchRange>>,
) -> Result<(Cut, u64), ExtractError> {
    expect(reader, most);
    let entries = reader.entries();
    let mut coarse = vec![0; entries.len()];
    let cut = Cut::for_triangles_read(entries, most, |i| {
        let patches = match known.entry(i) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => new.insert(patches(reader, i)?),
        };
        for patch in &*patches {
            add(&mut coarse, patch, patch.count.into());
        }
        Ok::<_, ExtractError>(patches.clone())
    })?;
    let from = triangles(&cut, entries, &coarse);
    Ok((cut, from))
}

/// Triangles of a cut: what the refined chunks have, without what they stand for.
fn triangles(cut: &Cut, entries: &[DirectoryEntry], coarse: &[u64]) -> u64 {
    let (mut added, mut removed) = (0u64, 0u64);
    for i in cut.refined() {
        added += entries.get(i as usize).map_or(0, |e| u64::from(e.triangles));
        removed += coarse.get(i as usize).copied().unwrap_or(0);
    }
    added.saturating_sub(removed)
}

/// The patches of a chunk. What each refinement removes stands in them; the directory has what it adds.
fn patches<S: Source>(reader: &Reader<S>, i: u32) -> Result<Vec<PatchRange>, ExtractError> {
    let e = reader.entries().get(i as usize).ok_or(ExtractError::NoChunk(i))?;
    let bytes = reader
        .source()
        .read_at(e.offset, e.encoded_bytes as usize)
        .map_err(|source| ExtractError::Read { chunk: i, source })?;
    if kilwa_pack::checksum(&bytes) != e.checksum {
        return Err(PackError::Checksum { what: format!("chunk {i}") }.into());
    }
    Ok(kilwa_pack::chunk::patch_table(&bytes)?)
}

/// Tell the source which chunks such a cut will about have: largest errors first, each refinement taking away half of what it adds.
fn expect<S: Source>(reader: &Reader<S>, limit: u64) {
    let entries = reader.entries();
    let mut by_error: Vec<u32> = (0u32..).zip(entries).map(|(i, _)| i).collect();
    by_error.sort_by_key(|&i| std::cmp::Reverse(entries[i as usize].error.to_bits()));
    let mut sum = 0;
    by_error.retain(|&i| {
        sum += u64::from(entries[i as usize].triangles) / 2;
        sum <= limit
    });
    by_error.sort_unstable();
    reader.source().expect(&stretches(reader, &by_error));
}

/// Where chunks lie.
pub(super) fn stretches<S: Source>(reader: &Reader<S>, chunks: &[u32]) -> Vec<(u64, usize)> {
    let entries = chunks.iter().filter_map(|&i| reader.entries().get(i as usize));
    entries.map(|e| (e.offset, e.encoded_bytes as usize)).collect()
}

fn add(sums: &mut [u64], patch: &PatchRange, count: u64) {
    if let Some(sum) = sums.get_mut(patch.diamond as usize) {
        *sum += count;
    }
}

/// The directory as if there were only what lies in the box: triangles are those inside, and what lies outside has no
/// error. Spheres are saturated, so that an entry that meets the box has parents that do: errors stay in order.
fn inside<S: Source + Sync>(
    reader: &Reader<S>,
    region: &Steps,
) -> Result<(Vec<DirectoryEntry>, Vec<u64>), ExtractError> {
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

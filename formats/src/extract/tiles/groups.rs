//! Which diamonds are refined together, and the values by which a client decides that.
//!
//! A client knows nothing of cuts: it refines a tile by the tile's own bounding sphere and `geometricError`. It shows a valid cut all the same
//! if three things hold. The diamonds of a level are divided into *groups*; all tiles of a group have the same sphere and the same error, so
//! they are refined together. The sphere of a group contains those of the groups below it, and its error is larger, so that whatever a
//! client computes from error and distance is larger too: a group is refined only if all the groups above it are. And every patch is in a tile
//! that replaces what the group of its chunk showed, until the group of its own diamond is refined (`content`).
//!
//! A diamond alone has too few triangles for a tile; those of a group lie side by side.

use super::frame::Frame;
use crate::extract::ExtractError;
use kilwa_geometry::Sphere;
use kilwa_pack::chunk::patch_table;
use kilwa_pack::{DirectoryEntry, NO_DIAMOND, PackError, PatchRange, Reader, Source};
use std::collections::BTreeMap;

/// Bytes of a chunk that are read first: nearly all tables are shorter.
const START: u32 = 1024;
/// The error of a group is so many times the largest of the groups below it, or more: 3d-tiles-renderer refines where a child has the
/// same error as its parent.
const PARENT_ERROR_FACTOR: f64 = 1.0 + 1.0 / 4096.0;
/// A sphere reaches so far beyond those inside, in parts of their radius and in metres, which is more than clients round off far from the origin.
const MARGIN: f64 = 1e-6;
/// The chunks of a group, if it has several, have at most this many times the triangles of a tile: they are in memory together.
const CHUNKS_PER_TILE: u64 = 8;

/// Diamonds that are refined together.
#[derive(Debug)]
pub(super) struct Group {
    /// Their entries in the directory, ascending.
    pub(super) entries: Vec<u32>,
    /// Their level.
    pub(super) level: u8,
    /// Contains what they show, refined or not, and the spheres of `below`; metres in the frame of the tileset.
    pub(super) sphere: Sphere,
    /// The certified error while they are not refined, metres, or a little more: larger than those of `below`, and not 0.
    pub(super) error: f64,
    /// Groups that can be refined only when this one is.
    pub(super) below: Vec<u32>,
}

/// All groups, coarse to fine. The first one is the root entry, which is always refined.
pub(super) struct Groups {
    pub(super) all: Vec<Group>,
    /// The group of each entry.
    pub(super) of: Vec<u32>,
}

/// The patches in every chunk.
///
/// # Errors
/// Where a chunk does not begin with a table of its triangles, or names a diamond that the pack does not have.
pub(super) fn tables<S: Source>(reader: &Reader<S>) -> Result<Vec<Vec<PatchRange>>, ExtractError> {
    let entries = reader.entries();
    let read = |(i, e): (u32, &DirectoryEntry)| {
        let bytes = |n: u32| {
            let read = reader.source().read_at(e.offset, n as usize);
            read.map_err(|source| ExtractError::Read { chunk: i, source })
        };
        let table = match patch_table(&bytes(e.encoded_bytes.min(START))?) {
            Ok(table) => table,
            Err(_) => patch_table(&bytes(e.encoded_bytes)?)?,
        };
        if table.iter().map(|p| u64::from(p.count)).sum::<u64>() != u64::from(e.triangles) {
            let why = "the triangle count of its patches differs from the directory";
            return Err(PackError::Invalid { what: format!("chunk {i}"), why: why.to_owned() }.into());
        }
        match table.iter().find(|p| p.diamond != NO_DIAMOND && (p.diamond as usize >= entries.len() || p.diamond <= i))
        {
            Some(patch) => Err(ExtractError::NoChunk(patch.diamond)),
            None => Ok(table),
        }
    };
    (0..).zip(entries).map(read).collect()
}

impl Groups {
    /// Divide the diamonds into groups whose coarse forms have at most `tile` triangles, if they can be divided so far.
    ///
    /// # Errors
    /// If a sphere has no place in the frame.
    pub(super) fn new(
        entries: &[DirectoryEntry],
        tables: &[Vec<PatchRange>],
        tile: u64,
        frame: &Frame<'_>,
    ) -> Result<Self, ExtractError> {
        let mut coarse: Vec<Vec<(u32, u64)>> = vec![Vec::new(); entries.len()];
        for (chunk, table) in (0u32..).zip(tables) {
            for patch in table.iter().filter(|p| p.diamond != NO_DIAMOND) {
                coarse[patch.diamond as usize].push((chunk, patch.count.into()));
            }
        }
        let mut groups = Self { all: Vec::new(), of: vec![0; entries.len()] };
        groups.add(entries, vec![0]);
        let mut first = 1;
        while let Some(level) = entries.get(first).map(|e| e.level) {
            let last = first + entries[first..].iter().take_while(|e| e.level == level).count();
            let mut beside: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
            for i in first..last {
                beside.entry(groups.nearest_above(&entries[i], &coarse[i])).or_default().push(i as u32);
            }
            for members in beside.into_values() {
                let mut parts = Vec::new();
                divide(entries, &coarse, members, tile, &mut parts);
                for part in parts {
                    groups.add(entries, part);
                }
            }
            first = last;
        }
        groups.link(entries, &coarse);
        groups.saturate(entries, frame)?;
        Ok(groups)
    }

    fn add(&mut self, entries: &[DirectoryEntry], mut members: Vec<u32>) {
        members.sort_unstable();
        for i in &members {
            self.of[*i as usize] = self.all.len() as u32;
        }
        let level = members.first().map_or(0, |i| entries[*i as usize].level);
        self.all.push(Group { entries: members, level, sphere: Sphere::EMPTY, error: 0.0, below: Vec::new() });
    }

    /// The group above whose chunks hold most of a diamond's coarse form.
    fn nearest_above(&self, entry: &DirectoryEntry, coarse: &[(u32, u64)]) -> u32 {
        let mut shares: BTreeMap<u32, u64> = BTreeMap::new();
        for (chunk, count) in coarse {
            *shares.entry(self.of[*chunk as usize]).or_default() += count;
        }
        let most = shares.into_iter().max_by_key(|(group, count)| (*count, std::cmp::Reverse(*group)));
        most.map_or_else(|| entry.parents().next().map_or(0, |p| self.of[p as usize]), |(group, _)| group)
    }

    fn link(&mut self, entries: &[DirectoryEntry], coarse: &[Vec<(u32, u64)>]) {
        for (i, (entry, coarse)) in entries.iter().zip(coarse).enumerate().skip(1) {
            let of = self.of[i];
            for above in entry.parents().chain(coarse.iter().map(|(chunk, _)| *chunk)) {
                self.all[self.of[above as usize] as usize].below.push(of);
            }
        }
        for group in &mut self.all {
            group.below.sort_unstable();
            group.below.dedup();
        }
    }

    /// Spheres and errors, finest groups first.
    fn saturate(&mut self, entries: &[DirectoryEntry], frame: &Frame<'_>) -> Result<(), ExtractError> {
        // Errors below this are no longer reasons to show less.
        let least = frame.spacing() / 1024.0;
        for g in (0..self.all.len()).rev() {
            let mut sphere = Sphere::EMPTY;
            let mut error = least;
            for i in &self.all[g].entries {
                let entry = &entries[*i as usize];
                sphere = sphere.union(&frame.sphere(&entry.sphere)?);
                if entry.error.is_finite() {
                    error = error.max(f64::from(entry.error) * frame.scale());
                }
            }
            for below in &self.all[g].below {
                let below = &self.all[*below as usize];
                error = error.max(below.error * PARENT_ERROR_FACTOR);
                let Sphere { center, radius } = below.sphere;
                let wider = Sphere { center, radius: radius + MARGIN * radius + MARGIN };
                if !sphere.contains(&wider, 0.0) {
                    sphere = sphere.union(&wider);
                }
            }
            (self.all[g].sphere, self.all[g].error) = (sphere, error);
        }
        Ok(())
    }
}

/// Halve along the longest side until no part is too large.
fn divide(
    entries: &[DirectoryEntry],
    coarse: &[Vec<(u32, u64)>],
    mut members: Vec<u32>,
    tile: u64,
    parts: &mut Vec<Vec<u32>>,
) {
    let shown = |i: &u32| coarse[*i as usize].iter().map(|(_, count)| count).sum::<u64>();
    let refined = |i: &u32| u64::from(entries[*i as usize].triangles);
    let (sum, fine) = (members.iter().map(shown).sum::<u64>(), members.iter().map(refined).sum::<u64>());
    if members.len() < 2 || sum <= tile && fine <= tile.saturating_mul(CHUNKS_PER_TILE) {
        parts.push(members);
        return;
    }
    let center = |i: &u32| entries[*i as usize].sphere.center;
    let min = members.iter().map(center).fold(glam::DVec3::INFINITY, glam::DVec3::min);
    let max = members.iter().map(center).fold(glam::DVec3::NEG_INFINITY, glam::DVec3::max);
    let axis = (max - min).max_position();
    members.sort_by(|a, b| center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(b)));
    // Half of the triangles, those of both forms counted.
    let weight = |i: &u32| shown(i) + refined(i);
    let all: u64 = members.iter().map(weight).sum();
    let mut before = 0;
    let half = members.iter().position(|i| {
        before += weight(i);
        before * 2 >= all
    });
    let at = half.map_or(1, |half| half + 1).clamp(1, members.len() - 1);
    let rest = members.split_off(at);
    divide(entries, coarse, members, tile, parts);
    divide(entries, coarse, rest, tile, parts);
}

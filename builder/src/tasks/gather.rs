//! Copies what a task needs from the files of other tasks into its scratch folder.

use super::levels::LevelState;
use super::plan::{Divided, SharedBuild};
use super::regions::{LeavesState, PATCHES, RECORDS};
use super::shards::{LevelShard, PointBox, Shards, include, overlap, union};
use super::{Manifest, SharedFile, Task};
use crate::assemble::order_key;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::partition::tree_file::TREE;
use crate::partition::{BISECTIONS, Partition};
use crate::scratch::{
    PatchFile, Place, Records, checksum_matches, point_of, read_index, tetrahedron_of, visit_finished,
};
use rustc_hash::FxHashSet;

/// A gap between two wanted patches is read along with them if it is no longer than this.
const MAX_GAP: u64 = 1 << 16;
/// Max bytes read at a time.
const MAX_READ: u64 = 1 << 23;

/// The patches and records that a part of the tree is made of.
struct Source {
    patches: SharedFile,
    records: SharedFile,
    /// Bounding box of the points in its records.
    points: PointBox,
    is_leaves: bool,
}

/// Where to find the patches and records of the surface that a level coarsens.
pub(super) struct Sources<'a> {
    build: &'a SharedBuild,
    shards: &'a Shards,
    /// The part of the tree that is coarsened, with the levels of all tetrahedra.
    tree: &'a Partition,
    /// The level that was coarsened last: one more than the next.
    below: u8,
    /// Shards of leaves, then those of the level below.
    files: Vec<Source>,
    /// Where each shard of the level below begins in the order of the pack; empty if that level is not divided.
    firsts: Vec<(u8, u128)>,
}

impl<'a> Sources<'a> {
    /// Find out where everything is once the level `below` is coarsened, whose tasks must be done.
    pub(super) fn find(
        build: &'a SharedBuild,
        grown: &'a Divided,
        tree: &'a Partition,
        below: u8,
    ) -> Result<Self, BuildError> {
        let shards = &grown.state.shards;
        let of_tree = &build.file(&grown.manifest, TREE)?.name;
        let mut sources = Vec::new();
        let source = |manifest: &Manifest, points, is_leaves| -> Result<Source, BuildError> {
            let [patches, records] = [PATCHES, RECORDS].map(|content| build.file(manifest, content).cloned());
            Ok(Source { patches: patches?, records: records?, points, is_leaves })
        };
        for shard in 0..shards.leaves.len() as u32 {
            let manifest = build.finished_of(Task::Leaves { shard }, Some(of_tree))?;
            let LeavesState { points, .. } = build.state_of(&manifest)?;
            sources.push(source(&manifest, points, true)?);
        }
        let mut firsts = Vec::new();
        if let Some(divided) = shards.of_level(below) {
            firsts = divided.shards.iter().map(LevelShard::order_key).collect();
            for shard in 0..divided.shards.len() as u32 {
                let manifest = build.finished_of(Task::Level { level: below, shard }, Some(of_tree))?;
                let LevelState { points, .. } = build.state_of(&manifest)?;
                sources.push(source(&manifest, points, false)?);
            }
        }
        Ok(Self { build, shards, tree, below, files: sources, firsts })
    }

    /// The source of a tetrahedron of this part of the tree.
    fn of(&self, tetrahedron: u32) -> Option<u32> {
        let node = self.tree.tetrahedra.get(tetrahedron)?;
        if node.children.is_none() {
            return Some(self.shards.of_leaf(tetrahedron) as u32);
        }
        let is_below = !self.firsts.is_empty() && node.tetra.level == BISECTIONS * self.below;
        let key = order_key(&self.tree.diamonds.get(node.diamond).filter(|_| is_below)?.key);
        let shard = self.firsts.partition_point(|first| *first <= key).saturating_sub(1);
        Some((self.shards.leaves.len() + shard) as u32)
    }

    /// Copy the patches of these tetrahedra: those of leaves to `leaves`, others to `others`.
    pub(super) fn patches(
        &self,
        work: &Work<'_>,
        of: &[u32],
        leaves: &PatchFile,
        others: &PatchFile,
    ) -> Result<(), BuildError> {
        let mut wanted: Vec<(u32, u32)> = of.iter().filter_map(|t| Some((self.of(*t)?, *t))).collect();
        wanted.sort_unstable();
        wanted.dedup();
        for same in wanted.chunk_by(|a, b| a.0 == b.0) {
            let source = &self.files[same[0].0 as usize];
            let index = self.index(&source.patches)?;
            let want = |t: u32| same.binary_search(&(same[0].0, t)).is_ok();
            let mut places: Vec<(u32, Place)> = index.into_iter().filter(|(t, _)| want(*t)).collect();
            places.sort_unstable_by_key(|(_, place)| place.at);
            self.copy(work, &source.patches, &places, if source.is_leaves { leaves } else { others })?;
        }
        Ok(())
    }

    fn index(&self, file: &SharedFile) -> Result<Vec<(u32, Place)>, BuildError> {
        let index = read_index(file.bytes, |at, bytes| self.build.read(file, at, bytes))?;
        let is_inside = |p: &Place| p.at.checked_add(p.bytes).is_some_and(|end| end <= file.bytes);
        let index = index.filter(|index| index.iter().all(|(_, place)| is_inside(place)));
        index.ok_or_else(|| self.build.damaged_file(file, "its index is missing or damaged"))
    }

    /// Copy patches, neighbours in the file together.
    fn copy(
        &self,
        work: &Work<'_>,
        file: &SharedFile,
        places: &[(u32, Place)],
        to: &PatchFile,
    ) -> Result<(), BuildError> {
        let mut rest = places;
        while let Some((_, first)) = rest.first() {
            work.stop.check()?;
            let mut end = first.at;
            let near = |(_, p): &&(u32, Place)| {
                let is = end == first.at || (p.at <= end + MAX_GAP && p.at + p.bytes - first.at <= MAX_READ);
                end = if is { p.at + p.bytes } else { end };
                is
            };
            let count = rest.iter().take_while(near).count();
            let (now, later) = rest.split_at(count);
            let last = now.iter().map(|(_, p)| p.at + p.bytes).max().unwrap_or(first.at);
            let bytes = self.build.read(file, first.at, last - first.at)?;
            for (tetrahedron, place) in now {
                let at = (place.at - first.at) as usize;
                let patch = &bytes[at..at + place.bytes as usize];
                if !checksum_matches(patch) {
                    let why = format!("the patch at byte {} does not match its checksum", place.at);
                    return Err(self.build.damaged_file(file, &why));
                }
                to.append_encoded(*tetrahedron, place.triangles, patch)?;
            }
            rest = later;
        }
        Ok(())
    }

    /// Whether a tetrahedron is part of that surface: not inside of a diamond that has been coarsened.
    fn is_current(&self, tetrahedron: u32) -> bool {
        self.tree.level_of(tetrahedron).is_some_and(|level| level <= BISECTIONS * self.below)
    }

    /// Visit the records of a file. Their checksum is compared only at the end: until then, they may be damaged.
    fn visit(
        &self,
        file: &SharedFile,
        mut visit: impl FnMut(u128) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        let read = |at, bytes| self.build.read(file, at, bytes);
        let whole = visit_finished(file.bytes, read, |records| records.iter().try_for_each(|r| visit(*r)))?;
        if whole { Ok(()) } else { Err(self.build.damaged_file(file, "its records do not match their checksum")) }
    }

    /// Copy the records of all points that any of these tetrahedra uses.
    pub(super) fn records(&self, work: &Work<'_>, of: &[u32], to: &Records) -> Result<(), BuildError> {
        let mine: FxHashSet<u32> = of.iter().copied().collect();
        let own: FxHashSet<u32> = of.iter().filter_map(|t| self.of(*t)).collect();
        let mut points: FxHashSet<u128> = FxHashSet::default();
        let mut bounds: PointBox = None;
        for (_, source) in (0u32..).zip(&self.files).filter(|(i, _)| own.contains(i)) {
            work.stop.check()?;
            self.visit(&source.records, |r| {
                if mine.contains(&tetrahedron_of(r)) && points.insert(r >> 32) {
                    include(&mut bounds, point_of(r));
                }
                Ok(())
            })?;
        }
        let near = self.files.iter().filter(|s| overlap(s.points, bounds));
        self.copy_records(work, near, |r| points.contains(&(r >> 32)), to)
    }

    /// Copy the records of all points of the surface.
    pub(super) fn all_records(&self, work: &Work<'_>, to: &Records) -> Result<(), BuildError> {
        self.copy_records(work, &self.files, |_| true, to)
    }

    /// Copy the records of the current surface that are `wanted`.
    fn copy_records<'s>(
        &self,
        work: &Work<'_>,
        from: impl IntoIterator<Item = &'s Source>,
        wanted: impl Fn(u128) -> bool,
        to: &Records,
    ) -> Result<(), BuildError> {
        for source in from {
            work.stop.check()?;
            let mut gathered = Vec::new();
            self.visit(&source.records, |r| {
                if wanted(r) && self.is_current(tetrahedron_of(r)) {
                    gathered.push(r);
                }
                Ok(())
            })?;
            to.append(&gathered)?;
        }
        Ok(())
    }
}

/// The box of the points of records.
pub(super) fn box_of(records: &Records) -> Result<PointBox, BuildError> {
    let mut bounds = None;
    for first in (0..records.len()).step_by(1 << 16) {
        let block = records.read(first, (records.len() - first).min(1 << 16) as usize)?;
        let mut of_block = None;
        for r in block {
            include(&mut of_block, point_of(r));
        }
        bounds = union(bounds, of_block);
    }
    Ok(bounds)
}

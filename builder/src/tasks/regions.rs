//! The tasks between the ingest and the levels: weld the triangles of a region, grow the tree from the results of all
//! regions, fill a shard of the leaves.

use super::gather::box_of;
use super::ingest::{BASIS, REGIONS};
use super::manifest::TaskOutput;
use super::plan::{Ingest, SharedBuild, TreeState};
use super::shards::{ByteRange, Shards};
use super::{Manifest, SharedFile, Task};
use crate::build::options::BuildError;
use crate::build::report;
use crate::build::work::Work;
use crate::ingest::divided::{
    self, Findings, Grown, Joined, LINKS, REPLIES, RegionFiles, RegionIndex, RegionStore, Run, WELDED,
};
use crate::ingest::surface::{LEAVES, SHARED};
use crate::levels::diamonds_of;
use crate::partition::part::Part;
use crate::partition::tree_file::TREE;
use crate::partition::{BISECTIONS, Partition};
use crate::scratch::{Appender, Records, seal, visit_finished};
use serde::{Deserialize, Serialize};

/// The results of a region for the whole model.
const FINDINGS: &str = "findings";
/// Index of its files.
const INDEX: &str = "index";
/// The levels of bisection of all tetrahedra, one byte each, and a CRC-32.
pub(super) const LEVELS: &str = "levels";
/// The patches and the records of a shard.
pub(super) const PATCHES: &str = "patches";
pub(super) const RECORDS: &str = "shared";

pub(super) fn region_task(build: &SharedBuild, work: &Work<'_>, region: u32) -> Result<TaskOutput, BuildError> {
    let Ingest { stated, state, manifest } = build.ingest()?;
    let about = state.regions.get(region as usize).ok_or_else(|| BuildError::Inputs {
        why: format!("this build has no region {region}; use one of the tasks that `kilwa plan` lists"),
    })?;
    let files: RegionFiles = build.sealed(build.file(&manifest, REGIONS)?, about.at, about.bytes)?;
    for (name, crc32) in files.files() {
        build.download(build.file(&manifest, name)?, crc32, work, name)?;
    }
    let (findings, index) = divided::weld(work, &stated.basis, &files)?;
    work.scratch.write(FINDINGS, &seal(&serde_json::to_vec(&findings).unwrap_or_default()))?;
    work.scratch.write(INDEX, &seal(&serde_json::to_vec(&index).unwrap_or_default()))?;
    let files = [WELDED, REPLIES, LINKS, FINDINGS, INDEX].map(|name| (name.to_owned(), name.to_owned()));
    let of = Some(build.file(&manifest, BASIS)?.name.clone());
    Ok(TaskOutput { files: files.into(), of, state: serde_json::Value::Null })
}

/// The manifests of all regions, in their order.
fn regions(build: &SharedBuild, ingest: &Ingest) -> Result<Vec<Manifest>, BuildError> {
    let basis = &build.file(&ingest.manifest, BASIS)?.name;
    let all = (0..ingest.state.regions.len() as u32).map(|region| Task::Region { region });
    all.map(|task| build.finished_of(task, Some(basis))).collect()
}

pub(super) fn tree_task(build: &SharedBuild, work: &Work<'_>) -> Result<TaskOutput, BuildError> {
    let ingest = build.ingest()?;
    let basis = &ingest.stated.basis;
    let mut joined = Joined::new(work, basis)?;
    let mut indices: Vec<RegionIndex> = Vec::new();
    for manifest in regions(build, &ingest)? {
        work.stop.check()?;
        let file = build.file(&manifest, FINDINGS)?;
        let findings: Findings = build.sealed(file, 0, file.bytes)?;
        let first = joined.add(findings).ok_or_else(|| build.damaged_file(file, "it has too many components"))?;
        let links = build.file(&manifest, LINKS)?;
        let read = |at, bytes| build.read(links, at, bytes);
        let take = |records: &[u128]| -> Result<(), BuildError> { Ok(joined.links(records, first)?) };
        if !visit_finished(links.bytes, read, take)? {
            return Err(build.damaged_file(links, "its records do not match their checksum"));
        }
        let file = build.file(&manifest, INDEX)?;
        indices.push(build.sealed(file, 0, file.bytes)?);
    }
    let triangles = |bucket: u32| -> u64 {
        let region = indices.partition_point(|index| index.buckets().end <= bucket);
        indices.get(region).map_or(0, |index| index.triangles(bucket))
    };
    let Grown { tree, estimate, surface } = joined.grow(triangles)?;
    let runs = basis.runs(&tree);
    let of_run: Vec<u64> = runs.iter().map(|run| run.buckets.clone().map(triangles).sum()).collect();
    let mut shards = Shards::divide(&tree, basis.lattice(), estimate, (&runs, &of_run), build.plan.task_triangles);
    for i in 0..shards.leaves.len() {
        let of_shard = &runs[shards.runs(i, runs.len())];
        let (first, end) = (of_shard.first(), of_shard.last());
        let buckets = first.map_or(0, |r| r.buckets.start)..end.map_or(0, |r| r.buckets.end);
        let concerned = (0u32..).zip(&indices).filter(|(_, index)| index.concerns(&buckets));
        shards.leaves[i].regions = concerned.map(|(region, _)| region).collect();
    }
    write_parts(work, &tree, &runs, &mut shards)?;
    let metadata = report::metadata(&surface, &ingest.stated.metadata);
    let (color_bits, normal_bits) = (ingest.stated.metadata.color_bits, ingest.stated.metadata.normal_bits);
    let state = TreeState { surface, metadata, color_bits, normal_bits, shards };
    let of = Some(build.file(&ingest.manifest, BASIS)?.name.clone());
    let files = [TREE, LEVELS].map(|name| (name.to_owned(), name.to_owned())).into();
    Ok(TaskOutput { files, of, state: serde_json::to_value(&state).unwrap_or_default() })
}

/// Write the parts of the tree that the other tasks need, one after the other, and the levels of all tetrahedra.
fn write_parts(work: &Work<'_>, tree: &Partition, runs: &[Run], shards: &mut Shards) -> Result<(), BuildError> {
    let (mut file, mut end) = (Appender::new(work.scratch.create(TREE)?), 0);
    let mut push = |bytes: &[u8]| -> Result<ByteRange, BuildError> {
        work.stop.check()?;
        file.push(bytes)?;
        let range = ByteRange { at: end, bytes: bytes.len() as u64 };
        end += range.bytes;
        Ok(range)
    };
    for i in 0..shards.leaves.len() {
        let of_shard = &runs[shards.runs(i, runs.len())];
        shards.leaves[i].runs = push(&seal(&serde_json::to_vec(of_shard).unwrap_or_default()))?;
        shards.leaves[i].part = push(&Part::below(tree, of_shard).bytes(tree))?;
    }
    for level in &mut shards.levels {
        let diamonds = diamonds_of(tree, level.level);
        for i in 0..level.shards.len() {
            let of_shard = level.diamonds(i, &diamonds).unwrap_or_default();
            level.shards[i].part = push(&Part::to_coarsen(tree, of_shard).bytes(tree))?;
        }
    }
    shards.tail_part = push(&Part::above(tree, BISECTIONS * shards.tail).bytes(tree))?;
    shards.pack_part = push(&Part::of_pack(tree).bytes(tree))?;
    file.finish()?.sync()?;
    let mut levels: Vec<u8> = tree.tetrahedra.iter().map(|node| node.tetra.level).collect();
    levels.extend(crc32fast::hash(&levels).to_le_bytes());
    Ok(work.scratch.write(LEVELS, &levels)?)
}

/// The results of a shard of leaves, in addition to its files.
#[derive(Serialize, Deserialize)]
pub(super) struct LeavesState {
    /// Bounding box of the points in its records.
    pub(super) points: super::shards::PointBox,
    /// Leaves that hold more triangles than they should.
    pub(super) overfull: u64,
}

pub(super) fn leaves_task(build: &SharedBuild, work: &Work<'_>, shard: u32) -> Result<TaskOutput, BuildError> {
    let ingest = build.ingest()?;
    let divided = build.divided()?;
    let about = divided.state.shards.leaves.get(shard as usize).ok_or_else(|| BuildError::Inputs {
        why: format!("this build has no shard {shard} of leaves; use one of the tasks that `kilwa plan` lists"),
    })?;
    let basis = &ingest.stated.basis;
    let of_basis = &build.file(&ingest.manifest, BASIS)?.name;
    let (mut files, mut indices) = (Vec::new(), Vec::new());
    for &region in &about.regions {
        let manifest = build.finished_of(Task::Region { region }, Some(of_basis))?;
        let index = build.file(&manifest, INDEX)?;
        indices.push(build.sealed::<RegionIndex>(index, 0, index.bytes)?);
        files.push([build.file(&manifest, WELDED)?.clone(), build.file(&manifest, REPLIES)?.clone()]);
    }
    let of_tree = build.file(&divided.manifest, TREE)?;
    let runs: Vec<Run> = build.sealed(of_tree, about.runs.at, about.runs.bytes)?;
    let tree = build.part(&divided, about.part)?;
    let store = WeldedFiles { build, files };
    let overfull = divided::fill(work, basis, &indices, &store, &tree, &runs)?;
    let points = box_of(&Records::open(work.scratch, SHARED)?)?;
    let files = [(PATCHES, LEAVES), (RECORDS, SHARED)].map(|(content, name)| (content.to_owned(), name.to_owned()));
    let of = Some(of_tree.name.clone());
    let state = serde_json::to_value(LeavesState { points, overfull }).unwrap_or_default();
    Ok(TaskOutput { files: files.into(), of, state })
}

/// The files of some regions.
struct WeldedFiles<'a> {
    build: &'a SharedBuild,
    /// Welded buckets, replies.
    files: Vec<[SharedFile; 2]>,
}

impl WeldedFiles<'_> {
    fn file(&self, region: usize, content: &str) -> &SharedFile {
        &self.files[region][usize::from(content == REPLIES)]
    }
}

impl RegionStore for WeldedFiles<'_> {
    fn read(&self, region: usize, content: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        self.build.read(self.file(region, content), at, bytes)
    }

    fn damaged(&self, region: usize, content: &str, at: u64) -> BuildError {
        let why = format!("the bucket at byte {at} does not match its checksum");
        self.build.damaged_file(self.file(region, content), &why)
    }
}

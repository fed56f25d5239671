//! The tasks that coarsen: a shard of one level, or all levels that are left.

use super::gather::{Sources, box_of};
use super::manifest::TaskOutput;
use super::plan::{Divided, SharedBuild};
use super::regions::{PATCHES, RECORDS};
use super::shards::PointBox;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::{Ingested, LEAVES, SHARED};
use crate::levels::{
    Batch, CHUNKS, Coarsened, Hierarchy, diamonds_of, merged_by, patches_name, results, results_name, shared_name,
};
use crate::partition::tree_file::TREE;
use crate::partition::tree_level;
use crate::scratch::{PatchFile, Records};
use kilwa_pack::verify::Totals;
use kilwa_simplify::Precision;
use serde::{Deserialize, Serialize};

/// The patches of the root tetrahedra, which the tail leaves.
pub(super) const ROOTS: &str = "roots";
/// The results of a task.
pub(super) const RESULTS: &str = "results";

/// The results of a shard of a level, in addition to its files.
#[derive(Serialize, Deserialize)]
pub(super) struct LevelState {
    /// Bounding box of the points in its records.
    pub(super) points: PointBox,
    /// The counts of its chunks, found by decoding them again.
    pub(super) decoded: Totals,
}

/// The results of the tail, in addition to its files.
#[derive(Serialize, Deserialize)]
pub(super) struct TailState {
    /// The counts of its chunks, found by decoding them again.
    pub(super) decoded: Totals,
}

fn precision(divided: &Divided) -> Precision {
    Precision { color_bits: divided.state.color_bits, normal_bits: divided.state.normal_bits }
}

pub(super) fn level_task(
    build: &SharedBuild,
    work: &Work<'_>,
    level: u8,
    shard: u32,
) -> Result<TaskOutput, BuildError> {
    let grown = build.divided()?;
    let of_level = grown.state.shards.of_level(level);
    let about = of_level.and_then(|l| l.shards.get(shard as usize)).ok_or_else(|| BuildError::Inputs {
        why: format!("this build has no shard {shard} of level {level}; use one of the tasks that `kilwa plan` lists"),
    })?;
    let tree = &build.part_with_levels(&grown, about.part)?;
    let diamonds = &diamonds_of(tree, level);
    let sources = Sources::find(build, &grown, tree, level + 1)?;
    let merged: Vec<u32> = diamonds.iter().flat_map(|d| merged_by(tree, *d)).collect();
    let leaves = PatchFile::create(work.scratch, LEAVES)?;
    let below = PatchFile::create(work.scratch, &patches_name(level + 1))?;
    sources.patches(work, &merged, &leaves, &below)?;
    let shared = Records::create(work.scratch, SHARED)?;
    sources.records(work, &merged, &shared)?;
    let triangles = merged.iter().map(|t| u64::from(leaves.triangles(*t)) + u64::from(below.triangles(*t))).sum();
    let chunks = work.scratch.create(CHUNKS)?;
    let batch = Batch {
        surface: &grown.state.surface,
        tree,
        level,
        diamonds,
        leaves: &leaves,
        below: Some(&below),
        shared: &shared.finish()?,
        chunks: &chunks,
        precision: precision(&grown),
        decode_again: true,
        progress: (0, triangles),
    };
    let Coarsened { shared, decoded, .. } = batch.coarsen(work)?;
    let files = [
        (PATCHES, patches_name(level)),
        (RECORDS, shared_name(level)),
        (CHUNKS, CHUNKS.to_owned()),
        (RESULTS, results_name(level)),
    ];
    let state = LevelState { points: box_of(&shared)?, decoded };
    let state = serde_json::to_value(state).unwrap_or_default();
    let of = Some(build.file(&grown.manifest, TREE)?.name.clone());
    Ok(TaskOutput { files: files.map(|(content, name)| (content.to_owned(), name)).into(), of, state })
}

pub(super) fn tail_task(build: &SharedBuild, work: &Work<'_>) -> Result<TaskOutput, BuildError> {
    let grown = build.divided()?;
    let left = grown.state.shards.tail;
    let tree = build.part_with_levels(&grown, grown.state.shards.tail_part)?;
    let precision = precision(&grown);
    let leaves = PatchFile::create(work.scratch, LEAVES)?;
    let below = PatchFile::create(work.scratch, &patches_name(left))?;
    let shared = Records::create(work.scratch, SHARED)?;
    {
        let sources = Sources::find(build, &grown, &tree, left)?;
        let wanted = tree.tetrahedra.numbered().filter(|(_, node)| {
            let level = tree_level(node.tetra.level);
            if node.children.is_none() { level <= left } else { level == left }
        });
        let wanted: Vec<u32> = wanted.map(|(t, _)| t).collect();
        sources.patches(work, &wanted, &leaves, &below)?;
        sources.all_records(work, &shared)?;
    }
    let of = Some(build.file(&grown.manifest, TREE)?.name.clone());
    let Divided { state, .. } = grown;
    let ingested = Ingested { surface: state.surface, tree, leaves, shared: shared.finish()? };
    let chunks = work.scratch.create(CHUNKS)?;
    let mut hierarchy = Hierarchy::above(ingested, Some(below), chunks, left, state.shards.tail_triangles);
    while hierarchy.next().is_some() {
        work.stop.check()?;
        hierarchy.coarsen_next(work, precision)?;
    }
    let roots = PatchFile::create(work.scratch, ROOTS)?;
    for (t, patch) in hierarchy.roots()? {
        roots.append(t, &patch)?;
    }
    roots.finish()?;
    let all: Vec<_> = hierarchy.results().cloned().collect();
    results::write(work.scratch, RESULTS, &all)?;
    let files = [ROOTS, CHUNKS, RESULTS].map(|name| (name.to_owned(), name.to_owned()));
    let state = TailState { decoded: hierarchy.decoded().unwrap_or_default() };
    let state = serde_json::to_value(state).unwrap_or_default();
    Ok(TaskOutput { files: files.into(), of, state })
}

//! The task that reads the inputs: everything up to the leaves, as in a build on one machine, then the division into
//! shards.

use super::gather::{leaf_patches, leaf_records};
use super::manifest::TaskOutput;
use super::plan::{IngestState, SharedBuild};
use super::shards::{Shards, include};
use crate::build::options::{BuildError, BuildOptions};
use crate::build::work::Work;
use crate::build::{Inputs, ingest_of, plan, report};
use crate::ingest::surface::Ingested;
use crate::ingest::{Spool, ingest};
use crate::partition::tree_file::{self, TREE};
use crate::scratch::{PatchFile, Records, point_of, tetrahedron_of};
use std::path::Path;

/// Records of a shard that are gathered before they are written.
const GATHERED: usize = 1 << 14;
/// The records of all shards, by leaf.
const BY_LEAF: &str = "shards.records";

pub(super) fn ingest_task(
    build: &SharedBuild,
    work: &Work<'_>,
    inputs: &mut dyn Inputs,
    options: &BuildOptions,
) -> Result<TaskOutput, BuildError> {
    options.check()?;
    let now = plan(inputs, options)?;
    // Names, lengths and times must agree. Stamps need not: another machine may see other inodes of the same files.
    if let Some(why) = now.difference(&build.plan.plan, &[], &|_, _| Ok(true))? {
        let why = format!("this is not the build that was planned: {why}; run `kilwa plan` again");
        return Err(BuildError::Inputs { why });
    }
    let mut spool = Spool::create(work.scratch, Path::new("mesh"))?;
    let provenance = inputs.deliver(&mut spool, work)?;
    let Ingested { surface, tree, leaves, shared } =
        ingest(work, Some(spool.finish()?), &ingest_of(options), provenance)?;
    tree_file::write(work.scratch, &tree)?;
    let triangles = |leaf: u32| u64::from(leaves.triangles(leaf));
    let mut shards = Shards::divide(&tree, &surface.lattice, triangles, build.plan.task_triangles);
    let mut files = vec![(TREE.to_owned(), TREE.to_owned())];
    divide_patches(work, &shards, &leaves)?;
    divide_records(work, &mut shards, &shared)?;
    for i in 0..shards.leaves.len() {
        files.extend([leaf_patches(i), leaf_records(i)].map(|name| (name.clone(), name)));
    }
    let metadata = report::metadata(&surface, options);
    let (color_bits, normal_bits) = (options.color_bits, options.normal_bits);
    let state = IngestState { surface, metadata, color_bits, normal_bits, shards };
    Ok(TaskOutput { files, of_ingest: None, state: serde_json::to_value(&state).unwrap_or_default() })
}

fn divide_patches(work: &Work<'_>, shards: &Shards, leaves: &PatchFile) -> Result<(), BuildError> {
    let all = leaves.tetrahedra();
    for i in 0..shards.leaves.len() {
        let file = PatchFile::create(work.scratch, &leaf_patches(i))?;
        for &leaf in all.iter().filter(|leaf| shards.of_leaf(**leaf) == i) {
            work.stop.check()?;
            if let Some((triangles, bytes)) = leaves.read_encoded(leaf)? {
                file.append_encoded(leaf, triangles, &bytes)?;
            }
        }
        file.finish()?;
    }
    Ok(())
}

fn divide_records(work: &Work<'_>, shards: &mut Shards, shared: &Records) -> Result<(), BuildError> {
    // Sorted by leaf, they come shard by shard, so that one file at a time is open.
    let by_leaf = Records::create(work.scratch, BY_LEAF)?;
    for first in (0..shared.len()).step_by(GATHERED) {
        let mut block = shared.read(first, (shared.len() - first).min(GATHERED as u64) as usize)?;
        for r in &mut block {
            *r = r.rotate_right(32);
        }
        by_leaf.append(&block)?;
    }
    let mut next = 0;
    let mut file: Option<Records> = None;
    let mut gathered = Vec::new();
    let close = |file: &mut Option<Records>, gathered: &mut Vec<u128>| -> Result<(), BuildError> {
        if let Some(file) = file.take() {
            file.append(gathered)?;
            gathered.clear();
            file.finish()?;
        }
        Ok(())
    };
    let mut go_to = |shard: usize, file: &mut Option<Records>, gathered: &mut Vec<u128>| -> Result<(), BuildError> {
        while next <= shard {
            close(file, gathered)?;
            *file = Some(Records::create(work.scratch, &leaf_records(next))?);
            next += 1;
        }
        Ok(())
    };
    by_leaf.sorted::<BuildError>(work.scratch, "shards.runs", work.memory / 4, |r| {
        let r = r.rotate_left(32);
        let shard = shards.of_leaf(tetrahedron_of(r));
        go_to(shard, &mut file, &mut gathered)?;
        include(&mut shards.leaves[shard].records, point_of(r));
        gathered.push(r);
        if let Some(file) = file.as_ref().filter(|_| gathered.len() == GATHERED) {
            file.append(&gathered)?;
            gathered.clear();
        }
        Ok(())
    })?;
    go_to(shards.leaves.len(), &mut file, &mut gathered)?;
    drop(by_leaf);
    work.scratch.remove(BY_LEAF)?;
    Ok(work.scratch.remove(&leaf_records(shards.leaves.len()))?)
}

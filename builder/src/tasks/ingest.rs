//! The task that reads the inputs: everything up to the leaves, as in a build on one machine, then the division into
//! shards.

use super::gather::{leaf_patches, leaf_records};
use super::manifest::Made;
use super::plan::{IngestState, SharedBuild};
use super::shards::{Shards, extend};
use crate::build::options::{BuildError, BuildOptions};
use crate::build::work::Work;
use crate::build::{Inputs, ingest_of, plan, report};
use crate::ingest::surface::Ingested;
use crate::ingest::{Spool, ingest};
use crate::partition::tree_file::{self, TREE};
use crate::scratch::{PatchFile, Records, tetrahedron_of};
use std::path::Path;

/// Records of a shard that are gathered before they are written.
const GATHERED: usize = 1 << 12;

pub(super) fn ingest_task(
    build: &SharedBuild,
    work: &Work<'_>,
    inputs: &mut dyn Inputs,
    options: &BuildOptions,
) -> Result<Made, BuildError> {
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
    Ok(Made { files, state: serde_json::to_value(&state).unwrap_or_default() })
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
    let count = shards.leaves.len();
    let files = (0..count).map(|i| Records::create(work.scratch, &leaf_records(i)));
    let files: Vec<Records> = files.collect::<Result<_, _>>()?;
    let mut gathered: Vec<Vec<u128>> = vec![Vec::new(); count];
    shared.sorted::<BuildError>(work.scratch, "shards.runs", work.memory / 4, |r| {
        let shard = shards.of_leaf(tetrahedron_of(r));
        extend(&mut shards.leaves[shard].records, crate::scratch::point_of(r));
        gathered[shard].push(r);
        if gathered[shard].len() == GATHERED {
            files[shard].append(&gathered[shard])?;
            gathered[shard].clear();
        }
        Ok(())
    })?;
    for (file, rest) in files.into_iter().zip(gathered) {
        file.append(&rest)?;
        file.finish()?;
    }
    Ok(())
}

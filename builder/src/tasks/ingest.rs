//! The task that reads the inputs, and sorts their triangles into regions.

use super::manifest::TaskOutput;
use super::plan::{IngestState, RegionEntry, SharedBuild, Stated};
use crate::build::options::{BuildError, BuildOptions};
use crate::build::work::Work;
use crate::build::{Inputs, ingest_of, plan, report};
use crate::ingest::{Spool, divided};
use crate::scratch::seal;
use std::path::Path;

/// What all tasks know of the inputs.
pub(super) const BASIS: &str = "basis";
/// Where the triangles of each region are in its files.
pub(super) const REGIONS: &str = "regions";

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
    let size = build.plan.task_triangles;
    let (basis, sorted) = divided::sort(work, spool.finish()?, &ingest_of(options), provenance, size)?;
    let mut files = vec![(BASIS.to_owned(), BASIS.to_owned()), (REGIONS.to_owned(), REGIONS.to_owned())];
    let stated = Stated { basis, metadata: report::Stated::of(options) };
    work.scratch.write(BASIS, &seal(&serde_json::to_vec(&stated).unwrap_or_default()))?;
    let (mut regions, mut all) = (Vec::new(), Vec::new());
    for (region, near) in sorted.iter().zip(stated.basis.positions(&sorted)) {
        let line = seal(&serde_json::to_vec(region).unwrap_or_default());
        let (at, bytes) = (all.len() as u64, line.len() as u64);
        let triangles = stated.basis.triangles_of(region);
        regions.push(RegionEntry { at, bytes, triangles, near });
        all.extend(line);
        files.extend(region.files().map(|(name, _)| (name.to_owned(), name.to_owned())));
    }
    work.scratch.write(REGIONS, &all)?;
    let state = IngestState { triangles: stated.basis.triangles(), regions };
    Ok(TaskOutput { files, of: None, state: serde_json::to_value(&state).unwrap_or_default() })
}

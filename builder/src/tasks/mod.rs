//! One build as tasks for many machines, which exchange files through a [`Store`]: a folder that all of them see, or an
//! object store.
//!
//! | task | input | output |
//! |---|---|---|
//! | [`Task::Ingest`] | the inputs | the triangles, sorted into regions |
//! | [`Task::Region`] | the triangles of a region, and those of others that touch it | welded vertices, and what is known about the region |
//! | [`Task::Tree`] | what is known about every region | the tree, its division into shards, and what is known about the surface |
//! | [`Task::Leaves`] | a part of the tree, and the regions that a shard of its leaves touches | the patches of these leaves |
//! | [`Task::Level`] | a part of the tree, and every task of the leaves and of the level below | one shard of a level |
//! | [`Task::Tail`] | a part of the tree, and every task of the leaves and of the coarsest level that is divided into shards | all coarser levels, which together are a part of a task |
//!
//! The file of the tree contains the parts that the other tasks need, one after the other, so only the task that writes it holds the whole tree.
//! A region and a shard of leaves are ranges of the buckets of the ingest, in the order of the tree. A shard of a level is a range of its diamonds in the order of the pack, along a Hilbert curve. [`plan`] lists the tasks;
//! [`run`] runs one of them, and [`assemble`] writes the pack. A task processes a diamond exactly as [`mod@crate::build`]
//! does, so the pack is byte for byte the same, however the work is divided. It also decodes each chunk that it encoded, and counts what is in it;
//! [`assemble`] only compares checksums and adds up the counts.
//!
//! A task copies what it needs into its own scratch folder, works there, uploads its results under names that no other
//! attempt uses, and creates its *manifest*, `done/TASK.json`, last. The first manifest counts; an attempt that
//! finds one removes its own files. So a task may run twice, or on two workers at once, or be killed at any moment.
//! Every file that is exchanged carries checksums, which are compared by the task that reads it.
//!
//! Failures: [`BuildError`], with what is wrong and what to do.

mod gather;
mod ingest;
mod levels;
mod manifest;
mod objects;
mod pack;
mod plan;
mod read_ahead;
mod regions;
mod shards;
mod store;

pub use manifest::{Manifest, SharedFile};
pub use objects::ObjectFolder;
pub use pack::assemble;
use plan::State;
pub use plan::{PLAN, SharedBuild, SharedPlan, TaskEntry, TaskFile};
pub use shards::TASK_TRIANGLES;
pub(crate) use shards::equal_parts;
pub use store::{SharedFolder, Store};

use crate::build::Inputs;
use crate::build::machine;
use crate::build::options::{BuildError, BuildOptions};
use crate::build::work::Work;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// One task of a build; the assembly of the pack is not among them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Task {
    /// Read the inputs, sort the triangles into regions.
    Ingest,
    /// Weld the triangles of a region.
    Region {
        /// The number of the region.
        region: u32,
    },
    /// Grow the tree from the results of the regions.
    Tree,
    /// Fill one shard of the leaves.
    Leaves {
        /// The number of the shard.
        shard: u32,
    },
    /// Coarsen one shard of a level.
    Level {
        /// The level of the diamonds, 0 is the coarsest.
        level: u8,
        /// The number of the shard.
        shard: u32,
    },
    /// Coarsen all levels that are left.
    Tail,
}

impl Task {
    /// Its name, unique in a build: `ingest`, `region-0012`, `tree`, `leaves-0012`, `level-07-0012`, `tail`.
    pub fn id(self) -> String {
        let number = match self {
            Self::Ingest | Self::Tree | Self::Tail => return self.stage(),
            Self::Region { region: number } | Self::Leaves { shard: number } | Self::Level { shard: number, .. } => {
                number
            }
        };
        format!("{}-{number:04}", self.stage())
    }

    /// The stage it belongs to: `ingest`, `region`, `tree`, `leaves`, `level-07`, `tail`.
    pub(crate) fn stage(self) -> String {
        match self {
            Self::Ingest => "ingest".to_owned(),
            Self::Region { .. } => "region".to_owned(),
            Self::Tree => "tree".to_owned(),
            Self::Leaves { .. } => "leaves".to_owned(),
            Self::Level { level, .. } => format!("level-{level:02}"),
            Self::Tail => "tail".to_owned(),
        }
    }
}

/// The outcome of a task.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Its manifest.
    pub manifest: Manifest,
    /// Whether it was done before, or by somebody else at the same time.
    pub already_done: bool,
}

/// Where the inputs and options of a build come from, for [`Task::Ingest`]; other tasks do not ask.
pub type Prepare<'a> = &'a mut dyn FnMut() -> Result<(Box<dyn Inputs>, BuildOptions), BuildError>;

/// Do a task, unless it is done.
///
/// # Errors
/// [`BuildError`]: a task that it needs is not done, a file cannot be read or written or is damaged, the inputs have
/// changed since the build was planned, or those of the stages themselves.
pub fn run(build: &SharedBuild, task: Task, work: &Work<'_>, prepare: Prepare<'_>) -> Result<Outcome, BuildError> {
    match build.state(task)? {
        State::Done(manifest) => return Ok(Outcome { manifest, already_done: true }),
        State::Damaged { why, bytes, manifest } => {
            work.progress.note(&format!("the task {} was done, but {why}; running it again", task.id()));
            build.remove_manifest(task, &bytes, manifest.as_ref())?;
        }
        State::Pending => {}
    }
    let (clock, cpu) = (Instant::now(), machine::cpu_seconds());
    let made = match task {
        Task::Ingest => {
            let (mut inputs, options) = prepare()?;
            ingest::ingest_task(build, work, inputs.as_mut(), &options)?
        }
        Task::Region { region } => regions::region_task(build, work, region)?,
        Task::Tree => regions::tree_task(build, work)?,
        Task::Leaves { shard } => regions::leaves_task(build, work, shard)?,
        Task::Level { level, shard } => levels::level_task(build, work, level, shard)?,
        Task::Tail => levels::tail_task(build, work)?,
    };
    work.stop.check()?;
    let cpu_seconds = cpu.and_then(|before| Some(machine::cpu_seconds()? - before));
    build.complete(task, work, made, clock.elapsed().as_secs_f64(), cpu_seconds)
}

//! One build on many machines: `kilwa plan` lists its tasks, `kilwa task` does one, `kilwa assemble` writes the pack.
//!
//! The machines exchange files in a folder that all of them see, or in an object store. The program that starts the tasks (kilwa-dask, a
//! Slurm job array, a shell) reads the list, and may start a task twice or kill it at any moment.

mod assemble;
mod assembled;
mod object;
mod place;
mod plan;
mod task;

pub(crate) use assemble::Args as AssembleArgs;
pub(crate) use plan::Args as PlanArgs;
pub(crate) use task::Args as TaskArgs;

pub(crate) use assemble::run as assemble;
pub(crate) use plan::run as plan;
pub(crate) use task::run as task;

use anyhow::Context;
use kilwa_builder::build::machine;
use kilwa_builder::build::work::Stop;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::tasks::SharedBuild;
use place::Place;
use std::path::PathBuf;

/// What a verb that works on a shared build may use of this machine.
#[derive(clap::Args)]
pub(crate) struct Machine {
    /// Worker threads (default: one per core). The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = crate::build::parse_threads)]
    threads: usize,
    /// Memory to use, for example 300M or 2.5GiB (default: a quarter of the machine's). The bytes do not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = crate::build::size::memory)]
    memory: Option<u64>,
    /// Folder for scratch files, preferably on a disk of this machine (default: the system's folder for temporary files).
    #[arg(long, value_name = "DIR")]
    scratch: Option<PathBuf>,
}

impl Machine {
    fn memory(&self) -> u64 {
        self.memory.unwrap_or_else(machine::default_budget)
    }

    /// The number of threads, once they run.
    fn threads(&self) -> usize {
        if self.threads == 0 { rayon::current_num_threads() } else { self.threads }
    }

    /// A scratch folder that is removed in the end.
    fn scratch(&self) -> anyhow::Result<Scratch> {
        let Some(parent) = &self.scratch else { return Ok(Scratch::temporary()?) };
        std::fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        Ok(Scratch::temporary_in(parent)?)
    }
}

/// The build in a folder or store.
fn open(place: &Place, stop: &Stop) -> anyhow::Result<SharedBuild> {
    Ok(SharedBuild::open(place.store(stop)?)?)
}

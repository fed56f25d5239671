//! The resources that a command may use: threads, memory, a folder for scratch files.

use crate::build::{self, size};
use kilwa_builder::build::machine;
use kilwa_files::atomic::folder_of;
use std::path::{Path, PathBuf};

/// Options of commands whose result does not depend on them.
#[derive(clap::Args)]
pub(crate) struct Resources {
    /// Worker threads (default: one per core). The result does not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = build::parse_threads)]
    pub(crate) threads: usize,
    /// Memory to use, for example 300M or 2.5GiB (default: a quarter of the machine's). The result does not depend on it.
    #[arg(long, value_name = "SIZE", value_parser = size::memory)]
    pub(crate) memory: Option<u64>,
    /// Folder for scratch files, preferably on a fast disk (default: the folder of the output).
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
}

impl Resources {
    /// The number of threads.
    pub(crate) fn threads(&self) -> usize {
        let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        if self.threads == 0 { cores() } else { self.threads }
    }

    /// Bytes of memory.
    pub(crate) fn memory(&self) -> u64 {
        self.memory.unwrap_or_else(machine::default_budget)
    }

    /// The folder for scratch files of a command that writes `output`.
    pub(crate) fn scratch_for(&self, output: &Path) -> PathBuf {
        self.scratch.clone().unwrap_or_else(|| folder_of(output).to_owned())
    }
}

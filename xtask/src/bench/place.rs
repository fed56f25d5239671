//! Where a benchmark works, and with which program.

use crate::process::{command, run as run_command};
use anyhow::Result;
use std::path::{Path, PathBuf};

/// The folder of a benchmark, and the program that it measures.
pub(super) struct Place {
    pub(super) folder: PathBuf,
    pub(super) kilwa: PathBuf,
}

impl Place {
    /// The path of a file or folder in it.
    pub(super) fn at(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The same as text.
    pub(super) fn text(&self, name: &str) -> String {
        self.at(name).display().to_string()
    }

    /// Run kilwa.
    pub(super) fn kilwa(&self, args: &[&str], paths: &[&Path]) -> Result<()> {
        run_command(command(&self.kilwa.to_string_lossy(), args)?.args(paths))
    }
}

//! The note `.NAME.kilwa.done` beside the output says which build made which pack. It is written before the pack gets its final name, and removed
//! after the scratch files. If a build is killed in between, the note shows `--resume` that only the scratch files are left to remove.
//!
//! A note alone proves nothing: the pack must have the identity in the note and be sound, and the build must be the same.

use super::output::{beside, check};
use crate::inputs::Inputs;
use crate::new_file::NewFile;
use crate::progress::Bar;
use crate::source::open_pack;
use anyhow::Context;
use kilwa_builder::build::journal::Plan;
use kilwa_builder::build::plan;
use kilwa_builder::build::work::Stop;
use kilwa_builder::{BuildOptions, Inputs as _};
use kilwa_files::plain_file;
use kilwa_pack::metadata::SourceFile;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A longer file is not a note. Each input takes a few hundred bytes.
const NOTE_MAX: u64 = 1 << 30;

/// The content of a note.
#[derive(Serialize, Deserialize)]
pub(super) struct Finished {
    /// What was built.
    pub(super) plan: Plan,
    /// The identity of the pack.
    pub(super) identity: String,
    /// Its length.
    pub(super) bytes: u64,
    /// The report as JSON.
    pub(super) report: serde_json::Value,
}

fn name(output: &Path) -> PathBuf {
    beside(output, ".done")
}

/// Remove the note of an output, if there is one.
pub(super) fn remove(output: &Path) {
    if Finished::read(output).is_some() {
        drop(std::fs::remove_file(name(output)));
    }
}

impl Finished {
    /// Write the note. Without it, a build that is killed in its last moments cannot be resumed.
    ///
    /// # Errors
    /// If it cannot be written, or another file has its name.
    pub(super) fn write(&self, output: &Path) -> anyhow::Result<()> {
        remove(output);
        NewFile::write(&name(output), &serde_json::to_vec(self)?, false)
    }

    fn read(output: &Path) -> Option<Self> {
        let file = plain_file::open_own(&name(output)).ok()?;
        serde_json::from_slice(&plain_file::read(file, NOTE_MAX).ok()?).ok()
    }

    /// The note of a build of these inputs with these options, if the output is its pack.
    ///
    /// # Errors
    /// If an input cannot be read, or the pack is the right one but damaged.
    pub(super) fn find(
        output: &Path,
        inputs: &Inputs,
        options: &BuildOptions,
        bar: &Bar,
        stop: &Stop,
    ) -> anyhow::Result<Option<Self>> {
        let Some(finished) = Self::read(output) else { return Ok(None) };
        let Ok(pack) = open_pack(output) else { return Ok(None) };
        let bytes = output.metadata().map_or(0, |about| about.len());
        if pack.identity() != finished.identity || bytes != finished.bytes {
            return Ok(None);
        }
        let is_unchanged = |number: usize, sources: &[SourceFile]| inputs.is_unchanged(number, sources, bar, stop);
        let now = plan(inputs, options)?;
        if now.difference(&finished.plan, &pack.metadata().sources, &is_unchanged)?.is_some() {
            return Ok(None);
        }
        let damaged = || format!("{} was complete but is damaged now; use --force to build it again", output.display());
        let checked = check(output, bar, stop);
        stop.check()?;
        checked.with_context(damaged)?;
        Ok(Some(finished))
    }
}

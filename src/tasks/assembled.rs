//! A record of the pack, which a build writes before the pack gets its final name. If the command is killed and run again, it shows whether the
//! existing pack was made by this build or is an older one with the same name.

use super::object::Pack;
use anyhow::Context;
use kilwa_builder::tasks::{PLAN, SharedBuild, Store};
use serde::{Deserialize, Serialize};

/// The record. Its folder is the last one of a build to be removed.
const NOTE: &str = "scratch/assembled.json";

/// A complete pack that is about to get its final name.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Assembled {
    #[serde(flatten)]
    pub(super) pack: Pack,
    /// Whether the build stays when the pack is in place.
    pub(super) kept: bool,
}

impl Assembled {
    /// The record of the build in a store, if it exists and can be read.
    pub(super) fn of(store: &dyn Store) -> anyhow::Result<Option<Self>> {
        Ok(store.read_all(NOTE)?.and_then(|text| serde_json::from_slice(&text).ok()))
    }

    /// Write it, replacing an earlier one.
    pub(super) fn note(&self, store: &dyn Store) -> anyhow::Result<()> {
        let text = crate::terminal::json_text(self)?;
        for _ in 0..2 {
            if store.create_new(NOTE, text.as_bytes())? {
                // If another assembly has removed the build, the record must not stay for a later build of the same inputs.
                if !exists(store)? {
                    store.remove(NOTE)?;
                }
                return Ok(());
            }
            match store.read_all(NOTE)? {
                Some(there) if there == text.as_bytes() => return Ok(()),
                _ => store.remove(NOTE)?,
            }
        }
        // Another assembly is writing the same.
        Ok(())
    }

    /// Whether this is its pack.
    pub(super) fn is(&self, pack: &Pack) -> bool {
        (self.pack.bytes, &self.pack.sha256) == (pack.bytes, &pack.sha256)
    }
}

/// Whether the build is partly removed: the results of its tasks are removed first.
pub(super) fn is_being_removed(build: &SharedBuild) -> anyhow::Result<bool> {
    Ok(build.store().list("done")?.is_empty())
}

/// Whether there is a build at all.
pub(super) fn exists(store: &dyn Store) -> anyhow::Result<bool> {
    Ok(store.length(PLAN).context("cannot look for the build")?.is_some())
}

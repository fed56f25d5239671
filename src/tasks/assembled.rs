//! What a build notes about its own pack before that gets its name: so the same command, after a death, knows whether the pack that is there is
//! the one that this build made, or an older one of the same name.

use super::object::Pack;
use anyhow::Context;
use kilwa_builder::tasks::{PLAN, SharedBuild, Store};
use serde::{Deserialize, Serialize};

/// The note. Of all folders of a build this one is removed last.
const NOTE: &str = "scratch/assembled.json";

/// A pack that is complete, and about to get its name.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Assembled {
    #[serde(flatten)]
    pub(super) pack: Pack,
    /// Whether the build stays when the pack is in place.
    pub(super) kept: bool,
}

impl Assembled {
    /// The note of the build in a store, if there is one that can be read.
    pub(super) fn of(store: &dyn Store) -> anyhow::Result<Option<Self>> {
        Ok(store.read_all(NOTE)?.and_then(|text| serde_json::from_slice(&text).ok()))
    }

    /// Write it, in place of an earlier one.
    pub(super) fn note(&self, store: &dyn Store) -> anyhow::Result<()> {
        let text = crate::terminal::json_text(self)?;
        for _ in 0..2 {
            if store.create_new(NOTE, text.as_bytes())? {
                // If another assembly has removed the build, the note must not stay for a later build of the same inputs.
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
        // Another assembly notes the same at the same time.
        Ok(())
    }

    /// Whether this is its pack.
    pub(super) fn is(&self, pack: &Pack) -> bool {
        (self.pack.bytes, &self.pack.sha256) == (pack.bytes, &pack.sha256)
    }
}

/// Whether the build was being removed when its pack was in place: what its tasks left goes first.
pub(super) fn is_being_removed(build: &SharedBuild) -> anyhow::Result<bool> {
    Ok(build.store().list("done")?.is_empty())
}

/// Whether there is a build at all.
pub(super) fn exists(store: &dyn Store) -> anyhow::Result<bool> {
    Ok(store.length(PLAN).context("cannot look for the build")?.is_some())
}

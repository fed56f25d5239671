//! A pack in a store. Which build made it is noted on the object, so that a build that was killed when its pack was in place is found complete.

use crate::build;
use crate::progress::Bar;
use crate::stores;
use anyhow::{Context, anyhow};
use kilwa_archive::checksums::sha256_of;
use kilwa_builder::Progress;
use kilwa_builder::build::work::Stop;
use kilwa_store::{Address, Condition, ObjectError, Objects};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

/// Names of the notes.
const BUILD: &str = "kilwa-build";
const SHA256: &str = "kilwa-sha256";
const TRIANGLES: &str = "kilwa-triangles";

/// A pack that is complete.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Pack {
    pub(super) bytes: u64,
    pub(super) sha256: String,
    pub(super) triangles: u64,
}

/// The object that a pack becomes.
pub(super) struct Object {
    address: Address,
    objects: Objects,
}

impl Object {
    /// The one that an output names, if it names one.
    pub(super) fn of(output: &Path, stop: &Stop) -> anyhow::Result<Option<Self>> {
        let Some(address) = stores::address(output)? else { return Ok(None) };
        build::refuse_name(output)?;
        let objects = stores::objects(&address.bucket, stop)?;
        Ok(Some(Self { address, objects }))
    }

    /// Refuse to replace what is there.
    pub(super) fn refuse_existing(&self) -> anyhow::Result<()> {
        let there = self.objects.about(&self.address.path).with_context(|| self.cannot())?;
        if there.is_some() { Err(self.exists()) } else { Ok(()) }
    }

    /// The pack, if it is there and was made by the build with this key.
    pub(super) fn finished(&self, key: &str) -> anyhow::Result<Option<Pack>> {
        let cannot = || format!("cannot read {}", self.address);
        let Some(about) = self.objects.about(&self.address.path).with_context(cannot)? else { return Ok(None) };
        let notes = self.objects.notes(&self.address.path).with_context(cannot)?.unwrap_or_default();
        let is_ours = notes.get(BUILD).is_some_and(|of| of == key);
        let triangles = notes.get(TRIANGLES).and_then(|n| n.parse().ok());
        let sha256 = notes.get(SHA256).filter(|_| is_ours).cloned();
        Ok(sha256.zip(triangles).map(|(sha256, triangles)| Pack { bytes: about.bytes, sha256, triangles }))
    }

    /// Send the pack that the build with this key made; it appears when it is whole.
    pub(super) fn send(&self, local: &Path, key: &str, triangles: u64, force: bool, bar: &Bar) -> anyhow::Result<Pack> {
        let cannot = || format!("cannot read {}", local.display());
        let (bytes, sha256) = sha256_of(File::open(local).with_context(cannot)?).with_context(cannot)?;
        let notes = [(BUILD, key.to_owned()), (SHA256, sha256.clone()), (TRIANGLES, triangles.to_string())];
        let notes: BTreeMap<String, String> = notes.map(|(name, value)| (name.to_owned(), value)).into();
        let condition = if force { Condition::Replace } else { Condition::New };
        let progress = &mut |done, all| bar.update("uploading", done, all);
        match self.objects.upload(&self.address.path, local, condition, &notes, progress) {
            // Ours, where the answer was lost.
            Err(ObjectError::Exists) if self.finished(key)?.is_some_and(|there| there.sha256 == sha256) => {}
            Err(ObjectError::Exists) => return Err(self.exists()),
            sent => sent.with_context(|| self.cannot())?,
        }
        // What assemblies left that were killed while they sent.
        if let Err(e) = self.objects.abort_unfinished(&self.address.path) {
            crate::terminal::say!("kilwa: warning: cannot look for unfinished uploads to {}: {e}", self.address);
        }
        Ok(Pack { bytes, sha256, triangles })
    }

    fn cannot(&self) -> String {
        format!("cannot write {}", self.address)
    }

    fn exists(&self) -> anyhow::Error {
        anyhow!("{} already exists; use --force to replace it, or choose another name", self.address)
    }
}

//! A pack in a store. The metadata of the object states which build made it, so that a build that was killed after its pack was uploaded counts as complete.

use crate::build;
use crate::progress::Bar;
use crate::stores;
use anyhow::{Context, anyhow, bail};
use kilwa_builder::Progress;
use kilwa_builder::build::work::Stop;
use kilwa_store::{Address, Condition, ObjectError, Objects};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the metadata.
const BUILD: &str = "kilwa-build";
const SHA256: &str = "kilwa-sha256";
const TRIANGLES: &str = "kilwa-triangles";

/// A pack that is complete.
#[derive(Debug, Clone, Serialize, Deserialize)]
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
    /// The object that an output argument names, if it is an address.
    pub(super) fn of(output: &Path, stop: &Stop) -> anyhow::Result<Option<Self>> {
        let Some(address) = stores::address(output)? else { return Ok(None) };
        build::refuse_name(output)?;
        let objects = stores::objects(&address.bucket, stop)?;
        Ok(Some(Self { address, objects }))
    }

    /// Refuse to replace an existing object.
    pub(super) fn refuse_existing(&self) -> anyhow::Result<()> {
        let there = self.objects.info(&self.address.path).with_context(|| self.cannot())?;
        if there.is_some() { Err(self.exists()) } else { Ok(()) }
    }

    /// The pack, if it is there and was made by the build with this key.
    pub(super) fn finished(&self, key: &str) -> anyhow::Result<Option<Pack>> {
        let cannot = || format!("cannot read {}", self.address);
        let Some(about) = self.objects.info(&self.address.path).with_context(cannot)? else { return Ok(None) };
        let notes = self.objects.notes(&self.address.path).with_context(cannot)?.unwrap_or_default();
        let is_ours = notes.get(BUILD).is_some_and(|of| of == key);
        let triangles = notes.get(TRIANGLES).and_then(|n| n.parse().ok());
        let sha256 = notes.get(SHA256).filter(|_| is_ours).cloned();
        Ok(sha256.zip(triangles).map(|(sha256, triangles)| Pack { bytes: about.bytes, sha256, triangles }))
    }

    /// Upload the pack that the build with this key made; it becomes visible only when it is complete.
    pub(super) fn send(&self, local: &Path, key: &str, pack: &Pack, force: bool, bar: &Bar) -> anyhow::Result<()> {
        let Pack { sha256, triangles, .. } = pack;
        let notes = [(BUILD, key.to_owned()), (SHA256, sha256.clone()), (TRIANGLES, triangles.to_string())];
        let notes: BTreeMap<String, String> = notes.map(|(name, value)| (name.to_owned(), value)).into();
        let condition = if force { Condition::Replace } else { Condition::New };
        let progress = &mut |done, all| bar.update("uploading", done, all);
        // Left by assemblies that were killed during the upload. Uploads that begin later may still be running.
        let earlier = self.objects.unfinished_of(&self.address.path);
        let sent = self.objects.upload(&self.address.path, local, condition, &notes, progress);
        let is_taken = match sent {
            Ok(()) | Err(ObjectError::Missing) => false,
            Err(ObjectError::Exists) => true,
            Err(e) => return Err(e).with_context(|| self.cannot()),
        };
        // The pack may also be there if the response was lost, or if another assembly of the same build was faster and aborted this upload.
        let is_there = self.finished(key)?.is_some_and(|there| there.sha256 == *sha256);
        if is_taken && !is_there {
            return Err(self.exists());
        }
        if !is_there {
            bail!(
                "{}: another process aborted the upload or replaced the pack; run the same command again",
                self.cannot()
            );
        }
        let aborted = earlier.and_then(|uploads| self.objects.abort_uploads(uploads));
        if let Err(e) = aborted {
            crate::terminal::say!("kilwa: warning: cannot abort earlier incomplete uploads to {}: {e}", self.address);
        }
        Ok(())
    }

    fn cannot(&self) -> String {
        format!("cannot write {}", self.address)
    }

    fn exists(&self) -> anyhow::Error {
        anyhow!("{} already exists; use --force to replace it, or choose another name", self.address)
    }
}

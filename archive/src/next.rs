//! Replacing what an object is, so that every reader sees the old object or the new one, wherever it is cut off.
//!
//! The new manifest and landing page, and the folder of a further version, are prepared elsewhere and put into the object's hidden folder [`NEXT`] by one
//! rename. Then the version's folder is moved out of it to its name, then the manifest, then the landing page. **The manifest decides**: until
//! it is replaced the object is the old one, from then on the new one.
//!
//! | cut off | what is there | who comes next |
//! |---|---|---|
//! | before the manifest | the old object, and perhaps a folder `vN` that the manifest in [`NEXT`] names | takes both away |
//! | between manifest and page | the new object; its page lies in [`NEXT`], the old page leads to the version before, which is there and whole | puts the page in its place |
//!
//! `kilwa serve` shows the page that the manifest names, also from [`NEXT`]; a static host shows `index.html`, whose version is there in either
//! case. [`settle`] is called under the lock of the folder of objects by whatever changes an object, before it reads the manifest. It also gives earlier
//! versions the permissions that the manifest requires: they are closed before the manifest is replaced, and opened after it.

use super::assemble::existing;
use super::checksums::sha256;
use super::disk;
use super::draft::{DraftError, Steps};
use super::layout::{CHECKSUMS, MANIFEST, PAGE, Slug};
use super::lock::Lock;
use super::manifest::{MANIFEST_MAX, Manifest, Version};
use super::modes;
use crate::layout::SMALL_FILE_MAX;
use kilwa_files::plain_file;
use std::path::Path;

/// Hidden folder of an object with what it is about to become.
pub const NEXT: &str = ".kilwa-next";

/// Make of the object what `prepared` holds: `manifest.json`, `index.html` and, where a version is added, its folder.
///
/// # Errors
/// [`DraftError`]: the object is as it was, or [`DraftError::Unfinished`]: it is the new one but for its page, as `done` says.
pub(super) fn become_next(
    object: &Path,
    prepared: &Path,
    version: Option<&str>,
    done: &'static str,
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    let next = object.join(NEXT);
    let decided = (|| {
        disk::rename(prepared, &next, steps)?;
        if let Some(version) = version {
            disk::rename(&next.join(version), &object.join(version), steps)?;
        }
        disk::rename(&next.join(MANIFEST), &object.join(MANIFEST), steps)
    })();
    if decided.is_err() && (prepared.exists() || next.join(MANIFEST).exists()) {
        // As far as the disk allows; whoever changes the object next does the rest.
        drop(take_back(object, &|_| Ok(())));
        return decided;
    }
    decided.and_then(|()| show_page(object, steps)).map_err(|e| e.after(done))
}

/// The page into its place; then nothing of the hidden folder is needed.
fn show_page(object: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let next = object.join(NEXT);
    disk::rename(&next.join(PAGE), &object.join(PAGE), steps)?;
    disk::remove(&next, steps)
}

/// The manifest of the object `slug` of the locked folder, after finishing or removing what an interrupted change left. `None`
/// where there is no such object.
///
/// # Errors
/// [`DraftError`] if that fails or the folder is not an object.
pub fn settle(lock: &Lock, slug: &Slug, steps: Steps<'_>) -> Result<Option<Manifest>, DraftError> {
    let manifest = settle_contents(lock, slug, steps)?;
    if let Some(manifest) = &manifest {
        match modes::settle_published(lock, slug, manifest, steps) {
            // Files of another user must not prevent a new version. If their permissions matter to that version, it is refused later.
            Err(e) if e.is_denied() => {}
            settled => settled?,
        }
    }
    Ok(manifest)
}

/// As [`settle`], but without setting permissions: for a withdrawal, which moves the files away.
pub(super) fn settle_contents(lock: &Lock, slug: &Slug, steps: Steps<'_>) -> Result<Option<Manifest>, DraftError> {
    let object = lock.folder().join(slug.as_str());
    let manifest = existing(&object).map_err(DraftError::Other)?;
    let (next, Some(manifest)) = (object.join(NEXT), manifest) else { return Ok(None) };
    if next.join(MANIFEST).exists() {
        take_back(&object, steps)?;
    } else if is_page_of(&next, &manifest) {
        show_page(&object, steps)
            .map_err(|e| e.after("an earlier change was made, but its page is not in its place"))?;
    }
    disk::remove(&next, steps)?;
    Ok(Some(manifest))
}

/// Whether the hidden folder has the page that a manifest names.
fn is_page_of(next: &Path, manifest: &Manifest) -> bool {
    plain_file::read_at(&next.join(PAGE), SMALL_FILE_MAX).is_ok_and(|page| sha256(&page) == manifest.page.sha256)
}

/// The manifest was not replaced: the object is the old one, and the prepared change is removed.
fn take_back(object: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let next = object.join(NEXT);
    if let Some(added) = added(object) {
        let (folder, back) = (object.join(&added.folder), next.join(&added.folder));
        let list = plain_file::read_at(&folder.join(CHECKSUMS), SMALL_FILE_MAX);
        if !back.exists() && list.is_ok_and(|list| sha256(&list) == added.checksums.sha256) {
            disk::rename(&folder, &back, steps)?;
        }
    }
    disk::remove(&next, steps)
}

/// The version that an object was about to get when that was cut off, before its manifest named it.
pub fn added(object: &Path) -> Option<Version> {
    let manifest = |at: &Path| Manifest::parse(&plain_file::read_at(&at.join(MANIFEST), MANIFEST_MAX).ok()?).ok();
    let (now, next) = (manifest(object)?, manifest(&object.join(NEXT))?);
    next.versions.into_iter().find(|v| v.version as usize == now.versions.len() + 1)
}

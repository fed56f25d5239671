//! Who publishes a version to a store: a claim, `.kilwa-claim-vN` beside the version's folder.
//!
//! A store changes one file at a time. The manifest can be put on the condition that nobody has changed it; the files of a version cannot be put on the
//! condition that nobody has published them meanwhile. So whoever sends a version claims its number first, and nobody else touches its files while that
//! claim is renewed. A claim says what is published (a hash of the pack, metadata, notes, holes, 3D Tiles and version note), so that the same command continues at once where it was cut
//! off; another one may take it over when it was not renewed for [`super::S3Options::lease`], by the clock of the store. The claim goes when
//! the version is published. Failures: a claim of another user is an error that says since when and what to do.

use super::S3;
use super::s3::is_changed;
use axum::body::Bytes;
use kilwa_archive::Manifest;
use kilwa_archive::checksums::{hex, sha256};
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_archive::layout::{MANIFEST, METADATA, Slug, version_folder};
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use object_store::{Attributes, ObjectStoreExt as _, PutMode, UpdateVersion};
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// It is renewed so often within the time for which it holds.
const RENEWALS: u32 = 15;
/// The file that is written to learn the store's time.
const CLOCK: &str = ".kilwa-clock";

/// A version's number in a store, held.
#[derive(Debug)]
pub(super) struct Claim<'a> {
    store: &'a Arc<S3>,
    key: String,
    content: Bytes,
    /// Its tag, and when it was put there.
    held: Mutex<(Option<String>, Instant)>,
}

/// The purpose of a claim, from the object in its folder: what is published, without the day and the pictures, which another run may rebuild.
pub(super) fn purpose(object: &Path, version: u32) -> io::Result<String> {
    let manifest =
        Manifest::parse(&plain_file::read_at(&object.join(MANIFEST), SMALL_FILE_MAX)?).map_err(io::Error::other)?;
    let entry = manifest.versions.iter().find(|v| v.version == version);
    let entry = entry.ok_or_else(|| io::Error::other(format!("the manifest has no version {version}")))?;
    let metadata = match plain_file::read_at(&object.join(version_folder(version)).join(METADATA), SMALL_FILE_MAX) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Vec::new(),
        metadata => metadata?,
    };
    let optional = entry.optional();
    let [notes, holes] = [optional.notes, optional.holes].map(Option::unwrap_or_default);
    let metadata = sha256(&metadata);
    let mut parts = vec![&*entry.pack.sha256, &*metadata, notes, holes, &*entry.note];
    parts.extend(optional.tiles);
    parts.extend(optional.colour_report);
    Ok(sha256(parts.join("\n").as_bytes()))
}

impl<'a> Claim<'a> {
    /// Claim a version of an object for a [`purpose`].
    pub(super) fn take(store: &'a Arc<S3>, slug: &Slug, version: u32, purpose: &str) -> io::Result<Self> {
        let key = format!("{slug}/.kilwa-claim-{}", version_folder(version));
        let mut own = [0; 16];
        getrandom::fill(&mut own).map_err(io::Error::other)?;
        // No two claims are the same bytes, and so none has the tag of another.
        let content = Bytes::from(format!("kilwa publish {purpose} {}\n", hex(&own)));
        let mut mode = PutMode::Create;
        // Somebody else may be claiming at the same moment.
        for _ in 0..3 {
            match store.put(&key, content.clone(), mode, Attributes::new()) {
                Ok(tag) => {
                    return Ok(Self { store, key, content, held: Mutex::new((tag, Instant::now())) });
                }
                Err(e) if is_changed(&e) => {}
                Err(e) => return Err(e),
            }
            mode = match taken_over(store, &key, purpose)? {
                Some(tag) => PutMode::Update(UpdateVersion { e_tag: Some(tag), version: None }),
                None => PutMode::Create,
            };
        }
        Err(refused(version, store.lease()))
    }

    /// Renew it when it is time.
    pub(super) fn renew(&self) -> io::Result<()> {
        let since = self.held.lock().unwrap_or_else(PoisonError::into_inner).1;
        if since.elapsed() < self.store.lease() / RENEWALS { Ok(()) } else { self.renew_now() }
    }

    /// Renew it; it is still ours then.
    pub(super) fn renew_now(&self) -> io::Result<()> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let mode = PutMode::Update(UpdateVersion { e_tag: held.0.clone(), version: None });
        let tag = match self.store.put(&self.key, self.content.clone(), mode, Attributes::new()) {
            // Nobody else writes these bytes, so this is our own renewal, which was sent twice because its response was lost.
            Err(e) if is_changed(&e) && self.is_in_the_store()? => {
                self.store.changed(&self.key)?.0.tag().map(str::to_owned)
            }
            tag => tag?,
        };
        *held = (tag, Instant::now());
        Ok(())
    }

    fn is_in_the_store(&self) -> io::Result<bool> {
        match self.store.read(&self.key, SMALL_FILE_MAX) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            content => Ok(content? == self.content),
        }
    }

    /// Remove the claim when it is no longer needed: the version is published, or nothing of it was sent. If it cannot be removed, it stays hidden and does no harm.
    pub(super) fn release(self) {
        let Ok(path) = self.store.at(&self.key) else { return };
        drop(self.store.wait(&self.key, move |store| async move { store.client.delete(&path).await }));
    }
}

/// The tag of a claim that may be taken over: one for the same purpose, or one that was not renewed for long; none where it is gone by now.
fn taken_over(store: &Arc<S3>, key: &str, purpose: &str) -> io::Result<Option<String>> {
    let (identity, changed) = match store.changed(key) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        found => found?,
    };
    let content = match store.read(key, SMALL_FILE_MAX) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        content => content?,
    };
    let tag = identity.tag().unwrap_or_default().to_owned();
    let is_ours = String::from_utf8_lossy(&content).split(' ').nth(2) == Some(purpose);
    if is_ours || store.lease().is_zero() {
        return Ok(Some(tag));
    }
    store.put(
        CLOCK,
        Bytes::from_static(b"kilwa publish asks what time it is\n"),
        PutMode::Overwrite,
        Attributes::new(),
    )?;
    let now = store.changed(CLOCK)?.1;
    if now.duration_since(changed).unwrap_or_default() >= store.lease() {
        return Ok(Some(tag));
    }
    let version = key.rsplit_once('v').and_then(|(_, n)| n.parse().ok()).unwrap_or_default();
    Err(refused(version, store.lease()))
}

fn refused(version: u32, lease: Duration) -> io::Error {
    io::Error::other(format!(
        "somebody else is publishing version {version} of this object at this moment; run the same command again when that is done. \
         If they gave up, run it again after {}",
        counted(lease.as_secs().div_ceil(60), "minute", "minutes")
    ))
}

//! Putting a version on disk so that nobody ever sees half of one, and two who publish at once lose nothing.
//!
//! A [`Draft`] is made in a hidden folder on the same file system ([`super::scratch`]), which takes as long as it takes and keeps nobody from
//! publishing. Then the folder of objects is locked ([`super::lock`]), what is published is read again ([`super::next::settle`]), everything that depends on it
//! is decided, and [`Draft::finish`] gives the version its name: a first one appears with its object in one rename, a further one by
//! [`super::next`]. A version folder that is there is never touched.
//!
//! Before every change on disk [`Steps`] is called: for progress, and for tests that fail or kill there.

use super::checksums::{Checksum, Checksums, sha256, sha256_of};
use super::disk::{self, failed};
use super::layout::{CHECKSUMS, MANIFEST, PAGE, Slug, safe, version_folder};
use super::lock::Lock;
use super::manifest::{FileEntry, MANIFEST_MAX, Manifest, ManifestError};
use super::modes;
use super::next::become_next;
use super::scratch::{self, Scratch};
use super::viewer::PageError;
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// How hidden temporary names begin.
pub const HIDDEN: &str = ".kilwa-";

/// Called before every change on disk; an error stops the publication there.
pub type Steps<'a> = &'a dyn Fn(&str) -> io::Result<()>;

/// Why nothing was published.
#[derive(Debug, Error)]
pub enum DraftError {
    /// The system refused.
    #[error("cannot {what} {path}: {reason}{hint}", hint = hint(reason))]
    Disk {
        /// Write, rename, read.
        what: &'static str,
        /// Which file or folder.
        path: PathBuf,
        /// The system's reason. The message has it, so that it is no `source`: who prints the chain of causes would print it twice.
        reason: io::Error,
    },
    /// Another program changes the folder now.
    #[error(
        "another kilwa command is changing {0} (publishing, withdrawing or saving); nothing was changed. Run this command again when that one has finished"
    )]
    Busy(PathBuf),
    /// The folder cannot be locked.
    #[error(
        "cannot lock {path}: {reason}. Without a lock two changes at once could lose one of them; nothing was changed. \
         Run the command on the computer that has the disk, or mount it so that files can be locked"
    )]
    Unlockable {
        /// Which folder.
        path: PathBuf,
        /// The system's reason.
        reason: io::Error,
    },
    /// Something is there that must not be replaced.
    #[error("{0} already exists")]
    There(PathBuf),
    /// A version folder that the manifest does not name.
    #[error(
        "{0} is there, but manifest.json does not name it: somebody may be copying that version here, or an earlier kilwa was interrupted. \
         It is left as it is; wait for the copy, or move the folder away, and run the same command again"
    )]
    Unnamed(PathBuf),
    /// The manifest was replaced, what follows it was not.
    #[error("{done}: {what}. Run the same command again to finish", what = after_the_change(why))]
    Unfinished {
        /// What is done, and what is lacking.
        done: &'static str,
        /// What stopped it.
        why: Box<DraftError>,
    },
    /// Nothing was withdrawn, but some files made for it could not be removed.
    #[error(
        "{cause}. The object is unchanged, but leftovers of this command remain: {rest}. Remove them, or run the same command again",
        cause = after_the_change(why), rest = after_the_change(left)
    )]
    Left {
        /// What stopped the command.
        why: Box<DraftError>,
        /// What could not be removed, and why.
        left: Box<DraftError>,
    },
    /// The folder is not an object; the text is for people.
    #[error("{0}")]
    Other(String),
    /// A file of another user is in the place of one of the object's files.
    #[error("{0} was not made by kilwa and was left as it is; move it away, publish to another folder, or omit --site")]
    Foreign(PathBuf),
    /// A viewer page that no landing page can be made of.
    #[error(transparent)]
    Page(#[from] PageError),
    /// A manifest that cannot be.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
}

fn hint(e: &io::Error) -> &'static str {
    match e.kind() {
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            ". Choose a folder that you can write to, or ask its owner; nothing was changed"
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            ". Free space on that disk, or choose a folder on another one; nothing was changed"
        }
        _ => "",
    }
}

/// An error of what follows the change: something was changed, and no other folder helps.
fn after_the_change(e: &DraftError) -> String {
    match e {
        DraftError::Disk { what, path, reason } => {
            let advice = match reason.kind() {
                io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
                    ". Make sure that you can write there, or ask its owner"
                }
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => ". Free space on that disk",
                _ => "",
            };
            format!("cannot {what} {}: {reason}{advice}", path.display())
        }
        DraftError::Busy(path) => format!("another kilwa is changing {}", path.display()),
        DraftError::Unlockable { path, reason } => format!("cannot lock {}: {reason}", path.display()),
        DraftError::Unfinished { why, .. } => after_the_change(why),
        other => other.to_string(),
    }
}

impl DraftError {
    /// Whether the system denied permission to this user.
    pub(super) fn is_denied(&self) -> bool {
        let (Self::Disk { reason, .. } | Self::Unlockable { reason, .. }) = self else { return false };
        reason.kind() == io::ErrorKind::PermissionDenied
    }

    /// Whether a file or folder is missing.
    pub(super) fn is_missing(&self) -> bool {
        let (Self::Disk { reason, .. } | Self::Unlockable { reason, .. }) = self else { return false };
        reason.kind() == io::ErrorKind::NotFound
    }

    /// The same error of what follows a change that is made already: it says what is `done`, and not that nothing was changed.
    #[must_use]
    pub fn after(self, done: &'static str) -> Self {
        let why = match self {
            Self::Unfinished { why, .. } => why,
            other => Box::new(other),
        };
        Self::Unfinished { done, why }
    }
}

/// What is done when the manifest names a version, and something is lacking.
const PUBLISHED: &str = "the version is published, but not all of its files are in place";

/// A version that is being written.
pub struct Draft<'a> {
    slug: Slug,
    hidden: Scratch,
    files: Vec<(String, u64, Checksum)>,
    steps: Steps<'a>,
}

impl<'a> Draft<'a> {
    /// Begin a version of the object `slug` in the locked folder; what earlier ones that were cut off have left is removed. The lock is not needed
    /// while the version is made.
    ///
    /// # Errors
    /// [`DraftError`] when the folder cannot be written to.
    pub fn begin(lock: &Lock, slug: &Slug, steps: Steps<'a>) -> Result<Self, DraftError> {
        let (shelf, object) = (lock.folder(), lock.folder().join(slug.as_str()));
        scratch::sweep(shelf, &|name| scratch::is_of(slug, name), steps)?;
        super::site::sweep(lock, steps)?;
        // Who may add versions to an object need not be allowed to add objects.
        let parent = if object.is_dir() {
            scratch::sweep(&object, &|name| name.starts_with(HIDDEN) && name != super::next::NEXT, steps)?;
            &object
        } else {
            shelf
        };
        let hidden = Scratch::create(parent, &scratch::prefix(slug), steps)?;
        let draft = Self { slug: slug.clone(), hidden, files: Vec::new(), steps };
        disk::create_dir(&draft.folder(), steps)?;
        Ok(draft)
    }

    /// The version's folder, under its temporary name: others may write files there, and [`Self::adopt`] them.
    pub fn folder(&self) -> PathBuf {
        self.hidden.path().join("version")
    }

    /// What is in it so far: path, bytes, SHA-256.
    pub fn files(&self) -> &[(String, u64, Checksum)] {
        &self.files
    }

    /// Write a file of the version.
    ///
    /// # Errors
    /// [`DraftError::Disk`].
    pub fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), DraftError> {
        let to = self.prepare(path)?;
        disk::write(&to, bytes, self.steps)?;
        self.files.push((path.to_owned(), bytes.len() as u64, sha256(bytes)));
        Ok(())
    }

    /// Take a file that somebody else has written to [`Self::folder`].
    ///
    /// # Errors
    /// [`DraftError::Disk`].
    pub fn adopt(&mut self, path: &str) -> Result<(u64, Checksum), DraftError> {
        let (at, file) = self.settle(path)?;
        let (bytes, sum) = sha256_of(BufReader::new(file)).map_err(failed("read", &at))?;
        self.files.push((path.to_owned(), bytes, sum.clone()));
        Ok((bytes, sum))
    }

    /// As [`Self::adopt`], of a file whose length and SHA-256 the caller has found out and that nobody can have written to since: a pack may
    /// take an hour to be hashed.
    ///
    /// # Errors
    /// [`DraftError::Disk`], also where it has another length.
    pub fn adopt_known(&mut self, path: &str, bytes: u64, sum: &str) -> Result<(), DraftError> {
        let (at, file) = self.settle(path)?;
        if file.metadata().map_err(failed("read", &at))?.len() != bytes {
            return Err(failed("read", &at)(io::Error::other(format!(
                "it is not {} long",
                counted(bytes, "byte", "bytes")
            ))));
        }
        self.files.push((path.to_owned(), bytes, sum.to_owned()));
        Ok(())
    }

    /// A file that somebody else has written: on disk, and for a web server to read.
    fn settle(&self, path: &str) -> Result<(PathBuf, File), DraftError> {
        let at = self.prepare(path)?;
        let file = File::open(&at).map_err(failed("read", &at))?;
        file.sync_all().map_err(failed("write", &at))?;
        disk::readable(&file).map_err(failed("write", &at))?;
        Ok((at, file))
    }

    /// As [`Self::adopt`], under another name, which is made of its SHA-256.
    ///
    /// # Errors
    /// [`DraftError::Disk`].
    pub fn adopt_named(
        &mut self,
        path: &str,
        name: impl FnOnce(&str) -> String,
    ) -> Result<(u64, Checksum), DraftError> {
        let (bytes, sum) = self.adopt(path)?;
        let name = name(&sum);
        let (from, to) = (self.folder().join(path), self.folder().join(&name));
        disk::rename(&from, &to, self.steps)?;
        if let Some(last) = self.files.last_mut() {
            last.0 = name;
        }
        Ok((bytes, sum))
    }

    fn prepare(&self, path: &str) -> Result<PathBuf, DraftError> {
        let to = self.folder().join(path);
        if !safe(path) {
            return Err(failed("write", &to)(io::Error::other("this is not a path inside an object")));
        }
        (self.steps)(path).map_err(failed("write", &to))?;
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(failed("write", parent))?;
        }
        Ok(to)
    }

    /// Write the list of checksums, and give the version its name, its place in the manifest, and its page, while the folder of objects is locked.
    /// `manifest` makes the manifest of the list of checksums and the page as they were written; it must have been decided under this lock.
    ///
    /// # Errors
    /// [`DraftError`]; the object is as it was before, but for [`DraftError::Unfinished`].
    pub fn finish(
        mut self,
        lock: &Lock,
        version: u32,
        page: &[u8],
        manifest: impl FnOnce(FileEntry, FileEntry) -> Manifest,
    ) -> Result<PathBuf, DraftError> {
        let object = lock.folder().join(self.slug.as_str());
        let before = free(&object, version)?;
        let mut list = Checksums::default();
        for (path, _, sum) in &self.files {
            list.add(path.clone(), sum.clone());
        }
        let list = list.to_text();
        self.write(CHECKSUMS, list.as_bytes())?;
        let folder = version_folder(version);
        let entry = |url: String, bytes: &[u8]| FileEntry { url, bytes: bytes.len() as u64, sha256: sha256(bytes) };
        let manifest = manifest(entry(format!("{folder}/{CHECKSUMS}"), list.as_bytes()), entry(PAGE.to_owned(), page));
        let bytes = manifest.to_bytes()?;
        let whole = self.hidden.path().join("next");
        disk::create_dir(&whole, self.steps)?;
        disk::open_to_all(&self.folder(), self.steps)?;
        disk::rename(&self.folder(), &whole.join(&folder), self.steps)?;
        modes::settle(&whole.join(&folder), modes::is_for_everybody(&manifest.access), lock.folder(), self.steps)?;
        disk::write(&whole.join(PAGE), page, self.steps)?;
        disk::write(&whole.join(MANIFEST), &bytes, self.steps)?;
        disk::open_to_all(&whole, self.steps)?;
        (self.steps)("sync").map_err(failed("write", &whole))?;
        disk::sync_folders(&whole)?;
        match before {
            Some(before) => add(lock, &object, &whole, (&before, &manifest), self.steps)?,
            None => disk::rename(&whole, &object, self.steps).map_err(|e| {
                // It has its name, and the disk does not say that this would outlive a power cut.
                if whole.exists() { e } else { e.after(PUBLISHED) }
            })?,
        }
        // It is published, whether the empty folder goes now or with the next version.
        drop(self.hidden.close(self.steps));
        Ok(object)
    }
}

/// Add the version prepared in `whole` to an object. Earlier versions are closed before the manifest is replaced, or opened after it. An error
/// before the manifest is replaced leaves them as they were.
fn add(
    lock: &Lock,
    object: &Path,
    whole: &Path,
    (before, after): (&Manifest, &Manifest),
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    let is_open = modes::is_for_everybody(&after.access);
    let settle_earlier = || modes::settle_object(object, before, is_open, lock.folder(), steps);
    let added = (|| {
        if !is_open {
            settle_earlier()?;
        }
        become_next(object, whole, after.versions.last().map(|v| v.folder.as_str()), PUBLISHED, steps)
    })();
    if let Err(e) = added {
        if !matches!(e, DraftError::Unfinished { .. }) {
            let was_open = modes::is_for_everybody(&before.access);
            // Errors are ignored: the next change to the object does the rest.
            drop(modes::settle_object(object, before, was_open, lock.folder(), &|_| Ok(())));
        }
        return Err(e);
    }
    if is_open { settle_earlier().map_err(|e| e.after(PUBLISHED)) } else { Ok(()) }
}

/// Check that `version` is the object's next one and that nothing has the name of its folder yet. Returns the object's manifest, if it has one.
fn free(object: &Path, version: u32) -> Result<Option<Manifest>, DraftError> {
    let folder = object.join(version_folder(version));
    if version == 1 {
        return if object.exists() { Err(DraftError::There(object.to_owned())) } else { Ok(None) };
    }
    let path = object.join(MANIFEST);
    let manifest = Manifest::parse(&plain_file::read_at(&path, MANIFEST_MAX).map_err(failed("read", &path))?)?;
    if super::assemble::next_version(Some(&manifest)) != version {
        return Err(DraftError::There(folder));
    }
    if fs::symlink_metadata(&folder).is_ok() { Err(DraftError::Unnamed(folder)) } else { Ok(Some(manifest)) }
}

#[cfg(test)]
#[path = "draft_tests.rs"]
pub(crate) mod tests;

//! Putting a version on disk so that nobody ever sees half of one.
//!
//! Everything is written under a hidden temporary name on the same file system, on disk (fsync), and renamed at the end. A first version appears
//! with its object in one rename. A further version: its folder is renamed, then the landing page is replaced, then the manifest; what is
//! there before the last step is the old object, complete, with one folder more that no manifest names. A failure removes what was
//! begun; what a power cut leaves (names that begin with `.kilwa-`, a version folder without a place in the manifest) the next
//! publication of that object takes away. One publication at a time per folder (a lock on the folder).
//!
//! Before every change on disk [`Steps`] is told of it: for progress, and for tests that fail or kill there.

use super::checksums::{Checksum, Checksums, sha256, sha256_of};
use super::layout::{CHECKSUMS, MANIFEST, PAGE, Slug, safe, version_folder};
use super::manifest::{FileEntry, Manifest, ManifestError};
use std::fs::{self, File};
use std::io::{self, BufReader, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// How hidden temporary names begin.
pub const HIDDEN: &str = ".kilwa-";

/// Told of every change on disk before it is made; an error stops the publication there.
pub type Steps<'a> = &'a dyn Fn(&str) -> io::Result<()>;

/// Why nothing was published.
#[derive(Debug, Error)]
pub enum DraftError {
    /// The system refused.
    #[error("cannot {what} {path}: {source}{hint}", hint = hint(source))]
    Disk {
        /// Write, rename, read.
        what: &'static str,
        /// Which file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Another program publishes here now.
    #[error("another kilwa publishes to {0} at this moment; run the same again when it is done")]
    Busy(PathBuf),
    /// Something is there that must not be replaced.
    #[error("{0} is there already")]
    There(PathBuf),
    /// A file of somebody else's stands where one of ours would.
    #[error("{0} is not from kilwa and is left as it is; move it away, publish to another folder, or leave --site out")]
    Foreign(PathBuf),
    /// A manifest that cannot be.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
}

fn hint(e: &io::Error) -> &'static str {
    match e.kind() {
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            ". Give a folder with --to that you may write to, or ask whoever keeps it; nothing was changed"
        }
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            ". Make room on that disk, or give a folder on another one with --to; nothing was changed"
        }
        _ => "",
    }
}

fn disk(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DraftError {
    let path = path.to_owned();
    move |source| DraftError::Disk { what, path, source }
}

/// Held while something is published to a folder.
#[derive(Debug)]
pub struct Lock {
    _folder: Option<File>,
}

impl Lock {
    /// Take the folder for oneself.
    ///
    /// # Errors
    /// [`DraftError::Busy`] while another program has it.
    pub fn take(folder: &Path) -> Result<Self, DraftError> {
        // Where folders cannot be opened as files (Windows) there is no lock.
        let Ok(file) = File::open(folder) else { return Ok(Self { _folder: None }) };
        match file.try_lock() {
            Err(fs::TryLockError::WouldBlock) => Err(DraftError::Busy(folder.to_owned())),
            Ok(()) | Err(fs::TryLockError::Error(_)) => Ok(Self { _folder: Some(file) }),
        }
    }
}

/// A version that is being written.
pub struct Draft<'a> {
    shelf: PathBuf,
    slug: Slug,
    version: u32,
    /// The hidden folder: of the object for a first version, of the version else.
    hidden: tempfile::TempDir,
    files: Vec<(String, u64, Checksum)>,
    steps: Steps<'a>,
}

impl<'a> Draft<'a> {
    /// Begin version `version` of the object `slug` in the folder `shelf`, which is there. A first version begins an object.
    ///
    /// # Errors
    /// [`DraftError`] when the folder cannot be written to, or the object is there already (first version).
    pub fn begin(shelf: &Path, slug: &Slug, version: u32, steps: Steps<'a>) -> Result<Self, DraftError> {
        let object = shelf.join(slug.as_str());
        let first = version == 1;
        if first && object.exists() {
            return Err(DraftError::There(object));
        }
        let parent = if first { shelf } else { &object };
        let prefix = if first { format!("{HIDDEN}{slug}-") } else { HIDDEN.to_owned() };
        remove_hidden(parent, &prefix, steps)?;
        steps("begin").map_err(disk("write to", parent))?;
        let hidden = tempfile::Builder::new().prefix(&prefix).tempdir_in(parent).map_err(disk("write to", parent))?;
        let draft = Self { shelf: shelf.to_owned(), slug: slug.clone(), version, hidden, files: Vec::new(), steps };
        fs::create_dir_all(draft.folder()).map_err(disk("write", &draft.folder()))?;
        Ok(draft)
    }

    /// The version's folder, under its temporary name: others may write files there, and [`Self::adopt`] them.
    pub fn folder(&self) -> PathBuf {
        if self.version == 1 { self.hidden.path().join(version_folder(1)) } else { self.hidden.path().to_owned() }
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
        put(&to, bytes)?;
        self.files.push((path.to_owned(), bytes.len() as u64, sha256(bytes)));
        Ok(())
    }

    /// Take a file that somebody else has written to [`Self::folder`].
    ///
    /// # Errors
    /// [`DraftError::Disk`].
    pub fn adopt(&mut self, path: &str) -> Result<(u64, Checksum), DraftError> {
        let (at, file) = self.settle(path)?;
        let (bytes, sum) = sha256_of(BufReader::new(file)).map_err(disk("read", &at))?;
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
        if file.metadata().map_err(disk("read", &at))?.len() != bytes {
            return Err(disk("read", &at)(io::Error::other(format!("it is not {bytes} bytes long"))));
        }
        self.files.push((path.to_owned(), bytes, sum.to_owned()));
        Ok(())
    }

    /// A file that somebody else has written: on disk, and for a web server to read.
    fn settle(&self, path: &str) -> Result<(PathBuf, File), DraftError> {
        let at = self.prepare(path)?;
        let file = File::open(&at).map_err(disk("read", &at))?;
        file.sync_all().map_err(disk("write", &at))?;
        readable(&file).map_err(disk("write", &at))?;
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
        fs::rename(&from, &to).map_err(disk("rename", &from))?;
        if let Some(last) = self.files.last_mut() {
            last.0 = name;
        }
        Ok((bytes, sum))
    }

    fn prepare(&self, path: &str) -> Result<PathBuf, DraftError> {
        let to = self.folder().join(path);
        if !safe(path) {
            return Err(disk("write", &to)(io::Error::other("this is no path inside of an object")));
        }
        (self.steps)(path).map_err(disk("write", &to))?;
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent).map_err(disk("write", parent))?;
        }
        Ok(to)
    }

    /// Write the list of checksums, give everything its name, replace landing page and manifest. `manifest` makes it of the list of
    /// checksums and the page as they were written.
    ///
    /// # Errors
    /// [`DraftError`]; the object is as it was before.
    pub fn finish(
        mut self,
        page: &[u8],
        manifest: impl FnOnce(FileEntry, FileEntry) -> Manifest,
    ) -> Result<PathBuf, DraftError> {
        let mut list = Checksums::default();
        for (path, _, sum) in &self.files {
            list.add(path.clone(), sum.clone());
        }
        let list = list.to_text();
        self.write(CHECKSUMS, list.as_bytes())?;
        let folder = version_folder(self.version);
        let entry = |url: String, bytes: &[u8]| FileEntry { url, bytes: bytes.len() as u64, sha256: sha256(bytes) };
        let manifest = manifest(entry(format!("{folder}/{CHECKSUMS}"), list.as_bytes()), entry(PAGE.to_owned(), page));
        let manifest = manifest.to_bytes()?;
        sync_folders(&self.folder())?;
        let object = self.shelf.join(self.slug.as_str());
        if self.version == 1 {
            self.appear(&object, page, &manifest)?;
        } else {
            self.follow(&object, &folder, page, &manifest)?;
        }
        Ok(object)
    }

    /// A new object, in one rename.
    fn appear(self, object: &Path, page: &[u8], manifest: &[u8]) -> Result<(), DraftError> {
        let hidden = self.hidden.path().to_owned();
        for (name, bytes) in [(PAGE, page), (MANIFEST, manifest)] {
            (self.steps)(name).map_err(disk("write", &hidden.join(name)))?;
            put(&hidden.join(name), bytes)?;
        }
        open_to_all(&hidden)?;
        sync_folders(&hidden)?;
        (self.steps)("appear").map_err(disk("rename", object))?;
        if object.exists() {
            return Err(DraftError::There(object.to_owned()));
        }
        fs::rename(&hidden, object).map_err(disk("rename", object))?;
        // It has another name now: nothing is left to remove.
        let _ = self.hidden.keep();
        sync_folder(&self.shelf)
    }

    /// A further version.
    fn follow(self, object: &Path, folder: &str, page: &[u8], manifest: &[u8]) -> Result<(), DraftError> {
        let to = object.join(folder);
        (self.steps)("version folder").map_err(disk("rename", &to))?;
        if to.exists() {
            // Left by a publication that did not come to its manifest; never published.
            let stale = tempfile::Builder::new().prefix(HIDDEN).tempdir_in(object).map_err(disk("write to", object))?;
            fs::rename(&to, stale.path().join(folder)).map_err(disk("rename", &to))?;
        }
        open_to_all(self.hidden.path())?;
        fs::rename(self.hidden.path(), &to).map_err(disk("rename", &to))?;
        let _ = self.hidden.keep();
        let old_page = fs::read(object.join(PAGE)).map_err(disk("read", &object.join(PAGE)))?;
        let replaced = (|| {
            sync_folder(object)?;
            replace(object, PAGE, page, self.steps)?;
            replace(object, MANIFEST, manifest, self.steps)
        })();
        if replaced.is_err() && !names_version(object, folder) {
            // The old manifest stands: the old page goes back to it, and then the folder that nobody names goes.
            if replace(object, PAGE, &old_page, &|_| Ok(())).is_ok() {
                drop(fs::remove_dir_all(&to));
            }
        }
        replaced
    }
}

fn names_version(object: &Path, folder: &str) -> bool {
    let manifest = fs::read(object.join(MANIFEST)).ok().and_then(|bytes| Manifest::parse(&bytes).ok());
    manifest.is_some_and(|m| m.versions.iter().any(|v| v.folder == folder))
}

/// Replace a file of the root: written beside, on disk, renamed.
///
/// # Errors
/// [`DraftError::Disk`]; the old file stands.
pub fn replace(object: &Path, name: &str, bytes: &[u8], steps: Steps<'_>) -> Result<(), DraftError> {
    let to = object.join(name);
    steps(name).map_err(disk("replace", &to))?;
    let failed = || disk("replace", &to);
    let mut file = tempfile::Builder::new().prefix(HIDDEN).tempfile_in(object).map_err(failed())?;
    file.write_all(bytes).map_err(failed())?;
    readable(file.as_file()).map_err(failed())?;
    file.as_file().sync_all().map_err(failed())?;
    file.persist(&to).map_err(|e| failed()(e.error))?;
    sync_folder(object)
}

/// Remove what earlier publications that were cut off have left.
fn remove_hidden(folder: &Path, prefix: &str, steps: Steps<'_>) -> Result<(), DraftError> {
    for entry in fs::read_dir(folder).map_err(disk("read", folder))? {
        let entry = entry.map_err(disk("read", folder))?;
        if !entry.file_name().to_string_lossy().starts_with(prefix) {
            continue;
        }
        let path = entry.path();
        steps("remove what an earlier publication left").map_err(disk("remove", &path))?;
        let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        removed.map_err(disk("remove", &path))?;
    }
    Ok(())
}

/// A new file, on disk.
fn put(path: &Path, bytes: &[u8]) -> Result<(), DraftError> {
    let written = (|| {
        let mut file = File::create_new(path)?;
        file.write_all(bytes)?;
        readable(&file)?;
        file.sync_all()
    })();
    written.map_err(disk("write", path))
}

/// Temporary files and folders are private; what is published is for a web server to read.
fn readable(file: &File) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(fs::Permissions::from_mode(0o644))?;
    }
    #[cfg(not(unix))]
    let _ = file;
    Ok(())
}

fn open_to_all(folder: &Path) -> Result<(), DraftError> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(folder, fs::Permissions::from_mode(0o755)).map_err(disk("write", folder))?;
    }
    #[cfg(not(unix))]
    let _ = folder;
    Ok(())
}

/// The names in a folder and its folders, on disk.
fn sync_folders(folder: &Path) -> Result<(), DraftError> {
    for entry in fs::read_dir(folder).map_err(disk("read", folder))? {
        let path = entry.map_err(disk("read", folder))?.path();
        if path.is_dir() {
            sync_folders(&path)?;
        }
    }
    sync_folder(folder)
}

/// The names in a folder, on disk. Systems that cannot open folders (Windows) do it themselves.
fn sync_folder(folder: &Path) -> Result<(), DraftError> {
    if let Ok(file) = File::open(folder) {
        file.sync_all().map_err(disk("write", folder))?;
    }
    Ok(())
}

#[cfg(test)]
#[path = "draft_tests.rs"]
mod tests;

//! Files that a build keeps on disk while it runs, so that memory does not grow with the mesh.
//!
//! A [`Scratch`] is a folder that one build holds locked. [`ScratchFile`] is a plain file that any thread appends to and
//! reads by position; [`PatchFile`] keeps patches by tetrahedron, [`Records`] 16-byte records that are sorted outside
//! of memory. The bytes in the folder, current and peak, are counted as they are written and removed.
//!
//! The folder is used only if the file `lock` in it says that Kilwa made it. Links are never followed, neither to the folder nor inside it.
//!
//! Numbers are stored little-endian. Every block that matters carries a checksum (CRC-32) or a length that is checked
//! when it is read. Failures: [`ScratchError`], which names the file, what was being done, why, and what to do.

mod error;
mod file;
mod folder;
mod patch_file;
mod records;
mod sum;

pub use error::ScratchError;
pub use file::{Appender, ScratchFile};
pub use patch_file::PatchFile;
pub(crate) use patch_file::{Place, checksum_matches, read_index};
pub(crate) use records::visit_finished;
pub use records::{Records, point_key, point_of, record, tetrahedron_of};
pub(crate) use sum::{Sum, Summing, seal, unseal};

use folder::LOCK;
use kilwa_files::atomic::{self, Access};
use kilwa_files::unfinished::{self, Unfinished};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes in a scratch folder, now and at most.
#[derive(Debug, Default)]
pub(crate) struct Space {
    now: AtomicU64,
    peak: AtomicU64,
    /// The folder goes away with the process: nothing in it needs to outlive a crash of the machine.
    fleeting: bool,
}

impl Space {
    fn add(&self, bytes: u64) {
        let now = self.now.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(now, Ordering::Relaxed);
    }

    fn take(&self, bytes: u64) {
        self.now.fetch_sub(bytes.min(self.now.load(Ordering::Relaxed)), Ordering::Relaxed);
    }
}

/// A folder of scratch files that this process alone uses. Clones share it; it is unlocked with the last of them.
#[derive(Debug, Clone)]
pub struct Scratch {
    held: Arc<Held>,
    space: Arc<Space>,
}

/// A folder that must be removed.
type Temporary = (tempfile::TempDir, Unfinished);

#[derive(Debug)]
struct Held {
    folder: PathBuf,
    _lock: File,
    /// A folder that is removed with its last user, or when a signal ends the program.
    _temporary: Option<Temporary>,
}

impl Scratch {
    /// Use the folder at `path`, which is created if it does not exist; files in it are kept. A link in its place is not followed.
    ///
    /// # Errors
    /// [`ScratchError::Busy`] if another build uses it, [`ScratchError::Foreign`] if it is a link or was not made by a build,
    /// [`ScratchError::Io`] if it cannot be created.
    pub fn open(path: &Path) -> Result<Self, ScratchError> {
        folder::make(path)?;
        Self::hold(path.to_owned(), None)
    }

    /// A private folder among the system's temporary files, removed with the last clone.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where it cannot be made.
    pub fn temporary() -> Result<Self, ScratchError> {
        Self::temporary_in(&std::env::temp_dir())
    }

    /// A private folder in an existing one, removed with the last clone.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where it cannot be made.
    pub fn temporary_in(parent: &Path) -> Result<Self, ScratchError> {
        let mut builder = tempfile::Builder::new();
        // Temporary files are private by default; temporary folders are not.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        let folder = unfinished::make(|| builder.prefix("kilwa-").tempdir_in(parent), tempfile::TempDir::path);
        let folder = folder.map_err(|e| ScratchError::io(parent, "create", e))?;
        Self::hold(folder.0.path().to_owned(), Some(folder))
    }

    fn hold(folder: PathBuf, temporary: Option<Temporary>) -> Result<Self, ScratchError> {
        let lock = folder::take(&folder)?;
        let space = Arc::new(Space { fleeting: temporary.is_some(), ..Space::default() });
        let scratch = Self { held: Arc::new(Held { folder, _lock: lock, _temporary: temporary }), space };
        scratch.recount()?;
        Ok(scratch)
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.held.folder
    }

    /// Where the file `name` of the folder is. Names that lead out of the folder are refused, because names are also read from its files.
    fn place(&self, name: &str) -> Result<PathBuf, ScratchError> {
        let path = self.path(name);
        if Path::new(name).file_name().is_some_and(|own| own == name) {
            return Ok(path);
        }
        Err(ScratchError::damaged(
            &self.path(crate::build::journal::JOURNAL),
            format!("{name:?} is not the name of a scratch file"),
        ))
    }

    /// Where the file `name` of the folder is.
    pub fn path(&self, name: &str) -> PathBuf {
        self.held.folder.join(name)
    }

    /// An empty file; what had the name is replaced.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be made.
    pub fn create(&self, name: &str) -> Result<ScratchFile, ScratchError> {
        self.remove(name)?;
        ScratchFile::new(self.place(name)?, true, Arc::clone(&self.space))
    }

    /// A file that is there.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be opened.
    pub fn existing(&self, name: &str) -> Result<ScratchFile, ScratchError> {
        ScratchFile::new(self.place(name)?, false, Arc::clone(&self.space))
    }

    /// Count the bytes that are really in the folder: small files come into it by other means than [`Scratch::create`].
    ///
    /// # Errors
    /// As [`Scratch::files`].
    pub(crate) fn recount(&self) -> Result<(), ScratchError> {
        let there: u64 = self.files()?.iter().map(|(_, bytes)| bytes).sum();
        self.space.now.store(there, Ordering::Relaxed);
        self.space.peak.fetch_max(there, Ordering::Relaxed);
        Ok(())
    }

    /// Length of a file in bytes, `None` if there is none.
    pub fn length(&self, name: &str) -> Option<u64> {
        std::fs::symlink_metadata(self.path(name)).ok().filter(std::fs::Metadata::is_file).map(|m| m.len())
    }

    /// Remove a file, or a link in its place but never the link's target. A missing file is not an error. Folders are left alone,
    /// because no build creates any.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where the system refuses.
    pub fn remove(&self, name: &str) -> Result<(), ScratchError> {
        let path = self.place(name)?;
        let bytes = self.length(name).unwrap_or(0);
        match std::fs::remove_file(&path) {
            Ok(()) => self.space.take(bytes),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(e) => return Err(ScratchError::io(&path, "remove", e)),
        }
        Ok(())
    }

    /// Names and lengths of the files in the folder, the lock aside, by name.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where the folder cannot be read.
    pub fn files(&self) -> Result<Vec<(String, u64)>, ScratchError> {
        let cannot = |e| ScratchError::io(&self.held.folder, "list", e);
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&self.held.folder).map_err(cannot)? {
            let entry = entry.map_err(cannot)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // The metadata of the entry itself, not of a link's target.
            let about = entry.metadata().map_err(cannot)?;
            if name != LOCK && !about.is_dir() {
                files.push((name, about.len()));
            }
        }
        files.sort_unstable();
        Ok(files)
    }

    /// Write a small file whole, in place of one of that name. It is durable, unless the folder is temporary: nothing reads that after a crash.
    ///
    /// # Errors
    /// [`ScratchError::DiskFull`], [`ScratchError::Io`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), ScratchError> {
        let path = self.path(name);
        let written = if self.space.fleeting {
            std::fs::write(&path, bytes)
        } else {
            atomic::write(&path, bytes, Access::Private, true)
        };
        written.map_err(|e| ScratchError::write(&path, bytes.len() as u64, 0, e))
    }

    /// Make the names in the folder durable.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where the system refuses.
    pub fn sync(&self) -> Result<(), ScratchError> {
        if !self.space.fleeting {
            let synced = atomic::sync_folder(&self.held.folder);
            synced.map_err(|e| ScratchError::io(&self.held.folder, "make durable", e))?;
        }
        Ok(())
    }

    /// Bytes in the folder now.
    pub fn bytes(&self) -> u64 {
        self.space.now.load(Ordering::Relaxed)
    }

    /// The most bytes that were in the folder at any moment.
    pub fn peak_bytes(&self) -> u64 {
        self.space.peak.load(Ordering::Relaxed)
    }

    /// Remove the files named by `ours` and then the folder where nothing else is left in it: a folder that the user
    /// named may hold other things.
    ///
    /// # Errors
    /// [`ScratchError::Io`] where a file cannot be removed.
    pub fn discard(self, ours: impl Fn(&str) -> bool) -> Result<(), ScratchError> {
        for (name, _) in self.files()? {
            if ours(&name) {
                self.remove(&name)?;
            }
        }
        // The lock goes last; a folder with other things in it stays.
        let _ = std::fs::remove_file(self.path(LOCK));
        let _ = std::fs::remove_dir(&self.held.folder);
        Ok(())
    }
}

#[cfg(test)]
mod tests;

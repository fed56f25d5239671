//! Folders that a command makes on the way to what it writes: where it fails, those that stayed empty go again.

use super::disk;
use super::draft::{DraftError, Steps};
use super::keep::is_own_folder;
use super::lock::LOCK_FILE;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders that were made. When this is dropped those that are empty are removed, so that nothing is left of a command that wrote nothing.
#[derive(Debug, Default)]
#[must_use]
pub struct Made {
    /// The outermost first.
    folders: Vec<PathBuf>,
    /// Whether the caller holds the lock of the innermost until this is dropped; then its lock file may go, too.
    is_locked: bool,
}

impl Made {
    /// Make a folder, and those above it that are missing.
    ///
    /// # Errors
    /// [`DraftError::Disk`] where that fails; what was made is removed.
    pub fn create(folder: &Path, steps: Steps<'_>) -> Result<Self, DraftError> {
        let mut made = Self::default();
        disk::create_dirs(folder, &mut made.folders, steps)?;
        Ok(made)
    }

    /// The innermost is locked from now on, for longer than this is there.
    pub(super) fn lock(&mut self) {
        self.is_locked = true;
    }

    /// Others use the folders: they stay.
    pub(super) fn leave(&mut self) {
        self.folders.clear();
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        if let Some(folder) = self.folders.last().filter(|folder| self.is_locked && holds_only_lock(folder)) {
            drop(fs::remove_file(folder.join(LOCK_FILE)));
        }
        while let Some(folder) = self.folders.pop() {
            // No folder is removed with anything in it.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
    }
}

/// Whether nothing but a lock is in a folder, which is no link to one.
fn holds_only_lock(folder: &Path) -> bool {
    let mut entries = match fs::read_dir(folder) {
        Ok(entries) if is_own_folder(folder).unwrap_or(false) => entries,
        _ => return false,
    };
    entries.all(|entry| entry.is_ok_and(|entry| entry.file_name() == OsStr::new(LOCK_FILE)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_that_stayed_empty_are_removed_and_no_others() {
        let parent = tempfile::tempdir().unwrap();
        let inner = parent.path().join("new/inner");
        drop(Made::create(&inner, &|_| Ok(())).unwrap());
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        // What was there before stays, and so does what has something in it.
        fs::create_dir(parent.path().join("new")).unwrap();
        drop(Made::create(&inner, &|_| Ok(())).unwrap());
        assert!(parent.path().join("new").is_dir() && !inner.exists());
        let mut made = Made::create(&inner, &|_| Ok(())).unwrap();
        made.lock();
        fs::write(inner.join(LOCK_FILE), "").unwrap();
        fs::write(inner.join("thesis.txt"), "years of work").unwrap();
        drop(made);
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 2);
        fs::remove_file(inner.join("thesis.txt")).unwrap();
        let mut made = Made { folders: vec![inner.clone()], is_locked: false };
        made.lock();
        drop(made);
        assert!(!inner.exists(), "only its lock was in it");
    }
}

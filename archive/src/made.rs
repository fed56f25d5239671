//! Folders that a command creates for its output. If it fails, those that are still empty are removed.

use super::disk;
use super::draft::{DraftError, Steps};
use super::keep::is_own_folder;
use super::lock::LOCK_FILE;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

/// Folders that were created. On drop, the empty ones are removed, so that a command that wrote nothing leaves nothing.
#[derive(Debug, Default)]
#[must_use]
pub struct Made {
    /// The outermost first.
    folders: Vec<PathBuf>,
    /// Whether the caller holds the lock of the innermost until this is dropped; then its lock file may be removed too.
    is_locked: bool,
}

impl Made {
    /// Create a folder and its missing parents.
    ///
    /// # Errors
    /// [`DraftError::Disk`] if that fails; folders created so far are removed.
    pub fn create(folder: &Path, steps: Steps<'_>) -> Result<Self, DraftError> {
        let mut made = Self::default();
        disk::create_dirs(folder, &mut made.folders, steps)?;
        Ok(made)
    }

    /// Note that the innermost is locked from now on, until after this is dropped.
    pub(super) fn lock(&mut self) {
        self.is_locked = true;
    }

    /// Keep the folders, because others use them.
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
            // Only empty folders are removed.
            if fs::remove_dir(folder).is_err() {
                break;
            }
        }
    }
}

/// Whether a folder, which must not be a link, contains nothing but a lock.
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
    fn only_empty_folders_are_removed() {
        let parent = tempfile::tempdir().unwrap();
        let inner = parent.path().join("new/inner");
        drop(Made::create(&inner, &|_| Ok(())).unwrap());
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        // Folders that existed before stay, and so do those that are not empty.
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

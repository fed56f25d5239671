//! Folders that a command creates for its output. If it fails, those that are still empty are removed.

use super::disk;
use super::draft::{DraftError, Steps};
use super::keep::is_own_folder;
use super::lock::{LOCK_FILE, Lock, PATIENCE};
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// How often a folder is created that others keep removing.
const ATTEMPTS: u32 = 100;

/// Folders that were created. On drop, the empty ones are removed, so that a command that wrote nothing leaves nothing. The caller
/// has given back the lock of the innermost by then, unless it called [`Self::lock`]; a folder that another command has locked stays.
#[derive(Debug, Default)]
#[must_use]
pub struct CreatedFolders {
    /// The outermost first.
    folders: Vec<PathBuf>,
    /// Whether the caller holds the lock of the innermost until this is dropped; then its lock file may be removed too.
    is_locked: bool,
}

impl CreatedFolders {
    /// Create a folder and its missing parents.
    ///
    /// # Errors
    /// [`DraftError::Disk`] if that fails; folders created so far are removed.
    pub fn create(folder: &Path, steps: Steps<'_>) -> Result<Self, DraftError> {
        let mut created = Self::default();
        disk::create_dirs(folder, &mut created.folders, steps)?;
        Ok(created)
    }

    /// Create a folder and its missing parents, and lock it. It is created again if another command, which had created it too and wrote
    /// nothing, removes it before it is locked. Drop the lock first.
    ///
    /// # Errors
    /// As for [`Self::create`] and [`Lock::wait`].
    pub fn create_locked(folder: &Path, waits: &dyn Fn(), steps: Steps<'_>) -> Result<(Self, Lock), DraftError> {
        for _ in 1..ATTEMPTS {
            let created = Self::create(folder, steps);
            match created.and_then(|created| Ok((created, Lock::wait(folder, PATIENCE, waits)?))) {
                Err(e) if e.is_missing() => {}
                locked => return locked,
            }
        }
        Ok((Self::create(folder, steps)?, Lock::wait(folder, PATIENCE, waits)?))
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

impl Drop for CreatedFolders {
    fn drop(&mut self) {
        let Some(innermost) = self.folders.last() else { return };
        if innermost.is_dir() && !holds_only_lock(innermost) {
            return;
        }
        // Removed only under its lock, so that nobody who has just locked it loses it.
        let lock = (!self.is_locked).then(|| Lock::take(innermost));
        if let Some(Err(DraftError::Busy(_))) = lock {
            return;
        }
        if !matches!(lock, Some(Err(_))) && holds_only_lock(innermost) {
            drop(fs::remove_file(innermost.join(LOCK_FILE)));
        }
        while let Some(folder) = self.folders.pop() {
            // Only empty folders are removed. Another command may have removed one already.
            if fs::remove_dir(folder).is_err_and(|e| e.kind() != io::ErrorKind::NotFound) {
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
        drop(CreatedFolders::create(&inner, &|_| Ok(())).unwrap());
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        // Folders that existed before stay, and so do those that are not empty.
        fs::create_dir(parent.path().join("new")).unwrap();
        drop(CreatedFolders::create(&inner, &|_| Ok(())).unwrap());
        assert!(parent.path().join("new").is_dir() && !inner.exists());
        let mut created = CreatedFolders::create(&inner, &|_| Ok(())).unwrap();
        created.lock();
        fs::write(inner.join(LOCK_FILE), "").unwrap();
        fs::write(inner.join("thesis.txt"), "years of work").unwrap();
        drop(created);
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 2);
        fs::remove_file(inner.join("thesis.txt")).unwrap();
        let mut created = CreatedFolders { folders: vec![inner.clone()], is_locked: false };
        created.lock();
        drop(created);
        assert!(!inner.exists(), "only its lock was in it");
    }

    #[test]
    fn a_folder_that_another_command_has_locked_is_not_removed() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("new");
        let created = CreatedFolders::create(&folder, &|_| Ok(())).unwrap();
        let lock = Lock::take(&folder).unwrap();
        drop(created);
        assert!(folder.is_dir());
        drop(lock);
    }

    #[test]
    fn commands_that_create_and_remove_the_same_folder_do_not_disturb_each_other() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("new/inner");
        let publish = || {
            for round in 0..60 {
                let (created, lock) = CreatedFolders::create_locked(&folder, &|| {}, &|_| Ok(())).unwrap();
                // Nobody removes it while it is locked.
                let file = folder.join(format!("{round}"));
                fs::write(&file, "").unwrap();
                fs::remove_file(&file).unwrap();
                drop(lock);
                drop(created);
            }
        };
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(publish))));
    }
}

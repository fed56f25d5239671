//! Folders that are missing for an output. Every command that writes a file makes them in this way, just before it begins the file.

use crate::atomic::{folder_of, sync_folder};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Folders that were made. Dropped when the file is there; those that are empty then, because nothing was written, are removed.
#[derive(Debug, Default)]
#[must_use = "they are removed again when this is dropped before a file is in them"]
pub struct MadeFolders {
    /// The innermost first.
    folders: Vec<PathBuf>,
}

impl MadeFolders {
    /// Make the folder that a file at `path` will be in, and what is missing above it.
    ///
    /// # Errors
    /// The system's error; what was made until then is removed.
    pub fn for_file(path: &Path) -> io::Result<Self> {
        Self::all_of(folder_of(path))
    }

    /// Make a folder, and what is missing above it.
    ///
    /// # Errors
    /// As for [`Self::for_file`].
    pub fn all_of(folder: &Path) -> io::Result<Self> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        let mut made = Self::default();
        for folder in missing.into_iter().rev() {
            match fs::create_dir(folder) {
                Ok(()) => made.folders.insert(0, folder.to_owned()),
                // Another command was faster: the folder is its own.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && folder.is_dir() => {}
                Err(e) => return Err(e),
            }
            sync_folder(folder_of(folder))?;
        }
        Ok(made)
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        // A folder that is not empty stays, and so do its parents.
        let _ = self.folders.iter().try_for_each(fs::remove_dir);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_stay_only_if_something_was_written_into_them() {
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("a/b/file");
        drop(MadeFolders::for_file(&file).unwrap());
        assert!(!parent.path().join("a").exists());
        fs::create_dir(parent.path().join("a")).unwrap();
        drop(MadeFolders::for_file(&file).unwrap());
        assert!(parent.path().join("a").is_dir() && !parent.path().join("a/b").exists(), "a was there before");
        let made = MadeFolders::for_file(&file).unwrap();
        fs::write(&file, "x").unwrap();
        drop(made);
        assert!(file.is_file());
        assert!(MadeFolders::for_file(&file.join("below/new")).is_err(), "a file is in the way");
        drop(MadeFolders::for_file(Path::new("name")).unwrap());
    }
}

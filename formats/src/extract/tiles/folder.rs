//! A folder that gets its name only when it is complete.

use crate::extract::ExtractError;
use kilwa_files::atomic::{folder_of, sync_folder};
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::unfinished::{self, Unfinished};
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Where a tileset goes.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
}

impl Folder {
    /// Check that it can be made.
    ///
    /// # Errors
    /// If something has its name, or something that is not a folder is where it should be put.
    pub fn prepare(path: &Path) -> Result<Self, ExtractError> {
        let shown = path.display();
        let refused = |why: String| Err(ExtractError::Output(why));
        if fs::symlink_metadata(path).is_ok() {
            return refused(format!("{shown} already exists; remove it, or choose another name"));
        }
        let above = folder_of(path).ancestors().find(|above| above.exists());
        match above.filter(|above| !above.is_dir()) {
            Some(above) => refused(format!("{shown}: {} is not a folder; choose another folder", above.display())),
            None => Ok(Self { path: path.to_owned() }),
        }
    }

    /// Begin to fill it, under another name.
    ///
    /// # Errors
    /// If that is impossible.
    pub(super) fn begin(&self) -> Result<Filling, ExtractError> {
        let cannot = |source| ExtractError::Write { path: self.path.clone(), source };
        let made = MadeFolders::for_file(&self.path).map_err(cannot)?;
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
        let make = || builder.prefix(".kilwa-").suffix(".part").tempdir_in(folder_of(&self.path));
        let (folder, noted) = unfinished::make(make, TempDir::path).map_err(cannot)?;
        Ok(Filling { folder, path: self.path.clone(), _noted: noted, _made: made })
    }
}

/// A folder that is being filled. It is removed when this is dropped or a signal ends the program.
#[derive(Debug)]
pub(super) struct Filling {
    // Removed before the folders above it are.
    folder: TempDir,
    path: PathBuf,
    _noted: Unfinished,
    _made: MadeFolders,
}

impl Filling {
    /// Write one of its files, in a folder that is made if it is missing.
    ///
    /// # Errors
    /// The system's, naming the file as it shall be called.
    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), ExtractError> {
        let to = self.folder.path().join(name);
        let write = || {
            fs::create_dir_all(folder_of(&to))?;
            let mut file = File::create_new(&to)?;
            file.write_all(bytes)?;
            file.sync_all()
        };
        write().map_err(|source| ExtractError::Write { path: self.path.join(name), source })
    }

    /// It is complete: give it its name.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::AlreadyExists`] if something has that name by now.
    pub(super) fn finish(self) -> Result<(), ExtractError> {
        let name = || {
            sync_all(self.folder.path())?;
            if fs::symlink_metadata(&self.path).is_ok() {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            fs::rename(self.folder.path(), &self.path)?;
            sync_folder(folder_of(&self.path))
        };
        name().map_err(|source| ExtractError::Write { path: self.path.clone(), source })?;
        // It is no longer there under its old name.
        drop(self.folder.keep());
        Ok(())
    }
}

/// Sync the names in a folder and in the folders below it.
fn sync_all(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_all(&entry.path())?;
        }
    }
    sync_folder(folder)
}

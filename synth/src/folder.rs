//! A new folder that gets its name when everything in it is complete.

use kilwa_files::atomic::{folder_of, sync_folder};
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::unfinished;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Why there is no new folder.
pub(crate) enum FolderError {
    /// The name cannot be used: what is wrong with it and what to do.
    Name(PathBuf, &'static str),
    /// The system refused.
    Io(PathBuf, io::Error),
}

fn failed(path: &Path) -> impl Fn(io::Error) -> FolderError + '_ {
    |source| FolderError::Io(path.to_owned(), source)
}

/// Whether a folder of this name can be made.
///
/// # Errors
/// [`FolderError`] if something is there, other than an empty folder.
pub(crate) fn check(out: &Path) -> Result<(), FolderError> {
    let name = |why| Err(FolderError::Name(out.to_owned(), why));
    if out.file_name().is_none() {
        return name("not a valid name for a new folder: choose another one, such as survey");
    }
    match fs::symlink_metadata(out) {
        Ok(about) if about.is_dir() => match fs::read_dir(out).map_err(failed(out))?.next() {
            None => Ok(()),
            Some(_) => name("already exists and is not empty: choose another name, or remove it"),
        },
        Ok(_) => name("already exists: choose another name, or remove it"),
        Err(_) => Ok(()),
    }
}

/// Create the folder `out`: `fill` writes into a temporary folder beside it, which is then renamed.
///
/// # Errors
/// Those of `fill`, and [`FolderError`]; there is no folder `out` then.
pub(crate) fn create<T, E: From<FolderError>>(out: &Path, fill: impl FnOnce(&Path) -> Result<T, E>) -> Result<T, E> {
    let parent = folder_of(out);
    let mut builder = tempfile::Builder::new();
    builder.prefix(".kilwa-").suffix(".part");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    // Dropped after the contents are there, or removed.
    let _folders = MadeFolders::all_of(parent).map_err(failed(parent))?;
    let make = || builder.tempdir_in(parent);
    let (folder, noted) = unfinished::make(make, tempfile::TempDir::path).map_err(failed(parent))?;
    let filled = fill(folder.path())?;
    fs::rename(folder.path(), out).map_err(failed(out))?;
    // Nothing is left of it under the temporary name.
    let _ = folder.keep();
    drop(noted);
    sync_folder(parent).map_err(failed(parent))?;
    Ok(filled)
}

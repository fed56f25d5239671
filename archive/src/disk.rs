//! Changes on disk: each is reported to [`Steps`] before it is made, and its failure says what, where and why.

use super::draft::{DraftError, Steps};
use kilwa_files::atomic::{self, folder_of};
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Makes an error that says what could not be done, and where.
pub(crate) fn failed(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DraftError {
    let path = path.to_owned();
    move |reason| DraftError::Disk { what, path, reason }
}

/// Write a new file, on disk (fsync), for a web server to read.
pub(crate) fn write(path: &Path, bytes: &[u8], steps: Steps<'_>) -> Result<(), DraftError> {
    let written = (|| {
        steps(&name(path))?;
        let mut file = File::create_new(path)?;
        file.write_all(bytes)?;
        readable(&file)?;
        file.sync_all()
    })();
    written.map_err(failed("write", path))
}

/// Create a folder and its missing parents, and sync their names to disk.
pub(crate) fn create_dir(path: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    create_dirs(path, &mut Vec::new(), steps)
}

/// The same. Adds each folder that it creates to `made`, outermost first.
pub(crate) fn create_dirs(path: &Path, made: &mut Vec<PathBuf>, steps: Steps<'_>) -> Result<(), DraftError> {
    steps(&name(path)).map_err(failed("write", path))?;
    let mut missing: Vec<&Path> = path.ancestors().take_while(|at| !is_current(at) && !at.is_dir()).collect();
    // An interrupted command may have created the existing folder without syncing its name.
    let nearest = path.ancestors().nth(missing.len()).filter(|at| !is_current(at) && at.parent().is_some());
    if let Some(nearest) = nearest {
        sync(folder_of(nearest), steps)?;
    }
    while let Some(folder) = missing.pop() {
        if create_unless_there(folder).map_err(failed("write", folder))? {
            made.push(folder.to_owned());
        }
        sync(folder_of(folder), steps)?;
    }
    Ok(())
}

/// How often a folder is created that others keep creating and removing.
const ATTEMPTS: u32 = 100;

/// Create a folder; `false` if it exists. Another command may remove the one that it had created between the two answers of the system,
/// that a folder exists and what it is: then it is created after all.
fn create_unless_there(folder: &Path) -> io::Result<bool> {
    let mut attempts = 0..ATTEMPTS;
    loop {
        let exists = match fs::create_dir(folder) {
            Ok(()) => return Ok(true),
            Err(e) => e,
        };
        match fs::metadata(folder) {
            Ok(there) if there.is_dir() => return Ok(false),
            Err(e) if e.kind() == io::ErrorKind::NotFound && exists.kind() == io::ErrorKind::AlreadyExists => {
                attempts.next().ok_or(exists)?;
            }
            _ => return Err(exists),
        }
    }
}

/// Whether a path is empty, like the last ancestor of a relative path.
fn is_current(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// Give a file or folder another name, and put that on disk.
pub(crate) fn rename(from: &Path, to: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let what = format!("rename {}", name(to));
    steps(&what).and_then(|()| fs::rename(from, to)).map_err(failed("rename", to))?;
    for folder in [to.parent(), from.parent().filter(|folder| Some(*folder) != to.parent())].into_iter().flatten() {
        sync(folder, steps)?;
    }
    Ok(())
}

/// Sync the names in a folder to disk.
pub(crate) fn sync(folder: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    steps(&format!("sync {}", name(folder))).map_err(failed("write", folder))?;
    sync_folder(folder)
}

/// Remove a file or a folder with everything in it; nothing if there is none.
pub(crate) fn remove(path: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let is_folder = match fs::symlink_metadata(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        there => there.map_err(failed("remove", path))?.is_dir(),
    };
    if is_folder {
        for entry in fs::read_dir(path).map_err(failed("remove", path))? {
            // Its failure names the file in the folder, once.
            remove(&entry.map_err(failed("remove", path))?.path(), steps)?;
        }
    }
    let removed = steps(&format!("remove {}", name(path)));
    match removed.and_then(|()| if is_folder { fs::remove_dir(path) } else { fs::remove_file(path) }) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed.map_err(failed("remove", path)),
    }
}

/// Temporary files and folders are private; what is published is for a web server to read.
pub(crate) fn readable(file: &File) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(fs::Permissions::from_mode(0o644))?;
    }
    #[cfg(not(unix))]
    let _ = file;
    Ok(())
}

/// The same for a folder.
pub(crate) fn open_to_all(folder: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    steps("open to all").map_err(failed("write", folder))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(folder, fs::Permissions::from_mode(0o755)).map_err(failed("write", folder))?;
    }
    Ok(())
}

/// The names in a folder and its folders, on disk.
pub(crate) fn sync_folders(folder: &Path) -> Result<(), DraftError> {
    for entry in fs::read_dir(folder).map_err(failed("read", folder))? {
        let entry = entry.map_err(failed("read", folder))?;
        if entry.file_type().map_err(failed("read", folder))?.is_dir() {
            sync_folders(&entry.path())?;
        }
    }
    sync_folder(folder)
}

fn sync_folder(folder: &Path) -> Result<(), DraftError> {
    atomic::sync_folder(folder).map_err(failed("write", folder))
}

fn name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

//! Creating and locking the scratch folder, which must be one that a build made.
//!
//! Somebody else may have put anything in its place: meshes come in folders from other people, and temporary folders are shared.
//! All files in a scratch folder are removed at the end. So links are not followed, and a folder is used only if it is empty or
//! its file `lock` contains [`MARKER`]. Failures: [`ScratchError::Foreign`], [`ScratchError::Busy`], [`ScratchError::Io`].

use super::ScratchError;
use kilwa_files::plain_file;
use std::ffi::OsString;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Name of the file that a build locks while it uses the folder.
pub(super) const LOCK: &str = "lock";

/// Content of that file.
const MARKER: &[u8] = b"Kilwa keeps the scratch files of a build in this folder, and removes all files in it.\n";

/// Create the folder if it does not exist.
pub(super) fn make(path: &Path) -> Result<(), ScratchError> {
    let cannot = |e| ScratchError::io(path, "create", e);
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).map_err(cannot)?;
    }
    match std::fs::create_dir(path) {
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
        made => made.map_err(cannot),
    }
}

/// Lock the folder, and make sure that it may be used.
pub(super) fn take(folder: &Path) -> Result<File, ScratchError> {
    let foreign = |what: String| ScratchError::Foreign { path: folder.to_owned(), what };
    let path = folder.join(LOCK);
    refuse_links(folder)?;
    let there = std::fs::symlink_metadata(&path).ok();
    // Checked before anything is created in the folder.
    if there.as_ref().is_some_and(|there| !there.is_file()) {
        return Err(foreign("its `lock` is not a regular file, so no build made the folder".to_owned()));
    }
    if there.is_none()
        && let Some(name) = another(folder)?
    {
        let name = name.display();
        return Err(foreign(format!("contains {name} but not the file `lock` that every build creates there")));
    }
    let cannot = |doing| move |e| ScratchError::io(&folder.join(LOCK), doing, e);
    let mut lock = match File::options().read(true).write(true).create_new(true).open(&path) {
        Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => plain_file::open_own(&path),
        made => made,
    }
    .map_err(cannot("create"))?;
    match fs4::FileExt::try_lock(&lock) {
        Ok(()) => {}
        Err(fs4::TryLockError::WouldBlock) => return Err(ScratchError::Busy { path: folder.to_owned() }),
        Err(fs4::TryLockError::Error(e)) => return Err(cannot("lock")(e)),
    }
    let mut text = Vec::new();
    (&mut lock).take(MARKER.len() as u64 + 1).read_to_end(&mut text).map_err(cannot("read"))?;
    if text != MARKER {
        // A build that was killed as it started may have left part of the marker, and nothing else.
        if !MARKER.starts_with(&text) || another(folder)?.is_some() {
            let what = "its file `lock` is damaged, or was not written by a build";
            return Err(foreign(what.to_owned()));
        }
        let written = lock.seek(SeekFrom::Start(0)).and_then(|_| lock.write_all(MARKER)).and_then(|()| lock.sync_all());
        written.map_err(|e| ScratchError::write(&path, MARKER.len() as u64, 0, e))?;
    }
    // The locked file must still be the one in the folder.
    refuse_links(folder)?;
    let there = std::fs::symlink_metadata(&path).map_err(cannot("lock"))?;
    let locked = lock.metadata().map_err(cannot("lock"))?;
    if plain_file::is_same_file(&locked, &there) { Ok(lock) } else { Err(cannot("lock")(plain_file::replaced())) }
}

fn refuse_links(folder: &Path) -> Result<(), ScratchError> {
    let kind = std::fs::symlink_metadata(folder).map_err(|e| ScratchError::io(folder, "open", e))?;
    if kind.is_dir() {
        return Ok(());
    }
    let what =
        if kind.is_symlink() { "is a link; scratch files are not written through links" } else { "is not a folder" };
    Err(ScratchError::Foreign { path: folder.to_owned(), what: what.to_owned() })
}

/// The name of a file or folder in the folder, besides the lock.
fn another(folder: &Path) -> Result<Option<OsString>, ScratchError> {
    let cannot = |e| ScratchError::io(folder, "list", e);
    for entry in std::fs::read_dir(folder).map_err(cannot)? {
        let name = entry.map_err(cannot)?.file_name();
        if name != LOCK {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

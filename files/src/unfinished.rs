//! A list of the temporary files and folders that are being written, so that they can be removed when a signal ends the program, because
//! destructors do not run then.
//!
//! Invariant: a file is created and noted under the same lock, so [`remove_all`] knows every one.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

static ALL: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// How often, and after what pause, removing a folder is tried again while something still writes to it.
const ATTEMPTS: u32 = 100;
const PAUSE: Duration = Duration::from_millis(10);

fn all() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    ALL.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps a path noted. Drop it after the file was renamed or removed.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Drop for Unfinished {
    fn drop(&mut self) {
        all().remove(&self.0);
    }
}

/// Create a temporary file or folder, and note its path.
///
/// # Errors
/// The error of `make`.
pub fn make<T>(make: impl FnOnce() -> io::Result<T>, path: impl FnOnce(&T) -> &Path) -> io::Result<(T, Unfinished)> {
    let mut all = all();
    let made = make()?;
    let path = path(&made).to_owned();
    all.insert(path.clone());
    Ok((made, Unfinished(path)))
}

/// Note an existing file.
pub fn note(path: &Path) -> Unfinished {
    all().insert(path.to_owned());
    Unfinished(path.to_owned())
}

/// Remove all of them. The program must end now: a thread that creates or finishes another waits for ever.
pub fn remove_all() {
    let all = all();
    all.iter().for_each(|path| remove(path));
    std::mem::forget(all);
}

/// Remove a file or a whole folder to which something may still be written.
fn remove(path: &Path) {
    if fs::symlink_metadata(path).is_ok_and(|about| !about.is_dir()) {
        drop(fs::remove_file(path));
        return;
    }
    for _ in 0..ATTEMPTS {
        match fs::remove_dir_all(path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => sleep(PAUSE),
            _ => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unfinished_files_are_removed_and_finished_ones_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let write = |name: &'static str| {
            let path = at(name);
            make(|| fs::write(&path, "x").map(|()| path.clone()), PathBuf::as_path).unwrap().1
        };
        let (finished, unfinished) = (write("finished"), write("unfinished"));
        drop(finished);
        fs::create_dir_all(at("folder/below")).unwrap();
        fs::write(at("folder/below/x"), "x").unwrap();
        let (noted, gone) = (note(&at("folder")), note(&at("gone")));
        assert!(make(|| Err::<PathBuf, _>(io::ErrorKind::StorageFull.into()), PathBuf::as_path).is_err());
        let own: Vec<PathBuf> = all().iter().filter(|path| path.starts_with(folder.path())).cloned().collect();
        assert_eq!(own, [at("folder"), at("gone"), at("unfinished")]);
        for path in &own {
            remove(path);
        }
        let left: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["finished"]);
        drop((unfinished, noted, gone));
        assert!(!all().iter().any(|path| path.starts_with(folder.path())));
    }
}

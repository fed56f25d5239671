//! The folder outside the served one to which withdrawn files are moved: where it may be, and its lock along with that of the folder of objects.

use super::created_folders::CreatedFolders;
use super::disk::failed;
use super::draft::{DraftError, Steps};
use super::layout::Slug;
use super::lock::{Lock, PATIENCE};
use super::withdraw::{WITHDRAWN, outlook};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Hidden file in the folder of a kept object until all of its files are there. It shows `kilwa verify` that a withdrawal is in progress or was
/// interrupted.
pub const KEEPING: &str = ".kilwa-keeping";
/// Content of that file.
pub const KEEPING_TEXT: &str = "A withdrawal is in progress or was interrupted; the same command finishes it.\n";

/// Both folders of a withdrawal, locked. On drop, the one outside is removed if it was created for the withdrawal and is still empty.
#[derive(Debug)]
pub struct Folders {
    // Dropped before the locks.
    _created: CreatedFolders,
    pub(super) shelf: Lock,
    pub(super) keep: PathBuf,
    /// The lock of that folder, if it exists.
    pub(super) kept: Option<Lock>,
}

impl Folders {
    /// Lock the folder of objects and the one outside, which is created if it is missing and the object `slug` still has files. If somebody else is changing
    /// one of them, `waits` is called with it.
    ///
    /// The folders are always locked in the same order, so that no two withdrawals wait for each other, whatever folders they are given.
    ///
    /// # Errors
    /// [`DraftError::Other`] if `keep` is in the folder of objects; otherwise as for [`Lock::wait`], or if the folder cannot be created.
    pub fn lock(
        shelf: &Path,
        keep: &Path,
        slug: &Slug,
        waits: &dyn Fn(&Path),
        steps: Steps<'_>,
    ) -> Result<Self, DraftError> {
        check_outside(shelf, keep)?;
        let there = outlook(shelf, slug).ok();
        let mut created = match there.filter(|there| !there.is_done()) {
            Some(there) => {
                let created = CreatedFolders::create(keep, steps);
                created.map_err(|e| if there.withdrawn.is_some() { e.after(WITHDRAWN) } else { e })?
            }
            None => CreatedFolders::default(),
        };
        let locked = lock_both(shelf, keep, waits);
        if let Err(DraftError::Busy(_)) = &locked {
            // Whoever holds the lock is working there.
            created.leave();
        }
        let (shelf, kept) = locked?;
        if kept.is_some() {
            created.lock();
        }
        let folders = Self { _created: created, shelf, keep: keep.to_owned(), kept };
        // Somebody may have put a link in its place while this command waited.
        check_outside(folders.shelf.folder(), keep)?;
        Ok(folders)
    }

    /// The folder of objects.
    pub fn shelf(&self) -> &Lock {
        &self.shelf
    }
}

/// Lock the folder of objects and, if it exists, the one outside.
fn lock_both(shelf: &Path, keep: &Path, waits: &dyn Fn(&Path)) -> Result<(Lock, Option<Lock>), DraftError> {
    let wait = |folder: &Path| Lock::wait(folder, PATIENCE, &|| waits(folder));
    if !keep.is_dir() {
        Ok((wait(shelf)?, None))
    } else if real(keep)? < real(shelf)? {
        let kept = wait(keep)?;
        Ok((wait(shelf)?, Some(kept)))
    } else {
        let shelf = wait(shelf)?;
        Ok((shelf, Some(wait(keep)?)))
    }
}

/// Check that the folder `keep`, which need not exist, is outside the folder of objects, with links followed.
///
/// # Errors
/// [`DraftError`] if it is inside, or if this cannot be determined.
pub fn check_outside(shelf: &Path, keep: &Path) -> Result<(), DraftError> {
    let absolute = std::path::absolute(keep).map_err(failed("read", keep))?;
    // The nearest existing ancestor. Parts that do not exist cannot be links.
    let nearest = absolute.ancestors().find(|at| at.symlink_metadata().is_ok()).unwrap_or(&absolute);
    let missing = absolute.strip_prefix(nearest).unwrap_or(Path::new(""));
    if missing.components().any(|part| part == Component::ParentDir) {
        return Err(DraftError::Other(format!(
            "{} has .. after a folder that does not exist; give a path without ..",
            keep.display()
        )));
    }
    if real(nearest)?.starts_with(real(shelf)?) {
        return Err(DraftError::Other(format!(
            "{} is in {}, so a web server would still serve the files; give a folder outside it with --keep",
            keep.display(),
            shelf.display()
        )));
    }
    Ok(())
}

/// The path with links resolved.
fn real(path: &Path) -> Result<PathBuf, DraftError> {
    path.canonicalize().map_err(failed("find", path))
}

/// Whether something is itself a folder and not a link to one, so that files linked or copied into it do not end up elsewhere.
pub(super) fn is_own_folder(path: &Path) -> io::Result<bool> {
    Ok(path.symlink_metadata()?.is_dir())
}

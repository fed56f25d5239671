//! The folder outside of what is served that withdrawn files go to: where it may be, and its lock beside that of the folder of objects.

use super::disk::failed;
use super::draft::{DraftError, Steps};
use super::layout::Slug;
use super::lock::{Lock, PATIENCE};
use super::made::Made;
use super::withdraw::{WITHDRAWN, outlook};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Hidden file in what is kept of an object, until all of its files are there: so whoever verifies it knows that a withdrawal is in progress or was
/// interrupted.
pub const KEEPING: &str = ".kilwa-keeping";
/// What is in that file.
pub const KEEPING_TEXT: &str = "A withdrawal is in progress or was interrupted; the same command finishes it.\n";

/// Both folders of a withdrawal, locked. The one outside is removed with this where it was made for it and nothing went there.
#[derive(Debug)]
pub struct Folders {
    // Removed before the locks go.
    _made: Made,
    pub(super) shelf: Lock,
    pub(super) keep: PathBuf,
    /// Whether that folder is there, and locked.
    pub(super) kept: Option<Lock>,
}

impl Folders {
    /// Lock the folder of objects and the one outside, which is made where it is missing and the object `slug` still has files. `waits` is told which
    /// folder somebody else is changing.
    ///
    /// Always in the same order, so that no two withdrawals wait for each other, whatever folders they are given.
    ///
    /// # Errors
    /// [`DraftError::Other`] where `keep` is in the folder of objects; else as of [`Lock::wait`], and when the folder cannot be made.
    pub fn lock(
        shelf: &Path,
        keep: &Path,
        slug: &Slug,
        waits: &dyn Fn(&Path),
        steps: Steps<'_>,
    ) -> Result<Self, DraftError> {
        check_outside(shelf, keep)?;
        let there = outlook(shelf, slug).ok();
        let mut made = match there.filter(|there| !there.is_done()) {
            Some(there) => {
                let made = Made::create(keep, steps);
                made.map_err(|e| if there.withdrawn.is_some() { e.after(WITHDRAWN) } else { e })?
            }
            None => Made::default(),
        };
        let locked = lock_both(shelf, keep, waits);
        if let Err(DraftError::Busy(_)) = &locked {
            // Whoever holds the lock works there.
            made.leave();
        }
        let (shelf, kept) = locked?;
        if kept.is_some() {
            made.lock();
        }
        let folders = Self { _made: made, shelf, keep: keep.to_owned(), kept };
        // Somebody may have put a link in its place while it was waited for.
        check_outside(folders.shelf.folder(), keep)?;
        Ok(folders)
    }

    /// The folder of objects.
    pub fn shelf(&self) -> &Lock {
        &self.shelf
    }
}

/// Lock the folder of objects and, where it is there, the one outside.
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

/// Whether the folder `keep`, which need not be there, is outside of the folder of objects, whatever links lead to either.
///
/// # Errors
/// [`DraftError`] where it is in it, or that cannot be told.
pub fn check_outside(shelf: &Path, keep: &Path) -> Result<(), DraftError> {
    let absolute = std::path::absolute(keep).map_err(failed("read", keep))?;
    // The nearest that is there: of what is not, nothing is a link.
    let nearest = absolute.ancestors().find(|at| at.symlink_metadata().is_ok()).unwrap_or(&absolute);
    let missing = absolute.strip_prefix(nearest).unwrap_or(Path::new(""));
    if missing.components().any(|part| part == Component::ParentDir) {
        return Err(DraftError::Other(format!(
            "{} has .. after a folder that is not there; give a path without it",
            keep.display()
        )));
    }
    if real(nearest)?.starts_with(real(shelf)?) {
        return Err(DraftError::Other(format!(
            "{} is in {}, from where a web server would go on serving the files; give a folder outside with --keep",
            keep.display(),
            shelf.display()
        )));
    }
    Ok(())
}

/// The path without links.
fn real(path: &Path) -> Result<PathBuf, DraftError> {
    path.canonicalize().map_err(failed("find", path))
}

/// Whether something is a folder itself, and no link to one: what is linked or copied into it must not go elsewhere.
pub(super) fn is_own_folder(path: &Path) -> io::Result<bool> {
    Ok(path.symlink_metadata()?.is_dir())
}

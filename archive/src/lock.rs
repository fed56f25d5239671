//! One change at a time to a folder: a lock that holds between threads, programs and users of this computer.
//!
//! The lock is taken on the folder itself, so that nothing is left behind. Where the system cannot lock a folder (network file systems, Windows)
//! it is taken on a hidden file in it, [`LOCK_FILE`]. Where neither works the change is refused: two changes at once could lose one of them.

use super::disk::failed;
use super::draft::DraftError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The file that is locked where a folder cannot be.
pub const LOCK_FILE: &str = ".kilwa-lock";
/// How long another change is waited for.
pub const PATIENCE: Duration = Duration::from_secs(600);
/// Longest pause between two attempts.
const PAUSE: Duration = Duration::from_millis(100);

/// Held while a folder is changed. Whoever decides something by what is in the folder reads it while holding this.
#[derive(Debug)]
pub struct Lock {
    folder: PathBuf,
    _file: File,
}

impl Lock {
    /// Take the lock of a folder.
    ///
    /// # Errors
    /// [`DraftError::Busy`] while somebody else holds it, [`DraftError::Unlockable`] where it cannot be locked at all.
    pub fn take(folder: &Path) -> Result<Self, DraftError> {
        if cfg!(unix) {
            let opened = File::open(folder);
            let file = opened.map_err(failed("open", folder))?;
            match file.try_lock() {
                Ok(()) => return Ok(Self { folder: folder.to_owned(), _file: file }),
                Err(TryLockError::WouldBlock) => return Err(DraftError::Busy(folder.to_owned())),
                Err(TryLockError::Error(_)) => {}
            }
        }
        Self::of_file(folder)
    }

    /// The same, by the hidden file.
    fn of_file(folder: &Path) -> Result<Self, DraftError> {
        let failed = |reason: io::Error| DraftError::Unlockable { path: folder.to_owned(), reason };
        let path = folder.join(LOCK_FILE);
        let file = OpenOptions::new().create(true).read(true).write(true).truncate(false).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => Ok(Self { folder: folder.to_owned(), _file: file }),
            Err(TryLockError::WouldBlock) => Err(DraftError::Busy(folder.to_owned())),
            Err(TryLockError::Error(e)) => Err(failed(e)),
        }
    }

    /// Take the lock, waiting while somebody else holds it. `waits` is called once, when it has to wait.
    ///
    /// # Errors
    /// As [`Self::take`]; [`DraftError::Busy`] when it was waited for as long as `patience`.
    pub fn wait(folder: &Path, patience: Duration, waits: &dyn Fn()) -> Result<Self, DraftError> {
        let (began, mut pause) = (Instant::now(), Duration::from_millis(1));
        loop {
            match Self::take(folder) {
                Err(DraftError::Busy(_)) if began.elapsed() < patience => {}
                taken => return taken,
            }
            if pause == Duration::from_millis(1) {
                waits();
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(PAUSE);
        }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_held_by_one_at_a_time_also_by_its_hidden_file() {
        let folder = tempfile::tempdir().unwrap();
        for take in [Lock::take, Lock::of_file] {
            let held = take(folder.path()).unwrap();
            assert!(matches!(take(folder.path()), Err(DraftError::Busy(_))));
            drop(held);
            assert!(take(folder.path()).is_ok());
        }
    }

    #[test]
    fn whoever_waits_is_let_in_when_the_other_is_done_and_refused_when_patience_ends() {
        let folder = tempfile::tempdir().unwrap();
        let held = Lock::take(folder.path()).unwrap();
        let refused = Lock::wait(folder.path(), Duration::ZERO, &|| ());
        assert!(matches!(refused, Err(DraftError::Busy(_))));
        let (waits, waited) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            let path = folder.path();
            let other = scope.spawn(move || Lock::wait(path, PATIENCE, &|| waits.send(()).unwrap()).is_ok());
            waited.recv().unwrap();
            drop(held);
            assert!(other.join().unwrap());
        });
    }

    #[test]
    fn what_cannot_be_locked_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(Lock::take(&folder.path().join("none")), Err(DraftError::Disk { .. })));
        std::fs::create_dir(folder.path().join(LOCK_FILE)).unwrap();
        let refused = Lock::of_file(folder.path()).unwrap_err();
        assert!(matches!(refused, DraftError::Unlockable { .. }), "{refused}");
        assert!(refused.to_string().contains("could lose one of them"), "{refused}");
    }
}

//! One change at a time to a folder: a lock that holds between threads, programs and users of this computer.
//!
//! The lock is taken on the folder itself, so that nothing is left behind. Where the system cannot lock a folder (network file systems, Windows)
//! it is taken on a hidden file in it, [`LOCK_FILE`]. If neither works, the change is refused, because one of two simultaneous changes could be lost.
//!
//! [`LOCK_FILE`] is shared: another program that opened it may lock it a moment later, so a program that could not lock it must not remove it. It is therefore created
//! only if a nameless file could be locked in the same folder. A folder in which nothing can be locked is left unchanged.
//!
//! After locking, the file or folder must still have its name: the lock of one that was removed meanwhile excludes nobody.

use super::disk::failed;
use super::draft::DraftError;
use kilwa_files::plain_file;
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
                Ok(()) => return Self::of(folder, file, folder),
                Err(TryLockError::WouldBlock) => return Err(DraftError::Busy(folder.to_owned())),
                Err(TryLockError::Error(_)) => {}
            }
        }
        Self::of_file(folder)
    }

    /// The same, by the hidden file.
    fn of_file(folder: &Path) -> Result<Self, DraftError> {
        Self::of_file_by(folder, &File::try_lock)
    }

    /// The same, by the system call `try_lock`.
    fn of_file_by(folder: &Path, try_lock: &TryLock<'_>) -> Result<Self, DraftError> {
        let failed = |reason: io::Error| DraftError::Unlockable { path: folder.to_owned(), reason };
        let path = folder.join(LOCK_FILE);
        let open = |creates| OpenOptions::new().create(creates).read(true).write(true).truncate(false).open(&path);
        let file = match open(false) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                check_lockable(folder, try_lock).and_then(|()| open(true)).map_err(failed)?
            }
            opened => opened.map_err(failed)?,
        };
        match try_lock(&file) {
            Ok(()) => Self::of(folder, file, &path),
            Err(TryLockError::WouldBlock) => Err(DraftError::Busy(folder.to_owned())),
            Err(TryLockError::Error(e)) => Err(failed(e)),
        }
    }

    /// The lock, given the locked file or folder, unless `path` leads to another one by now.
    fn of(folder: &Path, file: File, path: &Path) -> Result<Self, DraftError> {
        let is_there = match (file.metadata(), std::fs::metadata(path)) {
            (Ok(locked), Ok(there)) => plain_file::is_same_file(&locked, &there),
            _ => false,
        };
        if is_there {
            Ok(Self { folder: folder.to_owned(), _file: file })
        } else {
            Err(DraftError::Busy(folder.to_owned()))
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

/// Locks an open file, or says why not.
type TryLock<'a> = dyn Fn(&File) -> Result<(), TryLockError> + 'a;

/// Check that files in a folder can be locked, with a nameless file that nobody else can open and that disappears when it is closed.
fn check_lockable(folder: &Path, try_lock: &TryLock<'_>) -> io::Result<()> {
    match try_lock(&tempfile::tempfile_in(folder)?) {
        Err(TryLockError::Error(e)) => Err(e),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_program_at_a_time_holds_the_lock_of_a_folder_or_of_its_hidden_file() {
        let folder = tempfile::tempdir().unwrap();
        for take in [Lock::take, Lock::of_file] {
            let held = take(folder.path()).unwrap();
            assert!(matches!(take(folder.path()), Err(DraftError::Busy(_))));
            drop(held);
            assert!(take(folder.path()).is_ok());
        }
    }

    #[test]
    fn a_waiting_program_gets_the_lock_when_it_is_released_or_gives_up_after_its_patience() {
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

    /// As on file systems without locks (ENOLCK, ENOTSUP).
    fn no_lock(_: &File) -> Result<(), TryLockError> {
        Err(TryLockError::Error(io::ErrorKind::Unsupported.into()))
    }

    #[test]
    fn a_folder_that_cannot_be_locked_is_left_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let names = || std::fs::read_dir(folder.path()).unwrap().count();
        let refused = Lock::of_file_by(folder.path(), &no_lock).unwrap_err();
        assert!(matches!(refused, DraftError::Unlockable { .. }), "{refused}");
        assert_eq!(names(), 0, "a file is left");
        // An existing one belongs to others too.
        drop(Lock::of_file(folder.path()).unwrap());
        assert!(Lock::of_file_by(folder.path(), &no_lock).is_err());
        assert_eq!(names(), 1, "a file of others is gone");
    }

    #[cfg(unix)]
    #[test]
    fn a_removed_lock_file_blocks_nobody() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(LOCK_FILE);
        drop(Lock::of_file(folder.path()).unwrap());
        // Between opening and locking, another has removed the file.
        let removing = |file: &File| {
            drop(std::fs::remove_file(&path));
            file.try_lock()
        };
        let late = Lock::of_file_by(folder.path(), &removing);
        assert!(matches!(late, Err(DraftError::Busy(_))), "it holds a file that nobody else finds");
        assert!(Lock::of_file(folder.path()).is_ok());
    }

    #[test]
    fn a_path_that_cannot_be_locked_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(Lock::take(&folder.path().join("none")), Err(DraftError::Disk { .. })));
        std::fs::create_dir(folder.path().join(LOCK_FILE)).unwrap();
        let refused = Lock::of_file(folder.path()).unwrap_err();
        assert!(matches!(refused, DraftError::Unlockable { .. }), "{refused}");
        assert!(refused.to_string().contains("could lose one of them"), "{refused}");
    }
}

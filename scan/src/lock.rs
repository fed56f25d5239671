//! Only one command at a time may write to a survey.

use crate::ScanError;
use kilwa_files::plain_file;
use std::fs::{File, TryLockError};
use std::io::ErrorKind;
use std::path::Path;

/// Held while a command writes to a survey. The system gives it back also when the process is killed.
#[derive(Debug)]
pub(crate) struct Lock(#[expect(dead_code, reason = "held until it is dropped")] File);

impl Lock {
    /// Take it, or refuse where another process has it.
    pub(crate) fn take(folder: &Path) -> Result<Self, ScanError> {
        let path = folder.join(".lock");
        let cannot = ScanError::write(&path);
        // What is there may be anything: a link to a file elsewhere, or a pipe, which would wait for ever.
        let file = match File::options().create_new(true).write(true).open(&path) {
            Err(e) if e.kind() == ErrorKind::AlreadyExists => plain_file::open(&path),
            made => made,
        };
        let file = file.map_err(cannot)?;
        match file.try_lock() {
            Ok(()) => Ok(Self(file)),
            Err(TryLockError::WouldBlock) => {
                let message = format!(
                    "another command is writing to {} (an import or masks); wait until it is done",
                    folder.display()
                );
                Err(ScanError::Request(message))
            }
            Err(TryLockError::Error(e)) => Err(ScanError::Write { path: path.clone(), source: e }),
        }
    }
}

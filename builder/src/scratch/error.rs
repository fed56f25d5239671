//! What can go wrong with scratch files: always which file, what was being done, why, and what to do.

use kilwa_pack::plural::counted;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a scratch file could not be used.
#[derive(Debug, Error)]
pub enum ScratchError {
    /// The disk holds no more.
    #[error(
        "the disk is full: {} to be written to {}, which already holds {held}; free space there, or \
         give --scratch a folder on another disk",
        counted(*bytes, "more byte was", "more bytes were"),
        path.display()
    )]
    DiskFull {
        /// The file.
        path: PathBuf,
        /// Bytes that did not fit.
        bytes: u64,
        /// Bytes that the file held before.
        held: u64,
    },
    /// The system refused.
    #[error("cannot {doing} the scratch file {}: {reason}; check the folder and its disk, or give another --scratch", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done: "create", "read" …
        doing: &'static str,
        /// The system's reason; part of the message, and so not the source of this error.
        reason: std::io::Error,
    },
    /// A scratch file is not what was written.
    #[error("the scratch file {} is damaged: {why}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        why: String,
    },
    /// The scratch folder exists, but no build made it.
    #[error("the scratch folder {} already exists and {what}; remove it or rename it, or give another --scratch", path.display())]
    Foreign {
        /// The folder.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// Another build is using the folder.
    #[error("the scratch folder {} is in use by another build; wait for it, or give another --scratch", path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
}

/// The builder keeps what readers deliver in scratch files.
impl From<ScratchError> for kilwa_formats::ReadError {
    fn from(error: ScratchError) -> Self {
        Self::Sink(Box::new(error))
    }
}

impl ScratchError {
    /// A failed read, removal …
    pub(crate) fn io(path: &Path, doing: &'static str, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), doing, reason }
    }

    /// A failed write of `bytes` at `held`: a full disk is an error of its own.
    pub(crate) fn write(path: &Path, bytes: u64, held: u64, source: std::io::Error) -> Self {
        use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
        if matches!(source.kind(), StorageFull | QuotaExceeded | FileTooLarge) {
            Self::DiskFull { path: path.to_owned(), bytes, held }
        } else {
            Self::io(path, "write", source)
        }
    }

    /// A file that does not hold what was written to it.
    pub(crate) fn damaged(path: &Path, why: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), why: why.into() }
    }
}

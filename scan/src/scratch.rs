//! A scratch file: what is written to it is read back once or more, and checked.

use crate::ScanError;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A file without a name, which disappears when this is dropped.
pub(crate) struct ScratchFile {
    folder: PathBuf,
    /// What needs less space, as the end of a sentence; may be empty.
    way_out: &'static str,
    inner: Mutex<(File, u64)>,
}

/// A part of a scratch file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Stretch {
    at: u64,
    bytes: u64,
    /// The first four bytes of the BLAKE3 hash.
    sum: u32,
}

impl ScratchFile {
    /// Create one. `way_out` is the end of the sentence that says what to do when the disk is full.
    pub(crate) fn create(folder: &Path, way_out: &'static str) -> Result<Self, ScanError> {
        let failed = |source| ScanError::Scratch { folder: folder.to_owned(), way_out, source };
        let file = tempfile::tempfile_in(folder).map_err(failed)?;
        Ok(Self { folder: folder.to_owned(), way_out, inner: Mutex::new((file, 0)) })
    }

    /// Write bytes at the end.
    pub(crate) fn append(&self, bytes: &[u8]) -> Result<Stretch, ScanError> {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let (file, end) = &mut *inner;
        let at = *end;
        file.seek(SeekFrom::Start(at)).and_then(|_| file.write_all(bytes)).map_err(|e| self.failed(e))?;
        *end += bytes.len() as u64;
        Ok(Stretch { at, bytes: bytes.len() as u64, sum: sum(bytes) })
    }

    /// Read what was written.
    pub(crate) fn read(&self, stretch: Stretch) -> Result<Vec<u8>, ScanError> {
        let mut bytes = vec![0; usize::try_from(stretch.bytes).unwrap_or(usize::MAX)];
        {
            let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
            let file = &mut inner.0;
            let read = file.seek(SeekFrom::Start(stretch.at)).and_then(|_| file.read_exact(&mut bytes));
            read.map_err(|e| self.failed(e))?;
        }
        if sum(&bytes) != stretch.sum {
            let why = "it does not contain what was written; check the disk and run the command again";
            return Err(self.failed(io::Error::other(why)));
        }
        Ok(bytes)
    }

    /// Bytes in the file.
    pub(crate) fn bytes(&self) -> u64 {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).1
    }

    fn failed(&self, source: io::Error) -> ScanError {
        ScanError::Scratch { folder: self.folder.clone(), way_out: self.way_out, source }
    }
}

fn sum(bytes: &[u8]) -> u32 {
    let hash = blake3::hash(bytes);
    let first = hash.as_bytes();
    u32::from_le_bytes([first[0], first[1], first[2], first[3]])
}

//! One plain file: any thread appends to it and reads from it by position.

use super::{ScratchError, Space};
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that an [`Appender`] gathers before it writes.
const BUFFER: usize = 1 << 20;

/// A scratch file. Appends reserve their place first and are written without a lock, so that threads do not wait.
#[derive(Debug)]
pub struct ScratchFile {
    file: File,
    path: PathBuf,
    end: AtomicU64,
    space: Arc<Space>,
}

impl ScratchFile {
    pub(super) fn new(path: PathBuf, create: bool, space: Arc<Space>) -> Result<Self, ScratchError> {
        let doing = if create { "create" } else { "open" };
        // Never follow a link that somebody put there.
        let opened = if create {
            File::options().read(true).write(true).create_new(true).open(&path)
        } else {
            plain_file::open_own(&path)
        };
        let file = opened.map_err(|e| ScratchError::io(&path, doing, e))?;
        let end = file.metadata().map_err(|e| ScratchError::io(&path, doing, e))?.len();
        Ok(Self { file, path, end: AtomicU64::new(end), space })
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes in the file, those being appended included.
    pub fn len(&self) -> u64 {
        self.end.load(Ordering::Acquire)
    }

    /// Whether the file holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Append; returns where the bytes begin.
    ///
    /// # Errors
    /// [`ScratchError::DiskFull`], or [`ScratchError::Io`].
    pub fn append(&self, bytes: &[u8]) -> Result<u64, ScratchError> {
        let length = bytes.len() as u64;
        let at = self.end.fetch_add(length, Ordering::AcqRel);
        write_all_at(&self.file, bytes, at).map_err(|e| ScratchError::write(&self.path, length, at, e))?;
        self.space.add(length);
        Ok(at)
    }

    /// Write at a position, which may lie beyond the end: what is between reads as zeros, and counts as bytes of the file.
    ///
    /// # Errors
    /// As [`ScratchFile::append`].
    pub fn write_at(&self, at: u64, bytes: &[u8]) -> Result<(), ScratchError> {
        let length = bytes.len() as u64;
        write_all_at(&self.file, bytes, at).map_err(|e| ScratchError::write(&self.path, length, at, e))?;
        let before = self.end.fetch_max(at + length, Ordering::AcqRel);
        self.space.add((at + length).saturating_sub(before));
        Ok(())
    }

    /// Fill `into` with the bytes from `at` on.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] where the file ends before, [`ScratchError::Io`].
    pub fn read_into(&self, at: u64, into: &mut [u8]) -> Result<(), ScratchError> {
        read_exact_at(&self.file, into, at).map_err(|e| {
            if e.kind() == std::io::ErrorKind::UnexpectedEof {
                let why = format!("at {at}, {} not there", counted(into.len(), "byte is", "bytes are"));
                ScratchError::damaged(&self.path, why)
            } else {
                ScratchError::io(&self.path, "read", e)
            }
        })
    }

    /// `length` bytes from `at` on. Nothing is allocated for bytes that the file does not have.
    ///
    /// # Errors
    /// As [`ScratchFile::read_into`].
    pub fn read(&self, at: u64, length: u64) -> Result<Vec<u8>, ScratchError> {
        let size = usize::try_from(length).ok().filter(|_| at.checked_add(length).is_some_and(|end| end <= self.len()));
        let Some(size) = size else {
            return Err(ScratchError::damaged(
                &self.path,
                format!("at {at}, {} not there", counted(length, "byte is", "bytes are")),
            ));
        };
        let mut bytes = vec![0; size];
        self.read_into(at, &mut bytes)?;
        Ok(bytes)
    }

    /// Cut the file to `length` bytes.
    ///
    /// # Errors
    /// [`ScratchError::Io`].
    pub fn truncate(&self, length: u64) -> Result<(), ScratchError> {
        self.file.set_len(length).map_err(|e| ScratchError::io(&self.path, "cut", e))?;
        let before = self.end.swap(length, Ordering::AcqRel);
        self.space.take(before.saturating_sub(length));
        Ok(())
    }

    /// Wait until everything is on the disk (of a temporary folder nothing needs to be).
    ///
    /// # Errors
    /// [`ScratchError::DiskFull`] where a file system finds out only now, [`ScratchError::Io`].
    pub fn sync(&self) -> Result<(), ScratchError> {
        if self.space.fleeting {
            return Ok(());
        }
        self.file.sync_data().map_err(|e| ScratchError::write(&self.path, 0, self.len(), e))
    }
}

/// Gathers small writes from one thread.
#[derive(Debug)]
pub struct Appender {
    file: ScratchFile,
    buffer: Vec<u8>,
}

impl Appender {
    /// Append to `file`.
    pub fn new(file: ScratchFile) -> Self {
        Self { file, buffer: Vec::with_capacity(BUFFER) }
    }

    /// Append `bytes`.
    ///
    /// # Errors
    /// As [`ScratchFile::append`].
    pub fn push(&mut self, bytes: &[u8]) -> Result<(), ScratchError> {
        if self.buffer.len() + bytes.len() > BUFFER {
            self.flush()?;
        }
        if bytes.len() > BUFFER {
            self.file.append(bytes)?;
        } else {
            self.buffer.extend_from_slice(bytes);
        }
        Ok(())
    }

    /// Bytes pushed so far, those in the file before included.
    pub fn len(&self) -> u64 {
        self.file.len() + self.buffer.len() as u64
    }

    /// Whether nothing was pushed.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Write what was gathered.
    ///
    /// # Errors
    /// As [`ScratchFile::append`].
    pub fn flush(&mut self) -> Result<(), ScratchError> {
        if !self.buffer.is_empty() {
            self.file.append(&self.buffer)?;
            self.buffer.clear();
        }
        Ok(())
    }

    /// The file, everything written.
    ///
    /// # Errors
    /// As [`ScratchFile::append`].
    pub fn finish(mut self) -> Result<ScratchFile, ScratchError> {
        self.flush()?;
        Ok(self.file)
    }
}

#[cfg(unix)]
fn write_all_at(file: &File, bytes: &[u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, at)
}

#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn write_all_at(file: &File, mut bytes: &[u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let n = std::os::windows::fs::FileExt::seek_write(file, bytes, at)?;
        if n == 0 {
            return Err(std::io::ErrorKind::WriteZero.into());
        }
        bytes = &bytes[n..];
        at += n as u64;
    }
    Ok(())
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let n = std::os::windows::fs::FileExt::seek_read(file, bytes, at)?;
        if n == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[n..];
        at += n as u64;
    }
    Ok(())
}

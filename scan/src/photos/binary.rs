//! Binary files of other programs: little-endian numbers with their offsets. Counts are compared with what is left of the file before anything is allocated.

use crate::ScanError;
use kilwa_files::plain_file;
use kilwa_formats::read::{Place, ReadError};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest name of a file, bytes.
const NAME_MAX: usize = 4096;

pub(super) struct Bytes {
    path: PathBuf,
    file: BufReader<File>,
    at: u64,
    total: u64,
}

impl Bytes {
    pub(super) fn open(path: &Path) -> Result<Self, ScanError> {
        let cannot = |source| ReadError::Open { file: path.to_owned(), source };
        let file = plain_file::open(path).map_err(cannot)?;
        let total = file.metadata().map_err(cannot)?.len();
        Ok(Self { path: path.to_owned(), file: BufReader::with_capacity(1 << 18, file), at: 0, total })
    }

    fn fill(&mut self, out: &mut [u8]) -> Result<(), ScanError> {
        if self.total - self.at < out.len() as u64 {
            return Err(self.wrong("the end of the file", "more data; the file is truncated"));
        }
        let read = self.file.read_exact(out);
        read.map_err(|source| ReadError::Io { file: self.path.clone(), offset: self.at, source })?;
        self.at += out.len() as u64;
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], ScanError> {
        let mut out = [0; N];
        self.fill(&mut out)?;
        Ok(out)
    }

    pub(super) fn byte(&mut self) -> Result<u8, ScanError> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u32(&mut self) -> Result<u32, ScanError> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, ScanError> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, ScanError> {
        self.array().map(f64::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], ScanError> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f64()?;
        }
        Ok(out)
    }

    /// How many records of at least `size` bytes follow.
    pub(super) fn count(&mut self, what: &str, size: u64) -> Result<u64, ScanError> {
        let count = self.u64()?;
        let left = self.total - self.at;
        if count > left / size {
            self.at -= 8;
            let expected = format!("at most {}, which is what the rest of the file can hold", left / size);
            return Err(self.wrong(format!("a count of {count} {what}"), expected));
        }
        Ok(count)
    }

    /// Skip bytes.
    pub(super) fn skip(&mut self, length: u64) -> Result<(), ScanError> {
        if length > self.total - self.at {
            return Err(self.wrong("the end of the file", "more data; the file is truncated"));
        }
        let distance =
            i64::try_from(length).map_err(|_| self.wrong("a length of 2^63 or more", "a length within the file"))?;
        let moved = self.file.seek_relative(distance);
        moved.map_err(|source| ReadError::Io { file: self.path.clone(), offset: self.at, source })?;
        self.at += length;
        Ok(())
    }

    /// A name that ends with a zero byte.
    pub(super) fn name(&mut self) -> Result<String, ScanError> {
        let (start, mut name) = (self.at, Vec::new());
        loop {
            match self.byte()? {
                0 => break,
                byte => name.push(byte),
            }
            if name.len() > NAME_MAX {
                self.at = start;
                return Err(self.wrong(format!("a name of more than {NAME_MAX} bytes"), "a file name and a zero byte"));
            }
        }
        String::from_utf8(name).map_err(|_| {
            self.at = start;
            self.wrong("a name that is not UTF-8", "a file name in UTF-8")
        })
    }

    /// The file must end here.
    pub(super) fn end(&self) -> Result<(), ScanError> {
        let left = self.total - self.at;
        if left > 0 { Err(self.wrong(format!("extra data ({left} B)"), "the end of the file")) } else { Ok(()) }
    }

    /// The error for unexpected content at this position.
    pub(super) fn wrong(&self, found: impl Into<String>, expected: impl Into<String>) -> ScanError {
        ScanError::malformed(&self.path, Place::Byte(self.at), found, expected)
    }
}

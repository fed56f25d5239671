//! Reads little-endian numbers from a part of a file and reports the offset of anything missing or wrong.

use super::super::error::{Place, ReadError};
use std::path::Path;

/// An error at a byte of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    /// Offset from the beginning of the file.
    pub(super) at: u64,
    /// What was found there.
    pub(super) found: String,
    /// What was expected there.
    pub(super) expected: String,
}

impl Fault {
    /// The error with the file name.
    pub(super) fn in_file(self, file: &Path) -> ReadError {
        let Self { at, found, expected } = self;
        ReadError::Malformed { file: file.to_owned(), place: Place::Byte(at), found, expected }
    }
}

/// Reads a part of a file from its beginning.
#[derive(Debug, Clone)]
pub(super) struct Cursor<'b> {
    bytes: &'b [u8],
    at: usize,
    /// Offset of the part in the file.
    base: u64,
}

impl<'b> Cursor<'b> {
    /// For `bytes`, which are at offset `base` in the file.
    pub(super) fn new(bytes: &'b [u8], base: u64) -> Self {
        Self { bytes, at: 0, base }
    }

    /// The offset of the next byte in the file.
    pub(super) fn offset(&self) -> u64 {
        self.base + self.at as u64
    }

    /// An error at the next byte.
    pub(super) fn fault(&self, found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault { at: self.offset(), found: found.into(), expected: expected.into() }
    }

    /// The next `n` bytes; `what` describes them in the error message.
    pub(super) fn take(&mut self, n: usize, what: &str) -> Result<&'b [u8], Fault> {
        let left = &self.bytes[self.at..];
        let Some(taken) = left.get(..n) else {
            return Err(self.fault(
                format!("only {} bytes", left.len()),
                format!("{n} bytes for {what}; the file is truncated or damaged: copy it again"),
            ));
        };
        self.at += n;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Fault> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        Ok(array)
    }

    pub(super) fn u8(&mut self, what: &str) -> Result<u8, Fault> {
        Ok(self.array::<1>(what)?[0])
    }

    pub(super) fn u16(&mut self, what: &str) -> Result<u16, Fault> {
        self.array(what).map(u16::from_le_bytes)
    }

    pub(super) fn i16(&mut self, what: &str) -> Result<i16, Fault> {
        self.array(what).map(i16::from_le_bytes)
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, Fault> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, what: &str) -> Result<u64, Fault> {
        self.array(what).map(u64::from_le_bytes)
    }

    pub(super) fn f32(&mut self, what: &str) -> Result<f32, Fault> {
        self.array(what).map(f32::from_le_bytes)
    }

    /// Skip to a multiple of four bytes from the beginning of the part.
    pub(super) fn align(&mut self, what: &str) -> Result<(), Fault> {
        self.take(self.at.wrapping_neg() & 3, what).map(|_| ())
    }
}

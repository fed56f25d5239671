//! A writer that keeps nothing and compares what is written with bytes that exist already.

use kilwa_pack::Source;
use std::io::{self, Write};

/// Compares the bytes written to it with those of `source`, from its beginning. Writing other bytes, or more than there are, fails.
#[derive(Debug)]
pub struct CompareWriter<'a, S> {
    source: &'a S,
    at: u64,
}

impl<'a, S> CompareWriter<'a, S> {
    /// Begin at the first byte of `source`.
    pub fn new(source: &'a S) -> Self {
        Self { source, at: 0 }
    }

    /// How many bytes were written.
    pub fn written(&self) -> u64 {
        self.at
    }
}

impl<S: Source> Write for CompareWriter<'_, S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.source.read_at(self.at, bytes.len())? != bytes {
            return Err(io::ErrorKind::InvalidData.into());
        }
        self.at += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

//! The bytes of the file, through one large buffer, with the offset of each and progress.
//!
//! Invariants: `offset` is always the place in the file of the next byte; the buffer never holds more than
//! [`BUFFER`] bytes, so memory does not grow with the file.

use super::{Bytes, OnProgress, Place, ReadError};
use std::io::{ErrorKind, SeekFrom};
use std::ops::Range;
use std::path::Path;

/// Bytes read at a time; also the most that can be looked at in one piece.
pub(super) const BUFFER: usize = 1 << 20;

pub(super) struct Source<'a> {
    reader: &'a mut dyn Bytes,
    path: &'a Path,
    progress: &'a mut OnProgress<'a>,
    total: u64,
    buffer: Vec<u8>,
    /// The part of `buffer` that is read and not yet used.
    ready: Range<usize>,
    /// Offset in the file of `buffer[0]`.
    base: u64,
    ended: bool,
    /// The furthest place that progress was reported of; it never goes back.
    reported: u64,
    /// Which part of the work this pass over the file is: where it begins and how much it is, of 1.
    pass: (f64, f64),
}

impl<'a> Source<'a> {
    pub(super) fn new(reader: &'a mut dyn Bytes, total: u64, path: &'a Path, progress: &'a mut OnProgress<'a>) -> Self {
        Self {
            reader,
            path,
            progress,
            total,
            buffer: vec![0; BUFFER],
            ready: 0..0,
            base: 0,
            ended: false,
            reported: 0,
            pass: (0.0, 1.0),
        }
    }

    /// The place in the file of the next byte.
    pub(super) fn offset(&self) -> u64 {
        self.base + self.ready.start as u64
    }

    /// How many bytes the file has left, as its length says.
    pub(super) fn remaining(&self) -> u64 {
        self.total.saturating_sub(self.offset())
    }

    /// What is in the buffer and not yet used.
    #[inline]
    pub(super) fn available(&self) -> &[u8] {
        &self.buffer[self.ready.clone()]
    }

    /// Read more behind what is in the buffer. `false` at the end of the file or when the buffer is full.
    pub(super) fn refill(&mut self) -> Result<bool, ReadError> {
        if self.ended {
            return Ok(false);
        }
        if self.ready.start > 0 {
            self.buffer.copy_within(self.ready.clone(), 0);
            self.base += self.ready.start as u64;
            self.ready = 0..self.ready.len();
        }
        while self.ready.end < self.buffer.len() {
            match self.reader.read(&mut self.buffer[self.ready.end..]) {
                Ok(0) => {
                    self.ended = true;
                    return Ok(false);
                }
                Ok(n) => {
                    self.ready.end += n;
                    let read = (self.base + self.ready.end as u64).min(self.total);
                    let done = (self.pass.0 * self.total as f64 + self.pass.1 * read as f64) as u64;
                    if done > self.reported {
                        self.reported = done;
                        (self.progress)(done.min(self.total), self.total);
                    }
                    return Ok(true);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(source) => {
                    let offset = self.base + self.ready.end as u64;
                    return Err(ReadError::Io { file: self.path.to_owned(), offset, source });
                }
            }
        }
        Ok(false)
    }

    /// Whether `n` bytes (at most [`BUFFER`]) are there; reads until they are or the file ends.
    #[inline]
    pub(super) fn ensure(&mut self, n: usize) -> Result<bool, ReadError> {
        while self.ready.len() < n {
            if !self.refill()? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Use up `n` bytes that are there (see [`ensure`](Self::ensure)).
    #[inline]
    pub(super) fn take(&mut self, n: usize) -> &[u8] {
        let start = self.ready.start;
        self.ready.start = (start + n).min(self.ready.end);
        &self.buffer[start..self.ready.start]
    }

    /// Use up `n` bytes; `false` where the file ends before.
    pub(super) fn skip(&mut self, mut n: u64) -> Result<bool, ReadError> {
        loop {
            let here = n.min(self.ready.len() as u64);
            self.take(here as usize);
            n -= here;
            if n == 0 {
                return Ok(true);
            }
            if !self.refill()? {
                return Ok(false);
            }
        }
    }

    /// Go to the beginning for a pass over the whole file that is `part` of the work and comes after `before` of it.
    pub(super) fn begin_pass(&mut self, before: f64, part: f64) -> Result<(), ReadError> {
        self.pass = (before, part);
        self.go_to(0)
    }

    /// Read on from another place of the file.
    pub(super) fn go_to(&mut self, offset: u64) -> Result<(), ReadError> {
        let buffered = self.base..=self.base + self.ready.end as u64;
        if buffered.contains(&offset) {
            self.ready.start = (offset - self.base) as usize;
            return Ok(());
        }
        let cannot = |source| ReadError::Io { file: self.path.to_owned(), offset, source };
        self.reader.seek(SeekFrom::Start(offset)).map_err(cannot)?;
        (self.base, self.ready, self.ended) = (offset, 0..0, false);
        Ok(())
    }

    /// Tell the progress that all is read.
    pub(super) fn done(&mut self) {
        (self.progress)(self.total, self.total);
    }

    /// The error for something found at `place`.
    pub(super) fn malformed(&self, place: Place, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::Malformed { file: self.path.to_owned(), place, found: found.into(), expected: expected.into() }
    }
}

/// Bytes of a file as a message can show them: quoted, escaped and cut.
pub(super) fn quote(bytes: &[u8]) -> String {
    const SHOWN: usize = 60;
    let cut = if bytes.len() > SHOWN { "…" } else { "" };
    format!("\"{}{cut}\"", bytes[..bytes.len().min(SHOWN)].escape_ascii())
}

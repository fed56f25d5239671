//! Text files of other programs: lines with their numbers, words, and the numbers in them.

use crate::ScanError;
use kilwa_files::plain_file;
use kilwa_formats::read::{Place, ReadError};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line, bytes: the observations of a picture stand in one line.
const LINE_MAX: u64 = 64 << 20;

/// How much of a line that is skipped is looked at, bytes.
const SKIPPED_PREFIX: u64 = 4 << 10;

/// The lines of a file.
pub(crate) struct Lines {
    path: PathBuf,
    file: BufReader<File>,
    line: Vec<u8>,
    /// The number of the line that came last; the first is 1.
    pub(super) number: u64,
    offset: u64,
}

impl Lines {
    pub(crate) fn open(path: &Path) -> Result<Self, ScanError> {
        let file = plain_file::open(path).map_err(|source| ReadError::Open { file: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), file: BufReader::new(file), line: Vec::new(), number: 0, offset: 0 })
    }

    /// The next line, without spaces around it; None at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<&str>, ScanError> {
        self.line.clear();
        let length = (&mut self.file).take(LINE_MAX).read_until(b'\n', &mut self.line);
        let length =
            length.map_err(|source| ReadError::Io { file: self.path.clone(), offset: self.offset, source })? as u64;
        if length == 0 {
            return Ok(None);
        }
        self.number += 1;
        self.offset += length;
        if length == LINE_MAX {
            return Err(self.wrong(format!("a line of {LINE_MAX} bytes or more"), "a text file with shorter lines"));
        }
        // Where it is text but not UTF-8, names of files were written in another encoding.
        match std::str::from_utf8(&self.line) {
            Ok(line) => Ok(Some(line.trim())),
            Err(_) => Err(ScanError::malformed(
                &self.path,
                Place::Line(self.number),
                "bytes that are not UTF-8",
                "text in UTF-8",
            )),
        }
    }

    /// The next line that is neither empty nor a comment.
    pub(crate) fn next_content(&mut self) -> Result<Option<&str>, ScanError> {
        loop {
            match self.next()? {
                None => return Ok(None),
                Some(line) if line.is_empty() || line.starts_with('#') => {}
                // The borrow checker does not allow `line` to be returned from the loop.
                Some(_) => break,
            }
        }
        Ok(std::str::from_utf8(&self.line).ok().map(str::trim))
    }

    /// Skip a line of any length; returns its beginning, up to [`SKIPPED_PREFIX`] bytes.
    pub(super) fn skip(&mut self) -> Result<&str, ScanError> {
        self.line.clear();
        let begun = (&mut self.file).take(SKIPPED_PREFIX).read_until(b'\n', &mut self.line);
        let is_whole = self.line.ends_with(b"\n");
        let rest = if is_whole { Ok(0) } else { self.file.skip_until(b'\n') };
        let length = begun.and_then(|begun| Ok(begun + rest?));
        let length = length.map_err(|source| ReadError::Io { file: self.path.clone(), offset: self.offset, source })?;
        self.offset += length as u64;
        self.number += u64::from(length > 0);
        Ok(std::str::from_utf8(&self.line).unwrap_or_default().trim())
    }

    /// The error for unexpected content in the line that was read last.
    pub(crate) fn wrong(&self, found: impl Into<String>, expected: impl Into<String>) -> ScanError {
        ScanError::malformed(&self.path, Place::Line(self.number), found, expected)
    }

    /// The error for a file that ends too early.
    pub(super) fn ended(&self, expected: impl Into<String>) -> ScanError {
        ScanError::malformed(&self.path, Place::Line(self.number + 1), "the end of the file", expected)
    }
}

/// Exactly `N` finite numbers.
pub(super) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    let mut words = text.split_ascii_whitespace();
    for value in &mut out {
        *value = number(words.next()?)?;
    }
    words.next().is_none().then_some(out)
}

/// A finite number.
pub(crate) fn number(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value: &f64| value.is_finite())
}

/// A line for a message: not too long.
pub(crate) fn quoted(line: &str) -> String {
    let start: String = line.chars().take(60).collect();
    if start.len() < line.len() { format!("\"{start}…\"") } else { format!("\"{start}\"") }
}

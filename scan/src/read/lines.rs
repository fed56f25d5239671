//! Lines of large text files, and the numbers in them.

use crate::ScanError;
use kilwa_formats::read::{Place, ReadError};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

const BUFFER: usize = 1 << 20;
/// A longer line is no line of numbers.
const MAX_LINE: usize = 1 << 16;

/// Walks the lines of a file. Lines end with LF or CRLF; the last one needs no end.
pub(super) struct Lines {
    path: PathBuf,
    file: File,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    is_ended: bool,
    /// Bytes of the file before the buffer.
    before: u64,
    /// The line that was returned last; the first is 1.
    number: u64,
    /// Where the last line is in the buffer, and whether it is to come again.
    last: (usize, usize),
    again: bool,
    /// Whether the last line has no end.
    is_cut: bool,
    reported: u64,
}

impl Lines {
    pub(super) fn new(path: &Path, file: File) -> Self {
        Self {
            path: path.to_owned(),
            file,
            buffer: vec![0; BUFFER],
            start: 0,
            end: 0,
            is_ended: false,
            before: 0,
            number: 0,
            last: (0, 0),
            again: false,
            is_cut: false,
            reported: 0,
        }
    }

    /// The next line without its end; `None` at the end of the file.
    #[inline]
    pub(super) fn next(&mut self) -> Result<Option<&[u8]>, ScanError> {
        if std::mem::take(&mut self.again) {
            return Ok(Some(self.last()));
        }
        loop {
            let here = &self.buffer[self.start..self.end];
            if let Some(length) = memchr::memchr(b'\n', here) {
                return Ok(Some(self.taken(length, 1)));
            }
            if here.len() > MAX_LINE {
                return Err(ScanError::malformed(
                    &self.path,
                    Place::Line(self.number + 1),
                    format!("a line of more than {MAX_LINE} bytes"),
                    "lines of numbers that end with a line feed",
                ));
            }
            if self.is_ended {
                let length = here.len();
                return Ok(if length == 0 { None } else { Some(self.taken(length, 0)) });
            }
            self.refill()?;
        }
    }

    /// Deliver the line that came last once more.
    pub(super) fn back(&mut self) {
        self.again = true;
    }

    /// The line that came last.
    pub(super) fn last(&self) -> &[u8] {
        &self.buffer[self.last.0..self.last.1]
    }

    /// Whether the line that came last is the last one of the file and has no end. Then the file may have been cut inside it.
    #[inline]
    pub(super) fn is_cut(&self) -> bool {
        self.is_cut
    }

    /// Whether no line is to come.
    pub(super) fn is_at_end(&mut self) -> Result<bool, ScanError> {
        Ok(self.peek(1)?.is_empty())
    }

    /// What is to come, up to `bytes`, which is less than a mebibyte; fewer at the end of the file.
    pub(super) fn peek(&mut self, bytes: usize) -> Result<&[u8], ScanError> {
        while !self.is_ended && self.end - self.kept() < bytes {
            self.refill()?;
        }
        let from = self.kept();
        Ok(&self.buffer[from..self.end.min(from + bytes)])
    }

    /// Where what is still needed begins in the buffer.
    fn kept(&self) -> usize {
        if self.again { self.last.0 } else { self.start }
    }

    fn taken(&mut self, length: usize, end: usize) -> &[u8] {
        let from = self.start;
        self.is_cut = end == 0;
        self.start += length + end;
        self.number += 1;
        let line = &self.buffer[from..from + length];
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        self.last = (from, from + line.len());
        line
    }

    fn refill(&mut self) -> Result<(), ScanError> {
        let from = self.kept();
        self.buffer.copy_within(from..self.end, 0);
        self.before += from as u64;
        self.end -= from;
        self.start -= from;
        if self.again {
            self.last = (0, self.last.1 - from);
        }
        loop {
            match self.file.read(&mut self.buffer[self.end..]) {
                Ok(0) => {
                    self.is_ended = true;
                    return Ok(());
                }
                Ok(n) => {
                    self.end += n;
                    return Ok(());
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(source) => {
                    let offset = self.before + self.end as u64;
                    return Err(ReadError::Io { file: self.path.clone(), offset, source }.into());
                }
            }
        }
    }

    /// Where the line is that came last.
    pub(super) fn place(&self) -> Place {
        Place::Line(self.number)
    }

    /// Where the line is that comes after `ahead` others.
    pub(super) fn place_of_next(&self, ahead: usize) -> Place {
        Place::Line(self.number + u64::from(!self.again) + ahead as u64)
    }

    /// Bytes read since the last call, in steps of a mebibyte: `Some` about once a mebibyte.
    #[inline]
    pub(super) fn step(&mut self) -> Option<u64> {
        let done = self.before + self.start as u64;
        if done < self.reported + BUFFER as u64 {
            return None;
        }
        self.reported = done;
        Some(done)
    }

    /// The error for something found in the line that came last.
    pub(super) fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> ScanError {
        ScanError::malformed(&self.path, self.place(), found, expected)
    }
}

#[inline]
fn is_blank(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | b',' | b';')
}

/// The numbers of a line, separated by blanks, tabs, commas or semicolons, into `out`; how many, or `Err` with the word that is no number. Words
/// beyond the length of `out` are counted but not looked at. NaN and infinities are numbers, also as C writes them.
#[inline]
pub(super) fn numbers<'l>(line: &'l [u8], out: &mut [f64]) -> Result<usize, &'l [u8]> {
    let (mut at, mut count) = (0, 0);
    loop {
        while line.get(at).is_some_and(|b| is_blank(*b)) {
            at += 1;
        }
        if at == line.len() {
            return Ok(count);
        }
        let end = || at + line[at..].iter().position(|b| is_blank(*b)).unwrap_or(line.len() - at);
        if count < out.len() {
            let (value, next) = match fast_float2::parse_partial::<f64, _>(&line[at..]) {
                Ok((value, used)) if line.get(at + used).is_none_or(|b| is_blank(*b)) => (value, at + used),
                _ => (not_finite(&line[at..end()]).ok_or_else(|| &line[at..end()])?, end()),
            };
            out[count] = value;
            at = next;
        } else {
            at = end();
        }
        count += 1;
    }
}

/// NaN for the forms in which C libraries write numbers that are none.
fn not_finite(word: &[u8]) -> Option<f64> {
    let lower = word.strip_prefix(b"-").unwrap_or(word).to_ascii_lowercase();
    let forms: [&[u8]; 5] = [b"nan(", b"1.#ind", b"1.#qnan", b"1.#snan", b"1.#inf"];
    forms.iter().any(|form| lower.starts_with(form)).then_some(f64::NAN)
}

/// A whole number alone in its line.
pub(super) fn whole(line: &[u8]) -> Option<u64> {
    let word = line.trim_ascii();
    if word.is_empty() || !word.iter().all(u8::is_ascii_digit) {
        return None;
    }
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Bytes of a line as a message can show them.
pub(super) fn quote(line: &[u8]) -> String {
    const SHOWN: usize = 60;
    let cut = if line.len() > SHOWN { "…" } else { "" };
    format!("\"{}{cut}\"", line[..line.len().min(SHOWN)].escape_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_are_those_of_the_standard_library(values in prop::collection::vec(any::<f64>(), 0..9), decimals in 0usize..12) {
            let words: Vec<String> = values
                .iter()
                .enumerate()
                .map(|(k, v)| if k % 2 == 0 { v.to_string() } else { format!("{:.decimals$}", v % 1e6) })
                .collect();
            let line = words.join(" \t");
            let mut out = [0.0; 8];
            let count = numbers(line.as_bytes(), &mut out).unwrap();
            prop_assert_eq!(count, words.len());
            for (word, value) in words.iter().zip(out) {
                let wanted: f64 = word.parse().unwrap();
                prop_assert!(wanted.to_bits() == value.to_bits() || wanted.is_nan() && value.is_nan());
            }
        }
    }

    #[test]
    fn words_that_are_no_numbers_are_returned() {
        let mut out = [0.0; 4];
        assert_eq!(numbers(b"1 2 x3 4", &mut out), Err(&b"x3"[..]));
        assert_eq!(numbers(b"1,5;2\t7", &mut out), Ok(4));
        assert_eq!(numbers(b"1.5.2", &mut out), Err(&b"1.5.2"[..]));
        assert_eq!(numbers(b"  ", &mut out), Ok(0));
        assert_eq!(numbers(b"1 -1.#IND nan(0x1) 4 word word", &mut out), Ok(6));
        assert!(out[1].is_nan() && out[2].is_nan());
        assert_eq!((whole(b" 12 "), whole(b"1 2"), whole(b"-1"), whole(b"")), (Some(12), None, None, None));
    }

    #[test]
    fn lines_are_numbered_correctly_with_any_line_ending() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let long = "7 ".repeat(30_000);
        std::fs::write(&path, format!("1 2\r\n\n3\n{long}\n4")).unwrap();
        let mut lines = Lines::new(&path, File::open(&path).unwrap());
        let mut all = Vec::new();
        while let Some(line) = lines.next().unwrap() {
            let line = line.to_vec();
            all.push((lines.number, line.len()));
        }
        assert_eq!(all, [(1, 3), (2, 0), (3, 1), (4, 60_000), (5, 1)]);
        std::fs::write(&path, "x".repeat(MAX_LINE + 2)).unwrap();
        let message = Lines::new(&path, File::open(&path).unwrap()).next().unwrap_err().to_string();
        assert!(message.contains("line 1") && message.contains("more than 65536 bytes"), "{message}");
    }
}

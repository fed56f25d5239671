//! The lines of an OBJ or MTL: LF, CRLF or CR at their ends, joined where a `\` ends them, with their numbers.

pub(super) use crate::read::number::number;
use crate::read::source::{BUFFER, Source};
use crate::read::{Place, ReadError};
use memchr::memchr;

/// Bytes of a line that was joined; one that was not is bounded by the buffer.
const MAX_JOINED: usize = BUFFER;

pub(super) struct Lines<'s, 'a> {
    source: &'s mut Source<'a>,
    /// The byte that ends lines: LF, or CR where the file has no LF.
    end: u8,
    /// The line handed out last, by the first of its lines where it was joined.
    number: u64,
    /// Physical lines used up.
    used: u64,
    joined: Vec<u8>,
}

impl<'s, 'a> Lines<'s, 'a> {
    /// The lines of the file, of which `source` stands at the beginning.
    pub(super) fn new(source: &'s mut Source<'a>) -> Result<Self, ReadError> {
        source.ensure(BUFFER)?;
        let start = source.available();
        let end = if memchr(b'\n', start).is_none() && memchr(b'\r', start).is_some() { b'\r' } else { b'\n' };
        let mark = if start.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        source.take(mark);
        Ok(Self { source, end, number: 0, used: 0, joined: Vec::new() })
    }

    /// The number of the line that comes next, by the first of its lines where it is joined; the first is 1.
    pub(super) fn next_number(&self) -> u64 {
        self.used + 1
    }

    /// The next line without its end and without blanks around it; `None` at the end of the file.
    pub(super) fn next(&mut self) -> Result<Option<&[u8]>, ReadError> {
        self.number = self.used + 1;
        let Some(n) = self.length()? else { return Ok(None) };
        self.used += 1;
        let is_cut = |line: &[u8]| line.trim_ascii_end().ends_with(b"\\");
        if !self.source.available().get(..n).is_some_and(is_cut) {
            return Ok(Some(self.source.take(n).trim_ascii()));
        }
        self.joined.clear();
        let mut n = n;
        loop {
            let line = self.source.take(n).trim_ascii_end();
            let cut = is_cut(line);
            self.joined.extend_from_slice(line.strip_suffix(b"\\").unwrap_or(line));
            self.joined.push(b' ');
            if self.joined.len() > MAX_JOINED {
                return Err(self.too_long());
            }
            match self.length()? {
                Some(more) if cut => n = more,
                _ => return Ok(Some(self.joined.trim_ascii())),
            }
            self.used += 1;
        }
    }

    /// Bytes of the physical line at the cursor with its end; all are then in the buffer.
    fn length(&mut self) -> Result<Option<usize>, ReadError> {
        let mut looked_at = 0;
        loop {
            let here = self.source.available();
            if let Some(n) = memchr(self.end, &here[looked_at..]) {
                return Ok(Some(looked_at + n + 1));
            }
            looked_at = here.len();
            if !self.source.refill()? {
                return match looked_at {
                    0 => Ok(None),
                    BUFFER => Err(self.too_long()),
                    n => Ok(Some(n)),
                };
            }
        }
    }

    fn too_long(&self) -> ReadError {
        let found = format!("a line of more than {BUFFER} bytes");
        self.source.malformed(Place::Line(self.number), found, "lines as an OBJ has them; the file is damaged")
    }
}

/// The next word of a line, and the rest; an empty word at its end or where a comment begins.
#[inline]
pub(super) fn word(line: &[u8]) -> (&[u8], &[u8]) {
    let line = line.trim_ascii_start();
    if line.first() == Some(&b'#') {
        return (&[], &[]);
    }
    line.split_at(line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len()))
}

/// Up to `N` numbers of a line and how many there are in all; `Err` with a word that is no number.
#[inline]
pub(super) fn numbers<const N: usize>(mut line: &[u8]) -> Result<([f64; N], usize), &[u8]> {
    let mut values = [0.0; N];
    let mut n = 0;
    loop {
        let (one, rest) = word(line);
        if one.is_empty() {
            return Ok((values, n));
        }
        let value = number(one).ok_or(one)?;
        if let Some(slot) = values.get_mut(n) {
            *slot = value;
        }
        n += 1;
        line = rest;
    }
}

//! Rows of text files: one row a line, words between spaces; LF, CRLF and CR line ends.
//!
//! Tolerated and counted: words after the last one of a row, comment lines among the data. Blank lines count for nothing.

use super::elements::{Columns, Cursor, Row, Rows};
use super::plan::Field;
use super::scalar::Scalar;
use super::{Place, ReadError};
use crate::Diagnostics;
use crate::read::number::number;
use crate::read::source::{Source, quote};

/// A word longer than this is no number.
const MAX_WORD: usize = 4096;

pub(super) struct Ascii<'s, 'a> {
    source: &'s mut Source<'a>,
    /// The line the cursor is in; the first is 1.
    line: u64,
}

impl<'s, 'a> Ascii<'s, 'a> {
    /// Rows that begin after a header of so many lines.
    pub(super) fn new(source: &'s mut Source<'a>, header_lines: u64) -> Self {
        Self { source, line: header_lines + 1 }
    }

    /// Pass over the blanks before the next word; `false` where the line or the file ends first.
    #[inline]
    fn seek_word(&mut self) -> Result<bool, ReadError> {
        loop {
            let here = self.source.available();
            let blanks = here.iter().take_while(|&&b| is_blank(b)).count();
            let next = here.get(blanks).copied();
            self.source.take(blanks);
            match next {
                Some(b) => return Ok(!is_line_end(b)),
                None if self.source.refill()? => {}
                None => return Ok(false),
            }
        }
    }

    /// The length of the word at the cursor, all of which is then in the buffer.
    #[inline]
    fn word_length(&mut self) -> Result<usize, ReadError> {
        loop {
            let here = self.source.available();
            let end = here.iter().position(|&b| is_blank(b) || is_line_end(b));
            if let Some(n) = end.filter(|&n| n <= MAX_WORD) {
                return Ok(n);
            }
            if here.len() > MAX_WORD {
                let found = format!("a word of more than {MAX_WORD} characters: {}", quote(here));
                return Err(self.source.malformed(Place::Line(self.line), found, "a number"));
            }
            if !self.source.refill()? {
                return Ok(self.source.available().len());
            }
        }
    }

    /// The next word of the line; it is used up.
    #[inline]
    fn word(&mut self, row: Row<'_>, field: &Field) -> Result<&[u8], ReadError> {
        if self.seek_word()? {
            let n = self.word_length()?;
            Ok(self.source.take(n))
        } else {
            Err(self.cut(row, field))
        }
    }

    fn cut(&self, row: Row<'_>, field: &Field) -> ReadError {
        let what = if self.source.available().is_empty() { "file" } else { "line" };
        self.source.malformed(
            Place::Line(self.line),
            format!("the end of the {what} in {} {} of {}", row.element.name, row.number, row.element.count),
            format!("a value of the property {}", field.name),
        )
    }

    /// Pass over the rest of the line and its end; how many words there were.
    fn leave_line(&mut self) -> Result<u64, ReadError> {
        let mut words = 0;
        while self.seek_word()? {
            words += 1;
            self.pass_word()?;
        }
        if self.source.ensure(1)? {
            let cr = self.source.take(1) == b"\r";
            if cr && self.source.ensure(1)? && self.source.available().first() == Some(&b'\n') {
                self.source.take(1);
            }
            self.line += 1;
        }
        Ok(words)
    }

    /// Pass over the word at the cursor, however long.
    fn pass_word(&mut self) -> Result<(), ReadError> {
        loop {
            let here = self.source.available();
            let n = here.iter().position(|&b| is_blank(b) || is_line_end(b));
            let all = here.len();
            self.source.take(n.unwrap_or(all));
            if n.is_some() || !self.source.refill()? {
                return Ok(());
            }
        }
    }

    /// Go to the next word, over line ends and comment lines; `false` at the end of the file.
    fn seek_row(&mut self, diagnostics: &mut Diagnostics) -> Result<bool, ReadError> {
        loop {
            if self.seek_word()? {
                if !matches!(self.source.available().first(), Some(b'c' | b'o')) {
                    return Ok(true);
                }
                let n = self.word_length()?;
                if !matches!(self.source.available().get(..n), Some(b"comment" | b"obj_info")) {
                    return Ok(true);
                }
                let line = self.line;
                diagnostics.add("comment lines among the data passed over", || format!("line {line}"));
            } else if self.source.available().is_empty() {
                return Ok(false);
            }
            self.leave_line()?;
        }
    }

    fn bad_word(&self, row: Row<'_>, field: &Field, word: &str, expected: &str) -> ReadError {
        let hint = if word.contains(',') { " (numbers are written with a point, not a comma)" } else { "" };
        self.fault(row, field, word.to_owned(), format!("{expected}{hint}"))
    }
}

fn is_blank(b: u8) -> bool {
    matches!(b, b' ' | b'\t' | 0x0b | 0x0c)
}

fn is_line_end(b: u8) -> bool {
    matches!(b, b'\n' | b'\r')
}

/// The whole number a word represents.
#[inline]
fn parse_integer(word: &[u8]) -> Option<i64> {
    let (negative, digits) = match word {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, word),
    };
    if digits.is_empty() {
        return None;
    }
    let mut value = 0i64;
    for &b in digits {
        if !b.is_ascii_digit() {
            return None;
        }
        value = value.checked_mul(10)?.checked_add(i64::from(b - b'0'))?;
    }
    Some(if negative { -value } else { value })
}

impl Rows for Ascii<'_, '_> {
    fn place(&self) -> Cursor {
        Cursor { offset: self.source.offset(), line: self.line }
    }

    fn go_to(&mut self, cursor: Cursor) -> Result<(), ReadError> {
        self.line = cursor.line;
        self.source.go_to(cursor.offset)
    }

    fn begin(&mut self, row: Row<'_>, diagnostics: &mut Diagnostics) -> Result<(), ReadError> {
        if self.seek_row(diagnostics)? {
            return Ok(());
        }
        let Row { element, number } = row;
        Err(self.source.malformed(
            Place::Line(self.line),
            format!("the end of the file before {} {number} of {}", element.name, element.count),
            "the rest of the rows; the file is truncated or its header is wrong: copy or export it again",
        ))
    }

    fn number(&mut self, row: Row<'_>, field: &Field, _: Scalar) -> Result<f64, ReadError> {
        let word = self.word(row, field)?;
        if let Some(value) = number(word) {
            return Ok(value);
        }
        let word = quote(word);
        Err(self.bad_word(row, field, &word, "a number"))
    }

    #[inline]
    fn integer(&mut self, row: Row<'_>, field: &Field, _: Scalar) -> Result<i64, ReadError> {
        let word = self.word(row, field)?;
        if let Some(value) = parse_integer(word) {
            return Ok(value);
        }
        let word = quote(word);
        Err(self.bad_word(row, field, &word, "a whole number"))
    }

    fn pass(&mut self, row: Row<'_>, field: &Field, _: Scalar, n: u64) -> Result<(), ReadError> {
        for _ in 0..n {
            if !self.seek_word()? {
                return Err(self.cut(row, field));
            }
            self.pass_word()?;
        }
        Ok(())
    }

    fn end(&mut self, _: Row<'_>, diagnostics: &mut Diagnostics) -> Result<(), ReadError> {
        let line = self.line;
        if self.leave_line()? > 0 {
            diagnostics.add("lines with more words than the header declares", || format!("line {line}"));
        }
        Ok(())
    }

    fn can_hold(&self, _: Scalar, n: u64) -> bool {
        // A word takes a character and the space before it.
        n <= self.source.remaining() / 2
    }

    fn fault(&self, row: Row<'_>, field: &Field, found: String, expected: String) -> ReadError {
        let found = format!("{found} in {} {} (property {})", row.element.name, row.number, field.name);
        self.source.malformed(Place::Line(self.line), found, expected)
    }

    fn block(&mut self, _: Row<'_>, _: &[Field], _: u64, _: &mut Columns) -> Result<usize, ReadError> {
        Ok(0)
    }

    fn triangles(&mut self, _: &[Field], _: u64, _: usize, _: u64, _: &mut Vec<[u64; 3]>) -> Result<usize, ReadError> {
        Ok(0)
    }

    fn pass_all(&mut self, _: Row<'_>, _: &[Field]) -> Result<bool, ReadError> {
        Ok(false)
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) -> Result<(), ReadError> {
        while self.seek_row(diagnostics)? {
            let line = self.line;
            diagnostics.add("lines after the last element ignored", || format!("line {line}"));
            self.leave_line()?;
        }
        Ok(())
    }
}

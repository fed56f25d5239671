//! Lists of points that other programs export: the index of each point in the file that was imported, one a line.

use crate::ScanError;
use kilwa_formats::read::Place;
use std::io::{self, BufRead};
use std::path::Path;

/// Longest line, bytes.
const LINE_MAX: usize = 4096;

/// Read a list. Each line has one number, or several, separated by blanks, commas or semicolons, of which `column` (from 1) is the index; empty lines, lines
/// that begin with `#` or `//`, and one line of names at the top are left out. Indices count from 0 and may be written as `12.000`. `found` is called
/// with each index and its line.
///
/// # Errors
/// [`ScanError::Read`] with the line, what was found and what was expected; what `found` returns.
pub fn read_list(
    file: &Path,
    source: &mut dyn BufRead,
    column: Option<usize>,
    found: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let (mut text, mut number, mut may_be_names) = (Vec::new(), 0, true);
    loop {
        text.clear();
        number += 1;
        let read = io::Read::take(&mut *source, LINE_MAX as u64 + 1).read_until(b'\n', &mut text);
        let bytes = read.map_err(|source| kilwa_formats::read::ReadError::Open { file: file.to_owned(), source })?;
        if bytes == 0 {
            return Ok(());
        }
        let wrong = |what: String, expected: &str| ScanError::malformed(file, Place::Line(number), what, expected);
        if bytes > LINE_MAX {
            return Err(wrong(format!("a line of more than {LINE_MAX} bytes"), "the index of a point"));
        }
        let line = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text).trim_ascii();
        if line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//") {
            continue;
        }
        let is_names = std::mem::take(&mut may_be_names) && line.iter().any(u8::is_ascii_alphabetic);
        let is_between = |byte: &u8| byte.is_ascii_whitespace() || matches!(byte, b',' | b';');
        let words: Vec<&[u8]> = line.split(is_between).filter(|word| !word.is_empty()).collect();
        if is_names && words.iter().all(|word| word.first().is_some_and(|c| !c.is_ascii_digit())) {
            continue;
        }
        let word = match column {
            None if words.len() > 1 => {
                let expected = "one index; choose the column of the index with --column";
                return Err(wrong(format!("{} numbers in a line", words.len()), expected));
            }
            None => words.first(),
            Some(column) => words.get(column.wrapping_sub(1)),
        };
        let Some(word) = word else {
            let what = format!("{} columns", words.len());
            return Err(wrong(what, "the index in the column given by --column"));
        };
        let Some(index) = index(word) else {
            let what = format!("\"{}\"", String::from_utf8_lossy(&word[..word.len().min(40)]));
            return Err(wrong(what, "the index of a point, a whole number of 0 or more"));
        };
        found(index, number)?;
    }
}

/// A whole number, also with a decimal point and zeros behind it.
fn index(word: &[u8]) -> Option<u64> {
    let whole = match word.iter().position(|c| *c == b'.') {
        Some(point) if word[point + 1..].iter().all(|c| *c == b'0') => &word[..point],
        Some(_) => return None,
        None => word,
    };
    if whole.is_empty() || !whole.iter().all(u8::is_ascii_digit) {
        return None;
    }
    std::str::from_utf8(whole).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, column: Option<usize>) -> Result<Vec<u64>, String> {
        let mut all = Vec::new();
        let done = read_list(Path::new("edit.txt"), &mut text.as_bytes(), column, &mut |index, _| {
            all.push(index);
            Ok(())
        });
        done.map(|()| all).map_err(|e| e.to_string())
    }

    #[test]
    fn lists_are_read_as_programs_write_them() {
        assert_eq!(read("3\n1\n\n2\n", None).unwrap(), [3, 1, 2]);
        assert_eq!(read("\u{feff}# edited\n//x\nindex\r\n7\r\n8.000\n9", None).unwrap(), [7, 8, 9]);
        assert_eq!(read("//X Y Z index\n1.5 2 -3 11.000000\n1,2,3,12\n", Some(4)).unwrap(), [11, 12]);
        assert_eq!(read("", None).unwrap(), Vec::<u64>::new());
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        for (text, column, parts) in [
            ("1\n-2\n", None, ["line 2", "\"-2\""]),
            ("1\n2.5\n", None, ["line 2", "\"2.5\""]),
            ("1\nname\n", None, ["line 2", "\"name\""]),
            ("1 2 3\n", None, ["line 1", "--column"]),
            ("1 2 3\n", Some(4), ["line 1", "3 columns"]),
            ("99999999999999999999999\n", None, ["line 1", "whole number"]),
        ] {
            let message = read(text, column).unwrap_err();
            assert!(parts.iter().all(|part| message.contains(part)) && message.contains("edit.txt"), "{message}");
        }
    }
}

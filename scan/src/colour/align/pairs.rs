//! Files with points that are known in the reconstruction and in the survey.
//!
//! Text, a point per line: its name, x y z in the reconstruction, x y z in the survey (metres), and if known the standard deviation of their difference (metres). Columns are separated by
//! commas, semicolons, tabs or spaces; names with such characters stand in double quotes. Lines that begin with `#` are comments.

use crate::ScanError;
use glam::DVec3;
use kilwa_files::plain_file;
use kilwa_formats::read::{Place, ReadError};
use kilwa_scan_core::photo_pose::similarity::Pair;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// The standard deviation of a point where none is given, metres.
pub const SIGMA: f64 = 0.01;
/// Most points.
const MAX_PAIRS: usize = 100_000;
/// The longest line, bytes.
const MAX_LINE: u64 = 4_096;

/// A point that is known in both frames, with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPair {
    /// The name.
    pub name: String,
    /// The point.
    pub pair: Pair,
}

/// Read a file with pairs of points.
///
/// # Errors
/// [`ScanError::Read`] with the line: it cannot be read, a column is missing or no number, or two points have the same name.
pub fn read(file: &Path) -> Result<Vec<NamedPair>, ScanError> {
    let failed = |source| ReadError::Io { path: file.to_owned(), source };
    let mut reader = BufReader::new(plain_file::open(file).map_err(failed)?);
    let mut out: Vec<NamedPair> = Vec::new();
    let mut line = String::new();
    for number in 1.. {
        let malformed = |found: String, expected: &str| ScanError::malformed(file, Place::Line(number), found, expected);
        line.clear();
        let read = reader.by_ref().take(MAX_LINE).read_line(&mut line);
        match read {
            Ok(0) => break,
            Ok(count) if count as u64 == MAX_LINE => {
                return Err(malformed(format!("a line of more than {MAX_LINE} bytes"), "a point per line"));
            }
            Ok(_) => {}
            Err(e) if e.kind() == std::io::ErrorKind::InvalidData => {
                return Err(malformed("bytes that are not UTF-8".to_owned(), "text"));
            }
            Err(e) => return Err(failed(e).into()),
        }
        let text = line.trim_start_matches('\u{feff}').trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let pair = parsed(text).map_err(|(found, expected)| malformed(found, expected))?;
        if out.iter().any(|other| other.name == pair.name) {
            return Err(malformed(format!("a second point {}", pair.name), "a different name for each point"));
        }
        if out.len() == MAX_PAIRS {
            return Err(malformed(format!("more than {MAX_PAIRS} points"), "fewer points"));
        }
        out.push(pair);
    }
    Ok(out)
}

/// The point of a line; or what was found, and what was expected.
fn parsed(text: &str) -> Result<NamedPair, (String, &'static str)> {
    const EXPECTED: &str = "a name, three coordinates in the reconstruction, three in the survey, and optionally a standard deviation";
    let (name, rest) = match text.strip_prefix('"') {
        Some(quoted) => quoted.split_once('"').ok_or(("a name without a closing quote".to_owned(), EXPECTED))?,
        None => text.split_once(is_separator).unwrap_or((text, "")),
    };
    let columns: Vec<&str> = rest.split(is_separator).filter(|column| !column.is_empty()).collect();
    if !(6..=7).contains(&columns.len()) {
        return Err((format!("{} columns", columns.len() + 1), EXPECTED));
    }
    let mut numbers = [SIGMA; 7];
    for (number, column) in numbers.iter_mut().zip(&columns) {
        let value: Option<f64> = column.parse().ok().filter(|value: &f64| value.is_finite());
        *number = value.ok_or_else(|| (format!("{column:?}"), "a number"))?;
    }
    let [a, b, c, x, y, z, sigma] = numbers;
    if sigma <= 0.0 {
        return Err((format!("the standard deviation {sigma}"), "a positive number of metres"));
    }
    let pair = Pair { reconstruction: DVec3::new(a, b, c), survey: DVec3::new(x, y, z), sigma };
    Ok(NamedPair { name: name.to_owned(), pair })
}

fn is_separator(c: char) -> bool {
    matches!(c, ',' | ';') || c.is_whitespace()
}

//! Files with points that are known in the reconstruction and in the survey.
//!
//! Text, a point per line: its name, x y z in the reconstruction, x y z in the survey (metres), and if known the standard deviation of their difference (metres). Columns are separated by
//! commas, semicolons, tabs or spaces; names with such characters stand in double quotes. Lines that begin with `#` are comments.

use crate::ScanError;
use crate::photos::text::{Lines, number, quoted};
use glam::DVec3;
use kilwa_scan_core::photo_pose::similarity::Pair;
use std::collections::HashSet;
use std::path::Path;

/// The standard deviation of a point where none is given, metres.
pub const SIGMA: f64 = 0.01;
/// Most points.
const MAX_PAIRS: usize = 100_000;

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
    let mut lines = Lines::open(file)?;
    let mut out: Vec<NamedPair> = Vec::new();
    let mut names = HashSet::new();
    while let Some(text) = lines.next_content()? {
        let pair = match parsed(text.trim_start_matches('\u{feff}')) {
            Ok(pair) => pair,
            Err((found, expected)) => return Err(lines.wrong(found, expected)),
        };
        if !names.insert(pair.name.clone()) {
            return Err(
                lines.wrong(format!("a second point {}", quoted(&pair.name)), "a different name for each point")
            );
        }
        if out.len() == MAX_PAIRS {
            return Err(lines.wrong(format!("more than {MAX_PAIRS} points"), "fewer points"));
        }
        out.push(pair);
    }
    Ok(out)
}

/// The point of a line; or what was found, and what was expected.
fn parsed(text: &str) -> Result<NamedPair, (String, &'static str)> {
    const EXPECTED: &str =
        "a name, three coordinates in the reconstruction, three in the survey, and optionally a standard deviation";
    let (name, rest) = match text.strip_prefix('"') {
        Some(quoted) => quoted.split_once('"').ok_or(("a name without a closing quote".to_owned(), EXPECTED))?,
        None => text.split_once(is_separator).unwrap_or((text, "")),
    };
    let columns: Vec<&str> = rest.split(is_separator).filter(|column| !column.is_empty()).collect();
    if !(6..=7).contains(&columns.len()) {
        return Err((format!("{} columns", columns.len() + 1), EXPECTED));
    }
    let mut numbers = [SIGMA; 7];
    for (value, column) in numbers.iter_mut().zip(&columns) {
        *value = number(column).ok_or_else(|| (quoted(column), "a number"))?;
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

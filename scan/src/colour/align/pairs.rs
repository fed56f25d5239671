//! Files with points that are known in the reconstruction and in the survey, and files with known positions of cameras.
//!
//! Text, a point per line: its name, x y z in the reconstruction, x y z in the survey (metres), and optionally the standard deviation of their difference (metres).
//! For a camera: the name of its photograph, x y z in the survey (metres), and optionally their standard deviation (metres). Columns are separated by
//! commas, semicolons, tabs or spaces; names with such characters are in double quotes. Lines that begin with `#` are comments.

use crate::ScanError;
use crate::photos::text::{Lines, number, quoted};
use glam::DVec3;
use kilwa_scan_core::photo_pose::similarity::Pair;
use std::collections::HashSet;
use std::path::Path;

/// The standard deviation of a point where none is given, metres.
pub const SIGMA: f64 = 0.01;
/// The same for the position of a camera: roughly that of satellite positioning with corrections.
pub const CAMERA_SIGMA: f64 = 0.1;
/// Maximum number of lines of a file.
const MAX_ROWS: usize = 100_000;

/// A point that is known in both frames, with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPair {
    /// The name.
    pub name: String,
    /// The point.
    pub pair: Pair,
}

/// A camera whose position is known: the name of its photograph, the position in the survey (metres), and its standard deviation (metres).
pub type KnownCamera = (String, DVec3, f64);

/// Read a file with pairs of points.
///
/// # Errors
/// [`ScanError::Read`] with the line: it cannot be read, a column is missing or no number, or two points have the same name.
pub fn read(file: &Path) -> Result<Vec<NamedPair>, ScanError> {
    const EXPECTED: &str =
        "a name, three coordinates in the reconstruction, three in the survey, and optionally a standard deviation";
    let named = |(name, [a, b, c, x, y, z], sigma): Row<6>| {
        let pair = Pair { reconstruction: DVec3::new(a, b, c), survey: DVec3::new(x, y, z), sigma };
        NamedPair { name, pair }
    };
    Ok(named_rows(file, SIGMA, EXPECTED)?.into_iter().map(named).collect())
}

/// Read a file with known positions of cameras.
///
/// # Errors
/// As [`read`].
pub fn read_cameras(file: &Path) -> Result<Vec<KnownCamera>, ScanError> {
    const EXPECTED: &str =
        "the name of a photograph, three coordinates in the survey, and optionally a standard deviation";
    let rows = named_rows(file, CAMERA_SIGMA, EXPECTED)?;
    Ok(rows.into_iter().map(|(name, at, sigma)| (name, DVec3::from_array(at), sigma)).collect())
}

/// A line of `N` coordinates: its name, the coordinates, and the standard deviation.
type Row<const N: usize> = (String, [f64; N], f64);

/// The lines of a file; all names must differ. `sigma`: the default standard deviation.
fn named_rows<const N: usize>(file: &Path, sigma: f64, expected: &'static str) -> Result<Vec<Row<N>>, ScanError> {
    let mut lines = Lines::open(file)?;
    let mut out: Vec<Row<N>> = Vec::new();
    let mut names = HashSet::new();
    while let Some(text) = lines.next_content()? {
        let row: Row<N> = match parsed(text.trim_start_matches('\u{feff}'), sigma, expected) {
            Ok(row) => row,
            Err((found, expected)) => return Err(lines.wrong(found, expected)),
        };
        if !names.insert(row.0.clone()) {
            return Err(lines.wrong(format!("a second line for {}", quoted(&row.0)), "a different name in each line"));
        }
        if out.len() == MAX_ROWS {
            return Err(lines.wrong(format!("more than {MAX_ROWS} lines"), "fewer"));
        }
        out.push(row);
    }
    Ok(out)
}

/// The values of a line; or what was found, and what was expected.
fn parsed<const N: usize>(text: &str, sigma: f64, expected: &'static str) -> Result<Row<N>, (String, &'static str)> {
    let (name, rest) = match text.strip_prefix('"') {
        Some(quoted) => quoted.split_once('"').ok_or(("a name without a closing quote".to_owned(), expected))?,
        None => text.split_once(is_separator).unwrap_or((text, "")),
    };
    let columns: Vec<&str> = rest.split(is_separator).filter(|column| !column.is_empty()).collect();
    if !(N..=N + 1).contains(&columns.len()) {
        return Err((format!("{} columns", columns.len() + 1), expected));
    }
    let read = |column: &&str| number(column).ok_or_else(|| (quoted(column), "a number"));
    let mut coordinates = [0.0; N];
    for (value, column) in coordinates.iter_mut().zip(&columns) {
        *value = read(column)?;
    }
    let sigma = columns.get(N).map(read).transpose()?.unwrap_or(sigma);
    if sigma <= 0.0 {
        return Err((format!("the standard deviation {sigma}"), "a positive number of metres"));
    }
    Ok((name.to_owned(), coordinates, sigma))
}

fn is_separator(c: char) -> bool {
    matches!(c, ',' | ';') || c.is_whitespace()
}

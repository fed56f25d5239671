//! Which format a file has.

use super::lines::{numbers, whole};
use super::order::has_decimal_commas;
use super::{beginning, ptx};
use crate::ScanError;
use std::path::Path;

/// How much of the beginning is looked at.
const SNIFFED: u64 = 16 * 1024;

/// A format that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Leica PTX, text with grids.
    Ptx,
    /// Leica PTS, text without grids.
    Pts,
    /// Text of columns.
    Xyz,
    /// ASTM E2807.
    E57,
    /// ASPRS LAS, or LAZ, which is LAS compressed.
    Las,
    /// PLY with a range grid, or of points alone.
    Ply,
}

/// Endings under which files in a folder are scans.
pub const EXTENSIONS: [&str; 7] = ["ptx", "pts", "e57", "las", "laz", "ply", "xyz"];

/// The format of the file at `path`.
///
/// # Errors
/// [`ScanError::Format`] where it is none that is read; [`kilwa_formats::read::ReadError::Open`] where it cannot be opened.
pub fn recognise(path: &Path) -> Result<Format, ScanError> {
    let start = beginning(path, SNIFFED)?;
    of(&start, path).ok_or_else(|| refusal(&start, path))
}

fn of(start: &[u8], path: &Path) -> Option<Format> {
    if start.starts_with(b"ASTM-E57") {
        return Some(Format::E57);
    }
    if start.starts_with(b"LASF") {
        return Some(Format::Las);
    }
    if start.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace)) {
        return Some(Format::Ply);
    }
    if ptx::is_ptx(start) || has_extension(path, "ptx") && first_line(start).is_some_and(|line| whole(line).is_some()) {
        return Some(Format::Ptx);
    }
    text(start, path)
}

/// PTS or XYZ: the first line of numbers decides.
fn text(start: &[u8], path: &Path) -> Option<Format> {
    let is_pts = has_extension(path, "pts");
    let lines = start.split(|b| *b == b'\n').map(<[u8]>::trim_ascii);
    let mut lines = lines.filter(|line| !line.is_empty() && !line.starts_with(b"#") && !line.starts_with(b"//"));
    let first = lines.next()?;
    if whole(first).is_some() {
        return Some(Format::Pts);
    }
    // Of numbers with decimal commas the reader says what is wrong with them.
    let has_points = |line: &[u8]| numbers(line, &mut [0.0; 8]).is_ok_and(|n| (3..=7).contains(&n));
    let fits = |line: &[u8]| has_points(line) || has_decimal_commas(line);
    // Names of columns may be in the first line.
    let is = fits(first) || lines.next().is_some_and(fits) && first.is_ascii();
    is.then_some(if is_pts { Format::Pts } else { Format::Xyz })
}

fn first_line(start: &[u8]) -> Option<&[u8]> {
    start.split(|b| *b == b'\n').map(<[u8]>::trim_ascii).find(|line| !line.is_empty())
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Whether a file in a folder is meant to be a scan, by its name.
pub fn is_named_as_scan(path: &Path) -> bool {
    EXTENSIONS.iter().any(|extension| has_extension(path, extension))
}

fn refusal(start: &[u8], path: &Path) -> ScanError {
    const EXPORT: &str = "Export the scans as E57 or PTX with the program of the scanner.";
    const RAW: &str = "It is in a proprietary scanner format, which Kilwa does not read; export the scans as E57 or PTX with the manufacturer's software.";
    let by_name: &[(&[&str], &str, &str)] = &[
        (&["fls", "fws", "lsproj"], "a FARO scan or project", RAW),
        (&["zfs", "zfprj"], "a Zoller+Fröhlich scan or project", RAW),
        (&["rxp", "rdbx", "rsp"], "a RIEGL scan or project", RAW),
        (&["imp", "lgs", "lgsx", "bin"], "a Leica project or a binary file", RAW),
        (&["rcp", "rcs"], "an Autodesk ReCap project", EXPORT),
        (&["clr", "cl3"], "a Topcon scan", RAW),
        (&["pcd"], "a PCD point cloud", "Convert it to PLY, or to LAS."),
        (&["obj", "stl", "glb", "gltf"], "a mesh", "Build it with `kilwa build`."),
        (&["zip", "gz", "7z", "rar"], "an archive", "Unpack it first."),
    ];
    let known = by_name.iter().find(|(endings, ..)| endings.iter().any(|e| has_extension(path, e)));
    let (what, way_out) = match known {
        _ if start.is_empty() => ("empty (0 bytes)", EXPORT),
        Some((_, what, way_out)) => (*what, *way_out),
        None if super::sniff::is_named_as_scan(path) => ("named as a scan, but its content is not one", EXPORT),
        None => ("in an unknown format", EXPORT),
    };
    ScanError::Format { file: path.to_owned(), what: what.to_owned(), way_out }
}

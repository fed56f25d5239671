//! What one line of an OBJ says: a vertex with its colour, a corner of a face.

use super::lines::{number, numbers, word};
use crate::read::source::quote;
use glam::{DVec2, DVec3};
use kilwa_pack::plural::counted;

/// A corner of a face: numbers from 0 of position, and of texture coordinates and normal where it has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) vertex: u64,
    pub(super) uv: Option<u64>,
    pub(super) normal: Option<u64>,
}

/// A vertex as its line has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vertex {
    pub(super) position: DVec3,
    /// As it stands there.
    pub(super) color: Option<DVec3>,
    /// Whether there is a weight other than 1.
    pub(super) weighted: bool,
}

/// What was found, and what was expected.
pub(super) type Fault = (String, String);

/// `v x y z [w] [r g b]`.
pub(super) fn vertex(rest: &[u8]) -> Result<Vertex, Fault> {
    let (v, n) = numbers::<7>(rest).map_err(bad_number)?;
    if n < 3 {
        return Err((
            format!("a vertex of {}", counted(n, "number", "numbers")),
            "x, y and z; the file is truncated or damaged".to_owned(),
        ));
    }
    let color = match n {
        6 => Some(DVec3::from_slice(&v[3..])),
        7.. => Some(DVec3::from_slice(&v[4..])),
        _ => None,
    };
    Ok(Vertex { position: DVec3::from_slice(&v), color, weighted: matches!(n, 4 | 7) && v[3] != 1.0 })
}

/// `vt u [v [w]]`.
pub(super) fn uv(rest: &[u8]) -> Result<DVec2, Fault> {
    match numbers::<2>(rest).map_err(bad_number)? {
        (_, 0) => Err(("texture coordinates without a number".to_owned(), "u and v".to_owned())),
        (uv, _) => Ok(uv.into()),
    }
}

/// `vn x y z`.
pub(super) fn normal(rest: &[u8]) -> Result<DVec3, Fault> {
    match numbers::<3>(rest).map_err(bad_number)? {
        (_, n @ 0..3) => Err((format!("a normal of {}", counted(n, "number", "numbers")), "x, y and z".to_owned())),
        (normal, _) => Ok(normal.into()),
    }
}

fn bad_number(word: &[u8]) -> Fault {
    let hint = if word.contains(&b',') { " (numbers are written with a point, not a comma)" } else { "" };
    (quote(word), format!("a number{hint}"))
}

/// How many of each there are: so far, which negative indices count from, and in the whole file.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub(super) vertices: u64,
    pub(super) uvs: u64,
    pub(super) normals: u64,
}

/// The corners of `f v/vt/vn …`. Texture coordinates and normals that do not exist are left out and counted in
/// `missing`; a vertex that does not exist is a fault.
pub(super) fn corners(
    mut rest: &[u8],
    so_far: &Counts,
    all: &Counts,
    corners: &mut Vec<Corner>,
    missing: &mut u64,
) -> Result<(), Fault> {
    corners.clear();
    loop {
        let (one, more) = word(rest);
        if one.is_empty() {
            return Ok(());
        }
        rest = more;
        let mut parts = one.split(|&b| b == b'/');
        let mut part = || match parts.next() {
            None | Some([]) => Ok(None),
            Some(digits) => index(digits)
                .map(Some)
                .ok_or_else(|| (quote(one), "a corner as 1, 1/2, 1//3 or 1/2/3, in whole numbers".to_owned())),
        };
        let (vertex, uv, normal) = (part()?, part()?, part()?);
        let Some(vertex) = vertex else {
            return Err((quote(one), "a corner that names a vertex".to_owned()));
        };
        let Some(vertex) = absolute(vertex, so_far.vertices, all.vertices) else {
            let negative = if so_far.vertices > 0 { format!(" or -1 to -{}", so_far.vertices) } else { String::new() };
            return Err((
                format!("vertex index {vertex}"),
                format!("1 to {}{negative}; the file is truncated or damaged, export it again", all.vertices),
            ));
        };
        let mut optional = |index: Option<i64>, so_far: u64, all: u64| {
            let found = index.and_then(|i| absolute(i, so_far, all));
            *missing += u64::from(found.is_none() && index.is_some());
            found
        };
        let uv = optional(uv, so_far.uvs, all.uvs);
        let normal = optional(normal, so_far.normals, all.normals);
        corners.push(Corner { vertex, uv, normal });
    }
}

/// From 1, or from the end where negative, to a number from 0.
#[inline]
fn absolute(index: i64, so_far: u64, all: u64) -> Option<u64> {
    if index > 0 {
        Some(index.unsigned_abs() - 1).filter(|&i| i < all)
    } else {
        so_far.checked_sub(index.unsigned_abs()).filter(|_| index < 0)
    }
}

/// The whole number a word represents.
#[inline]
fn index(digits: &[u8]) -> Option<i64> {
    let (negative, plain) = match digits {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, digits),
    };
    if plain.is_empty() || plain.len() > 18 {
        return None;
    }
    let mut value = 0i64;
    for &b in plain {
        if !b.is_ascii_digit() {
            // Some writers give indices as floats.
            return number(digits).filter(|v| v.fract() == 0.0 && v.abs() < 1e15).map(|v| v as i64);
        }
        value = value * 10 + i64::from(b - b'0');
    }
    Some(if negative { -value } else { value })
}

//! The first pass over an OBJ: what it has, so that the second can hand on each vertex in its final form.
//!
//! Counts what is not kept. Colours are looked at for their range alone; numbers are checked in the second pass.

use super::lines::{Lines, numbers, word};
use super::material::{LONGEST_NAME, text};
use crate::Diagnostics;
use crate::read::ReadError;
use std::collections::BTreeMap;

/// Names of materials and libraries kept, and the bytes that either may take together.
const MAX_NAMES: usize = 1 << 16;
const MAX_BYTES: usize = 16 << 20;

/// Names, each with the line that it stands in first.
#[derive(Debug, Default)]
pub(super) struct Names {
    /// By name.
    pub(super) lines: BTreeMap<String, u64>,
    bytes: usize,
}

impl Names {
    fn add(&mut self, rest: &[u8], line: u64) {
        if self.lines.len() >= MAX_NAMES || self.bytes >= MAX_BYTES {
            return;
        }
        let name = text(&rest[..rest.len().min(LONGEST_NAME)]);
        if !self.lines.contains_key(&name) {
            self.bytes += name.len();
            self.lines.insert(name, line);
        }
    }
}

/// What an OBJ has.
#[derive(Debug, Default)]
pub(super) struct Survey {
    pub(super) vertices: u64,
    pub(super) uvs: u64,
    pub(super) normals: u64,
    pub(super) faces: u64,
    /// Lines, points and free-form elements.
    pub(super) others: u64,
    /// Whether corners of faces name texture coordinates, normals.
    pub(super) uses_uvs: bool,
    pub(super) uses_normals: bool,
    pub(super) has_colors: bool,
    /// The largest colour component.
    pub(super) largest_color: f64,
    pub(super) libraries: Names,
    pub(super) materials: Names,
}

impl Survey {
    /// Look at all lines; what is not kept is counted.
    pub(super) fn read(lines: &mut Lines<'_, '_>, diagnostics: &mut Diagnostics) -> Result<Self, ReadError> {
        let mut survey = Self::default();
        loop {
            let number = lines.next_number();
            let Some(line) = lines.next()? else { return Ok(survey) };
            let (keyword, rest) = word(line);
            match keyword {
                b"v" => survey.vertex(rest),
                b"vt" => survey.uvs += 1,
                b"vn" => survey.normals += 1,
                b"f" | b"fo" => survey.face(rest),
                b"usemtl" => survey.materials.add(rest, number),
                b"mtllib" => survey.libraries.add(rest, number),
                b"" | b"#" | b"o" | b"g" | b"s" => {}
                _ => survey.others += not_kept(keyword, number, diagnostics),
            }
        }
    }

    fn vertex(&mut self, rest: &[u8]) {
        self.vertices += 1;
        // Once one is above 1, the range is known. Without a fourth word there is no colour.
        if self.largest_color <= 1.0
            && has_fourth_word(rest)
            && let Ok((values, n @ 6..)) = numbers::<7>(rest)
        {
            self.has_colors = true;
            let rgb = if n == 6 { &values[3..6] } else { &values[4..7] };
            self.largest_color = rgb.iter().copied().filter(|v| v.is_finite()).fold(self.largest_color, f64::max);
        }
    }

    fn face(&mut self, rest: &[u8]) {
        self.faces += 1;
        if self.uses_normals && self.uses_uvs {
            return;
        }
        let mut parts = word(rest).0.split(|&b| b == b'/').skip(1);
        self.uses_uvs |= parts.next().is_some_and(|part| !part.is_empty());
        self.uses_normals |= parts.next().is_some_and(|part| !part.is_empty());
    }
}

/// Whether there are four words or more.
#[inline]
fn has_fourth_word(line: &[u8]) -> bool {
    let mut in_word = false;
    let mut words = 0;
    for b in line {
        let letter = !b.is_ascii_whitespace();
        words += u32::from(letter && !in_word);
        in_word = letter;
    }
    words > 3
}

/// Count a statement that is not kept; 1 where it is geometry.
fn not_kept(keyword: &[u8], number: u64, diagnostics: &mut Diagnostics) -> u64 {
    let (kind, geometry) = match keyword {
        b"l" => ("lines (l) not kept", 1),
        b"p" => ("points (p) not kept", 1),
        b"curv" | b"curv2" | b"surf" | b"bzp" | b"bsp" | b"cdc" | b"cdp" | b"res" => {
            ("free-form curves and surfaces not kept", 1)
        }
        b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"end"
        | b"con" => return 0,
        b"mg" | b"bevel" | b"c_interp" | b"d_interp" | b"lod" | b"shadow_obj" | b"trace_obj" | b"ctech" | b"stech"
        | b"maplib" | b"usemap" => ("statements about display not kept", 0),
        b"call" | b"csh" => ("calls of other files and programs not followed", 0),
        _ => ("lines that begin with an unknown word passed over", 0),
    };
    diagnostics.add(kind, || format!("line {number}"));
    geometry
}

//! Binary STL: 80 bytes of free text, the number of facets, 50 bytes for each; little-endian.

use super::super::ReadError;
use super::colors::Colors;
use super::facets::Facets;
use super::{BEFORE, Bytes, FACET, HEADER};
use glam::DVec3;
use kilwa_pack::plural::counted;

/// Facets that the header counts.
fn count(start: &[u8]) -> Option<u64> {
    match start.get(HEADER..BEFORE) {
        Some(&[a, b, c, d]) => Some(u64::from(u32::from_le_bytes([a, b, c, d]))),
        _ => None,
    }
}

/// Whether the length of the file is what its header says. Many writers begin the free text with "solid" as a text file
/// does, so that nothing else can decide.
pub(super) fn is_exact(start: &[u8], total: u64) -> bool {
    count(start).is_some_and(|n| total == BEFORE as u64 + FACET as u64 * n)
}

/// Whether the facets in the first bytes make sense although the length is another: all numbers finite and of a size
/// that coordinates have, normals of length 0 or 1, corners not all the same.
pub(super) fn is_plausible(start: &[u8], total: u64) -> bool {
    if total < (BEFORE + FACET) as u64 || count(start).is_none() {
        return false;
    }
    let facets = start.get(BEFORE..).unwrap_or_default().chunks_exact(FACET);
    let mut with_area = 0;
    for facet in facets {
        let (normal, corners, _) = parse(facet);
        let usual = |x: f64| x.is_finite() && (x == 0.0 || (1e-20..1e15).contains(&x.abs()));
        let length = normal.length();
        let unit = length == 0.0 || (0.9..1.1).contains(&length);
        if !unit || ![normal].iter().chain(&corners).flat_map(DVec3::to_array).all(usual) {
            return false;
        }
        with_area += u32::from(corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0]);
    }
    with_area > 0
}

/// Normal, corners and attribute of 50 bytes.
fn parse(facet: &[u8]) -> (DVec3, [DVec3; 3], u16) {
    let float = |i: usize| match facet.get(4 * i..4 * i + 4) {
        Some(&[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        _ => f64::NAN,
    };
    let point = |i: usize| DVec3::new(float(3 * i), float(3 * i + 1), float(3 * i + 2));
    (point(0), [point(1), point(2), point(3)], attribute(facet))
}

fn attribute(facet: &[u8]) -> u16 {
    match facet.get(FACET - 2..FACET) {
        Some(&[a, b]) => u16::from_le_bytes([a, b]),
        _ => 0,
    }
}

/// Deliver the facets that are there; `bytes` stands at the beginning of the file and `start` is what stands there.
pub(super) fn read(bytes: &mut Bytes<'_>, start: &[u8], facets: &mut Facets<'_>) -> Result<(), ReadError> {
    let announced = count(start).unwrap_or(0);
    let there = bytes.total.saturating_sub(BEFORE as u64);
    let whole = there / FACET as u64;
    // Some writers leave the count at 0 because they do not know it when they begin.
    let wanted = if announced == 0 { whole } else { announced.min(whole) };
    if announced == 0 && whole > 0 {
        facets.diagnostics().add("headers that count no facets; those that are there were read", || {
            counted(whole, "facet", "facets").to_string()
        });
    }
    facets
        .diagnostics()
        .add_many("facets that the header counts and the file does not have", announced.saturating_sub(whole));
    let left = there - wanted * FACET as u64;
    facets.diagnostics().add_many("bytes after the last facet left out", left);

    let colors = match Colors::of_header(start.get(..HEADER).unwrap_or_default()) {
        Colors::Magics(object) if all_attributes_are_zero(bytes, wanted)? => Colors::Object(object),
        other => other,
    };
    bytes.seek(BEFORE as u64)?;
    let mut facet = [0; FACET];
    for number in 0..wanted {
        let got = bytes.fill(&mut facet)?;
        if got < FACET {
            // The file has become shorter since its length was taken.
            facets.diagnostics().add_many("facets that the header counts and the file does not have", wanted - number);
            break;
        }
        let (normal, corners, attribute) = parse(&facet);
        facets.check_normal(normal, &corners, || format!("facet {number}"));
        facets.add(corners, colors.of_facet(attribute))?;
    }
    Ok(())
}

/// Look through the attributes until one is not zero, which in a coloured file is one of the first.
fn all_attributes_are_zero(bytes: &mut Bytes<'_>, count: u64) -> Result<bool, ReadError> {
    bytes.seek(BEFORE as u64)?;
    let mut facet = [0; FACET];
    for _ in 0..count {
        if bytes.fill(&mut facet)? < FACET {
            break;
        }
        if attribute(&facet) != 0 {
            return Ok(false);
        }
    }
    Ok(true)
}

//! Whether a pack that claims to be without its location is what `kilwa publish --redact-location` writes. When it is read and written again, the bytes must
//! be the same, so that nothing is hidden in unknown members, reserved bytes or spare digits of numbers; and its numbers must fit the model.

use glam::DVec3;
use kilwa_archive::compare::CompareWriter;
use kilwa_archive::metadata::plain_capture;
use kilwa_pack::plural::counted;
use kilwa_pack::{Chunk, DirectoryEntry, Header, Metadata, NO_DIAMOND, Reader, Source, relocate};

/// Options that shape a pack.
const OPTIONS: [&str; 7] = [
    "step",
    "color-bits",
    "normal-bits",
    "coarse-color-bits",
    "coarse-normal-bits",
    "coarse-positions",
    "leaf-triangles",
];
/// Largest whole number that an option can have: the triangles of a leaf.
const OPTION_MAX: u32 = 1 << 20;
/// The stated median edge may be at most this many times that of the sampled triangles.
const EDGE: f64 = 3.0;
/// Maximum number of chunks that are sampled for it.
const CHUNKS: usize = 256;
/// Maximum difference of colours.
const COLOR: f32 = 256.0;
/// Maximum extent of a bounding sphere, in diagonals of the model.
const SPHERE: f64 = 4.0;

/// Check header, metadata and directory.
///
/// # Errors
/// A sentence that says what differs.
pub(super) fn check<S: Source + Sync>(reader: &Reader<S>) -> Result<(), String> {
    check_numbers(reader.metadata(), reader.header())?;
    check_directory(reader.entries())?;
    check_edge(reader)?;
    let again = CompareWriter::new(reader.source());
    let end = relocate(reader, again, reader.header().lattice.origin, |_| {});
    let length = reader.source().len().map_err(|e| format!("its pack cannot be read: {e}"))?;
    match end {
        Ok(again) if again.written() == length => Ok(()),
        _ => Err("its pack is not, byte for byte, what this version of kilwa publish writes".to_owned()),
    }
}

fn check_numbers(m: &Metadata, header: &Header) -> Result<(), String> {
    for (name, value) in &m.options {
        let number = value.parse::<u32>().ok().filter(|n| *n <= OPTION_MAX && n.to_string() == *value);
        if !OPTIONS.contains(&name.as_str()) || number.is_none() && has_digit(value) {
            return Err(format!("the option {name:?} of its pack is not one that kilwa build writes"));
        }
    }
    if let Some(kind) = m.repairs.keys().find(|kind| has_digit(kind)) {
        return Err(format!("the repair {kind:?} of its pack has a number in its name"));
    }
    if m.vertices > header.stored_vertices || m.vertices > m.triangles.saturating_mul(3) {
        return Err(format!(
            "its pack states {}, more than its triangles can have",
            counted(m.vertices, "vertex", "vertices")
        ));
    }
    if m.border_edges > m.triangles.saturating_mul(3) {
        return Err(format!(
            "its pack states {}, more than its triangles have edges",
            counted(m.border_edges, "border edge", "border edges")
        ));
    }
    plain_capture(m).map_err(|(name, what)| format!("{name} of its pack {what}"))
}

fn has_digit(text: &str) -> bool {
    text.chars().any(char::is_numeric)
}

fn check_directory(entries: &[DirectoryEntry]) -> Result<(), String> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for bounds in entries.iter().map(|e| &e.bounds).filter(|b| !b.is_empty()) {
        (min, max) = (min.min(bounds.min.as_dvec3()), max.max(bounds.max.as_dvec3()));
    }
    let diagonal = max.distance(min).max(1.0);
    let reach = diagonal * SPHERE;
    let is_around = |e: &DirectoryEntry| {
        let centre = e.sphere.center;
        e.sphere.radius <= reach && (0..3).all(|k| centre[k] >= min[k] - reach && centre[k] <= max[k] + reach)
    };
    if entries.iter().all(|e| is_around(e) && (e.color_error <= COLOR || e.color_error.is_infinite())) {
        return Ok(());
    }
    Err("the directory of its pack has bounding spheres or colour errors that do not fit its triangles".to_owned())
}

/// Check that the median edge is about that of a sample of the finest triangles.
fn check_edge<S: Source + Sync>(reader: &Reader<S>) -> Result<(), String> {
    let stated = reader.metadata().median_edge;
    let stride = reader.entries().len().div_ceil(CHUNKS).max(1);
    let mut edges = Vec::new();
    for index in (0u32..).take(reader.entries().len()).step_by(stride) {
        let chunk = reader.chunk(index).map_err(|e| format!("its pack cannot be read: {e}"))?;
        finest_edges(&chunk, &mut edges);
    }
    edges.sort_by(f64::total_cmp);
    let step = reader.header().lattice.step();
    // If no sampled chunk has any of the finest triangles, the bounding box limits the edge.
    let size = reader.metadata();
    let largest = size.bounds_max.distance(size.bounds_min);
    let median = edges.get(edges.len() / 2).map_or(largest, |edge| edge * step);
    if (0.0..=EDGE * median.max(step)).contains(&stated) {
        Ok(())
    } else {
        Err(format!("median_edge of its pack is {stated} m, but that of its triangles is {median:.3} m"))
    }
}

/// Lengths, in lattice units, of the edges of those triangles of a chunk that no other chunk refines.
fn finest_edges(chunk: &Chunk, edges: &mut Vec<f64>) {
    for patch in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
        let triangles = chunk.mesh.triangles.iter().skip(patch.first as usize).take(patch.count as usize);
        for &[a, b, c] in triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let at = |v: u32| chunk.mesh.positions.get(v as usize).map(|p| p.as_dvec3());
                if let (Some(p), Some(q)) = (at(from), at(to)) {
                    edges.push(p.distance(q));
                }
            }
        }
    }
}

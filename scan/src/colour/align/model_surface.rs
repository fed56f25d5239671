//! The surface of a pack as points with normals.

use crate::ScanError;
use crate::colour::Model;
use kilwa_pack::Source;
use kilwa_pack::cut::Cut;
use kilwa_scan_core::photo_pose::Surface;

/// Maximum number of triangles of the cut whose vertices represent the surface.
const MAX_TRIANGLES: u64 = 1_000_000;

/// The surface of a model for [`frame()`](super::frame()): the vertices of a cut of at most a million triangles, and the mean length of its edges, metres.
///
/// # Errors
/// [`ScanError::Model`] if a chunk is damaged.
pub fn surface_of<S: Source + Sync>(model: &Model<'_, S>) -> Result<(Surface, f64), ScanError> {
    let entries = model.reader().entries();
    let cut = Cut::for_triangles_read(entries, MAX_TRIANGLES, |i| model.part(i).map(|part| part.patches().to_vec()))?;
    let mut points = Vec::new();
    let (mut length, mut edges) = (0.0, 0u64);
    let mut is_used = Vec::new();
    for number in cut.refined() {
        let part = model.part(number)?;
        is_used.clear();
        is_used.resize(part.positions.len(), false);
        for [a, b, c] in cut.drawn(part.patches()).flat_map(|patch| part.triangles_of(patch)) {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                length += f64::from(part.positions[*from as usize].distance(part.positions[*to as usize]));
                edges += 1;
                is_used[*from as usize] = true;
            }
        }
        let foot = |k: usize| (part.origin + part.positions[k].as_dvec3(), part.normals[k].as_dvec3());
        points.extend(is_used.iter().enumerate().filter(|(_, is_used)| **is_used).map(|(k, _)| foot(k)));
    }
    Ok((Surface::new(points), length / edges.max(1) as f64))
}

//! What every site is made of: pieces (small local meshes) that a weld joins into one indexed stream.
//!
//! A site is cut into *tiles* (one output file each), a tile into *slabs*, a slab into *pieces*. Pieces are pure
//! functions of their number, so they are made in parallel and in any order, and the weld takes them in order: the
//! bytes do not depend on the number of threads. A vertex that several pieces use carries the same key in each; the
//! weld remembers the index of such a vertex only until the last slab that can use it, so memory is bounded by the
//! border of a slab and never grows with the mesh.
//!
//! Invariants: equal keys mean bit-equal positions and colours; a vertex is put out when the first triangle that uses
//! it is, so no vertex is unused; a triangle with two equal corners or no area is dropped.

use glam::DVec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// A vertex of a piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    /// Metres, z up, in the site's own frame.
    pub(super) position: DVec3,
    /// sRGB.
    pub(super) color: [u8; 3],
    /// Where other pieces use it too: its key in the whole site, and the last slab that can use it.
    pub(super) shared: Option<(u64, u32)>,
}

/// A local indexed mesh.
#[derive(Debug, Default)]
pub(super) struct Piece {
    /// Its vertices.
    pub(super) vertices: Vec<Vertex>,
    /// Indices into its own vertices, counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
}

/// A surface that can be made piece by piece.
pub(super) trait Site: Sync {
    /// About how many triangles all tiles have together.
    fn expected_triangles(&self) -> u64;
    /// Distance between neighbouring vertices, in metres.
    fn spacing(&self) -> f64;
    /// Number of slabs of a tile.
    fn slabs(&self, tile: u32) -> u32;
    /// Number of pieces of a slab.
    fn pieces(&self, tile: u32, slab: u32) -> u32;
    /// Make a piece.
    fn piece(&self, tile: u32, slab: u32, index: u32) -> Piece;
}

/// Takes the welded stream.
pub(super) trait Sink {
    /// What can go wrong.
    type Error;
    /// The next vertex; its index is the number of vertices before it.
    fn vertex(&mut self, position: DVec3, color: [u8; 3]) -> Result<(), Self::Error>;
    /// The next triangle, of vertices already put out.
    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), Self::Error>;
}

/// How many pieces are in memory at once.
const PIECES_AT_ONCE: u32 = 64;

/// Stream one tile into a sink. `single` rounds positions to `f32` first; `progress` is called with the triangles so far.
/// Gives the most shared vertices that were remembered at once.
pub(super) fn weld<S: Sink>(
    site: &dyn Site,
    tile: u32,
    single: bool,
    sink: &mut S,
    progress: &mut dyn FnMut(u64),
) -> Result<usize, S::Error> {
    let mut max = 0;
    let mut shared: HashMap<u64, (u32, u32)> = HashMap::new();
    let (mut next, mut written) = (0_u32, 0_u64);
    let mut local: Vec<Option<u32>> = Vec::new();
    for slab in 0..site.slabs(tile) {
        let count = site.pieces(tile, slab);
        for first in (0..count).step_by(PIECES_AT_ONCE as usize) {
            let last = (first + PIECES_AT_ONCE).min(count);
            let pieces: Vec<Piece> =
                (first..last).into_par_iter().map(|k| rounded(site.piece(tile, slab, k), single)).collect();
            for piece in &pieces {
                local.clear();
                local.resize(piece.vertices.len(), None);
                for t in piece.triangles.iter().filter(|t| has_area(piece, **t)) {
                    let mut corners = [0; 3];
                    for (corner, &v) in corners.iter_mut().zip(t) {
                        let known = local[v as usize];
                        let index = known
                            .map_or_else(|| place(&piece.vertices[v as usize], &mut shared, &mut next, sink), Ok)?;
                        local[v as usize] = Some(index);
                        *corner = index;
                    }
                    sink.triangle(corners)?;
                    written += 1;
                }
            }
            progress(written);
        }
        max = max.max(shared.len());
        shared.retain(|_, (_, last)| *last > slab);
    }
    Ok(max)
}

/// The index of a vertex in the stream, putting it out where it is new.
fn place<S: Sink>(
    v: &Vertex,
    shared: &mut HashMap<u64, (u32, u32)>,
    next: &mut u32,
    sink: &mut S,
) -> Result<u32, S::Error> {
    if let Some((index, _)) = v.shared.and_then(|(key, _)| shared.get(&key)) {
        return Ok(*index);
    }
    let index = *next;
    *next += 1;
    if let Some((key, last)) = v.shared {
        shared.insert(key, (index, last));
    }
    sink.vertex(v.position, v.color)?;
    Ok(index)
}

fn rounded(mut piece: Piece, single: bool) -> Piece {
    if single {
        for v in &mut piece.vertices {
            v.position = v.position.as_vec3().as_dvec3();
        }
    }
    piece
}

fn has_area(piece: &Piece, t: [u32; 3]) -> bool {
    let [a, b, c] = t.map(|v| piece.vertices[v as usize].position);
    (b - a).cross(c - a) != DVec3::ZERO
}

/// Cut a rectangle of `width` by `height` into exactly `count` near-square parts: columns and rows.
pub(super) fn tiling(count: u32, width: f64, height: f64) -> (u32, u32) {
    let elongation = |columns: u32| {
        let (w, h) = (width / f64::from(columns), height / f64::from(count / columns));
        if w > h { w / h } else { h / w }
    };
    let best = (1..=count)
        .filter(|c| count.is_multiple_of(*c))
        .min_by(|a, b| elongation(*a).total_cmp(&elongation(*b)))
        .unwrap_or(1);
    (best, count / best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tiling_has_the_requested_count_and_follows_the_shape() {
        assert_eq!(tiling(96, 60.0, 40.0), (12, 8));
        assert_eq!(tiling(7, 10.0, 5.0), (7, 1));
        assert_eq!(tiling(1, 10.0, 5.0), (1, 1));
    }
}

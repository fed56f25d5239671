//! Packs of points: what is measured are the points, not the squares that stand for them.

use crate::leaves::finest_triangles;
use glam::DVec3;
use kilwa_geometry::LatticePoint;
use kilwa_pack::{Chunk, Index};

/// Whether a pack is made of points. Never so in the module with which the page measures surfaces, which cannot read such packs.
pub fn is_of_points(index: &Index) -> bool {
    cfg!(any(not(target_arch = "wasm32"), feature = "points")) && index.header().is_of_points()
}

/// The finest triangles of a chunk: in a pack of points its [`halves`].
#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
pub(crate) fn triangles<'a>(index: &Index, chunk: &'a Chunk) -> impl Iterator<Item = [LatticePoint; 3]> + use<'a> {
    let turns = usize::from(index.header().is_of_points());
    finest_triangles(chunk).map(move |t| half(chunk, t, turns))
}

/// The finest triangles of a chunk.
#[cfg(not(any(not(target_arch = "wasm32"), feature = "points")))]
pub(crate) fn triangles<'a>(_: &Index, chunk: &'a Chunk) -> impl Iterator<Item = [LatticePoint; 3]> + use<'a> {
    crate::leaves::finest(chunk)
}

/// A triangle; with `turns` of 1, from one end of its square's diagonal to the other, which runs from the first vertex of a square to its third (FORMAT section 5.21).
fn half(chunk: &Chunk, t: usize, turns: usize) -> [LatticePoint; 3] {
    let [a, b, c] = chunk.mesh.corners(t);
    if t % 2 * turns == 0 { [a, b, c] } else { [b, c, a] }
}

/// The finest triangles of a chunk of points, each from one end of its square's diagonal to the other.
pub(crate) fn halves(chunk: &Chunk) -> impl Iterator<Item = [LatticePoint; 3]> + '_ {
    finest_triangles(chunk).map(|t| half(chunk, t, 1))
}

/// The point that a square stands for, lattice units, by one of its [`halves`]: the middle of the diagonal.
pub(crate) fn center([a, _, c]: [LatticePoint; 3]) -> DVec3 {
    (a.as_dvec3() + c.as_dvec3()) * 0.5
}

/// The point of a chunk's finest points nearest to `p`, lattice units, with the corners of a triangle of its square.
pub(crate) fn nearest(chunk: &Chunk, p: DVec3) -> Option<(DVec3, [DVec3; 3])> {
    // The first of the two triangles of each square would do; the second is as near.
    let away = halves(chunk).map(|t| (center(t), t.map(LatticePoint::as_dvec3)));
    away.min_by(|a, b| (a.0 - p).length_squared().total_cmp(&(b.0 - p).length_squared()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;
    use kilwa_geometry::normal;
    use kilwa_pack::chunk::splat::{MIN_RADIUS, Splats};
    use kilwa_pack::{NO_DIAMOND, PatchRange};

    #[test]
    fn both_triangles_of_a_square_lead_to_its_point() {
        let mut random = fastrand::Rng::with_seed(4);
        for _ in 0..2000 {
            let n = normal::encode(DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5));
            let p = IVec3::new(random.i32(5000..90_000), random.i32(5000..90_000), random.i32(5000..90_000));
            let splats = Splats {
                positions: vec![p],
                normals: vec![n],
                radii: vec![random.u8(MIN_RADIUS..40)],
                ..Splats::default()
            };
            let patches = vec![PatchRange { first: 0, count: 2, diamond: NO_DIAMOND }];
            let chunk = Chunk { mesh: splats.mesh(), patches };
            assert_eq!(halves(&chunk).map(center).collect::<Vec<_>>(), [p.as_dvec3(); 2]);
            assert_eq!(nearest(&chunk, DVec3::ZERO).map(|found| found.0), Some(p.as_dvec3()));
        }
    }
}

//! Packs of points: what is measured are the points, not the squares that stand for them.

use crate::leaves::finest_triangles;
use glam::{DVec3, IVec3};
use kilwa_geometry::LatticePoint;
use kilwa_pack::{Chunk, Index};

/// Whether a pack is made of points. Never so in the module with which the page measures surfaces, which cannot read such packs.
pub fn is_of_points(index: &Index) -> bool {
    cfg!(any(not(target_arch = "wasm32"), feature = "points")) && index.header().is_of_points()
}

/// The point that a square stands for, lattice units, by one of its two triangles: the middle of the diagonal, which begins at the first corner. Its
/// ends are as far from the point on both sides, so that their sum is even on every axis.
pub fn center([a, b, c]: [LatticePoint; 3]) -> DVec3 {
    let is_diagonal = |q: IVec3| ((a + q) & 1) == IVec3::ZERO;
    let length = |q: IVec3| (a - q).as_dvec3().length_squared();
    let far = match (is_diagonal(b), is_diagonal(c)) {
        (true, false) => b,
        (false, true) => c,
        _ if length(b) > length(c) => b,
        _ => c,
    };
    (a.as_dvec3() + far.as_dvec3()) * 0.5
}

/// The point of a chunk's finest points nearest to `p`, lattice units, with the corners of a triangle of its square.
pub(crate) fn nearest(chunk: &Chunk, p: DVec3) -> Option<(DVec3, [DVec3; 3])> {
    // The first of the two triangles of each square.
    let squares = finest_triangles(chunk).filter(|t| t % 2 == 0).map(|t| chunk.mesh.corners(t));
    let away = squares.map(|t| (center(t), t.map(LatticePoint::as_dvec3)));
    away.min_by(|a, b| (a.0 - p).length_squared().total_cmp(&(b.0 - p).length_squared()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::normal;
    use kilwa_pack::chunk::splat::{MIN_RADIUS, corners};

    #[test]
    fn both_triangles_of_a_square_lead_to_its_point() {
        let mut random = fastrand::Rng::with_seed(4);
        for _ in 0..2000 {
            let n = normal::encode(DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5));
            let p = IVec3::new(random.i32(5000..90_000), random.i32(5000..90_000), random.i32(5000..90_000));
            let [a, b, c, d] = corners(p, n, random.u8(MIN_RADIUS..40));
            assert_eq!([center([a, b, c]), center([a, c, d])], [p.as_dvec3(); 2]);
        }
    }
}

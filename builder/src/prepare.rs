//! What every stage agrees on about a vertex: how its place is written as a key.

use kilwa_geometry::LatticePoint;

/// A lattice point as one integer: 30 bits an axis, sorted by x, then y, then z.
pub fn point_key(p: LatticePoint) -> u128 {
    (u128::from(p[0] as u32) << 64) | (u128::from(p[1] as u32) << 32) | u128::from(p[2] as u32)
}

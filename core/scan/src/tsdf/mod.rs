//! Merging the surfaces of several stations into one: a sparse truncated signed distance field (TSDF), whose sums are integers.
//!
//! The triangles of every station are cut into small [`Piece`]s, planar pieces (surfels) of at most about one voxel. A piece adds to each voxel around it the signed
//! distance of the voxel's centre from its plane, with a weight: its area, times its quality, times a kernel that falls off laterally
//! ([`SIDE`]) and along the normal ([`REACH`], the truncation). The distance at a voxel is the weighted mean, as in the implicit moving least squares of
//! Kolluri ("Provably Good Moving Least Squares", 2008); weighting by area makes it independent of how densely a station sampled the surface,
//! and quality lets a near, perpendicular view prevail over a distant or oblique one (Curless and Levoy, "A Volumetric Method for
//! Building Complex Models from Range Images", 1996).
//!
//! Positions of pieces are integers, and so is everything that follows, so the sums do not depend on the order of pieces, on threads, or on how space is divided
//! among [`Field`]s.
//!
//! Lengths are voxels unless stated otherwise; the voxel with index `i` has its centre at the coordinate `i`.

mod backing;
mod cubes;
mod extract;
mod field;
mod piece;
mod sigma;

#[cfg(test)]
mod tests;

pub use backing::Backing;
pub use cubes::Cubes;
pub use extract::{EdgeKey, Patch, PatchVertex};
pub use field::{BRICK, Field, Region};
pub use piece::{Corner, INTENSITY_LOG2, INTENSITY_MAX, PIECE_BYTES, Piece, expected_pieces, pieces};
pub use sigma::{Sigma, Variance};

/// Positions of pieces are rounded to 1/2^SUB_LOG2 voxel.
pub const SUB_LOG2: u32 = 8;
/// How far a piece reaches along its normal: the truncation of the distances.
pub const REACH: f64 = 2.0;
/// The lateral reach of a piece.
pub const SIDE: f64 = 1.5;
/// Voxels that a region needs beyond its own, so that the sums of those that its surface depends on are complete: one for cells, one for signs that are extended, and
/// the reach of a piece, `hypot(REACH, SIDE)`.
pub const MARGIN: i32 = 5;

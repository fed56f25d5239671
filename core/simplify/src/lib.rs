//! One step of simplification on the lattice, and the certified error of that step.
//!
//! [`simplify`] collapses edges of a mesh, of which some points may be locked; [`certify`] bounds the distance between the meshes
//! before and after in both directions. Both are pure: the result depends on the geometry alone, on every machine. The builder
//! makes the levels of a pack with them, and extraction finishes a cut to a number of triangles.

#![forbid(unsafe_code)]

mod certify;
mod precision;
mod simplify;
mod weld;

pub use certify::{Bound, certify};
pub use precision::Precision;
pub use simplify::{PRUNED, Purpose, Simplified, simplify};
pub use weld::Welder;

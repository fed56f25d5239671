//! Pure geometry for Kilwa: the one integer lattice, the tetrahedra and diamonds that subdivide it, bounds,
//! mesh fragments and exact distances; polygons as triangles, colours, units of length.
//!
//! Nothing here touches files, threads, clocks or the GPU. Every function gives the same answer on every machine:
//! decisions are taken on integers, and where `f64` is used (distances) only `+ - * / sqrt` occur, which IEEE 754 fixes. The powers of [`color`] come from `libm`.
//!
//! Ownership and order: [`lattice`] defines points; [`tetra`] and [`diamond`] define the hierarchy over them
//! (Cignoni et al., "Adaptive TetraPuzzles", SIGGRAPH 2004); [`mesh`] is the fragment that every stage hands to the next.

pub mod bounds;
pub mod bvh;
pub mod clip;
pub mod color;
pub mod diamond;
pub mod distance;
pub mod hilbert;
pub mod lattice;
pub mod mesh;
pub mod normal;
pub mod tetra;
pub mod triangulate;
pub mod unit;

pub use bounds::{Aabb, Sphere};
pub use bvh::Bvh;
pub use diamond::DiamondKey;
pub use lattice::{Lattice, LatticePoint};
pub use mesh::Mesh;
pub use tetra::Tetra;
pub use triangulate::Triangulator;
pub use unit::LengthUnit;

//! The native builder: reads the final mesh of a scan, makes the adaptive-tetrahedra hierarchy and writes the pack.
//!
//! `read` (any mesh file to a [`RawMesh`]) → `prepare` (lattice, weld, normals) → `partition` (tetrahedra) →
//! `levels` (merge, lock, simplify, certify, split; finest first) → `assemble` (encode, order, write).
//! `synth` makes the demo and test sites.

pub mod raw;
pub mod read;
pub mod synth;

pub use raw::RawMesh;

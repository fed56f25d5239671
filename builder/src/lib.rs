//! The native builder: reads the final mesh of a scan, makes the adaptive-tetrahedra hierarchy and writes the pack.
//!
//! `read` (any mesh file, in blocks) → `ingest` (scratch files, lattice, weld, normals, tetrahedra, leaf patches) → `levels`
//! (merge, lock, simplify, certify, split, encode; finest first) → `assemble` (number, order, write). Between stages
//! everything lies in files of a `scratch` folder, with a `journal` of what is complete. `synth` makes the demo and test
//! sites.

pub mod assemble;
mod build;
pub mod certify;
pub mod fragment;
pub mod ingest;
pub mod journal;
pub mod levels;
pub mod machine;
pub mod options;
pub mod partition;
pub mod precision;
pub mod prepare;
pub mod progress;
pub mod raw;
pub mod read;
pub mod scratch;
pub mod simplify;
mod spread;
pub mod surface;
pub mod synth;
pub mod tree_file;
mod weld;
pub mod work;

pub use build::{BuildReport, Built, Inputs, Interruptible, Run, StageTime, build, build_pack};
pub use options::{BuildError, BuildOptions, Units, Up};
pub use precision::Precision;
pub use progress::{Progress, Silent};
pub use raw::{Findings, RawMesh};
pub use spread::Spread;
pub use surface::Finding;

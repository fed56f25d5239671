//! The native builder: makes the adaptive-tetrahedra hierarchy of the final mesh of a scan and writes the pack.
//!
//! | stage | does |
//! |---|---|
//! | `kilwa_formats::read` | delivers any mesh file in blocks |
//! | [`ingest`] | scratch files, lattice, weld, normals, tetrahedra, leaf patches |
//! | [`levels`] | merges, locks, simplifies, certifies, splits and encodes, finest level first |
//! | [`assemble`] | numbers the chunks, orders them and writes the pack |
//!
//! [`points`] goes from points, without a mesh, to a pack of splats; it shares the tree and the assembly.
//!
//! [`tasks`] divides one build among many machines; it does the same with the same code.
//!
//! [`mod@build`] runs the stages and keeps a journal of what is complete; between stages everything is in files in a
//! [`scratch`] folder. [`partition`] is the tree of tetrahedra that all stages share.

pub mod assemble;
pub mod build;
pub mod ingest;
pub mod levels;
pub mod partition;
pub mod points;
pub mod scratch;
pub mod tasks;

pub use assemble::Spread;
pub use build::options::{BuildError, BuildOptions};
pub use build::progress::{Progress, Silent};
pub use build::{BuildReport, Built, Capture, Inputs, Interruptible, Provenance, Run, StageTime, build, build_pack};
pub use ingest::surface::{ColoredBy, Diagnostic};
pub use kilwa_simplify::Precision;

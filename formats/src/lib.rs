//! Mesh files, read and written.
//!
//! [`read`] delivers the mesh in a file of any format it knows, in blocks, to a [`read::MeshSink`]; [`read::read_mesh`]
//! keeps a small one in memory as a [`RawMesh`]. Repairs and omissions are counted in [`Diagnostics`]; a refused file
//! gives a [`ReadError`]. [`extract`] writes the mesh of a pack as a file of such a format.

mod diagnostics;
pub mod extract;
mod mesh;
pub mod read;
mod up;

pub use diagnostics::{Diagnostics, Pictures};
pub use mesh::{RawMesh, UNCOLOURED};
pub use read::ReadError;
pub use up::Up;

//! Drawing triangles on the CPU: what a camera sees of a mesh, and how far away it is.
//!
//! Distorted and panoramic pictures are not drawn directly, because straight edges become curves there. A camera is covered by perspective
//! [`Window`]s instead (one for an ordinary lens, up to six for wide ones), in which edges are straight and depths exact; a viewing direction then maps to a pixel of
//! one of the windows.

mod draw;
mod edges;
#[cfg(test)]
mod tests;
mod window;

pub use draw::{Raster, Value};
pub use edges::Edges;
pub use window::{Window, windows};

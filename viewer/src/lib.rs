//! The renderer of Kilwa, shared by the page (wasm) and the headless command line.
//!
//! Who owns what, in order: a [`camera::Camera`] (world metres, f64) gives a [`kilwa_stream::View`] (lattice units);
//! the [`kilwa_stream::Streamer`] turns views into commands and a cut; a shell (`shell::native`, `shell::web`) carries
//! the commands out; the [`renderer::Renderer`] owns the GPU memory of chunks and draws the cut with the passes of
//! [`gpu`], one file per pass, each with its WGSL of the same name in `/shaders`.
//!
//! Positions stay integers until the shader has subtracted a cell near the eye; there is one conversion to `f32` and one matrix for
//! everything, so that equal lattice points land on equal pixels whichever chunk they come from.
//! The baseline stays inside WebGL2: uniform buffers, vertex attributes, no storage buffers, no compute.

pub mod camera;
pub mod clip;
pub mod colormap;
pub mod display;
pub mod draw_list;
pub mod eyes;
pub mod fade;
pub mod filled;
pub mod gpu;
pub mod options;
pub mod pick;
pub mod renderer;
pub mod shell;
pub mod walk;

pub use camera::{Bounds, Camera, Edges, StandardView};
pub use display::Display;
pub use gpu::context::{Gpu, GpuError, Prefer};
pub use kilwa_measure::clip as section;
pub use kilwa_stream::{Projection, View};
pub use options::{Background, Frustum, Mode, RenderOptions, Tile};
pub use renderer::{IdImage, Image, Renderer};
pub use section::Clip;

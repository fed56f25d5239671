//! Integration tests of the renderer.

mod camera;
mod indirect;
mod present;
mod shaders;

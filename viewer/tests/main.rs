//! Integration tests of the renderer.

mod camera;
mod present;
mod shaders;

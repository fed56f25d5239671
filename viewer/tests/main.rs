//! The renderer from outside.

mod camera;
mod present;
mod shaders;

//! Integration tests of packs: written packs are read back, and damaged ones are refused.

mod codec;
mod common;
mod container;
mod cuts;
#[cfg(unix)]
mod giant;
mod points;
mod relocate;

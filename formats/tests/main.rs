//! Integration tests of mesh files: written files are checked, and every file of `../shared/data` is read if that folder exists.

mod preview;
mod read_nexus;
mod read_shared_data;
mod read_stl_and_gltf;
mod reduce;
mod shared_data;
mod tiles;

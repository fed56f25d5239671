//! Mesh files from outside: what is written is checked, and every file of `../shared/data` is read where that is there.

mod preview;
mod read_shared_data;
mod read_stl_and_gltf;

//! Mesh files from outside: every file of `../shared/data` where that is there.

mod read_shared_data;
mod read_stl_and_gltf;

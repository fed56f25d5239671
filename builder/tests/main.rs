//! Integration tests of the builder: meshes in, packs out.

mod attributes;
mod bound;
mod cracks;
mod ingest;
mod islands;
mod objects;
mod out_of_core;
mod same_bytes;
mod support;
mod tasks;

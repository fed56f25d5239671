//! The builder from outside: meshes in, packs out.

mod attributes;
mod bound;
mod cracks;
mod ingest;
mod islands;
mod out_of_core;
mod same_bytes;
mod support;

//! Tests over whole files: written, imported into a survey, and read back from its spools.

mod density;
mod edited;
mod export;
mod formats;
mod hole_flags;
mod hole_truth;
mod las;
mod malformed;
mod masks;
mod mesh;
mod peers;
mod photo_peers;
mod photos;
mod pictures;
mod register;
mod resume;
mod shared_data;
mod simulated_photos;
mod stations;
mod support;

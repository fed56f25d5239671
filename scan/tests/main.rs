//! Tests over whole files: written, imported into a survey, and read back from its spools.

mod edited;
mod formats;
mod malformed;
mod masks;
mod mesh;
mod peers;
mod pictures;
mod resume;
mod shared_data;
mod support;

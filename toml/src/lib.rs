//! TOML files that people write: read table by table and field by field, so that every mistake is reported at once, each with its line,
//! its field and what to do. What was not asked for is unknown, and the known field nearest to it is suggested.

mod problem;
mod reader;

pub use problem::{Problem, Problems, nearest};
pub use reader::{File, Found, Table};

//! Surveys: scans read from the files of scanners, kept with their grids, poses and colours, looked at, masked and meshed.
//!
//! A survey is a folder: `survey.toml`, which a person may edit ([`survey`]), and a binary file for each station ([`spool`]). [`read`] hands the
//! stations of a file on sample by sample; [`import`] puts them into a survey; [`mask`] masks what is
//! not the site; [`panorama`] shows a station, [`top_view`] all of them from above; [`plan`] lays out drawings of them; [`mesh`] makes a mesh of a station;
//! [`photos`] finds out what is known of photographs, and [`colour`] colours a model from them.
//!
//! Memory does not grow with the files: readers hold a line or a packet, spools some blocks, meshing a few columns.

pub mod colour;
mod error;
pub mod export;
mod free_space;
mod hashed;
pub mod import;
mod lock;
pub mod mask;
pub mod merge;
pub mod mesh;
pub mod panorama;
pub mod photos;
pub mod plan;
pub mod points;
pub mod read;
pub mod register;
mod scratch;
pub mod spool;
pub mod survey;
pub mod top_view;
mod turn;

pub use error::ScanError;
mod write_png;

//! The archive object: what `kilwa publish` writes, `kilwa verify` checks and `kilwa serve` serves (docs/publish.md).
//!
//! ```text
//! <slug>/index.html               landing page and viewer; replaced with every version
//! <slug>/manifest.json            what there is ([`manifest`]); replaced last
//! <slug>/v1/ v2/ ...              one immutable folder per version ([`layout`])
//! <slug>/v1/checksums.sha256      SHA-256 of every other file of the folder ([`checksums`])
//! ```
//!
//! The manifest names each version's list of checksums with its own SHA-256, and the landing page with its; so everything but the
//! manifest is under a checksum. [`metadata`] is what a person writes about a model. Nothing here draws: pictures are handed over.
//! Inputs are files that people and other programs wrote: every refusal says what, where and what to do.

pub mod assemble;
pub mod bag;
pub mod checksums;
pub mod colour_report;
pub mod compare;
pub mod created_folders;
pub mod date;
mod disk;
pub mod draft;
pub mod drawing;
pub mod frame;
pub mod holes;
pub mod html;
pub mod keep;
#[cfg(test)]
mod kill_tests;
pub mod layout;
pub mod location;
pub mod lock;
pub mod manifest;
pub mod metadata;
pub mod modes;
pub mod next;
pub mod notes;
pub mod numbers;
pub mod page;
mod places;
pub mod record;
pub mod rights;
pub mod scratch;
pub mod site;
pub mod sound;
pub mod source;
pub mod viewer;
pub mod withdraw;

pub use checksums::{Checksum, Checksums};
pub use colour_report::ColourReport;
pub use holes::Holes;
pub use layout::Slug;
pub use manifest::{AccessState, Manifest, PackEntry, Version};
pub use metadata::Metadata;
pub use notes::Notes;

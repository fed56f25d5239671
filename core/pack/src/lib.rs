//! The Kilwa file format, `name.kilwa`: one immutable file, read by range. `docs/FORMAT.md` is normative; comments here
//! point into it.
//!
//! Layout (FORMAT section 2): `header | metadata JSON | directory page 0 | coarsest chunks | other pages | other chunks | footer`.
//! Header, metadata, page 0 and the coarsest chunks lie in the first 128 KiB, so that one request gives a picture.
//! All integers are little-endian. Chunks and directory entries are ordered coarse to fine (by level), then along a
//! space-filling curve, so that any prefix of the directory is a usable coarser tree.
//!
//! This crate parses bytes that it is given and makes bytes; it opens no file. Nothing is allocated before it is
//! checked against the bytes that are really there; no input makes it panic.

#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::cast_possible_truncation
    )
)]

mod bytes;
pub mod chunk;
pub mod cut;
pub mod directory;
pub mod error;
pub mod footer;
pub mod head;
pub mod header;
pub mod index;
pub mod json;
pub mod metadata;
pub mod plural;
pub mod reader;
pub mod relocate;
pub mod verify;
pub mod vertex_layout;
pub mod visible;
pub mod writer;

pub use bytes::checksum;
pub use chunk::{Attributes, Chunk, PatchRange};
pub use cut::Cut;
pub use directory::{Children, DirectoryEntry, ENTRIES_PER_PAGE, NO_DIAMOND, PAGE_BYTES};
pub use error::PackError;
pub use head::{Head, parse_head};
pub use header::{HEAD_BYTES, HEADER_BYTES, Header};
pub use index::Index;
pub use metadata::{Metadata, ScalarChannel};
pub use reader::{Reader, SliceSource, Source};
pub use relocate::{relocate, relocate_with_channels};
pub use vertex_layout::{GpuChunk, interleave};
pub use writer::PackWriter;

//! The directory: one fixed-size entry per diamond, coarse to fine, in pages of 16 KiB. FORMAT section 4.
//!
//! Entry 0 is the *root*: its chunk holds the patches of the six root tetrahedra, it has no parents, and it is always
//! refined. Entry `i > 0` is a diamond; its chunk holds the patches of its tetrahedra's children.

use crate::error::PackError;
use kilwa_geometry::{Aabb, Sphere};

/// Bytes of one page: a 128-byte page header and 127 entries of 128 bytes.
pub const PAGE_BYTES: usize = 16_384;
/// Entries in a full page.
pub const ENTRIES_PER_PAGE: usize = 127;
/// Bytes of one entry.
pub const ENTRY_BYTES: usize = 128;
/// "No such diamond": a leaf patch, or an unused parent slot.
pub const NO_DIAMOND: u32 = u32::MAX;

/// What the directory says of one diamond and its chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectoryEntry {
    /// Byte offset of the chunk in the file.
    pub offset: u64,
    /// Encoded bytes of the chunk.
    pub encoded_bytes: u32,
    /// Vertices in the chunk.
    pub vertices: u32,
    /// Triangles in the chunk.
    pub triangles: u32,
    /// Level of the diamond; 0 for the root entry and for the root diamond.
    pub level: u8,
    /// Certified, saturated two-sided error of this diamond's *coarse* form (the patches in its parents' chunks), in
    /// metres, rounded up: what is on screen while the diamond is NOT refined differs from the finest surface by at
    /// most this. Infinite for the root entry (it is always refined).
    pub error: f32,
    /// Largest colour difference of the coarse form, 0 to 255 per channel (estimate, root mean square), saturated.
    pub color_error: f32,
    /// Saturated bounding sphere, in lattice steps: contains the chunk's geometry, the coarse form's, and the spheres of all children.
    pub sphere: Sphere,
    /// Box of the chunk's geometry.
    pub bounds: Aabb,
    /// Directory indices of the diamonds that must be refined before this one, or [`NO_DIAMOND`]; the root diamond has
    /// `[0, NO_DIAMOND, ..]`. Always smaller than the entry's own index.
    pub parents: [u32; 4],
    /// First 16 bytes of the chunk's BLAKE3 hash.
    pub checksum: [u8; 16],
}

impl DirectoryEntry {
    /// The parents that exist.
    pub fn parents(&self) -> impl Iterator<Item = u32> + '_ {
        self.parents.iter().copied().filter(|&p| p != NO_DIAMOND)
    }
}

/// Parse and check one page; `page` is its number. Checks the page checksum, and that offsets, counts, parents,
/// spheres and errors are possible. Returns its entries.
///
/// # Errors
/// [`PackError`] naming the page and entry.
pub fn parse_page(_bytes: &[u8], _page: u32, _entry_count: u32) -> Result<Vec<DirectoryEntry>, PackError> {
    todo!()
}

/// Serialise up to [`ENTRIES_PER_PAGE`] entries as page `page`.
pub fn write_page(_entries: &[DirectoryEntry], _page: u32) -> Vec<u8> {
    todo!()
}

//! The fixed header of 256 bytes. FORMAT section 3.

use crate::error::PackError;
use kilwa_geometry::Lattice;

/// Bytes of the header.
pub const HEADER_BYTES: usize = 256;
/// What a reader asks for first: header, metadata, page 0 and the coarsest chunks lie in it.
pub const HEAD_BYTES: u64 = 131_072;

/// The parsed header.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// The lattice of every position in the file.
    pub lattice: Lattice,
    /// The root cube is `0..=2^cube_log2` on each axis.
    pub cube_log2: u32,
    /// Length of the whole file, in bytes.
    pub file_bytes: u64,
    /// Offset and length of the metadata JSON, and the first 16 bytes of its BLAKE3 hash.
    pub metadata: (u64, u32),
    /// Checksum of the metadata.
    pub metadata_checksum: [u8; 16],
    /// Number of directory entries, the root entry included.
    pub entry_count: u32,
    /// Offset of directory page 0.
    pub first_page: u64,
    /// Offset of page 1; the pages from 1 on follow each other.
    pub other_pages: u64,
    /// Triangles of the finest level (the whole model).
    pub triangles: u64,
    /// Triangles stored, all levels.
    pub stored_triangles: u64,
    /// Vertices of all chunks.
    pub stored_vertices: u64,
    /// Attributes in every chunk.
    pub attributes: crate::Attributes,
}

impl Header {
    /// Number of directory pages.
    pub fn page_count(&self) -> u32 {
        self.entry_count.div_ceil(crate::ENTRIES_PER_PAGE as u32)
    }

    /// Byte range of a directory page, as offset and length.
    pub fn page_range(&self, page: u32) -> (u64, u64) {
        let offset =
            if page == 0 { self.first_page } else { self.other_pages + u64::from(page - 1) * crate::PAGE_BYTES as u64 };
        (offset, crate::PAGE_BYTES as u64)
    }

    /// Parse and check the first [`HEADER_BYTES`] bytes of a file.
    ///
    /// # Errors
    /// [`PackError`] when this is no pack, a newer one, damaged or impossible.
    pub fn parse(_bytes: &[u8]) -> Result<Self, PackError> {
        todo!()
    }

    /// Serialise, checksum included.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        todo!()
    }
}

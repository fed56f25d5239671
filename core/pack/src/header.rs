//! The fixed header of 256 bytes. FORMAT section 3.

use crate::bytes::Cursor;
use crate::error::PackError;
use crate::plural::counted;
use glam::DVec3;
use kilwa_geometry::{Lattice, lattice::MAX_COORDINATE};

/// Bytes of the header.
pub const HEADER_BYTES: usize = 256;
/// Length of a reader's first request: header, metadata, page 0 and the coarsest chunks lie in it.
pub const HEAD_BYTES: u64 = 131_072;

/// First bytes of every pack.
pub const MAGIC: [u8; 8] = *b"KILWAPCK";
/// Format version of new packs of surfaces: major, minor. Every minor version of this major one is read; what they add is indicated by
/// feature bits.
pub const VERSION: (u16, u16) = (1, 1);
/// Required features that this reader knows.
const KNOWN: u64 = FEATURE_CODEC_2 | FEATURE_POINTS;
/// Required feature 0 (since 1.1): chunks may be coded by codec 2.
const FEATURE_CODEC_2: u64 = 1;
/// Required feature 1 (since 1.2): the model is made of points, and all chunks have codec 3.
const FEATURE_POINTS: u64 = 2;
/// Format version of new packs of points.
pub const POINTS_VERSION: (u16, u16) = (1, 2);
/// Longest metadata block, in bytes: it has to leave room for page 0 and a picture in the first [`HEAD_BYTES`].
pub const MAX_METADATA_BYTES: u32 = 65_536;
/// Most directory entries: indices are 32-bit and `u32::MAX` means none.
pub const MAX_ENTRIES: u32 = u32::MAX - 1;
/// Where the header's own hash lies in it.
const HASH_AT: usize = 224;

/// The parsed header.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Format version: major, minor.
    pub version: (u16, u16),
    /// Bits of the features that a reader must know. FORMAT section 3.
    pub required_features: u64,
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
    /// The header of a pack that is to be written; the writer fills in the offsets, lengths and counts, which are 0.
    pub fn new(lattice: Lattice, cube_log2: u32, triangles: u64, attributes: crate::Attributes) -> Self {
        Self {
            version: VERSION,
            required_features: FEATURE_CODEC_2,
            lattice,
            cube_log2,
            file_bytes: 0,
            metadata: (0, 0),
            metadata_checksum: [0; 16],
            entry_count: 0,
            first_page: 0,
            other_pages: 0,
            triangles,
            stored_triangles: 0,
            stored_vertices: 0,
            attributes,
        }
    }

    /// The header of a pack that gets chunks encoded by this program, whatever the version was before.
    #[must_use]
    pub fn with_current_codec(self) -> Self {
        Self { version: self.version.max(VERSION), required_features: self.required_features | FEATURE_CODEC_2, ..self }
    }

    /// The header of a pack of points.
    #[must_use]
    pub fn of_points(self) -> Self {
        Self { version: POINTS_VERSION, required_features: FEATURE_POINTS, ..self }
    }

    /// Whether the model is made of points: its triangles are squares that stand for them, two for each point.
    pub fn is_of_points(&self) -> bool {
        self.required_features & FEATURE_POINTS != 0
    }

    /// Number of directory pages.
    pub fn page_count(&self) -> u32 {
        self.entry_count.div_ceil(127)
    }

    /// Byte range of a directory page, as offset and length.
    pub fn page_range(&self, page: u32) -> (u64, u64) {
        let bytes = crate::PAGE_BYTES as u64;
        let offset = if page == 0 {
            self.first_page
        } else {
            self.other_pages.saturating_add(u64::from(page - 1).saturating_mul(bytes))
        };
        (offset, bytes)
    }

    /// Check that a chunk has a codec that the header announces.
    pub(crate) fn announces_codec_of(&self, chunk: &[u8]) -> Result<(), PackError> {
        if chunk.first() == Some(&crate::chunk::CODEC_2) && self.required_features & FEATURE_CODEC_2 == 0 {
            return Err(PackError::invalid("chunk", "it has codec 2, which the header does not announce"));
        }
        // Elsewhere a chunk of points has an unknown codec.
        if cfg!(any(not(target_arch = "wasm32"), feature = "points"))
            && (chunk.first() == Some(&crate::chunk::CODEC_3)) != self.is_of_points()
        {
            return Err(PackError::invalid("chunk", "the header does not announce its codec"));
        }
        Ok(())
    }

    /// Parse and check the first [`HEADER_BYTES`] bytes of a file.
    ///
    /// # Errors
    /// [`PackError`] when this is not a pack, or is a newer one, damaged or impossible.
    pub fn parse(bytes: &[u8]) -> Result<Self, PackError> {
        let there = bytes.len().min(MAGIC.len());
        if bytes.get(..there) != MAGIC.get(..there) || there == 0 {
            return Err(PackError::Magic);
        }
        let Some((hashed, hash)) = bytes.get(..HEADER_BYTES).and_then(|b| b.split_at_checked(HASH_AT)) else {
            return Err(PackError::Truncated {
                what: "header".to_owned(),
                needed: HEADER_BYTES as u64,
                available: bytes.len() as u64,
            });
        };
        if blake3::hash(hashed).as_bytes().as_slice() != hash {
            return Err(PackError::checksum("header"));
        }
        let mut c = Cursor::new(hashed, "header");
        c.take(MAGIC.len())?;
        let (major, minor) = (c.u16()?, c.u16()?);
        if major != VERSION.0 {
            return Err(PackError::Version { major, minor });
        }
        if c.u32()? as usize != HEADER_BYTES {
            return Err(PackError::invalid("header", "its length is not 256 bytes"));
        }
        let required_features = c.u64()?;
        let unknown = required_features & !KNOWN;
        if unknown != 0 {
            return Err(PackError::Feature { bit: unknown.trailing_zeros() });
        }
        c.u64()?; // Optional features: a reader may ignore every one of them.
        let header = Self {
            version: (major, minor),
            required_features,
            lattice: Lattice { origin: DVec3::new(c.f64()?, c.f64()?, c.f64()?), step_log2: c.i32()? },
            cube_log2: c.u32()?,
            file_bytes: c.u64()?,
            metadata: (c.u64()?, c.u32()?),
            entry_count: c.u32()?,
            metadata_checksum: c.array()?,
            first_page: c.u64()?,
            other_pages: c.u64()?,
            triangles: c.u64()?,
            stored_triangles: c.u64()?,
            stored_vertices: c.u64()?,
            attributes: {
                let (flags, scalars) = (c.u8()?, c.u8()?);
                if flags > 1 {
                    return Err(PackError::invalid("header", format!("attribute flags {flags:#x} are unknown")));
                }
                crate::Attributes { colors: flags == 1, scalars }
            },
        };
        header.check()?;
        Ok(header)
    }

    /// Whether all values are possible, whoever made them.
    pub(crate) fn check(&self) -> Result<(), PackError> {
        let bad = |why: String| Err(PackError::invalid("header", why));
        if !self.lattice.origin.to_array().iter().all(|x| x.is_finite()) {
            return bad("the lattice origin is not finite".to_owned());
        }
        if !(-1000..=1000).contains(&self.lattice.step_log2) {
            return bad(format!("a lattice spacing of 2^{} metres is not usable", self.lattice.step_log2));
        }
        if self.cube_log2 == 0 || self.cube_log2 > (MAX_COORDINATE + 1).trailing_zeros() {
            return bad(format!("a root cube of 2^{} steps is not usable", self.cube_log2));
        }
        if self.attributes.scalars > crate::chunk::MAX_SCALARS {
            return bad(format!("{} scalar channels; at most 16 are allowed", self.attributes.scalars));
        }
        if self.entry_count == 0 || self.entry_count > MAX_ENTRIES {
            return bad(format!("{} directory entries are not possible", self.entry_count));
        }
        let (at, length) = self.metadata;
        if at < HEADER_BYTES as u64 || length == 0 || length > MAX_METADATA_BYTES {
            return bad(format!("metadata of {} at {at} is not possible", counted(length, "byte", "bytes")));
        }
        let last = |(offset, bytes): (u64, u64)| offset.checked_add(bytes).filter(|&end| end <= self.file_bytes);
        let others = u64::from(self.page_count() - 1).saturating_mul(crate::PAGE_BYTES as u64);
        for (what, range) in [
            ("metadata", (at, u64::from(length))),
            ("directory page 0", (self.first_page, crate::PAGE_BYTES as u64)),
            ("directory pages", (self.other_pages, others)),
        ] {
            if last(range).is_none() {
                return bad(format!(
                    "{what} would lie outside the file of {}",
                    counted(self.file_bytes, "byte", "bytes")
                ));
            }
        }
        Ok(())
    }

    /// Serialise, checksum included.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let mut b = Vec::with_capacity(HEADER_BYTES);
        b.extend(MAGIC);
        b.extend(self.version.0.to_le_bytes());
        b.extend(self.version.1.to_le_bytes());
        b.extend(256u32.to_le_bytes());
        b.extend(self.required_features.to_le_bytes());
        b.extend(0u64.to_le_bytes()); // optional features
        for x in self.lattice.origin.to_array() {
            b.extend(x.to_le_bytes());
        }
        b.extend(self.lattice.step_log2.to_le_bytes());
        b.extend(self.cube_log2.to_le_bytes());
        b.extend(self.file_bytes.to_le_bytes());
        b.extend(self.metadata.0.to_le_bytes());
        b.extend(self.metadata.1.to_le_bytes());
        b.extend(self.entry_count.to_le_bytes());
        b.extend(self.metadata_checksum);
        for x in [self.first_page, self.other_pages, self.triangles, self.stored_triangles, self.stored_vertices] {
            b.extend(x.to_le_bytes());
        }
        b.extend([u8::from(self.attributes.colors), self.attributes.scalars]);
        b.resize(HASH_AT, 0);
        let hash = blake3::hash(&b);
        b.extend(hash.as_bytes());
        let mut out = [0; HEADER_BYTES];
        for (to, from) in out.iter_mut().zip(b) {
            *to = from;
        }
        out
    }
}

/// The header's own hash, its last 32 bytes, which the footer repeats.
pub(crate) fn hash_of(bytes: &[u8]) -> [u8; 32] {
    let mut out = [0; 32];
    for (to, from) in out.iter_mut().zip(bytes.iter().skip(HASH_AT)) {
        *to = *from;
    }
    out
}

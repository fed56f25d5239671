//! The footer: the last 80 bytes, so that a truncated copy is noticed and pages of two packs cannot be mixed.
//! FORMAT section 7.

use crate::PackError;
use crate::bytes::Cursor;

/// Bytes of the footer.
pub const FOOTER_BYTES: usize = 80;
/// First bytes of the footer.
pub const FOOTER_MAGIC: [u8; 8] = *b"KILWAEND";

/// The footer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footer {
    /// Length of the whole file.
    pub file_bytes: u64,
    /// The header's BLAKE3 hash (its last 32 bytes).
    pub header_hash: [u8; 32],
    /// BLAKE3 hash of all page checksums, in page order, 16 bytes each.
    pub directory_hash: [u8; 32],
}

impl Footer {
    /// Serialise.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut b = Vec::with_capacity(FOOTER_BYTES);
        b.extend(FOOTER_MAGIC);
        b.extend(self.file_bytes.to_le_bytes());
        b.extend(self.header_hash);
        b.extend(self.directory_hash);
        b
    }

    /// The name by which a measurement or an annotation refers to the pack: the first 16 bytes of the BLAKE3 hash of
    /// the footer, as 32 lower-case hexadecimal digits. The footer covers every checksum of the file, so that packs that
    /// differ anywhere are called otherwise. FORMAT section 7.
    pub fn identity(&self) -> String {
        let hash = blake3::hash(&self.to_bytes());
        hash.to_hex().chars().take(32).collect()
    }

    /// Parse the last [`FOOTER_BYTES`] bytes of a file.
    ///
    /// # Errors
    /// [`PackError::Truncated`] when too short, [`PackError::Invalid`] when it is not a footer.
    pub fn parse(bytes: &[u8]) -> Result<Self, PackError> {
        let mut c = Cursor::new(bytes, "footer");
        if c.array()? != FOOTER_MAGIC {
            return Err(
                c.invalid("it does not begin with \"KILWAEND\": the file is truncated or damaged; copy it again")
            );
        }
        let footer = Self { file_bytes: c.u64()?, header_hash: c.array()?, directory_hash: c.array()? };
        c.end()?;
        Ok(footer)
    }
}

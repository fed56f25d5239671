//! Reading a pack from anything that gives bytes by range.

use crate::{Chunk, DirectoryEntry, Header, Metadata, PackError};

/// Bytes by range: a file, a memory slice, an HTTP object.
pub trait Source {
    /// Length in bytes.
    ///
    /// # Errors
    /// What the system says.
    fn len(&self) -> std::io::Result<u64>;

    /// Exactly the bytes `offset .. offset + length`; a short read is an error of kind `UnexpectedEof`.
    ///
    /// # Errors
    /// What the system says.
    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>>;
}

/// An open pack: header, metadata and the whole directory, chunks on demand.
pub struct Reader<S> {
    source: S,
    header: Header,
    metadata: Metadata,
    entries: Vec<DirectoryEntry>,
}

impl<S: Source> Reader<S> {
    /// Open: checks header, file length, footer, metadata and every directory page.
    ///
    /// # Errors
    /// [`PackError`] naming the damaged part.
    pub fn open(_source: S) -> Result<Self, PackError> {
        todo!()
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The metadata.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// All directory entries; entry 0 is the root.
    pub fn entries(&self) -> &[DirectoryEntry] {
        &self.entries
    }

    /// The source it reads from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// Read, check and decode chunk `index`.
    ///
    /// # Errors
    /// [`PackError`] naming the chunk.
    pub fn chunk(&self, _index: u32) -> Result<Chunk, PackError> {
        todo!()
    }
}

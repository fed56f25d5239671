//! Laying out a pack: the caller hands encoded chunks over in directory order and gets the bytes to write.

use crate::{DirectoryEntry, Header, Metadata, PackError};

/// Lays out and writes one pack, streaming: no more than one chunk and the directory are held.
///
/// Use: all entries first (with `offset` unset and `encoded_bytes`, `checksum` known), then each chunk's bytes in
/// order. The order of the file is `header | metadata | page 0 | the first chunks that fit the head | pages 1.. | other
/// chunks | footer`.
pub struct PackWriter<W> {
    _out: W,
}

impl<W: std::io::Write> PackWriter<W> {
    /// Fix every offset and write header, metadata and page 0. `header`'s offsets, counts and lengths are filled in here.
    ///
    /// # Errors
    /// [`PackError::Invalid`] when entries are out of order; [`PackError::Io`] when writing fails.
    pub fn begin(
        _out: W,
        _header: Header,
        _metadata: &Metadata,
        _entries: Vec<DirectoryEntry>,
    ) -> Result<Self, PackError> {
        todo!()
    }

    /// Write the next chunk, in entry order; its length and checksum must be those announced.
    ///
    /// # Errors
    /// As [`PackWriter::begin`].
    pub fn chunk(&mut self, _encoded: &[u8]) -> Result<(), PackError> {
        todo!()
    }

    /// Write the footer and give the writer back; every chunk must have been written.
    ///
    /// # Errors
    /// As [`PackWriter::begin`].
    pub fn finish(self) -> Result<W, PackError> {
        todo!()
    }
}

//! Where the simulated bytes come from.

use crate::streamer::Streamer;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{HEAD_BYTES, Head, PackError, PatchRange, Reader, Source, parse_head};

/// What the other end of the link has.
pub trait Store {
    /// The bytes of directory pages; `None` if there are none.
    fn pages(&mut self, offset: u64, length: u64) -> Option<Vec<u8>>;

    /// The patches of a chunk, as its decoder finds them; `None` where it is damaged.
    fn patches(&mut self, chunk: u32) -> Option<Vec<PatchRange>>;
}

/// A real pack.
pub struct PackStore<S> {
    reader: Reader<S>,
    head: Head,
    head_bytes: u64,
}

impl<S: Source> PackStore<S> {
    /// Open a pack.
    ///
    /// # Errors
    /// [`PackError`] when it cannot be read or is none.
    pub fn open(source: S) -> Result<Self, PackError> {
        let reader = Reader::open(source)?;
        let mut head_bytes = HEAD_BYTES.min(reader.header().file_bytes);
        let head = match parse_head(&read(reader.source(), 0, head_bytes)?) {
            Err(PackError::Truncated { needed, .. }) if needed > head_bytes => {
                head_bytes = needed;
                parse_head(&read(reader.source(), 0, needed)?)?
            }
            other => other?,
        };
        Ok(Self { reader, head, head_bytes })
    }

    /// The parsed head, for [`Streamer::new`].
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Bytes of the first request.
    pub fn head_bytes(&self) -> u64 {
        self.head_bytes
    }

    /// The pack.
    pub fn reader(&self) -> &Reader<S> {
        &self.reader
    }

    /// A streamer for it.
    pub fn streamer(&self, budgets: crate::Budgets) -> Streamer {
        Streamer::new(&self.head, self.head_bytes, budgets)
    }
}

impl<S: Source> Store for PackStore<S> {
    fn pages(&mut self, offset: u64, length: u64) -> Option<Vec<u8>> {
        read(self.reader.source(), offset, length).ok()
    }

    fn patches(&mut self, chunk: u32) -> Option<Vec<PatchRange>> {
        let entry = self.reader.entries().get(chunk as usize)?;
        let bytes = read(self.reader.source(), entry.offset, u64::from(entry.encoded_bytes)).ok()?;
        decode_checked(&bytes, chunk, entry, self.reader.header()).ok().map(|c| c.patches)
    }
}

fn read<S: Source>(source: &S, offset: u64, length: u64) -> Result<Vec<u8>, PackError> {
    let failed = |source| PackError::Io { what: "pack".to_owned(), source };
    let count = usize::try_from(length).map_err(|_| failed(std::io::ErrorKind::OutOfMemory.into()))?;
    source.read_at(offset, count).map_err(failed)
}

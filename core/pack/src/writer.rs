//! Laying out a pack: the caller hands encoded chunks over in directory order and gets the bytes to write.

use crate::directory::{page_checksum, write_page};
use crate::footer::{FOOTER_BYTES, Footer};
use crate::header::hash_of;
use crate::plural::counted;
use crate::{DirectoryEntry, ENTRIES_PER_PAGE, HEAD_BYTES, HEADER_BYTES, Header, Metadata, PAGE_BYTES, PackError};

/// Lays out and writes one pack, streaming: no more than one chunk and the directory are held.
///
/// Use: all entries first (with `offset` unset and `encoded_bytes`, `checksum` known), then each chunk's bytes in
/// order. The order of the file is `header | metadata | page 0 | the first chunks that fit the head | pages 1.. | other
/// chunks | footer`.
pub struct PackWriter<W> {
    out: W,
    header: Header,
    /// Length and checksum announced for each chunk.
    announced: Vec<(u32, [u8; 16])>,
    written: usize,
    /// Pages from 1 on, written before chunk number `pages_before`; emptied when written.
    other_pages: Vec<Vec<u8>>,
    pages_before: usize,
    directory_hash: [u8; 32],
}

impl<W: std::io::Write> PackWriter<W> {
    /// Fix every offset and write header, metadata and page 0. `header`'s offsets, counts and lengths are filled in here.
    ///
    /// # Errors
    /// [`PackError::Invalid`] when entries are out of order; [`PackError::Io`] when writing fails.
    pub fn begin(
        out: W,
        mut header: Header,
        metadata: &Metadata,
        mut entries: Vec<DirectoryEntry>,
    ) -> Result<Self, PackError> {
        header.entry_count = u32::try_from(entries.len())
            .map_err(|_| PackError::invalid("directory", "it has more than 2^32 entries"))?;
        header.stored_triangles = entries.iter().map(|e| u64::from(e.triangles)).sum();
        header.stored_vertices = entries.iter().map(|e| u64::from(e.vertices)).sum();
        let json = metadata.to_bytes(&header)?;
        header.metadata = (HEADER_BYTES as u64, u32::try_from(json.len()).unwrap_or(u32::MAX));
        header.metadata_checksum = crate::checksum(&json);
        header.first_page = (header.metadata.0 + u64::from(header.metadata.1)).next_multiple_of(16);
        let pages_before = lay_out(&mut header, &mut entries);
        header.check()?;
        for (index, entry) in (0u32..).zip(&entries) {
            entry.check(index)?;
        }
        crate::reader::check_tree(&entries)?;
        let mut pages: Vec<Vec<u8>> =
            (0u32..).zip(entries.chunks(ENTRIES_PER_PAGE)).map(|(number, page)| write_page(page, number)).collect();
        let directory_hash = directory_hash(pages.iter().map(|page| page_checksum(page)));
        let first = if pages.is_empty() { Vec::new() } else { pages.remove(0) };
        let announced = entries.iter().map(|e| (e.encoded_bytes, e.checksum)).collect();
        let mut writer = Self { out, header, announced, written: 0, other_pages: pages, pages_before, directory_hash };
        let padding = writer.header.first_page - writer.header.metadata.0 - u64::from(writer.header.metadata.1);
        writer.put(&writer.header.to_bytes(), "header")?;
        writer.put(&json, "metadata")?;
        writer.put(&vec![0; usize::try_from(padding).unwrap_or(0)], "metadata")?;
        writer.put(&first, "directory page 0")?;
        Ok(writer)
    }

    /// Write the next chunk, in entry order; its length and checksum must be those announced.
    ///
    /// # Errors
    /// As [`PackWriter::begin`].
    pub fn chunk(&mut self, encoded: &[u8]) -> Result<(), PackError> {
        let what = format!("chunk {}", self.written);
        let Some(&(length, sum)) = self.announced.get(self.written) else {
            return Err(PackError::invalid(what, "it was not announced in the directory"));
        };
        if encoded.len() != length as usize || crate::checksum(encoded) != sum {
            return Err(PackError::invalid(what, "its length or checksum is not the one announced"));
        }
        if self.written == self.pages_before {
            self.put_other_pages()?;
        }
        self.put(encoded, &what)?;
        self.written += 1;
        Ok(())
    }

    /// Write the footer and give the writer back; every chunk must have been written.
    ///
    /// # Errors
    /// As [`PackWriter::begin`].
    pub fn finish(mut self) -> Result<W, PackError> {
        if self.written != self.announced.len() {
            return Err(PackError::invalid(
                "pack",
                format!("{} written, {} announced", counted(self.written, "chunk", "chunks"), self.announced.len()),
            ));
        }
        self.put_other_pages()?;
        let footer = Footer {
            file_bytes: self.header.file_bytes,
            header_hash: hash_of(&self.header.to_bytes()),
            directory_hash: self.directory_hash,
        };
        self.put(&footer.to_bytes(), "footer")?;
        self.out.flush().map_err(|source| PackError::Io { what: "pack".to_owned(), source })?;
        Ok(self.out)
    }

    fn put_other_pages(&mut self) -> Result<(), PackError> {
        for (i, page) in std::mem::take(&mut self.other_pages).iter().enumerate() {
            self.put(page, &format!("directory page {}", i + 1))?;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8], what: &str) -> Result<(), PackError> {
        self.out.write_all(bytes).map_err(|source| PackError::Io { what: what.to_owned(), source })
    }
}

/// Give every chunk its offset: the first chunks follow page 0 as long as they fit the head, then come the other
/// pages, then the other chunks. Returns how many chunks lie before the other pages.
fn lay_out(header: &mut Header, entries: &mut [DirectoryEntry]) -> usize {
    let mut at = header.first_page.saturating_add(PAGE_BYTES as u64);
    let mut before = 0;
    for entry in entries.iter_mut() {
        let end = at.saturating_add(u64::from(entry.encoded_bytes));
        if end > HEAD_BYTES {
            break;
        }
        entry.offset = at;
        at = end;
        before += 1;
    }
    header.other_pages = at;
    let pages = u64::from(header.page_count().saturating_sub(1));
    at = at.saturating_add(pages.saturating_mul(PAGE_BYTES as u64));
    for entry in entries.iter_mut().skip(before) {
        entry.offset = at;
        at = at.saturating_add(u64::from(entry.encoded_bytes));
    }
    header.file_bytes = at.saturating_add(FOOTER_BYTES as u64);
    before
}

/// The footer's hash of the directory, from the page checksums in order.
pub fn directory_hash(checksums: impl Iterator<Item = [u8; 16]>) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    for sum in checksums {
        hasher.update(&sum);
    }
    *hasher.finalize().as_bytes()
}

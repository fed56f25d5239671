//! Everything of a pack but its chunks: header, metadata, the whole directory and the footer, checked against each other.
//!
//! Made by [`crate::Reader`] from a source that is read at once, or by [`Index::parse`] from parts that were fetched by range.

use crate::directory::{page_checksum, parse_page};
use crate::footer::{FOOTER_BYTES, Footer};
use crate::header::hash_of;
use crate::reader::{check_ranges, check_totals, check_tree};
use crate::{DirectoryEntry, HEADER_BYTES, Header, Metadata, PAGE_BYTES, PackError, parse_head};

/// Everything of a pack but its chunks.
#[derive(Debug, Clone, PartialEq)]
pub struct Index {
    header: Header,
    metadata: Metadata,
    entries: Vec<DirectoryEntry>,
    footer: Footer,
}

/// A directory that is put together page by page.
#[derive(Debug, Default)]
pub(crate) struct Pages {
    entries: Vec<DirectoryEntry>,
    sums: Vec<[u8; 16]>,
}

impl Pages {
    /// The next page.
    pub(crate) fn add(&mut self, bytes: &[u8], header: &Header) -> Result<(), PackError> {
        let page = u32::try_from(self.sums.len()).unwrap_or(u32::MAX);
        self.entries.extend(parse_page(bytes, page, header.entry_count)?);
        self.sums.push(page_checksum(bytes));
        Ok(())
    }
}

impl Index {
    /// The bytes of a pack that [`Index::parse`] needs beside the head, as offset and length: directory pages from the second on.
    pub fn other_pages(header: &Header) -> (u64, u64) {
        (header.other_pages, u64::from(header.page_count().saturating_sub(1)).saturating_mul(PAGE_BYTES as u64))
    }

    /// The bytes of the footer, as offset and length.
    pub fn footer_range(header: &Header) -> (u64, u64) {
        (header.file_bytes.saturating_sub(FOOTER_BYTES as u64), FOOTER_BYTES as u64)
    }

    /// From the first bytes of a pack (as for [`parse_head`]), the pages of [`Index::other_pages`] and the footer.
    ///
    /// # Errors
    /// [`PackError`] naming the damaged part.
    pub fn parse(head: &[u8], other_pages: &[u8], footer: &[u8]) -> Result<Self, PackError> {
        let parsed = parse_head(head)?;
        let (_, needed) = Self::other_pages(&parsed.header);
        if other_pages.len() as u64 != needed {
            let what = "directory".to_owned();
            return Err(PackError::Truncated { what, needed, available: other_pages.len() as u64 });
        }
        let mut pages = Pages::default();
        let first = usize::try_from(parsed.header.first_page).unwrap_or(usize::MAX);
        let first = first.checked_add(PAGE_BYTES).and_then(|end| head.get(first..end)).unwrap_or_default();
        for page in std::iter::once(first).chain(other_pages.chunks_exact(PAGE_BYTES)) {
            pages.add(page, &parsed.header)?;
        }
        Self::new(head, parsed.header, parsed.metadata, pages, Footer::parse(footer)?)
    }

    /// Put together; `head` begins with the header's bytes.
    pub(crate) fn new(
        head: &[u8],
        header: Header,
        metadata: Metadata,
        pages: Pages,
        footer: Footer,
    ) -> Result<Self, PackError> {
        let Pages { entries, sums } = pages;
        check_ranges(&header, &entries, 0)?;
        check_totals(&header, &entries)?;
        check_tree(&entries)?;
        if footer.file_bytes != header.file_bytes
            || footer.header_hash != hash_of(head.get(..HEADER_BYTES).unwrap_or_default())
        {
            return Err(PackError::invalid("footer", "it belongs to another pack"));
        }
        if footer.directory_hash != crate::writer::directory_hash(sums.into_iter()) {
            return Err(PackError::invalid("footer", "the directory is not the one that was written with it"));
        }
        Ok(Self { header, metadata, entries, footer })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The metadata.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The name by which others refer to the pack: [`Footer::identity`].
    pub fn identity(&self) -> String {
        self.footer.identity()
    }

    /// All directory entries; entry 0 is the root.
    pub fn entries(&self) -> &[DirectoryEntry] {
        &self.entries
    }
}

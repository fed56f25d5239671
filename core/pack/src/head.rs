//! The first bytes of a file, as a streaming viewer gets them in one request: header, metadata and page 0.
//! FORMAT section 2.

use crate::directory::parse_page;
use crate::{DirectoryEntry, Header, Metadata, PAGE_BYTES, PackError};

/// The contents of the first bytes of a pack.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// The header.
    pub header: Header,
    /// The metadata.
    pub metadata: Metadata,
    /// The entries of directory page 0: the coarsest diamonds, at most [`crate::ENTRIES_PER_PAGE`].
    pub entries: Vec<DirectoryEntry>,
}

/// Parse the beginning of a file, normally its first [`crate::HEAD_BYTES`] bytes. Chunks of page 0's entries whose
/// range lies inside `bytes` can be decoded from it at once.
///
/// # Errors
/// [`PackError::Truncated`] whose `needed` says how many bytes from the start of the file are needed, when metadata or
/// page 0 reach beyond `bytes`; any other [`PackError`] when the file is not a pack or is damaged.
pub fn parse_head(bytes: &[u8]) -> Result<Head, PackError> {
    let header = Header::parse(bytes)?;
    let (at, length) = header.metadata;
    let metadata_end = at.saturating_add(u64::from(length));
    let page_end = header.first_page.saturating_add(PAGE_BYTES as u64);
    let needed = metadata_end.max(page_end);
    if needed > bytes.len() as u64 {
        return Err(PackError::Truncated { what: "head".to_owned(), needed, available: bytes.len() as u64 });
    }
    let metadata = Metadata::parse(slice(bytes, at, u64::from(length)), &header)?;
    let page = slice(bytes, header.first_page, PAGE_BYTES as u64);
    let entries = parse_page(page, 0, header.entry_count)?;
    crate::reader::check_ranges(&header, &entries, 0)?;
    Ok(Head { header, metadata, entries })
}

/// The bytes at `offset`, or none of them when they are not all there.
fn slice(bytes: &[u8], offset: u64, length: u64) -> &[u8] {
    let (Ok(from), Ok(to)) = (usize::try_from(offset), usize::try_from(offset.saturating_add(length))) else {
        return &[];
    };
    bytes.get(from..to).unwrap_or_default()
}

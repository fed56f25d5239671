//! Reading a pack from anything that gives bytes by range.

use crate::chunk::Declared;
use crate::footer::{FOOTER_BYTES, Footer};
use crate::index::{Index, Pages};
use crate::plural::counted;
use crate::{Chunk, DirectoryEntry, HEADER_BYTES, Header, Metadata, PAGE_BYTES, PackError, PatchRange};

/// Bytes by range: a file, a memory slice, an HTTP object.
pub trait Source {
    /// Length in bytes.
    ///
    /// # Errors
    /// What the system says.
    fn len(&self) -> std::io::Result<u64>;

    /// Whether there is no byte at all.
    ///
    /// # Errors
    /// What the system says.
    fn is_empty(&self) -> std::io::Result<bool> {
        Ok(self.len()? == 0)
    }

    /// Exactly the bytes `offset .. offset + length`; a short read is an error of kind `UnexpectedEof`. Callers ask
    /// only for what lies inside [`Source::len`].
    ///
    /// # Errors
    /// What the system says.
    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>>;

    /// Stretches (offset and length in bytes, inside of [`Source::len`]) that will be read next, most of them and mostly in this order: a source that
    /// is far away may fetch them together. Failures are reported when they are read.
    fn expect(&self, stretches: &[(u64, usize)]) {
        let _ = stretches;
    }
}

/// A pack in memory.
#[derive(Debug, Clone)]
pub struct SliceSource<B>(pub B);

impl<B: AsRef<[u8]>> Source for SliceSource<B> {
    fn len(&self) -> std::io::Result<u64> {
        Ok(self.0.as_ref().len() as u64)
    }

    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        let from = usize::try_from(offset).ok();
        let range = from.and_then(|from| Some(from..from.checked_add(length)?));
        let bytes = range.and_then(|range| self.0.as_ref().get(range));
        bytes.map(<[u8]>::to_vec).ok_or_else(|| std::io::ErrorKind::UnexpectedEof.into())
    }
}

/// An open pack: header, metadata and the whole directory, chunks on demand.
pub struct Reader<S> {
    source: S,
    index: Index,
}

impl<S: Source> Reader<S> {
    /// Open: checks header, file length, footer, metadata and every directory page.
    ///
    /// # Errors
    /// [`PackError`] naming the damaged part.
    pub fn open(source: S) -> Result<Self, PackError> {
        let there = source.len().map_err(|source| PackError::Io { what: "pack".to_owned(), source })?;
        let first = there.min(HEADER_BYTES as u64);
        let header_bytes = read(&source, "header", 0, first)?;
        let header = Header::parse(&header_bytes)?;
        if there < header.file_bytes {
            return Err(PackError::Truncated { what: "pack".to_owned(), needed: header.file_bytes, available: there });
        }
        if there > header.file_bytes {
            return Err(PackError::invalid(
                "pack",
                format!(
                    "{} its end; copy the file again",
                    counted(there - header.file_bytes, "byte follows", "bytes follow")
                ),
            ));
        }
        let (at, length) = header.metadata;
        let metadata = Metadata::parse(&read(&source, "metadata", at, u64::from(length))?, &header)?;
        let pages = read_directory(&source, &header)?;
        let at = there.saturating_sub(FOOTER_BYTES as u64);
        let footer = Footer::parse(&read(&source, "footer", at, FOOTER_BYTES as u64)?)?;
        Ok(Self { source, index: Index::new(&header_bytes, header, metadata, pages, footer)? })
    }

    /// Everything but the chunks.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// The header.
    pub fn header(&self) -> &Header {
        self.index.header()
    }

    /// The metadata.
    pub fn metadata(&self) -> &Metadata {
        self.index.metadata()
    }

    /// The name by which others refer to the pack: [`Footer::identity`].
    pub fn identity(&self) -> String {
        self.index.identity()
    }

    /// All directory entries; entry 0 is the root.
    pub fn entries(&self) -> &[DirectoryEntry] {
        self.index.entries()
    }

    /// The source it reads from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// Read, check and decode chunk `index`.
    ///
    /// # Errors
    /// [`PackError`] naming the chunk.
    pub fn chunk(&self, index: u32) -> Result<Chunk, PackError> {
        let what = format!("chunk {index}");
        let Some(entry) = self.entries().get(index as usize) else {
            return Err(PackError::invalid(
                what,
                format!("the pack has {}", counted(self.entries().len(), "chunk", "chunks")),
            ));
        };
        let bytes = read(&self.source, &what, entry.offset, u64::from(entry.encoded_bytes))?;
        decode_checked(&bytes, index, entry, self.header())
    }

    /// The patch table of a chunk. The checksum is compared, but the geometry is not decoded; [`crate::verify::links`] checks the diamonds in it.
    ///
    /// # Errors
    /// As [`Self::chunk`], but not for errors in the geometry, nor for patches with wrong diamonds.
    pub fn patches(&self, index: u32) -> Result<Vec<PatchRange>, PackError> {
        let what = format!("chunk {index}");
        let entry = self.entries().get(index as usize).ok_or_else(|| {
            let count = counted(self.entries().len(), "chunk", "chunks");
            PackError::invalid(what.clone(), format!("the pack has {count}"))
        })?;
        let bytes = read(&self.source, &what, entry.offset, u64::from(entry.encoded_bytes))?;
        if crate::checksum(&bytes) != entry.checksum {
            return Err(PackError::checksum(what));
        }
        self.header().announces_codec_of(&bytes)?;
        let patches = crate::chunk::patch_table(&bytes)?;
        if patches.iter().map(|p| u64::from(p.count)).sum::<u64>() != u64::from(entry.triangles) {
            return Err(PackError::invalid(what, "its patches do not have as many triangles as its directory entry"));
        }
        Ok(patches)
    }
}

/// Check and decode the bytes of chunk `index`, however they were fetched.
///
/// # Errors
/// [`PackError`] naming the chunk.
pub fn decode_checked(bytes: &[u8], index: u32, entry: &DirectoryEntry, header: &Header) -> Result<Chunk, PackError> {
    let what = format!("chunk {index}");
    if bytes.len() as u64 != u64::from(entry.encoded_bytes) {
        let needed = u64::from(entry.encoded_bytes);
        return Err(PackError::Truncated { what, needed, available: bytes.len() as u64 });
    }
    if crate::checksum(bytes) != entry.checksum {
        return Err(PackError::checksum(what));
    }
    let declared = Declared { vertices: entry.vertices, triangles: entry.triangles };
    let decoded =
        header.announces_codec_of(bytes).and_then(|()| crate::chunk::decode(bytes, declared, header.attributes));
    let chunk = decoded.map_err(|e| match e {
        PackError::Invalid { what: part, why } => PackError::invalid(what.clone(), format!("{part}: {why}")),
        other => other,
    })?;
    let unknown = |p: &&crate::PatchRange| {
        p.diamond != crate::NO_DIAMOND && (p.diamond <= index || p.diamond >= header.entry_count)
    };
    if let Some(patch) = chunk.patches.iter().find(unknown) {
        return Err(PackError::invalid(
            what,
            format!("a patch names diamond {}, which is no later one", patch.diamond),
        ));
    }
    Ok(chunk)
}

/// Read `length` bytes that were checked to lie inside the file.
fn read<S: Source>(source: &S, what: &str, offset: u64, length: u64) -> Result<Vec<u8>, PackError> {
    let io = |source| PackError::Io { what: what.to_owned(), source };
    let length = usize::try_from(length).map_err(|_| io(std::io::ErrorKind::OutOfMemory.into()))?;
    let bytes = source.read_at(offset, length).map_err(io)?;
    if bytes.len() != length {
        return Err(io(std::io::ErrorKind::UnexpectedEof.into()));
    }
    Ok(bytes)
}

/// All pages.
fn read_directory<S: Source>(source: &S, header: &Header) -> Result<Pages, PackError> {
    // The header was checked: all pages lie inside the file, so that memory is bounded by the file's length.
    let mut pages = Pages::default();
    let ranges = (0..header.page_count()).map(|page| header.page_range(page));
    let near = |(offset, length): (u64, u64)| Some((offset, usize::try_from(length).ok()?));
    source.expect(&ranges.filter_map(near).collect::<Vec<_>>());
    for page in 0..header.page_count() {
        let (offset, length) = header.page_range(page);
        pages.add(&read(source, &format!("directory page {page}"), offset, length)?, header)?;
    }
    Ok(pages)
}

/// Chunks lie inside the file, in order, without overlap; `first` is the index of the first of `entries`.
pub(crate) fn check_ranges(header: &Header, entries: &[DirectoryEntry], first: u32) -> Result<(), PackError> {
    let mut end = header.first_page.saturating_add(PAGE_BYTES as u64);
    for (index, entry) in (first..).zip(entries) {
        let stop = entry.offset.checked_add(u64::from(entry.encoded_bytes));
        let Some(stop) = stop.filter(|&stop| stop <= header.file_bytes && entry.offset >= end) else {
            let why = "its chunk lies outside the file or overlaps another";
            return Err(PackError::invalid(format!("directory entry {index}"), why));
        };
        end = stop;
    }
    Ok(())
}

pub(crate) fn check_totals(header: &Header, entries: &[DirectoryEntry]) -> Result<(), PackError> {
    let triangles: u64 = entries.iter().map(|e| u64::from(e.triangles)).sum();
    let vertices: u64 = entries.iter().map(|e| u64::from(e.vertices)).sum();
    if triangles != header.stored_triangles || vertices != header.stored_vertices {
        return Err(PackError::invalid(
            "directory",
            format!(
                "its chunks sum to {} and {}, the header says {} and {}",
                counted(triangles, "triangle", "triangles"),
                counted(vertices, "vertex", "vertices"),
                header.stored_triangles,
                header.stored_vertices
            ),
        ));
    }
    Ok(())
}

/// Entries come coarse to fine, and errors never grow from a parent to its child.
pub(crate) fn check_tree(entries: &[DirectoryEntry]) -> Result<(), PackError> {
    let mut level = 0;
    for (index, entry) in entries.iter().enumerate() {
        let bad = |why: String| Err(PackError::invalid(format!("directory entry {index}"), why));
        if entry.level < level {
            return bad(format!("level {} after level {level}", entry.level));
        }
        level = entry.level;
        for parent in entry.parents() {
            let Some(above) = entries.get(parent as usize) else {
                return bad(format!("parent {parent} does not exist"));
            };
            // The root entry is always refined: it has no coarse form and so no colour error.
            if above.error < entry.error || (parent != 0 && above.color_error < entry.color_error) {
                return bad(format!("its error is larger than that of its parent {parent}"));
            }
            if parent != 0 && above.level >= entry.level {
                return bad(format!("its parent {parent} is not of a coarser level"));
            }
        }
    }
    Ok(())
}

/// Every sphere contains the spheres of the diamonds below it, to a relative 1e-9 of its radius.
///
/// # Errors
/// [`PackError::Invalid`] naming the entry.
pub fn check_spheres(entries: &[DirectoryEntry]) -> Result<(), PackError> {
    for (index, entry) in entries.iter().enumerate() {
        for parent in entry.parents() {
            let contained = entries
                .get(parent as usize)
                .is_some_and(|above| above.sphere.contains(&entry.sphere, above.sphere.radius.abs() * 1e-9));
            if !contained {
                let why = format!("the sphere of its parent {parent} does not contain its own");
                return Err(PackError::invalid(format!("directory entry {index}"), why));
            }
        }
    }
    Ok(())
}

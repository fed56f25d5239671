//! The directory: one fixed-size entry per diamond, coarse to fine, in pages of 16 KiB. FORMAT section 4.
//!
//! Entry 0 is the *root*: its chunk holds the patches of the six root tetrahedra, it has no parents, and it is always
//! refined. Entry `i > 0` is a diamond; its chunk holds the patches of its tetrahedra's children.

use crate::bytes::Cursor;
use crate::chunk::{MAX_CHUNK_BYTES, MAX_CHUNK_TRIANGLES, MAX_CHUNK_VERTICES};
use crate::error::PackError;
use crate::plural::counted;
use glam::{DVec3, IVec3};
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::{Aabb, Sphere};

/// Bytes of one page: a 128-byte page header and 127 entries of 128 bytes.
pub const PAGE_BYTES: usize = 16_384;
/// Entries in a full page.
pub const ENTRIES_PER_PAGE: usize = 127;
/// Bytes of one entry.
pub const ENTRY_BYTES: usize = 128;
/// "No such diamond": a leaf patch, or an unused parent slot.
pub const NO_DIAMOND: u32 = u32::MAX;

/// The directory's entry of one diamond and its chunk.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectoryEntry {
    /// Byte offset of the chunk in the file.
    pub offset: u64,
    /// Encoded bytes of the chunk.
    pub encoded_bytes: u32,
    /// Vertices in the chunk.
    pub vertices: u32,
    /// Triangles in the chunk.
    pub triangles: u32,
    /// Level of the diamond; 0 for the root entry and for the root diamond.
    pub level: u8,
    /// Certified, saturated two-sided error of this diamond's *coarse* form (the patches in its parents' chunks), in
    /// metres, rounded up: what is on screen while the diamond is NOT refined differs from the finest surface by at
    /// most this. Infinite for the root entry (it is always refined).
    pub error: f32,
    /// Largest colour difference of the coarse form, 0 to 255 per channel (estimate, root mean square), saturated.
    pub color_error: f32,
    /// Saturated bounding sphere, in lattice units: contains the chunk's geometry, the coarse form's, and the spheres of all children.
    pub sphere: Sphere,
    /// Box of the chunk's geometry.
    pub bounds: Aabb,
    /// Directory indices of the diamonds that must be refined before this one, or [`NO_DIAMOND`]; the root diamond has
    /// `[0, NO_DIAMOND, ..]`. Always smaller than the entry's own index.
    pub parents: [u32; 4],
    /// First 16 bytes of the chunk's BLAKE3 hash.
    pub checksum: [u8; 16],
    /// The entries that name this one as a parent, if there are any and the directory lists them.
    pub children: Option<Children>,
}

/// The entries that refine patches of another: what a reader needs to know of them before it has their pages, or without the chunk.
/// FORMAT section 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Children {
    /// The first of them; larger than the index of the entry itself.
    pub first: u32,
    /// How many, at least 1.
    pub count: u8,
    /// Number of the directory page of the last one, less that of the first; at most 127.
    pub pages: u8,
    /// They replace every triangle of the chunk: it has no leaf patch, or only empty ones.
    pub is_whole: bool,
    /// No child has a larger error than so many 65535ths of the entry's own.
    pub share: u16,
}

/// Bit of the byte of [`Children::pages`] that says [`Children::is_whole`].
const WHOLE: u8 = 0x80;

impl Children {
    /// The directory pages from that of the first child to that of the last.
    pub fn pages(&self) -> std::ops::RangeInclusive<u32> {
        let first = page_of(self.first);
        first..=first.saturating_add(u32::from(self.pages))
    }

    /// Bound of the children's errors, metres, where the entry's own error is `own`.
    pub fn error(&self, own: f32) -> f32 {
        if self.share == u16::MAX {
            own
        } else {
            round_up(f64::from(own) * f64::from(self.share) / f64::from(u16::MAX))
        }
    }

    /// With the smallest share that bounds `largest`; all of an infinite error, which that of the root entry is.
    fn bounding(self, largest: f32, own: f32) -> Self {
        if !own.is_finite() {
            return Self { share: u16::MAX, ..self };
        }
        let quotient = (f64::from(largest) / f64::from(own) * f64::from(u16::MAX)).ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, and NaN becomes 0")]
        let mut of = Self { share: quotient as u16, ..self };
        while of.error(own) < largest && of.share < u16::MAX {
            of.share += 1; // The quotient was rounded.
        }
        of
    }
}

/// The directory page that an entry is on.
fn page_of(index: u32) -> u32 {
    u32::try_from(ENTRIES_PER_PAGE).map_or(0, |per_page| index / per_page)
}

/// Tell every entry its children, from the parents that entries name; `is_whole` says, by index, whether they replace all of its triangles.
/// Children whose numbers are too large for their fields are not listed.
pub fn link_children(entries: &mut [DirectoryEntry], is_whole: impl Fn(usize) -> bool) {
    let found = children_of(entries);
    for (index, (entry, children)) in entries.iter_mut().zip(found).enumerate() {
        entry.children = children.map(|c| Children { is_whole: is_whole(index), ..c });
    }
}

/// The value that [`DirectoryEntry::children`] must have, except for [`Children::is_whole`]; `None` if the fields are too small, or if no entry names this one as its parent.
pub(crate) fn children_of(entries: &[DirectoryEntry]) -> Vec<Option<Children>> {
    let mut found = vec![(0u32, 0u32, 0u32, 0f32); entries.len()];
    for (index, entry) in (0u32..).zip(entries) {
        for parent in entry.parents() {
            if let Some((first, last, count, error)) = usize::try_from(parent).ok().and_then(|p| found.get_mut(p)) {
                *first = if *count == 0 { index } else { *first };
                (*last, *count, *error) = (index, *count + 1, error.max(entry.error));
            }
        }
    }
    let children_of = |(&(first, last, count, error), entry): (&(u32, u32, u32, f32), &DirectoryEntry)| {
        let (count, pages) = (u8::try_from(count).ok()?, u8::try_from(page_of(last) - page_of(first)).ok()?);
        let children = Children { first, count, pages, is_whole: false, share: u16::MAX };
        (count > 0 && pages < WHOLE).then(|| children.bounding(error, entry.error))
    };
    found.iter().zip(entries).map(children_of).collect()
}

impl DirectoryEntry {
    /// The parents that exist.
    pub fn parents(&self) -> impl Iterator<Item = u32> + '_ {
        self.parents.iter().copied().filter(|&p| p != NO_DIAMOND)
    }
}

/// First bytes of a page.
pub const PAGE_MAGIC: [u8; 4] = *b"KPAG";
/// Bytes of a page's own header.
const PAGE_HEADER_BYTES: usize = 128;
/// Where the checksum lies in a page; it counts as zero when the checksum is computed.
const CHECKSUM_AT: std::ops::Range<usize> = 16..32;

/// The smallest `f32` that is not below `x`: how a certified error is stored. Infinite above the range of `f32`.
pub fn round_up(x: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "rounds to nearest; the next lines repair rounding down")]
    let nearest = x as f32;
    if f64::from(nearest) < x { nearest.next_up() } else { nearest }
}

/// Number of entries that page `page` of a directory of `entry_count` entries holds.
pub fn entries_in_page(page: u32, entry_count: u32) -> u32 {
    let full = u32::try_from(ENTRIES_PER_PAGE).unwrap_or(u32::MAX);
    entry_count.saturating_sub(page.saturating_mul(full)).min(full)
}

/// Parse and check one page; `page` is its number. Checks the page checksum, and that offsets, counts, parents,
/// spheres and errors are possible. Returns its entries.
///
/// # Errors
/// [`PackError`] naming the page and entry.
pub fn parse_page(bytes: &[u8], page: u32, entry_count: u32) -> Result<Vec<DirectoryEntry>, PackError> {
    let what = format!("directory page {page}");
    if bytes.len() != PAGE_BYTES {
        return Err(PackError::Truncated { what, needed: PAGE_BYTES as u64, available: bytes.len() as u64 });
    }
    let mut c = Cursor::new(bytes, &what);
    let (magic, number, count, _) = (c.array()?, c.u32()?, c.u32()?, c.u32()?);
    let stored: [u8; 16] = c.array()?;
    if page_checksum(bytes) != stored {
        return Err(PackError::checksum(what));
    }
    let expected = entries_in_page(page, entry_count);
    if magic != PAGE_MAGIC || number != page || count != expected {
        return Err(c.invalid(&format!(
            "it says to be page {number} with {}, {} expected",
            counted(count, "entry", "entries"),
            counted(expected, "is", "are")
        )));
    }
    c.take(PAGE_HEADER_BYTES - 32)?;
    let first = page.saturating_mul(u32::try_from(ENTRIES_PER_PAGE).unwrap_or(u32::MAX));
    let mut entries = Vec::with_capacity(usize::try_from(count).unwrap_or(0));
    for index in (first..).take(entries.capacity()) {
        let entry = parse_entry(&mut c)?;
        entry.check(index)?;
        entries.push(entry);
    }
    Ok(entries)
}

/// The checksum of a page.
pub(crate) fn page_checksum(bytes: &[u8]) -> [u8; 16] {
    let mut copy = bytes.to_vec();
    if let Some(field) = copy.get_mut(CHECKSUM_AT) {
        field.fill(0);
    }
    crate::checksum(&copy)
}

fn parse_entry(c: &mut Cursor<'_>) -> Result<DirectoryEntry, PackError> {
    let entry = DirectoryEntry {
        offset: c.u64()?,
        encoded_bytes: c.u32()?,
        vertices: c.u32()?,
        triangles: c.u32()?,
        error: c.f32()?,
        color_error: c.f32()?,
        level: u8::try_from(c.u32()?).map_err(|_| c.invalid("a level is above 255"))?,
        sphere: Sphere { center: DVec3::new(c.f64()?, c.f64()?, c.f64()?), radius: c.f64()? },
        bounds: Aabb { min: IVec3::new(c.i32()?, c.i32()?, c.i32()?), max: IVec3::new(c.i32()?, c.i32()?, c.i32()?) },
        parents: [c.u32()?, c.u32()?, c.u32()?, c.u32()?],
        checksum: c.array()?,
        children: {
            let (first, [count, pages], share) = (c.u32()?, c.array()?, c.u16()?);
            let (pages, is_whole) = (pages & !WHOLE, pages & WHOLE != 0);
            (count > 0).then_some(Children { first, count, pages, is_whole, share })
        },
    };
    Ok(entry)
}

impl DirectoryEntry {
    /// Whether all values are possible for entry `index`, whoever made them.
    pub(crate) fn check(&self, index: u32) -> Result<(), PackError> {
        let bad = |why: String| Err(PackError::invalid(format!("directory entry {index}"), why));
        if self.triangles > MAX_CHUNK_TRIANGLES || self.vertices > MAX_CHUNK_VERTICES {
            return bad(format!("{} triangles and {} vertices are too many", self.triangles, self.vertices));
        }
        if self.encoded_bytes == 0 || self.encoded_bytes > MAX_CHUNK_BYTES {
            return bad(format!("a chunk of {} bytes is not possible", self.encoded_bytes));
        }
        if self.error.is_nan() || self.error < 0.0 || self.color_error.is_nan() || self.color_error < 0.0 {
            return bad(format!("errors {} m and {} are not possible", self.error, self.color_error));
        }
        let s = &self.sphere;
        if !s.center.is_finite() || !s.radius.is_finite() {
            return bad("its sphere is not finite".to_owned());
        }
        let in_lattice = |p: IVec3| p.cmpge(IVec3::ZERO).all() && p.cmple(IVec3::splat(MAX_COORDINATE)).all();
        let b = &self.bounds;
        if !(b.is_empty() && self.vertices == 0 || in_lattice(b.min) && in_lattice(b.max) && !b.is_empty()) {
            return bad("its box is not possible".to_owned());
        }
        if self.children.is_some_and(|c| c.first <= index) {
            return bad("a child does not come after it".to_owned());
        }
        if index == 0 {
            if self.parents().next().is_some() || self.error != f32::INFINITY {
                return bad("the root entry has no parents and an infinite error".to_owned());
            }
            return Ok(());
        }
        let mut seen = Vec::with_capacity(4);
        for parent in self.parents() {
            if parent >= index || seen.contains(&parent) {
                return bad(format!("parent {parent} does not come before it, or occurs twice"));
            }
            seen.push(parent);
        }
        if seen.is_empty() {
            return bad("it has no parent".to_owned());
        }
        if self.error.is_infinite() {
            return bad("only the root entry has an infinite error".to_owned());
        }
        Ok(())
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend(self.offset.to_le_bytes());
        for x in [self.encoded_bytes, self.vertices, self.triangles] {
            out.extend(x.to_le_bytes());
        }
        out.extend(self.error.to_le_bytes());
        out.extend(self.color_error.to_le_bytes());
        out.extend(u32::from(self.level).to_le_bytes());
        for x in self.sphere.center.to_array() {
            out.extend(x.to_le_bytes());
        }
        out.extend(self.sphere.radius.to_le_bytes());
        for x in [self.bounds.min, self.bounds.max].map(|p| p.to_array()).as_flattened() {
            out.extend(x.to_le_bytes());
        }
        for x in self.parents {
            out.extend(x.to_le_bytes());
        }
        out.extend(self.checksum);
        let Some(c) = self.children else {
            out.extend([0; 8]);
            return;
        };
        out.extend(c.first.to_le_bytes());
        out.extend([c.count, c.pages | if c.is_whole { WHOLE } else { 0 }]);
        out.extend(c.share.to_le_bytes());
    }
}

/// Serialise up to [`ENTRIES_PER_PAGE`] entries as page `page`.
pub fn write_page(entries: &[DirectoryEntry], page: u32) -> Vec<u8> {
    let mut b = Vec::with_capacity(PAGE_BYTES);
    b.extend(PAGE_MAGIC);
    b.extend(page.to_le_bytes());
    b.extend(u32::try_from(entries.len()).unwrap_or(u32::MAX).to_le_bytes());
    b.resize(PAGE_HEADER_BYTES, 0);
    for entry in entries.iter().take(ENTRIES_PER_PAGE) {
        entry.write(&mut b);
    }
    b.resize(PAGE_BYTES, 0);
    let sum = page_checksum(&b);
    if let Some(field) = b.get_mut(CHECKSUM_AT) {
        field.copy_from_slice(&sum);
    }
    b
}

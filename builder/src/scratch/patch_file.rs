//! Patches by tetrahedron, in one file: any thread appends and reads. The index is at the end of a finished file.
//!
//! A patch is `vertices u32 | triangles u32 | flags u8 | channels u8 | positions 3×i32 | colours 3×u8 | normals 2×i16 |
//! scalars f32 | corners 3×u16 or 3×u32 | borders u8 | bounds 2×f32 | CRC-32`; colours, borders and bounds that are not
//! there, or are all zero, take no space. A leaf of a coloured scan takes about 17 bytes a triangle.

use super::{Scratch, ScratchError, ScratchFile};
use crate::levels::fragment::Patch;
use kilwa_geometry::{LatticePoint, Mesh};
use kilwa_simplify::Bound;
use rustc_hash::FxHashMap;
use std::sync::RwLock;

const COLORS: u8 = 1;
const NORMALS: u8 = 2;
const BORDERS: u8 = 4;
const BOUNDS: u8 = 8;
const WIDE: u8 = 16;

/// Ends a finished file: index, its checksum, number of patches, this.
const MAGIC: u64 = u64::from_le_bytes(*b"KLWPATCH");
/// Bytes of an index entry: tetrahedron, triangles, offset, length.
const ENTRY: usize = 24;
/// Bytes after the index: checksum, number of patches, magic.
const END: u64 = 20;

/// Where a patch is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) at: u64,
    pub(crate) bytes: u64,
    pub(crate) triangles: u32,
}

/// The index of a finished file of `length` bytes, of which `read` returns a range (first byte, number of bytes); `None`
/// if it is missing or damaged.
///
/// # Errors
/// Those of `read`.
pub(crate) fn read_index<E>(
    length: u64,
    read: impl Fn(u64, u64) -> Result<Vec<u8>, E>,
) -> Result<Option<Vec<(u32, Place)>>, E> {
    let Some(at) = length.checked_sub(END) else { return Ok(None) };
    let end = read(at, END)?;
    let sum = u32_at(&end, 0);
    let count = u64_at(&end, 4);
    let bytes = count.checked_mul(ENTRY as u64).filter(|b| *b <= at && u64_at(&end, 12) == MAGIC);
    let Some(bytes) = bytes else { return Ok(None) };
    let entries = read(at - bytes, bytes)?;
    if crc32fast::hash(&entries) != sum {
        return Ok(None);
    }
    let entry = |e: &[u8]| (u32_at(e, 0), Place { triangles: u32_at(e, 4), at: u64_at(e, 8), bytes: u64_at(e, 16) });
    Ok(Some(entries.chunks_exact(ENTRY).map(entry).collect()))
}

/// A file of patches.
#[derive(Debug)]
pub struct PatchFile {
    file: ScratchFile,
    index: RwLock<FxHashMap<u32, Place>>,
}

impl PatchFile {
    /// An empty file.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be made.
    pub fn create(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        Ok(Self { file: scratch.create(name)?, index: RwLock::default() })
    }

    /// A file that [`PatchFile::finish`] completed.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] where its index is not whole.
    pub fn open(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        let file = scratch.existing(name)?;
        let damaged = || ScratchError::damaged(file.path(), "it has no whole index");
        let index = read_index(file.len(), |at, bytes| file.read(at, bytes))?.ok_or_else(damaged)?;
        Ok(Self { index: RwLock::new(index.into_iter().collect()), file })
    }

    /// Append the patch of a tetrahedron. A second patch of the same tetrahedron replaces the first.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be written.
    pub fn append(&self, tetra: u32, patch: &Patch) -> Result<(), ScratchError> {
        self.append_encoded(tetra, patch.mesh.triangle_count() as u32, &encode(patch))
    }

    /// Append a patch of `triangles` triangles as another file holds it.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be written.
    pub(crate) fn append_encoded(&self, tetra: u32, triangles: u32, bytes: &[u8]) -> Result<(), ScratchError> {
        let at = self.file.append(bytes)?;
        let place = Place { at, bytes: bytes.len() as u64, triangles };
        self.index.write().unwrap_or_else(std::sync::PoisonError::into_inner).insert(tetra, place);
        Ok(())
    }

    /// A patch as the file holds it, with the number of its triangles.
    #[cfg(test)]
    pub(crate) fn read_encoded(&self, tetra: u32) -> Result<Option<(u32, Vec<u8>)>, ScratchError> {
        let Some(place) = self.place(tetra) else { return Ok(None) };
        Ok(Some((place.triangles, self.file.read(place.at, place.bytes)?)))
    }

    fn place(&self, tetra: u32) -> Option<Place> {
        self.index.read().unwrap_or_else(std::sync::PoisonError::into_inner).get(&tetra).copied()
    }

    /// The patch of a tetrahedron, where it has one.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] where it is not what was written.
    pub fn read(&self, tetra: u32) -> Result<Option<Patch>, ScratchError> {
        let Some(place) = self.place(tetra) else { return Ok(None) };
        let bytes = self.file.read(place.at, place.bytes)?;
        let patch = decode(&bytes).filter(|p| p.mesh.triangle_count() as u32 == place.triangles);
        let damaged =
            || ScratchError::damaged(self.file.path(), format!("the patch at byte {} is not whole", place.at));
        patch.map(Some).ok_or_else(damaged)
    }

    /// Triangles of the patch of a tetrahedron, 0 where it has none.
    pub fn triangles(&self, tetra: u32) -> u32 {
        self.place(tetra).map_or(0, |p| p.triangles)
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.index.read().unwrap_or_else(std::sync::PoisonError::into_inner).len()
    }

    /// Whether there is no patch.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Tetrahedra with a patch, ascending.
    pub fn tetrahedra(&self) -> Vec<u32> {
        let mut all: Vec<u32> =
            self.index.read().unwrap_or_else(std::sync::PoisonError::into_inner).keys().copied().collect();
        all.sort_unstable();
        all
    }

    /// Write the index, wait until all is on the disk, and continue reading.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be written.
    pub fn finish(self) -> Result<Self, ScratchError> {
        let mut entries = Vec::new();
        let tetrahedra = self.tetrahedra();
        for t in &tetrahedra {
            if let Some(place) = self.place(*t) {
                entries.extend(t.to_le_bytes());
                entries.extend(place.triangles.to_le_bytes());
                entries.extend(place.at.to_le_bytes());
                entries.extend(place.bytes.to_le_bytes());
            }
        }
        let sum = crc32fast::hash(&entries);
        entries.extend(sum.to_le_bytes());
        entries.extend((tetrahedra.len() as u64).to_le_bytes());
        entries.extend(MAGIC.to_le_bytes());
        self.file.append(&entries)?;
        self.file.sync()?;
        Ok(self)
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..at + 8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes)
}

fn encode(patch: &Patch) -> Vec<u8> {
    let m = &patch.mesh;
    let (vertices, triangles) = (m.vertex_count(), m.triangle_count());
    let wide = vertices > usize::from(u16::MAX) + 1;
    let borders = m.borders.iter().any(|b| *b != 0);
    let bounds = patch.bounds.iter().any(|b| b.out != 0.0 || b.back != 0.0);
    let mut flags = 0;
    for (is, flag) in [
        (!m.colors.is_empty(), COLORS),
        (!m.normals.is_empty(), NORMALS),
        (borders, BORDERS),
        (bounds, BOUNDS),
        (wide, WIDE),
    ] {
        flags |= if is { flag } else { 0 };
    }
    let mut out = Vec::with_capacity(16 + vertices * (19 + 4 * m.scalars.len()) + triangles * 21);
    out.extend((vertices as u32).to_le_bytes());
    out.extend((triangles as u32).to_le_bytes());
    out.push(flags);
    out.push(m.scalars.len() as u8);
    out.extend(m.positions.iter().flat_map(glam::IVec3::to_array).flat_map(i32::to_le_bytes));
    out.extend(m.colors.as_flattened());
    out.extend(m.normals.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    for channel in &m.scalars {
        out.extend(channel.iter().flat_map(|x| x.to_bits().to_le_bytes()));
    }
    if wide {
        out.extend(m.triangles.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    } else {
        out.extend(m.triangles.as_flattened().iter().flat_map(|x| (*x as u16).to_le_bytes()));
    }
    if borders {
        out.extend(&m.borders);
    }
    if bounds {
        out.extend(patch.bounds.iter().flat_map(|b| {
            let [a, b] = [b.out.to_le_bytes(), b.back.to_le_bytes()];
            [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
        }));
    }
    let sum = crc32fast::hash(&out);
    out.extend(sum.to_le_bytes());
    out
}

/// Whether the bytes of a patch are those that were written.
pub(crate) fn checksum_matches(bytes: &[u8]) -> bool {
    bytes.split_last_chunk::<4>().is_some_and(|(body, sum)| crc32fast::hash(body) == u32::from_le_bytes(*sum))
}

/// The patch, or `None` where the bytes are not what [`encode`] made.
fn decode(bytes: &[u8]) -> Option<Patch> {
    let (body, _) = bytes.split_last_chunk::<4>().filter(|_| checksum_matches(bytes))?;
    let mut rest = body;
    let mut take = |n: usize| {
        let (head, tail) = rest.split_at_checked(n)?;
        rest = tail;
        Some(head)
    };
    let vertices = u32::from_le_bytes(take(4)?.try_into().ok()?) as usize;
    let triangles = u32::from_le_bytes(take(4)?.try_into().ok()?) as usize;
    let flags = take(1)?[0];
    let channels = usize::from(take(1)?[0]);
    let has = |flag: u8| flags & flag != 0;
    let positions = words(take(vertices * 12)?, i32::from_le_bytes).into_iter().map(LatticePoint::from_array).collect();
    let mut mesh = Mesh { positions, ..Mesh::default() };
    if has(COLORS) {
        mesh.colors = take(vertices * 3)?.as_chunks::<3>().0.to_vec();
    }
    if has(NORMALS) {
        mesh.normals = words(take(vertices * 4)?, i16::from_le_bytes);
    }
    for _ in 0..channels {
        mesh.scalars.push(words::<4, 1, f32>(take(vertices * 4)?, f32::from_le_bytes).into_iter().flatten().collect());
    }
    mesh.triangles = if has(WIDE) {
        words(take(triangles * 12)?, u32::from_le_bytes)
    } else {
        words(take(triangles * 6)?, |b: [u8; 2]| u32::from(u16::from_le_bytes(b)))
    };
    mesh.borders = if has(BORDERS) { take(triangles)?.to_vec() } else { vec![0; triangles] };
    let bounds = if has(BOUNDS) {
        let pairs: Vec<[f32; 2]> = words(take(triangles * 8)?, f32::from_le_bytes);
        pairs.into_iter().map(|[out, back]| Bound { out, back }).collect()
    } else {
        vec![Bound::default(); triangles]
    };
    let whole = rest.is_empty() && mesh.triangles.as_flattened().iter().all(|v| (*v as usize) < vertices);
    whole.then_some(Patch { mesh, bounds })
}

/// Groups of `N` numbers of `B` bytes each.
fn words<const B: usize, const N: usize, T: Copy>(bytes: &[u8], read: impl Fn([u8; B]) -> T) -> Vec<[T; N]> {
    let (numbers, _) = bytes.as_chunks::<B>();
    let (groups, _) = numbers.as_chunks::<N>();
    groups.iter().map(|g| g.map(&read)).collect()
}

//! The vertices of the finest surface, by chunk, in a scratch file that is read quickly for each photograph.

use super::subdivide::{Subdivision, finest_triangles};
use crate::ScanError;
use crate::import::Progress;
use crate::scratch::{ByteRange, ScratchFile};
use glam::{DVec3, IVec3};
use kilwa_geometry::normal::{self, OctNormal};
use kilwa_geometry::{Lattice, Mesh};
use kilwa_pack::{NO_DIAMOND, PatchRange, Reader, Source};
use rayon::prelude::*;
use std::path::Path;

/// Bytes of a vertex.
const BYTES: usize = 16;
/// Chunks decoded at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

/// The vertices of a chunk that belong to the finest surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// The number of the chunk.
    pub(super) chunk: u32,
    /// How many there are.
    pub(super) count: u32,
    /// How many of them, the first ones, were not added by splitting triangles.
    pub(super) original: u32,
    /// A bounding sphere, in metres.
    pub(super) center: DVec3,
    pub(super) radius: f64,
    range: ByteRange,
}

/// A vertex.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub(super) position: IVec3,
    pub(super) normal: OctNormal,
}

impl Vertex {
    /// Its unit normal.
    pub(super) fn normal(&self) -> DVec3 {
        normal::decode(self.normal)
    }

    /// A number that depends on the position only, evenly distributed.
    pub(super) fn hash(&self) -> u64 {
        let word = |v: i32| u64::from(v.cast_unsigned());
        let [x, y, z] = self.position.to_array().map(word);
        mixed(x ^ y.rotate_left(21) ^ z.rotate_left(42))
    }
}

/// A number whose bits all depend on all bits of `value` (the finaliser of SplitMix64 without its last step).
pub(super) fn mixed(value: u64) -> u64 {
    let value = value.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (value ^ (value >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11
}

/// The vertices of all chunks.
pub(super) struct Vertices {
    pub(super) lattice: Lattice,
    pub(super) groups: Vec<Group>,
    /// How triangles are split before they are coloured, if they are.
    pub(super) subdivision: Option<Subdivision>,
    /// Triangles of the finest surface before and after that.
    pub(super) triangles: [u64; 2],
    file: ScratchFile,
}

/// The numbers of the vertices of a chunk that belong to the finest surface, in ascending order.
pub(super) fn finest(mesh: &Mesh, patches: &[PatchRange]) -> Vec<u32> {
    let mut is_used = vec![false; mesh.positions.len()];
    for patch in patches.iter().filter(|patch| patch.diamond == NO_DIAMOND) {
        let range = patch.first as usize..(patch.first + patch.count) as usize;
        for corner in mesh.triangles.get(range).unwrap_or_default().iter().flatten() {
            is_used[*corner as usize] = true;
        }
    }
    (0u32..).zip(is_used).filter(|(_, is_used)| *is_used).map(|(k, _)| k).collect()
}

impl Vertices {
    /// Read them from a pack into a scratch file, with those that splitting triangles adds.
    pub(super) fn read<S: Source + Sync>(
        reader: &Reader<S>,
        subdivision: Option<Subdivision>,
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<Self, ScanError> {
        let file = ScratchFile::create(scratch, super::remedy(subdivision.is_some()))?;
        let lattice = reader.header().lattice;
        let count = u32::try_from(reader.entries().len()).unwrap_or(u32::MAX);
        let (mut groups, mut triangles) = (Vec::new(), [0; 2]);
        let numbers: Vec<u32> = (0..count).collect();
        // Split chunks may be large.
        let at_once = if subdivision.is_some() { rayon::current_num_threads() } else { BATCH };
        for batch in numbers.chunks(at_once) {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            progress.update("reading the model", batch[0].into(), count.into());
            let read: Vec<Result<_, ScanError>> = batch
                .par_iter()
                .map(|number| {
                    let mut chunk = reader.chunk(*number).map_err(|source| ScanError::Model { source })?;
                    let before = finest_triangles(&chunk).count();
                    let whole = chunk.mesh.positions.len() as u32;
                    if let Some(subdivision) = &subdivision {
                        subdivision.apply(&mut chunk)?;
                    }
                    let triangles = [before, finest_triangles(&chunk).count()];
                    let used = finest(&chunk.mesh, &chunk.patches);
                    let original = used.partition_point(|k| *k < whole) as u32;
                    let mut bytes = Vec::with_capacity(used.len() * BYTES);
                    let mut bounds = [IVec3::MAX, IVec3::MIN];
                    for k in &used {
                        let position = chunk.mesh.positions[*k as usize];
                        bounds = [bounds[0].min(position), bounds[1].max(position)];
                        bytes.extend(position.to_array().into_iter().flat_map(i32::to_le_bytes));
                        bytes.extend(chunk.mesh.normals[*k as usize].into_iter().flat_map(i16::to_le_bytes));
                    }
                    Ok((*number, [used.len() as u32, original], bounds, bytes, triangles))
                })
                .collect();
            for result in read {
                let (chunk, [count, original], bounds, bytes, [before, after]) = result?;
                triangles = [triangles[0] + before as u64, triangles[1] + after as u64];
                if count > 0 {
                    let [low, high] = bounds.map(|corner| lattice.world_from_lattice(corner));
                    let (center, radius) = (0.5 * (low + high), 0.5 * low.distance(high));
                    groups.push(Group { chunk, count, original, center, radius, range: file.append(&bytes)? });
                }
            }
        }
        Ok(Self { lattice, groups, subdivision, triangles, file })
    }

    /// How many there are; those on the borders of chunks are in several.
    pub(super) fn count(&self) -> u64 {
        self.groups.iter().map(|group| u64::from(group.count)).sum()
    }

    /// How many of them were not added by splitting triangles.
    pub(super) fn originals(&self) -> u64 {
        self.groups.iter().map(|group| u64::from(group.original)).sum()
    }

    /// The vertices of a group.
    pub(super) fn of(&self, group: &Group) -> Result<Vec<Vertex>, ScanError> {
        let bytes = self.file.read(group.range)?;
        let vertex = |b: &[u8; BYTES]| {
            let word = |k: usize| i32::from_le_bytes([b[k], b[k + 1], b[k + 2], b[k + 3]]);
            let short = |k: usize| i16::from_le_bytes([b[k], b[k + 1]]);
            Vertex { position: IVec3::new(word(0), word(4), word(8)), normal: [short(12), short(14)] }
        };
        Ok(bytes.as_chunks::<BYTES>().0.iter().map(vertex).collect())
    }
}

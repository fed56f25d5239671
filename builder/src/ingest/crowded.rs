//! Finds leaves that no chunk can hold before their triangles are read: many triangles at few places, which no tetrahedron separates.
//!
//! Input: `buckets`, and the split requests of the buckets that fit in memory. A bucket that does not fit is read as a stream to count its
//! places. If it has no more places than a leaf may have, nothing inside it requests a split. When that is known for every bucket, so are the
//! tree and the number of triangles in each leaf.
//!
//! Fails with [`BuildError::TooLarge`] for a leaf with more triangles than a chunk holds: no later stage could divide it.

use super::buckets::{Buckets, Run, point_of_words};
use super::leaves::tree_of;
use super::resolve::PIECE;
use super::split_requests::{self, Above, Places, add_place, sum_of};
use super::topology::Region;
use super::words::read_words_with_sum;
use crate::build::options::BuildError;
use crate::levels::too_large;
use crate::partition::Partition;
use crate::scratch::{ScratchError, ScratchFile};
use kilwa_geometry::{DiamondKey, Lattice};
use kilwa_pack::chunk::MAX_CHUNK_TRIANGLES;
use rustc_hash::FxHashMap;

impl Region<'_> {
    /// Refuse a leaf that no chunk can hold, as far as this is known before the buckets `large` are read. The others gave `known` (by
    /// bucket; ignored for those in `large`) and the split requests `keys`.
    ///
    /// # Errors
    /// [`BuildError::TooLarge`]; if a scratch file cannot be read, or a stop was requested.
    pub(super) fn refuse_crowded_leaves(
        &self,
        own: &ScratchFile,
        mut known: Vec<Above>,
        mut keys: Vec<DiamondKey>,
        large: &[usize],
    ) -> Result<(), BuildError> {
        if large.is_empty() || self.scattered.triangles <= u64::from(MAX_CHUNK_TRIANGLES) {
            return Ok(());
        }
        for &bucket in large {
            // It may be split inside; only reading it whole would show that.
            let Some(above) = self.survey(own, bucket)? else { return Ok(()) };
            known[bucket] = above;
        }
        let cube_log2 = self.scattered.cube_log2;
        keys.extend(split_requests::above(self.buckets, &known, cube_log2, self.leaf_triangles));
        let triangles = |bucket: u32| (self.scattered.own.words(bucket as usize) / self.layout.triangle()) as u64;
        refuse_leaves(self.buckets, self.lattice, triangles, &tree_of(cube_log2, keys))
    }

    /// Refuse a place in the buckets `large` with more triangles than a chunk can hold. Leaves are not checked here, because a region does not
    /// know how the others divide space.
    ///
    /// # Errors
    /// As [`Region::refuse_crowded_leaves`].
    pub(super) fn refuse_piles(&self, own: &ScratchFile, large: &[usize]) -> Result<(), BuildError> {
        for &bucket in large {
            let mut at: FxHashMap<[u32; 3], u32> = FxHashMap::default();
            self.visit(own, bucket, |corners| {
                let sum = sum_of(corners);
                // If a bucket has too many places to count, only the first ones are counted.
                if at.len() < self.leaf_triangles || at.contains_key(&sum) {
                    let n = at.entry(sum).or_default();
                    *n += 1;
                    if *n > MAX_CHUNK_TRIANGLES {
                        let near = point_of_words(corners[0]);
                        return Err(too_large(u64::from(*n), self.lattice.world_from_lattice(near)));
                    }
                }
                Ok(true)
            })?;
        }
        Ok(())
    }

    /// The figures of a bucket that the tetrahedra above it need, if it has no more places than a leaf may have.
    fn survey(&self, own: &ScratchFile, bucket: usize) -> Result<Option<Above>, BuildError> {
        let mut places = Places::default();
        self.visit(own, bucket, |corners| {
            add_place(&mut places, corners);
            Ok(places.len() <= self.leaf_triangles)
        })?;
        Ok((places.len() <= self.leaf_triangles).then(|| Above::of_places(&places)))
    }

    /// Visit the corners of the triangles of a bucket, until `visit` returns `false`.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] if all triangles were visited and their checksum does not match; errors of `visit`.
    fn visit(
        &self,
        own: &ScratchFile,
        bucket: usize,
        mut visit: impl FnMut([[u32; 3]; 3]) -> Result<bool, BuildError>,
    ) -> Result<(), BuildError> {
        let (width, triangle) = (self.layout.vertex(), self.layout.triangle());
        let (mut words, mut sum) = (Vec::new(), crc32fast::Hasher::new());
        for &(byte, count) in self.scattered.own.extents(bucket) {
            // Extents contain whole triangles.
            for first in (0..count as usize).step_by(PIECE * triangle) {
                self.work.stop.check()?;
                words.resize((count as usize - first).min(PIECE * triangle), 0);
                read_words_with_sum(own, byte + 4 * first as u64, &mut words, &mut sum)?;
                for corners in words.chunks_exact(triangle) {
                    let corner = |k: usize| [corners[k * width], corners[k * width + 1], corners[k * width + 2]];
                    if !visit([corner(0), corner(1), corner(2)])? {
                        return Ok(());
                    }
                }
            }
        }
        if sum.finalize() == self.scattered.own.crc32(bucket) {
            return Ok(());
        }
        Err(ScratchError::damaged(own.path(), format!("the checksum of list {bucket} does not match")).into())
    }
}

/// Refuse a leaf of the tree that no chunk can hold; `triangles` returns the number of triangles of a bucket.
///
/// # Errors
/// [`BuildError::TooLarge`] with the number of triangles and their place.
pub(super) fn refuse_leaves(
    buckets: &Buckets,
    lattice: &Lattice,
    triangles: impl Fn(u32) -> u64,
    tree: &Partition,
) -> Result<(), BuildError> {
    for Run { tetrahedron, buckets, .. } in buckets.runs(tree) {
        let tetrahedron = &tree.tetrahedra[tetrahedron as usize];
        if tetrahedron.children.is_some() {
            continue;
        }
        let triangles: u64 = buckets.map(&triangles).sum();
        if triangles > u64::from(MAX_CHUNK_TRIANGLES) {
            let near = DiamondKey::of(&tetrahedron.tetra).midpoint;
            return Err(too_large(triangles, lattice.world_from_lattice(near)));
        }
    }
    Ok(())
}

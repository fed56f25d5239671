//! 16-byte records, sorted outside of memory. Two kinds are kept: (point, tetrahedron), which says that a point of the
//! current surface is used by a tetrahedron, and (diamond, point), the points locked in a diamond.
//!
//! Files of records are plain: little-endian u128, one after the other, in any order. A finished file ends in one more of
//! the same length, a sum over the others that does not depend on their order; it is checked when they are visited.

use super::{Scratch, ScratchError, ScratchFile};
use kilwa_geometry::LatticePoint;
use rayon::slice::ParallelSliceMut;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of a record.
const RECORD: usize = 16;
/// Records that a merge reads at a time from each run.
const BLOCK: usize = 1 << 11;
/// Fewest records sorted in memory at a time, whatever the budget.
const SMALLEST_RUN: usize = 1 << 12;

/// A lattice point as one integer: 30 bits an axis, sorted by x, then y, then z.
pub fn point_key(p: LatticePoint) -> u128 {
    (u128::from(p.x as u32) << 64) | (u128::from(p.y as u32) << 32) | u128::from(p.z as u32)
}

/// A point and the tetrahedron that uses it; sorts by point, then by tetrahedron.
pub fn record(point: LatticePoint, tetra: u32) -> u128 {
    point_key(point) << 32 | u128::from(tetra)
}

/// The point of a record.
pub fn point_of(record: u128) -> LatticePoint {
    LatticePoint::new((record >> 96) as u32 as i32, (record >> 64) as u32 as i32, (record >> 32) as u32 as i32)
}

/// The tetrahedron of a record.
pub fn tetrahedron_of(record: u128) -> u32 {
    record as u32
}

/// Ends a finished file, after the sum.
const MAGIC: u64 = u64::from_le_bytes(*b"KLWRECRD");

/// A number that depends on every bit of a record; sums of it tell sets of records apart.
fn mixed(record: u128) -> u64 {
    let h = (record as u64 ^ 0x9e37_79b9_7f4a_7c15).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let h = (h ^ (h >> 32) ^ (record >> 64) as u64).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    h ^ (h >> 29)
}

/// Visit the records of a finished file of `length` bytes, in the order of the file, some at a time; `read` gives
/// stretches of it (first byte, number of bytes). Returns whether they are those that were written.
///
/// # Errors
/// Those of `read` and of `visit`.
pub(crate) fn visit_finished<E>(
    length: u64,
    read: impl Fn(u64, u64) -> Result<Vec<u8>, E>,
    mut visit: impl FnMut(&[u128]) -> Result<(), E>,
) -> Result<bool, E> {
    const STRETCH: u64 = 1 << 20;
    let Some(end) = length.checked_sub(RECORD as u64).filter(|at| at.is_multiple_of(RECORD as u64)) else {
        return Ok(false);
    };
    let mut sum = 0u64;
    for at in (0..end).step_by(STRETCH as usize) {
        let bytes = read(at, STRETCH.min(end - at))?;
        let records: Vec<u128> = bytes.as_chunks::<RECORD>().0.iter().map(|r| u128::from_le_bytes(*r)).collect();
        sum = records.iter().fold(sum, |sum, r| sum.wrapping_add(mixed(*r)));
        visit(&records)?;
    }
    let last = read(end, RECORD as u64)?;
    let written = u128::from(MAGIC) << 64 | u128::from(sum);
    Ok(last == written.to_le_bytes())
}

/// A file of records.
#[derive(Debug)]
pub struct Records {
    file: ScratchFile,
    /// Records, the end of a finished file not counted.
    count: AtomicU64,
    sum: AtomicU64,
    finished: bool,
}

impl Records {
    /// An empty file.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be made.
    pub fn create(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        let file = scratch.create(name)?;
        Ok(Self { file, count: AtomicU64::new(0), sum: AtomicU64::new(0), finished: false })
    }

    /// A file that [`Records::finish`] completed.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be opened or is not complete.
    pub fn open(scratch: &Scratch, name: &str) -> Result<Self, ScratchError> {
        let file = scratch.existing(name)?;
        let damaged = || ScratchError::damaged(file.path(), "it does not end as it should");
        let at = file.len().checked_sub(RECORD as u64).filter(|at| at.is_multiple_of(RECORD as u64));
        let at = at.ok_or_else(damaged)?;
        let mut end = [0; RECORD];
        file.read_into(at, &mut end)?;
        let end = u128::from_le_bytes(end);
        if (end >> 64) as u64 != MAGIC {
            return Err(damaged());
        }
        let count = AtomicU64::new(at / RECORD as u64);
        Ok(Self { count, sum: AtomicU64::new(end as u64), finished: true, file })
    }

    /// Number of records.
    pub fn len(&self) -> u64 {
        self.count.load(Ordering::Acquire)
    }

    /// Whether there is no record.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Append records, from any thread; best many at a time.
    ///
    /// # Errors
    /// [`ScratchError`] where they cannot be written.
    pub fn append(&self, records: &[u128]) -> Result<(), ScratchError> {
        if !records.is_empty() {
            let bytes: Vec<u8> = records.iter().flat_map(|r| r.to_le_bytes()).collect();
            self.file.append(&bytes)?;
            let sum = records.iter().fold(0u64, |sum, r| sum.wrapping_add(mixed(*r)));
            self.sum.fetch_add(sum, Ordering::AcqRel);
            self.count.fetch_add(records.len() as u64, Ordering::AcqRel);
        }
        Ok(())
    }

    /// `count` records from number `first` on.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] where they are not there.
    pub fn read(&self, first: u64, count: usize) -> Result<Vec<u128>, ScratchError> {
        let bytes = self.file.read(first * RECORD as u64, (count * RECORD) as u64)?;
        let (records, _) = bytes.as_chunks::<RECORD>();
        Ok(records.iter().map(|r| u128::from_le_bytes(*r)).collect())
    }

    /// Complete the file and wait until all is on the disk; it can still be read.
    ///
    /// # Errors
    /// [`ScratchError`] where it cannot be written.
    pub fn finish(mut self) -> Result<Self, ScratchError> {
        let end = u128::from(MAGIC) << 64 | u128::from(self.sum.load(Ordering::Acquire));
        self.file.append(&end.to_le_bytes())?;
        self.file.sync()?;
        self.finished = true;
        Ok(self)
    }

    /// What was read is what was written.
    fn check(&self, sum: u64) -> Result<(), ScratchError> {
        if self.finished && sum != self.sum.load(Ordering::Acquire) {
            return Err(ScratchError::damaged(self.file.path(), "its records are not those that were written"));
        }
        Ok(())
    }

    /// Visit all records in ascending order, equal ones once, holding about `memory` bytes. Where they do not fit, runs
    /// are sorted into the file `name` of `scratch`, merged, and removed.
    ///
    /// # Errors
    /// [`ScratchError`], and what `visit` says. Damage is noticed before the first visit.
    pub fn sorted<E: From<ScratchError>>(
        &self,
        scratch: &Scratch,
        name: &str,
        memory: u64,
        mut visit: impl FnMut(u128) -> Result<(), E>,
    ) -> Result<(), E> {
        let run = usize::try_from(memory / RECORD as u64 / 2).unwrap_or(usize::MAX).max(SMALLEST_RUN);
        let total = self.len();
        if total <= run as u64 {
            let mut all = self.read(0, total as usize)?;
            self.check(all.iter().fold(0u64, |sum, r| sum.wrapping_add(mixed(*r))))?;
            all.par_sort_unstable();
            all.dedup();
            return all.into_iter().try_for_each(visit);
        }
        let runs = Self::create(scratch, name)?;
        let mut sources = Vec::new();
        let (mut first, mut sum) = (0, 0u64);
        while first < total {
            let count = (total - first).min(run as u64);
            let mut block = self.read(first, count as usize)?;
            sum = block.iter().fold(sum, |sum, r| sum.wrapping_add(mixed(*r)));
            block.par_sort_unstable();
            block.dedup();
            let from = runs.len();
            runs.append(&block)?;
            sources.push(Run { next: from, end: runs.len(), block: Vec::new(), at: 0 });
            first += count;
        }
        self.check(sum)?;
        let mut heap = BinaryHeap::new();
        for (i, source) in sources.iter_mut().enumerate() {
            if let Some(r) = source.next(&runs)? {
                heap.push(Reverse((r, i)));
            }
        }
        let mut last = None;
        while let Some(Reverse((r, i))) = heap.pop() {
            if let Some(next) = sources[i].next(&runs)? {
                heap.push(Reverse((next, i)));
            }
            if last != Some(r) {
                visit(r)?;
                last = Some(r);
            }
        }
        drop(runs);
        scratch.remove(name)?;
        Ok(())
    }
}

/// A sorted stretch of a file of runs.
struct Run {
    next: u64,
    end: u64,
    block: Vec<u128>,
    at: usize,
}

impl Run {
    fn next(&mut self, runs: &Records) -> Result<Option<u128>, ScratchError> {
        if self.at == self.block.len() {
            let count = (self.end - self.next).min(BLOCK as u64);
            if count == 0 {
                return Ok(None);
            }
            self.block = runs.read(self.next, count as usize)?;
            self.next += count;
            self.at = 0;
        }
        self.at += 1;
        Ok(self.block.get(self.at - 1).copied())
    }
}

//! Which points of a level are locked. A vertex is free only if all its triangles are inside the diamond.
//!
//! There is one record (point, tetrahedron) for every point that more than one tetrahedron of the current surface uses.
//! At each level the records are sorted by point, outside of memory; a point whose tetrahedra belong to two owners
//! (diamonds of this level, or leaves outside all of them) is locked. The locked points are then sorted by diamond into
//! a file of their own, from which each diamond reads its share.

use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::partition::{BISECTIONS, Partition};
use crate::scratch::{Records, ScratchError, point_of, tetrahedron_of};
use kilwa_geometry::LatticePoint;
use rustc_hash::FxHashMap;

/// Locked points by diamond, in no order.
const UNSORTED: &str = "locked.unsorted";
/// The same, grouped by diamond.
const SORTED: &str = "locked";
/// Where runs are sorted.
const RUNS: &str = "locked.runs";

/// Records gathered before they are written.
const GATHERED: usize = 1 << 14;

/// The locked points of every diamond of a level.
pub(super) struct Locks {
    file: Records,
    /// First record and number of records of each diamond, by rank.
    places: Vec<(u64, u32)>,
}

/// Records on the way to a file.
struct Gather<'a> {
    file: &'a Records,
    gathered: Vec<u128>,
}

impl<'a> Gather<'a> {
    fn new(file: &'a Records) -> Self {
        Self { file, gathered: Vec::with_capacity(GATHERED) }
    }

    fn push(&mut self, record: u128) -> Result<(), ScratchError> {
        self.gathered.push(record);
        if self.gathered.len() == GATHERED { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ScratchError> {
        self.file.append(&self.gathered)?;
        self.gathered.clear();
        Ok(())
    }
}

impl Locks {
    /// Find the locked points of `diamonds`, which are at `level`, from the records of the current surface: all of them,
    /// or at least those of the points that these diamonds use. Records that coarser levels need as they are go to
    /// `kept`; those of tetrahedra that this level merges do not.
    ///
    /// An owner is the diamond whose split made a tetrahedron, for tetrahedra one level below; every other tetrahedron is
    /// a leaf at this level or above and owns itself.
    pub(super) fn of_level(
        work: &Work<'_>,
        tree: &Partition,
        level: u8,
        diamonds: &[u32],
        shared: &Records,
        kept: &Records,
    ) -> Result<Self, BuildError> {
        let rank = (0u32..).zip(diamonds).map(|(r, d)| (*d, r)).collect();
        let unsorted = Records::create(work.scratch, UNSORTED)?;
        let mut scan = Scan {
            tree,
            level,
            rank: &rank,
            locked: Gather::new(&unsorted),
            kept: Gather::new(kept),
            group: Vec::new(),
            owners: Vec::new(),
        };
        let memory = work.memory / 4;
        shared.sorted(work.scratch, RUNS, memory, |r| scan.visit(r))?;
        scan.close()?;
        scan.locked.flush()?;
        scan.kept.flush()?;
        work.stop.check()?;
        let sorted = Records::create(work.scratch, SORTED)?;
        let mut places = vec![(0, 0); diamonds.len()];
        let mut gather = Gather::new(&sorted);
        let mut number = 0;
        unsorted.sorted::<BuildError>(work.scratch, RUNS, memory, |r| {
            let place: &mut (u64, u32) = &mut places[(r >> 96) as usize];
            if place.1 == 0 {
                place.0 = number;
            }
            place.1 += 1;
            number += 1;
            Ok(gather.push(r)?)
        })?;
        gather.flush()?;
        drop(unsorted);
        work.scratch.remove(UNSORTED)?;
        Ok(Self { file: sorted, places })
    }

    /// The locked points of the `rank`-th diamond, ascending.
    pub(super) fn of(&self, rank: u32) -> Result<Vec<LatticePoint>, ScratchError> {
        let Some(&(first, count)) = self.places.get(rank as usize).filter(|p| p.1 > 0) else { return Ok(Vec::new()) };
        let records = self.file.read(first, count as usize)?;
        Ok(records.into_iter().map(|r| point_of(r << 32)).collect())
    }

    /// Remove the file.
    pub(super) fn remove(self, work: &Work<'_>) -> Result<(), ScratchError> {
        drop(self.file);
        work.scratch.remove(SORTED)
    }
}

/// Looks at records in order of their points.
struct Scan<'a> {
    tree: &'a Partition,
    level: u8,
    rank: &'a FxHashMap<u32, u32>,
    locked: Gather<'a>,
    kept: Gather<'a>,
    /// The records of one point.
    group: Vec<u128>,
    owners: Vec<(bool, u32)>,
}

impl Scan<'_> {
    fn visit(&mut self, record: u128) -> Result<(), BuildError> {
        if self.group.last().is_some_and(|last| last >> 32 != record >> 32) {
            self.close()?;
        }
        self.group.push(record);
        Ok(())
    }

    /// Decide about a point, all its records being known. One that a single tetrahedron uses is nobody else's and never
    /// will be: others get at a point only by having it locked, and keep it then.
    fn close(&mut self) -> Result<(), ScratchError> {
        if self.group.len() > 1 {
            let below = |t: u32| self.tree.level_of(t) == Some(BISECTIONS * (self.level + 1));
            self.owners.clear();
            self.owners.extend(self.group.iter().map(|r| {
                let t = tetrahedron_of(*r);
                // A tetrahedron outside this part of the tree belongs to a diamond of another task.
                let merged = self.tree.tetrahedra.get(t).filter(|_| below(t));
                merged.map_or((false, t), |node| (true, node.parent_diamond))
            }));
            self.owners.sort_unstable();
            self.owners.dedup();
            if self.owners.len() > 1 {
                let point = self.group[0] >> 32;
                for &(_, d) in self.owners.iter().filter(|o| o.0) {
                    // Others are not coarsened here, but by another task.
                    if let Some(&rank) = self.rank.get(&d) {
                        self.locked.push(u128::from(rank) << 96 | point)?;
                    }
                }
            }
            for r in self.group.iter().filter(|r| !below(tetrahedron_of(**r))) {
                self.kept.push(*r)?;
            }
        }
        self.group.clear();
        Ok(())
    }
}

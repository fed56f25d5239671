//! Division of the work: the leaves by ranges of the buckets that they are made of, the diamonds of a level by ranges in the
//! order of the pack, so that a shard has about as many triangles as one task should take.

use crate::assemble::order_key;
use crate::ingest::divided::Run;
use crate::levels::fragment::REDUCTION;
use crate::levels::{diamonds_of, level_count, merged_by};
use crate::partition::Partition;
use glam::DVec3;
use kilwa_geometry::{DiamondKey, Lattice, LatticePoint};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Default number of triangles per task: about half a minute on one core.
pub const TASK_TRIANGLES: u64 = 10_000_000;

/// Fewer parts than this are rounded up to a power of two.
const FEW: usize = 16;
/// A level is divided if it has more triangles than this part of a task; smaller levels are in the tail, which is kept small because all other
/// workers wait for it.
const TAIL_SHARE: u64 = 64;
/// A level of fewer triangles is divided only if it has more than four times that part of a task: starting a program takes as long as simplifying a few
/// thousand triangles.
const WORTH_DIVIDING: u64 = 10_000;
/// Minimum number of shards of a divided level.
const LEAST: usize = 4;

/// Smallest and largest coordinates of some points; `None` of none.
pub(super) type PointBox = Option<[LatticePoint; 2]>;

/// Add a point.
pub(super) fn include(of: &mut PointBox, p: LatticePoint) {
    *of = Some(of.map_or([p, p], |[min, max]| [min.min(p), max.max(p)]));
}

/// Whether two boxes have a point in common.
pub(super) fn overlap(a: PointBox, b: PointBox) -> bool {
    let (Some([a, b]), Some([c, d])) = (a, b) else { return false };
    a.cmple(d).all() && c.cmple(b).all()
}

/// The union of two boxes.
pub(super) fn union(a: PointBox, b: PointBox) -> PointBox {
    let mut all = a;
    for p in b.into_iter().flatten() {
        include(&mut all, p);
    }
    all
}

/// A range of bytes in a file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ByteRange {
    pub(super) at: u64,
    pub(super) bytes: u64,
}

/// How a build is divided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Shards {
    pub(super) leaves: Vec<LeafShard>,
    /// Levels that are divided, finest first.
    pub(super) levels: Vec<LevelShards>,
    /// Levels of the tail: those from 0 to one less.
    pub(super) tail: u8,
    /// Triangles that the tail is estimated to take.
    pub(super) tail_triangles: u64,
    /// Where the parts for the tail and for the pack are in the file of the tree.
    pub(super) tail_part: ByteRange,
    pub(super) pack_part: ByteRange,
}

/// Some leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct LeafShard {
    /// The first of the runs of buckets that its leaves are made of; the shard ends where the next begins.
    first_run: u32,
    /// The first leaf that is not a root.
    first: u32,
    /// Roots that are leaves.
    roots: Vec<u32>,
    pub(super) triangles: u64,
    /// A point in its middle, metres.
    pub(super) near: DVec3,
    /// The regions with its buckets, or with replies to these.
    pub(super) regions: Vec<u32>,
    /// Where its runs and its part of the tree are in the file of the tree.
    pub(super) runs: ByteRange,
    pub(super) part: ByteRange,
}

/// The shards of a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct LevelShards {
    pub(super) level: u8,
    pub(super) shards: Vec<LevelShard>,
}

/// Some diamonds of a level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct LevelShard {
    /// Rank of the first diamond in the order of the pack; the shard ends where the next begins.
    pub(super) first: u32,
    /// Estimated number of triangles.
    pub(super) triangles: u64,
    /// Midpoint of the diamond in the middle, metres.
    pub(super) near: DVec3,
    /// The first diamond: its level of bisection, and its midpoint.
    first_diamond: (u8, LatticePoint),
    /// Where its part of the tree is in the file of the tree.
    pub(super) part: ByteRange,
}

impl LevelShard {
    /// Where it begins in the order of the pack.
    pub(super) fn order_key(&self) -> (u8, u128) {
        let (level, midpoint) = self.first_diamond;
        order_key(&DiamondKey { level, midpoint })
    }
}

impl LevelShards {
    /// The diamonds of a shard; `diamonds` are those of the level in the order of the pack.
    pub(super) fn diamonds<'a>(&self, shard: usize, diamonds: &'a [u32]) -> Option<&'a [u32]> {
        let first = self.shards.get(shard)?.first as usize;
        let end = self.shards.get(shard + 1).map_or(diamonds.len(), |s| s.first as usize);
        diamonds.get(first..end)
    }
}

impl Shards {
    /// Divide a tree into shards of about `size` triangles. `estimate` is the estimated number of triangles of each tetrahedron
    /// that is a leaf; the leaves are made of the runs of buckets, which have that many `triangles`.
    pub(super) fn divide(
        tree: &Partition,
        lattice: &Lattice,
        mut estimate: Vec<f64>,
        (runs, triangles): (&[Run], &[u64]),
        size: u64,
    ) -> Self {
        let size = size.max(1);
        let midpoint = |diamond: u32| lattice.world_from_lattice(tree.diamonds[diamond as usize].key.midpoint);
        // What the coarse form of each tetrahedron is estimated to have; children come after their parents.
        for t in (0..tree.tetrahedra.len()).rev() {
            if let Some(children) = tree.tetrahedra[t].children {
                estimate[t] = children.map(|c| estimate[c as usize]).iter().sum::<f64>() / REDUCTION as f64;
            }
        }
        let weight = |d: u32| merged_by(tree, d).map(|t| estimate[t as usize]).sum::<f64>();
        let mut levels = Vec::new();
        let mut below = level_count(tree);
        let mut left: f64 = 0.0;
        while let Some(level) = below.checked_sub(1) {
            let diamonds = diamonds_of(tree, level);
            let weights: Vec<f64> = diamonds.iter().map(|d| weight(*d)).collect();
            let sum: f64 = weights.iter().sum();
            if sum <= largest_in_tail(size) as f64 {
                // The levels above take a part of it, then a part of that part …
                left = sum * REDUCTION as f64 / (REDUCTION - 1) as f64;
                break;
            }
            let firsts = parts(&weights, parts_of(sum, size).max(LEAST));
            let shard = |(first, end): (u32, u32)| {
                let key = tree.diamonds[diamonds[first as usize] as usize].key;
                LevelShard {
                    first,
                    triangles: weights[first as usize..end as usize].iter().sum::<f64>() as u64,
                    near: midpoint(diamonds[u32::midpoint(first, end.max(first + 1) - 1) as usize]),
                    first_diamond: (key.level, key.midpoint),
                    part: ByteRange::default(),
                }
            };
            levels.push(LevelShards { level, shards: ranges(&firsts, diamonds.len()).map(shard).collect() });
            below = level;
        }
        let leaves = divide_leaves(tree, runs, triangles, size, midpoint);
        let [tail_part, pack_part] = [ByteRange::default(); 2];
        Self { leaves, levels, tail: below, tail_triangles: left as u64, tail_part, pack_part }
    }

    /// The runs of a shard of leaves; there are `count` runs in total.
    pub(super) fn runs(&self, shard: usize, count: usize) -> Range<usize> {
        let first = |i: usize| self.leaves.get(i).map_or(count, |s| (s.first_run as usize).min(count));
        first(shard)..first(shard + 1).max(first(shard))
    }

    /// The shard of leaves that a leaf is in.
    pub(super) fn of_leaf(&self, leaf: u32) -> usize {
        // Roots are numbered before all others.
        let of_root = (leaf < 6).then(|| self.leaves.iter().position(|s| s.roots.contains(&leaf))).flatten();
        of_root.unwrap_or_else(|| self.leaves.partition_point(|s| s.first <= leaf).saturating_sub(1))
    }

    /// The shards of a level; `None` if it is in the tail.
    pub(super) fn of_level(&self, level: u8) -> Option<&LevelShards> {
        self.levels.iter().find(|l| l.level == level)
    }
}

fn divide_leaves(
    tree: &Partition,
    runs: &[Run],
    triangles: &[u64],
    size: u64,
    midpoint: impl Fn(u32) -> DVec3,
) -> Vec<LeafShard> {
    let weights: Vec<f64> = triangles.iter().map(|n| *n as f64).collect();
    let firsts = equal_parts(&weights, size);
    let shard = |(start, end): (u32, u32)| {
        let of_shard = &runs[start as usize..end as usize];
        let roots = of_shard.iter().filter(|r| tree.tetrahedra[r.tetrahedron as usize].children.is_none());
        let middle = of_shard.get(of_shard.len() / 2).map_or(0, |run| run.tetrahedron);
        LeafShard {
            first_run: start,
            first: 0,
            roots: roots.map(|r| r.tetrahedron).filter(|t| *t < 6).collect(),
            triangles: triangles[start as usize..end as usize].iter().sum(),
            near: midpoint(tree.tetrahedra[middle as usize].diamond),
            regions: Vec::new(),
            runs: ByteRange::default(),
            part: ByteRange::default(),
        }
    };
    let mut shards: Vec<LeafShard> = ranges(&firsts, runs.len()).map(shard).collect();
    // Backwards from the last: a shard with nothing but roots begins where the next one does.
    let mut next = u32::MAX;
    for (shard, (start, end)) in shards.iter_mut().zip(ranges(&firsts, runs.len())).rev() {
        let leaves = runs[start as usize..end as usize].iter().map(|run| first_leaf(tree, run));
        shard.first = leaves.filter(|leaf| *leaf >= 6).min().unwrap_or(next);
        next = shard.first;
    }
    shards
}

/// The first leaf in a run, in the order of the tree.
fn first_leaf(tree: &Partition, run: &Run) -> u32 {
    let mut first = run.half.map_or(run.tetrahedron, |quarters| quarters[0]);
    while let Some(children) = tree.tetrahedra[first as usize].children {
        first = children[0];
    }
    first
}

/// The most triangles that a level of the tail has, with tasks of `size` triangles.
fn largest_in_tail(size: u64) -> u64 {
    let share = size / TAIL_SHARE;
    share.max(WORTH_DIVIDING.min(4 * share))
}

/// The number of parts for `sum` triangles, so that each has at most about `size`. A small number is rounded up to a power of
/// two, so that a few equal workers finish at the same time.
fn parts_of(sum: f64, size: u64) -> usize {
    let count = (sum / size.max(1) as f64).ceil().max(1.0) as usize;
    if count < FEW { count.next_power_of_two() } else { count }
}

/// The first item of each of at most `count` non-empty parts of about the same weight.
fn parts(weights: &[f64], count: usize) -> Vec<u32> {
    let sum: f64 = weights.iter().sum();
    let (mut firsts, mut before) = (Vec::new(), 0.0);
    for (i, weight) in (0u32..).zip(weights) {
        // A part begins where the middle of this item passes the next of `count` equal shares.
        let part = ((before + weight / 2.0) * count as f64 / sum) as usize;
        if firsts.is_empty() || part.min(count - 1) >= firsts.len() {
            firsts.push(i);
        }
        before += weight;
    }
    if firsts.is_empty() { vec![0] } else { firsts }
}

/// The first item of each part, if these weights are divided into parts of about `size`.
pub(crate) fn equal_parts(weights: &[f64], size: u64) -> Vec<u32> {
    parts(weights, parts_of(weights.iter().sum(), size))
}

/// The first item and the end of each part.
fn ranges(firsts: &[u32], end: usize) -> impl DoubleEndedIterator<Item = (u32, u32)> + ExactSizeIterator {
    let end = end as u32;
    (0..firsts.len()).map(move |i| (firsts[i], firsts.get(i + 1).copied().unwrap_or(end)))
}

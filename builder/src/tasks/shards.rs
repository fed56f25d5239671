//! How the work is divided: the leaves into ranges in the order of the tree, the diamonds of a level into ranges in the
//! order of the pack, so that a shard has about as many triangles as one task should take.

use crate::levels::fragment::REDUCTION;
use crate::levels::{diamonds_of, level_count, merged_by};
use crate::partition::Partition;
use glam::DVec3;
use kilwa_geometry::{Lattice, LatticePoint};
use serde::{Deserialize, Serialize};

/// Default number of triangles per task: about half a minute on one core.
pub const TASK_TRIANGLES: u64 = 10_000_000;

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
}

/// Some leaves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct LeafShard {
    /// The first tetrahedron; the shard ends where the next begins.
    pub(super) first: u32,
    pub(super) triangles: u64,
    /// Bounding box of the points in its records.
    pub(super) records: PointBox,
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
    /// Triangles that it is estimated to take.
    pub(super) triangles: u64,
    /// Midpoint of the diamond in the middle, metres.
    pub(super) near: DVec3,
}

impl LevelShards {
    /// The shard of the diamond with this rank.
    pub(super) fn of_rank(&self, rank: u32) -> usize {
        self.shards.partition_point(|s| s.first <= rank).saturating_sub(1)
    }

    /// The diamonds of a shard; `diamonds` are those of the level in the order of the pack.
    pub(super) fn diamonds<'a>(&self, shard: usize, diamonds: &'a [u32]) -> Option<&'a [u32]> {
        let first = self.shards.get(shard)?.first as usize;
        let end = self.shards.get(shard + 1).map_or(diamonds.len(), |s| s.first as usize);
        diamonds.get(first..end)
    }
}

impl Shards {
    /// Divide a tree whose leaf `t` has `leaf_triangles(t)` triangles into shards of about `size` triangles.
    pub(super) fn divide(tree: &Partition, lattice: &Lattice, leaf_triangles: impl Fn(u32) -> u64, size: u64) -> Self {
        let size = size.max(1);
        let leaves = divide_leaves(tree, &leaf_triangles, size);
        // What the coarse form of each tetrahedron is estimated to have; children come after their parents.
        let mut estimate = vec![0.0f64; tree.tetrahedra.len()];
        for t in (0..tree.tetrahedra.len()).rev() {
            estimate[t] = match tree.tetrahedra[t].children {
                None => leaf_triangles(t as u32) as f64,
                Some(children) => children.map(|c| estimate[c as usize]).iter().sum::<f64>() / REDUCTION as f64,
            };
        }
        let weight = |d: u32| merged_by(tree, d).map(|t| estimate[t as usize]).sum::<f64>();
        let mut levels = Vec::new();
        let mut below = level_count(tree);
        let mut left: f64 = 0.0;
        while let Some(level) = below.checked_sub(1) {
            let diamonds = diamonds_of(tree, level);
            let weights: Vec<f64> = diamonds.iter().map(|d| weight(*d)).collect();
            let sum: f64 = weights.iter().sum();
            if sum <= size as f64 {
                // The levels above take a part of it, then a part of that part …
                left = sum * REDUCTION as f64 / (REDUCTION - 1) as f64;
                break;
            }
            let count = (sum / size as f64).ceil();
            let mut shards: Vec<LevelShard> = Vec::new();
            let mut before = 0.0;
            let midpoint = |rank: usize| {
                lattice.world_from_lattice(tree.diamonds[diamonds[rank.min(diamonds.len() - 1)] as usize].key.midpoint)
            };
            for (rank, weight) in weights.iter().enumerate() {
                // Where the sum so far passes the next of `count` equal parts.
                if shards.is_empty() || (before * count / sum) as usize >= shards.len() {
                    shards.push(LevelShard { first: rank as u32, triangles: 0, near: midpoint(rank) });
                }
                if let Some(shard) = shards.last_mut() {
                    shard.triangles += *weight as u64;
                }
                before += weight;
            }
            for i in 0..shards.len() {
                let end = shards.get(i + 1).map_or(diamonds.len(), |s| s.first as usize);
                shards[i].near = midpoint(usize::midpoint(shards[i].first as usize, end));
            }
            levels.push(LevelShards { level, shards });
            below = level;
        }
        Self { leaves, levels, tail: below, tail_triangles: left as u64 }
    }

    /// The shard of leaves that a leaf is in.
    pub(super) fn of_leaf(&self, leaf: u32) -> usize {
        self.leaves.partition_point(|s| s.first <= leaf).saturating_sub(1)
    }

    /// The shards of a level, `None` where the tail has it.
    pub(super) fn of_level(&self, level: u8) -> Option<&LevelShards> {
        self.levels.iter().find(|l| l.level == level)
    }
}

fn divide_leaves(tree: &Partition, triangles: impl Fn(u32) -> u64, size: u64) -> Vec<LeafShard> {
    let mut shards = vec![LeafShard { first: 0, triangles: 0, records: None }];
    for leaf in tree.leaves() {
        let (n, last) = (triangles(leaf), shards.len() - 1);
        if shards[last].triangles > 0 && shards[last].triangles + n > size {
            shards.push(LeafShard { first: leaf, triangles: n, records: None });
        } else {
            shards[last].triangles += n;
        }
    }
    shards
}

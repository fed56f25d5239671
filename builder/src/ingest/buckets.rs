//! Buckets: subtrees of the tetrahedra, each with few enough triangles to be worked on in memory.
//!
//! Which buckets there are depends on memory and on a sample of the triangles; nothing that leaves the ingest depends on
//! which there are. A triangle belongs to the bucket that its centroid is in, a point to the bucket that it is in, by the
//! exact rule of the partition. Buckets are convex, so a triangle whose corners lie in one bucket belongs to it.

use crate::partition::{Partition, root_of};
use glam::I64Vec3;
use kilwa_geometry::tetra::{Interior, SplitPlane, max_level};
use kilwa_geometry::{LatticePoint, Tetra};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::OnceLock;

/// A tetrahedron above the buckets, or a bucket.
#[derive(Debug, Clone, Copy)]
enum Node {
    Split { plane: SplitPlane, children: [u32; 2] },
    Bucket(u32),
}

/// Buckets that together fill a tetrahedron of the tree, or a half of one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Run {
    pub(crate) tetrahedron: u32,
    /// The quarters of which the half consists, if it is a half.
    pub(crate) half: Option<[u32; 2]>,
    pub(crate) buckets: Range<u32>,
}

/// The tetrahedra above the buckets.
#[derive(Debug, Clone)]
pub(super) struct Buckets {
    cube_log2: u32,
    /// The first six are the roots.
    nodes: Vec<Node>,
    /// The tetrahedron of each bucket, in the order of a depth-first walk.
    tetrahedra: Vec<Tetra>,
    /// Whether each tetrahedron of that walk is split: enough to rebuild the rest.
    shape: Vec<bool>,
    /// Made on first use: other uses of the buckets do not need it.
    lookup: OnceLock<Lookup>,
}

/// Finds the bucket of a point.
#[derive(Debug, Clone)]
struct Lookup {
    grid: Grid,
    /// By bucket.
    interiors: Vec<Interior>,
}

impl Buckets {
    /// Buckets of about `capacity` triangles. `samples` are sums of corners, each representing `weight` triangles.
    pub(super) fn divide(cube_log2: u32, samples: &mut [I64Vec3], weight: u64, capacity: u64) -> Self {
        let mut shape = Vec::new();
        samples.sort_unstable_by_key(|s| root_of(*s));
        for (root, tetra) in Tetra::roots(cube_log2).into_iter().enumerate() {
            let first = samples.partition_point(|s| root_of(*s) < root);
            let end = samples.partition_point(|s| root_of(*s) <= root);
            divide(&tetra, &mut samples[first..end], weight, capacity, max_level(cube_log2), &mut shape);
        }
        Self::of_shape(cube_log2, shape)
    }

    /// From the shape alone.
    pub(super) fn of_shape(cube_log2: u32, shape: Vec<bool>) -> Self {
        let mut b = Self {
            cube_log2,
            nodes: vec![Node::Bucket(0); 6],
            tetrahedra: Vec::new(),
            shape: Vec::new(),
            lookup: OnceLock::new(),
        };
        let mut splits = shape.iter().copied();
        for (root, tetra) in Tetra::roots(cube_log2).into_iter().enumerate() {
            b.node(root, tetra, &mut splits);
        }
        b.shape = shape;
        b
    }

    fn node(&mut self, index: usize, tetra: Tetra, splits: &mut impl Iterator<Item = bool>) {
        if splits.next() != Some(true) {
            self.nodes[index] = Node::Bucket(self.tetrahedra.len() as u32);
            self.tetrahedra.push(tetra);
            return;
        }
        let first = self.nodes.len();
        self.nodes.extend([Node::Bucket(0); 2]);
        self.nodes[index] = Node::Split { plane: tetra.split_plane(), children: [first as u32, first as u32 + 1] };
        for (child, tetra) in tetra.children().into_iter().enumerate() {
            self.node(first + child, tetra, splits);
        }
    }

    /// Number of buckets.
    pub(super) fn len(&self) -> usize {
        self.tetrahedra.len()
    }

    /// The root cube is `0..=2^cube_log2`.
    pub(super) fn cube_log2(&self) -> u32 {
        self.cube_log2
    }

    /// See [`Buckets::of_shape`].
    pub(super) fn shape(&self) -> &[bool] {
        &self.shape
    }

    /// The tetrahedra of the buckets; those that follow each other are neighbours in a depth-first walk.
    pub(super) fn tetrahedra(&self) -> &[Tetra] {
        &self.tetrahedra
    }

    /// The bucket of a triangle with this sum of corners.
    pub(super) fn of_sum(&self, sum: I64Vec3) -> u32 {
        self.below(root_of(sum) as u32, sum)
    }

    /// The bucket below a node.
    #[inline]
    fn below(&self, node: u32, sum: I64Vec3) -> u32 {
        let mut node = self.nodes[node as usize];
        loop {
            match node {
                Node::Bucket(b) => return b,
                Node::Split { plane, children } => node = self.nodes[children[plane.child_of_sum(sum)] as usize],
            }
        }
    }

    /// The bucket of a point.
    #[inline]
    pub(super) fn of_point(&self, p: [u32; 3]) -> u32 {
        let sum = I64Vec3::from(p.map(|x| 3 * i64::from(x)));
        match self.lookup().grid.node(p) {
            ALL => self.of_sum(sum),
            node => self.below(node, sum),
        }
    }

    /// Whether a point is inside a bucket and on none of its faces. If so, this is the bucket of the point. This takes a fraction of the time of
    /// [`Buckets::of_point`].
    #[inline]
    pub(super) fn is_inside(&self, bucket: u32, p: [u32; 3]) -> bool {
        self.lookup().interiors[bucket as usize].contains(I64Vec3::from(p.map(i64::from)))
    }

    #[inline]
    fn lookup(&self) -> &Lookup {
        self.lookup.get_or_init(|| Lookup {
            grid: Grid::of(self),
            interiors: self.tetrahedra.iter().map(Tetra::interior).collect(),
        })
    }

    /// The smallest tetrahedron at or below `node` that holds all of these points, given as sums.
    fn holding(&self, mut node: u32, sums: &[I64Vec3; 8]) -> u32 {
        if node == ALL {
            let root = root_of(sums[0]) as u32;
            if sums.iter().any(|s| root_of(*s) as u32 != root) {
                return ALL;
            }
            node = root;
        }
        while let Node::Split { plane, children } = self.nodes[node as usize] {
            let child = plane.child_of_sum(sums[0]);
            if sums.iter().any(|s| plane.child_of_sum(*s) != child) {
                break;
            }
            node = children[child];
        }
        node
    }

    /// Which tetrahedron of the tree each run of buckets lies in: a bucket its own, where the tree has it, or the one of
    /// which it is a half; where the tree ends above, all buckets below that leaf are one run.
    pub(super) fn runs(&self, tree: &Partition) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        // With the tetrahedron, the quarters that a half of it consists of.
        let mut stack: Vec<(u32, u32, Option<[u32; 2]>)> = (0..6).rev().map(|root| (root, root, None)).collect();
        while let Some((node, tetrahedron, half)) = stack.pop() {
            let quarters = tree.tetrahedra[tetrahedron as usize].children;
            match self.nodes[node as usize] {
                Node::Bucket(b) => match runs.last_mut() {
                    Some(last) if last.tetrahedron == tetrahedron && quarters.is_none() => last.buckets.end = b + 1,
                    _ => runs.push(Run { tetrahedron, half, buckets: b..b + 1 }),
                },
                Node::Split { children: [first, second], .. } => stack.extend(match (half, quarters) {
                    (Some([a, b]), _) => [(second, b, None), (first, a, None)],
                    (None, Some([a, b, c, d])) => {
                        [(second, tetrahedron, Some([c, d])), (first, tetrahedron, Some([a, b]))]
                    }
                    (None, None) => [(second, tetrahedron, None), (first, tetrahedron, None)],
                }),
            }
        }
        runs
    }

    /// Fold over the tetrahedra above the buckets, children first: `bucket` gives what is known of a bucket, `join` what
    /// is known of a tetrahedron from its two halves.
    pub(super) fn fold<T>(&self, bucket: &mut impl FnMut(u32) -> T, join: &mut impl FnMut(&Tetra, T, T) -> T) {
        for (root, tetra) in Tetra::roots(self.cube_log2).into_iter().enumerate() {
            self.fold_node(root as u32, &tetra, bucket, join);
        }
    }

    fn fold_node<T>(
        &self,
        node: u32,
        tetra: &Tetra,
        bucket: &mut impl FnMut(u32) -> T,
        join: &mut impl FnMut(&Tetra, T, T) -> T,
    ) -> T {
        match self.nodes[node as usize] {
            Node::Bucket(b) => bucket(b),
            Node::Split { children, .. } => {
                let halves = tetra.children();
                let first = self.fold_node(children[0], &halves[0], bucket, join);
                let second = self.fold_node(children[1], &halves[1], bucket, join);
                join(tetra, first, second)
            }
        }
    }
}

/// Divide the samples of a tetrahedron; `shape` receives the walk.
fn divide(tetra: &Tetra, samples: &mut [I64Vec3], weight: u64, capacity: u64, deepest: u8, shape: &mut Vec<bool>) {
    let alike = samples.windows(2).all(|w| w[0] == w[1]);
    let split = samples.len() as u64 * weight > capacity && tetra.level < deepest && !alike;
    shape.push(split);
    if split {
        let plane = tetra.split_plane();
        let mut first = 0;
        for i in 0..samples.len() {
            if plane.child_of_sum(samples[i]) == 0 {
                samples.swap(first, i);
                first += 1;
            }
        }
        let (a, b) = samples.split_at_mut(first);
        let [left, right] = tetra.children();
        divide(&left, a, weight, capacity, deepest, shape);
        divide(&right, b, weight, capacity, deepest, shape);
    }
}

/// The whole cube.
const ALL: u32 = u32::MAX;
/// Cells on a side of the grid, as a power of two.
const GRID_LOG2: u32 = 6;

/// A grid over the cube: the smallest tetrahedron that holds each cell, from which a walk begins.
#[derive(Debug, Clone, Default)]
struct Grid {
    shift: u32,
    log2: u32,
    cells: Vec<u32>,
}

impl Grid {
    fn of(buckets: &Buckets) -> Self {
        let log2 = buckets.cube_log2.min(GRID_LOG2);
        let mut grid = Self { shift: buckets.cube_log2 - log2, log2, cells: vec![ALL; 1 << (3 * log2)] };
        grid.fill(buckets, ALL, [0; 3], log2);
        grid
    }

    /// Fill the cube of `2^log2` cells a side that begins at `cell` and lies in tetrahedron `node`. A tetrahedron is
    /// convex: a cube whose corners lie in it does.
    fn fill(&mut self, buckets: &Buckets, node: u32, cell: [u32; 3], log2: u32) {
        let last = (1i64 << (self.shift + log2)) - 1;
        let corner = |i: usize| {
            let at = |k: usize| (i64::from(cell[k]) << self.shift) + if i >> k & 1 == 1 { last } else { 0 };
            3 * I64Vec3::new(at(0), at(1), at(2))
        };
        let node = buckets.holding(node, &std::array::from_fn(corner));
        let is_bucket = buckets.nodes.get(node as usize).is_some_and(|n| matches!(n, Node::Bucket(_)));
        if is_bucket || log2 == 0 {
            let n = 1u32 << log2;
            for x in cell[0]..cell[0] + n {
                for y in cell[1]..cell[1] + n {
                    let row = (((x << self.log2) + y) << self.log2) + cell[2];
                    self.cells[row as usize..(row + n) as usize].fill(node);
                }
            }
        } else {
            for i in 0..8 {
                let half = std::array::from_fn(|k| cell[k] + ((i >> k & 1) << (log2 - 1)));
                self.fill(buckets, node, half, log2 - 1);
            }
        }
    }

    #[inline]
    fn node(&self, p: [u32; 3]) -> u32 {
        let [x, y, z] = p.map(|c| (c >> self.shift) as usize);
        // Points on the far hull of the cube lie outside of the grid.
        if (x | y | z) >> self.log2 != 0 {
            return ALL;
        }
        self.cells.get((((x << self.log2) + y) << self.log2) + z).copied().unwrap_or(ALL)
    }
}

/// A lattice point in words.
pub(super) fn point_of_words(p: [u32; 3]) -> LatticePoint {
    p.map(|x| x as i32).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(n: u64, side: u64) -> Vec<I64Vec3> {
        let mut random = fastrand::Rng::with_seed(9);
        let mut next = || random.u64(..side);
        (0..n).map(|_| I64Vec3::new(next() as i64 * 3, next() as i64 * 3, (next() / 7) as i64 * 3)).collect()
    }

    #[test]
    fn the_grid_agrees_with_the_tree_walk_and_gives_the_same_buckets() {
        for cube_log2 in [4, 7, 12, 30] {
            let mut s = samples(3000, 1 << cube_log2);
            let buckets = Buckets::divide(cube_log2, &mut s, 3, 500);
            assert!(buckets.len() > 8);
            let again = Buckets::of_shape(cube_log2, buckets.shape().to_vec());
            assert_eq!(again.tetrahedra(), buckets.tetrahedra());
            let mut inside = 0;
            for sum in s {
                let bucket = buckets.of_sum(sum);
                assert_eq!(buckets.of_point(sum.to_array().map(|x| (x / 3) as u32)), bucket);
                assert_eq!(again.of_sum(sum), bucket);
                assert!(buckets.tetrahedra()[bucket as usize].violation(sum) < 1e-3);
                let p = sum.to_array().map(|x| (x / 3) as u32);
                let holding = (0..buckets.len() as u32).filter(|b| buckets.is_inside(*b, p));
                assert!(holding.clone().all(|b| b == bucket));
                inside += holding.count();
            }
            // In a large cube, hardly any random point is on a face.
            assert!(cube_log2 < 12 || inside > 2900, "{inside}");
        }
    }

    #[test]
    fn coincident_samples_do_not_subdivide_forever() {
        let mut s = vec![I64Vec3::new(30, 60, 90); 5000];
        assert_eq!(Buckets::divide(20, &mut s, 10, 100).len(), 6);
    }
}

//! From buckets to the patches of leaves, in canonical order.
//!
//! Input: `welded`, `replies`, the tree. Output: the patch of every leaf that is not empty, and a record for every point
//! that more than one leaf uses, once for each of them (and for points that several buckets see, whether or not more
//! than one leaf uses them). Triangles of a patch are sorted by their corners, vertices are in the order of first use:
//! what comes out depends on the mesh alone.

use super::buckets::{Buckets, Run, point_of_words};
use super::scatter::bytes_per_triangle;
use super::topology::{BORDER, REPLIES, REPLY, Topology, WELDED, Welded};
use super::words::{Layout, color_of_word, normal_of_word};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::{LEAVES, SHARED};
use crate::levels::fragment::Patch;
use crate::partition::{BISECTIONS, Partition};
use crate::scratch::{PatchFile, Records, ScratchError, ScratchFile, record};
use kilwa_geometry::tetra::{SplitPlane, max_level};
use kilwa_geometry::{DiamondKey, Mesh};
use kilwa_simplify::Bound;
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// No leaf.
const NONE: u32 = u32::MAX;

/// What the stage leaves beside its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Leaves {
    /// Triangles of every leaf that is not empty, by number.
    pub(super) triangles: Vec<(u32, u64)>,
}

/// The tree that the split requests make. Those between two of its levels are dropped: what holds such a tetrahedron wants to be
/// split as well, so a level above has the wish too.
pub(super) fn tree_of(cube_log2: u32, requests: impl IntoIterator<Item = DiamondKey>) -> Partition {
    let is_level =
        |key: &DiamondKey| key.level.is_multiple_of(BISECTIONS) && key.level + BISECTIONS <= max_level(cube_log2);
    Partition::from_split_requests(cube_log2, requests.into_iter().filter(is_level))
}

impl Leaves {
    /// Write the numbers of triangles into the tree.
    pub(super) fn count(&self, tree: &mut Partition, leaf_triangles: usize) {
        for &(leaf, n) in &self.triangles {
            tree.tetrahedra[leaf as usize].triangles = n;
            tree.overfull_leaves += u64::from(n > leaf_triangles as u64);
        }
    }
}

/// The source of the triangles of patches.
pub(super) trait Welds: Sync {
    /// Triangles of a bucket.
    fn triangles(&self, bucket: u32) -> u64;

    /// A bucket.
    ///
    /// # Errors
    /// [`BuildError`] if it cannot be read or is damaged.
    fn welded(&self, bucket: u32) -> Result<Welded, BuildError>;

    /// The replies of other buckets about its triangles.
    ///
    /// # Errors
    /// As [`Welds::welded`].
    fn replies(&self, bucket: u32) -> Result<Vec<u32>, BuildError>;
}

/// Buckets in the scratch folder.
struct Kept<'a> {
    topology: &'a Topology,
    layout: Layout,
    welded: ScratchFile,
    replies: ScratchFile,
}

impl Welds for Kept<'_> {
    fn triangles(&self, bucket: u32) -> u64 {
        self.topology.places[bucket as usize].triangles
    }

    fn welded(&self, bucket: u32) -> Result<Welded, BuildError> {
        Ok(Welded::read(&self.welded, self.topology.places[bucket as usize], self.layout)?)
    }

    fn replies(&self, bucket: u32) -> Result<Vec<u32>, BuildError> {
        let mut words = Vec::new();
        self.topology.replies.read(&self.replies, bucket as usize, &mut words)?;
        Ok(words)
    }
}

/// The stage.
pub(super) fn leaves(
    work: &Work<'_>,
    layout: Layout,
    buckets: &Buckets,
    topology: &Topology,
    tree: &Partition,
) -> Result<Leaves, BuildError> {
    let (welded, replies) = (work.scratch.existing(WELDED)?, work.scratch.existing(REPLIES)?);
    fill(work, layout, &Kept { topology, layout, welded, replies }, tree, &buckets.runs(tree))
}

/// Fill the leaves in some runs of buckets.
pub(super) fn fill(
    work: &Work<'_>,
    layout: Layout,
    from: &dyn Welds,
    tree: &Partition,
    runs: &[Run],
) -> Result<Leaves, BuildError> {
    let (patches, shared) = (PatchFile::create(work.scratch, LEAVES)?, Records::create(work.scratch, SHARED)?);
    let done = AtomicU64::new(0);
    let triangles = |run: &Run| run.buckets.clone().map(|b| from.triangles(b)).sum::<u64>();
    let cost = |u: usize| triangles(&runs[u]) * bytes_per_triangle(layout) / 2;
    let one = |u: usize| -> Result<Vec<(u32, u64)>, BuildError> {
        let mut unit = Unit::read(from, layout, runs[u].buckets.clone())?;
        let mut counts = Vec::new();
        let mut records = Vec::new();
        unit.divide(tree, runs[u].tetrahedron, &mut |unit, leaf, triangles| {
            let mesh = unit.patch(leaf, triangles, &mut records);
            counts.push((leaf, triangles.len() as u64));
            patches.append(leaf, &Patch { bounds: vec![Bound::default(); mesh.triangle_count()], mesh })
        })?;
        shared.append(&records)?;
        work.progress.update("filling leaves", done.fetch_add(1, Ordering::Relaxed) + 1, runs.len() as u64);
        Ok(counts)
    };
    let parts = work.run_jobs(runs.len(), work.memory / 10 * 9, cost, one)?;
    let mut triangles: Vec<(u32, u64)> = parts.into_iter().flatten().collect();
    triangles.sort_unstable();
    patches.finish()?;
    shared.finish()?;
    Ok(Leaves { triangles })
}

/// One or more buckets that fill a tetrahedron of the tree.
struct Unit {
    layout: Layout,
    /// Words of all vertices; those of several buckets one after the other, some of them equal.
    vertices: Vec<u32>,
    point_of: Vec<u32>,
    normals: Vec<u32>,
    triangles: Vec<[u32; 3]>,
    /// Three times the centroids.
    sums: Vec<[u32; 3]>,
    /// Whether other buckets may use a point.
    seen_by_others: Vec<bool>,
    /// The first leaf that uses a point, and whether that is recorded.
    first_leaf: Vec<u32>,
    recorded: Vec<bool>,
    /// The last leaf that used a vertex, and the vertex's rank there.
    stamp: Vec<u32>,
    rank: Vec<u32>,
}

impl Unit {
    fn read(from: &dyn Welds, layout: Layout, buckets: Range<u32>) -> Result<Self, BuildError> {
        let mut all = Welded::default();
        let mut points = 0;
        for bucket in buckets {
            let mut w = from.welded(bucket)?;
            apply(&mut w, from.replies(bucket)?.as_chunks::<REPLY>().0);
            let first = all.point_of.len() as u32;
            let count = w.point_of.iter().map(|p| p + 1).max().unwrap_or(0);
            all.vertices.append(&mut w.vertices);
            all.point_of.extend(w.point_of.iter().map(|p| p + points));
            all.normals.append(&mut w.normals);
            all.shared.extend(w.shared.iter().map(|p| p + points));
            // The border bit is above all numbers.
            all.triangles.extend(w.triangles.iter().map(|t| t.map(|v| v + first)));
            points += count;
        }
        let mut seen_by_others = vec![false; points as usize];
        all.shared.iter().for_each(|p| seen_by_others[*p as usize] = true);
        let (width, vertices) = (layout.vertex(), &all.vertices);
        let position = |v: u32| -> [u32; 3] {
            let at = (v & !BORDER) as usize * width;
            [vertices[at], vertices[at + 1], vertices[at + 2]]
        };
        let sum = |t: &[u32; 3]| {
            let [a, b, c] = t.map(position);
            std::array::from_fn(|i| a[i] + b[i] + c[i])
        };
        let sums = all.triangles.iter().map(sum).collect();
        Ok(Self {
            layout,
            sums,
            seen_by_others,
            first_leaf: vec![NONE; points as usize],
            recorded: vec![false; points as usize],
            stamp: vec![NONE; all.point_of.len()],
            rank: vec![0; all.point_of.len()],
            vertices: all.vertices,
            point_of: all.point_of,
            normals: all.normals,
            triangles: all.triangles,
        })
    }

    /// Give the triangles of each leaf below `node` to `leaf`, in order of the leaves.
    fn divide(
        &mut self,
        tree: &Partition,
        node: u32,
        leaf: &mut impl FnMut(&mut Self, u32, &[u32]) -> Result<(), ScratchError>,
    ) -> Result<(), ScratchError> {
        let mut order: Vec<u32> = (0..self.triangles.len() as u32).collect();
        let mut stack = vec![(node, 0..order.len())];
        while let Some((node, range)) = stack.pop() {
            if range.is_empty() {
                continue;
            }
            let tetrahedron = &tree.tetrahedra[node as usize];
            let Some(children) = tetrahedron.children else {
                leaf(self, node, &order[range])?;
                continue;
            };
            let halves = tetrahedron.tetra.children();
            let middle = self.part(&tetrahedron.tetra.split_plane(), &mut order, range.clone());
            let first = self.part(&halves[0].split_plane(), &mut order, range.start..middle);
            let last = self.part(&halves[1].split_plane(), &mut order, middle..range.end);
            let parts = [range.start..first, first..middle, middle..last, last..range.end];
            stack.extend(children.into_iter().zip(parts).rev());
        }
        Ok(())
    }

    /// Put the triangles of child 0 before those of child 1; where the latter begin.
    fn part(&self, plane: &SplitPlane, order: &mut [u32], range: Range<usize>) -> usize {
        let mut first = range.start;
        for i in range {
            if plane.child_of_sum(self.sums[order[i] as usize].map(i64::from).into()) == 0 {
                order.swap(first, i);
                first += 1;
            }
        }
        first
    }

    fn words(&self, vertex: u32) -> &[u32] {
        let width = self.layout.vertex();
        &self.vertices[vertex as usize * width..][..width]
    }

    /// The mesh of a leaf; points that other leaves use go to `records`.
    fn patch(&mut self, leaf: u32, triangles: &[u32], records: &mut Vec<u128>) -> Mesh {
        let ranked = self.rank_vertices(leaf, triangles);
        self.record_points(leaf, &ranked, records);
        let mut sorted: Vec<([u32; 3], u32)> = triangles
            .iter()
            .map(|&t| (self.triangles[t as usize].map(|v| self.rank[(v & !BORDER) as usize]), t))
            .collect();
        sorted.sort_unstable();
        let mut mesh = Mesh { scalars: vec![Vec::new(); self.layout.scalars], ..Mesh::default() };
        mesh.triangles.reserve_exact(sorted.len());
        mesh.borders.reserve_exact(sorted.len());
        mesh.positions.reserve(ranked.len());
        mesh.normals.reserve(ranked.len());
        let mut index = vec![NONE; ranked.len()];
        for (ranks, t) in sorted {
            let corners = ranks.map(|r| {
                let slot = &mut index[r as usize];
                if *slot == NONE {
                    *slot = mesh.positions.len() as u32;
                    self.push_vertex(ranked[r as usize], &mut mesh);
                }
                *slot
            });
            mesh.triangles.push(corners);
            let corners = self.triangles[t as usize];
            mesh.borders.push((0..3).map(|k| u8::from(corners[k] & BORDER != 0) << k).sum());
        }
        mesh
    }

    /// The vertices of a leaf in canonical order; equal ones (of several buckets) have the same rank.
    fn rank_vertices(&mut self, leaf: u32, triangles: &[u32]) -> Vec<u32> {
        let mut used: Vec<(u128, u32)> = Vec::with_capacity(triangles.len());
        for &t in triangles {
            for v in self.triangles[t as usize].map(|v| v & !BORDER) {
                if self.stamp[v as usize] != leaf {
                    self.stamp[v as usize] = leaf;
                    let w = self.words(v);
                    let key = (u128::from(w[0]) << 64) | (u128::from(w[1]) << 32) | u128::from(w[2]);
                    used.push((key, v));
                }
            }
        }
        used.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| self.words(a.1)[3..].cmp(&self.words(b.1)[3..])));
        let mut ranked: Vec<u32> = Vec::with_capacity(used.len());
        for &(_, v) in &used {
            if ranked.last().is_none_or(|last| self.words(*last) != self.words(v)) {
                ranked.push(v);
            }
            self.rank[v as usize] = ranked.len() as u32 - 1;
        }
        ranked
    }

    fn record_points(&mut self, leaf: u32, ranked: &[u32], records: &mut Vec<u128>) {
        for v in ranked {
            let p = self.point_of[*v as usize] as usize;
            let w = self.words(*v);
            let position = point_of_words([w[0], w[1], w[2]]);
            if self.seen_by_others[p] {
                records.push(record(position, leaf));
            } else if self.first_leaf[p] == NONE {
                self.first_leaf[p] = leaf;
            } else if self.first_leaf[p] != leaf {
                if !self.recorded[p] {
                    self.recorded[p] = true;
                    records.push(record(position, self.first_leaf[p]));
                }
                records.push(record(position, leaf));
            }
        }
    }

    fn push_vertex(&self, v: u32, mesh: &mut Mesh) {
        let w = self.words(v);
        mesh.positions.push(point_of_words([w[0], w[1], w[2]]));
        if let Some(at) = self.layout.color() {
            mesh.colors.push(color_of_word(w[at]));
        }
        let normal = self.layout.normal().map_or_else(|| self.normals[self.point_of[v as usize] as usize], |at| w[at]);
        mesh.normals.push(normal_of_word(normal));
        for (to, word) in mesh.scalars.iter_mut().zip(&w[self.layout.scalar()..]) {
            to.push(f32::from_bits(*word));
        }
    }
}

/// Apply what other buckets found out about the triangles of this one.
fn apply(welded: &mut Welded, replies: &[[u32; REPLY]]) {
    for reply in replies {
        let Some(corners) = welded.triangles.get_mut(reply[0] as usize) else { continue };
        for k in 0..3 {
            if reply[1] >> k & 1 == 1 {
                corners[k] |= BORDER;
            }
            if reply[1] >> (3 + k) & 1 == 1 {
                let point = welded.point_of[(corners[k] & !BORDER) as usize];
                welded.normals[point as usize] = reply[2 + k];
            }
        }
    }
}

//! From the leaves to the root, finest level first: merge the patches of a diamond's grandchildren, lock what others
//! share, simplify, certify, split among the diamond's own tetrahedra (design/hierarchy.md, construction steps 4 to 7).
//!
//! Diamonds of one level are independent and run in parallel; what they give depends on their input alone, so the
//! result is the same for any number of threads.
//!
//! Locks. A vertex is free only if all its triangles are inside the diamond. [`Shared`] keeps one record (point,
//! tetrahedron) for every point that more than one tetrahedron of the current surface uses. At each level the records
//! are sorted by point; a point whose tetrahedra belong to two owners (diamonds of this level, or leaves outside all of
//! them) is locked.

use crate::certify::Bound;
use crate::fragment::{Patch, canonical_key, coarsen, submesh};
use crate::partition::Partition;
use crate::prepare::point_key;
use crate::progress::Progress;
use kilwa_geometry::{LatticePoint, Mesh, Sphere};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// What one split diamond contributes to the pack.
pub struct Refined {
    /// Index in [`Partition::diamonds`].
    pub diamond: u32,
    /// The patches of its tetrahedra's children that are not empty: tetrahedron and geometry. This is its chunk.
    pub patches: Vec<(u32, Mesh)>,
    /// Certified error of the coarse form in lattice steps, not yet saturated over what lies below.
    pub error: f32,
    /// Root mean square colour difference of the coarse form, 0 to 255, not yet saturated.
    pub color_error: f32,
    /// Round the chunk and the coarse form, in lattice steps, not yet saturated.
    pub sphere: Sphere,
    /// Triangles before and after simplification.
    pub triangles: (usize, usize),
}

/// The finished hierarchy.
pub struct Levels {
    /// Every diamond with geometry, in no particular order.
    pub refined: Vec<Refined>,
    /// The patches of the six root tetrahedra that are not empty.
    pub roots: Vec<(u32, Mesh)>,
    /// Diamonds that gave back more than 90 % of their triangles.
    pub stuck: u64,
    /// Triangles in the coarse forms of stuck diamonds.
    pub stuck_triangles: u64,
}

/// Records of points that more than one tetrahedron uses.
struct Shared(Vec<(u128, u32)>);

/// Coarsen everything.
pub fn coarsen_all(mesh: &Mesh, tree: &Partition, progress: &dyn Progress) -> Levels {
    let mut patches = leaf_patches(mesh, tree);
    let mut shared = Shared::of_leaves(&patches);
    let mut out = Levels { refined: Vec::new(), roots: Vec::new(), stuck: 0, stuck_triangles: 0 };
    let mut by_level: Vec<Vec<u32>> = Vec::new();
    for (i, d) in tree.diamonds.iter().enumerate().filter(|(_, d)| d.split) {
        let level = usize::from(d.key.level);
        by_level.resize_with(by_level.len().max(level + 1), Vec::new);
        by_level[level].push(i as u32);
    }
    let total: u64 = by_level.iter().map(|l| l.len() as u64).sum();
    let done = AtomicU64::new(0);
    progress.update("simplifying", 0, total);
    while let Some(mut level) = by_level.pop() {
        level.sort_unstable_by_key(|d| tree.diamonds[*d as usize].key);
        let mut locks = shared.locks(tree, level.first().map_or(0, |d| tree.diamonds[*d as usize].key.level));
        let jobs: Vec<Job> = level
            .iter()
            .map(|&d| {
                let children =
                    tree.diamonds[d as usize].tetrahedra.iter().filter_map(|t| tree.tetrahedra[*t as usize].children);
                let input: Vec<(u32, Patch)> =
                    children.flatten().filter_map(|c| patches.remove(&c).map(|p| (c, p))).collect();
                Job { diamond: d, input, locked: locks.remove(&d).unwrap_or_default() }
            })
            .filter(|job| !job.input.is_empty())
            .collect();
        let finished: Vec<Done> = jobs
            .into_par_iter()
            .map(|job| {
                let r = job.run(tree);
                progress.update("simplifying", done.fetch_add(1, Ordering::Relaxed) + 1, total);
                r
            })
            .collect();
        shared.retire(tree, &finished);
        for f in finished {
            let r = &f.refined;
            if r.triangles.1 * 10 > r.triangles.0 * 9 {
                out.stuck += 1;
                out.stuck_triangles += r.triangles.1 as u64;
            }
            patches.extend(f.output);
            out.refined.push(f.refined);
        }
    }
    progress.update("simplifying", total, total);
    out.roots = (0..6u32).filter_map(|t| patches.remove(&t).map(|p| (t, p.mesh))).collect();
    out
}

fn leaf_patches(mesh: &Mesh, tree: &Partition) -> FxHashMap<u32, Patch> {
    let leaves: Vec<u32> = tree.leaves().filter(|t| !tree.tetrahedra[*t as usize].range.is_empty()).collect();
    leaves
        .into_par_iter()
        .map(|leaf| {
            let mut triangles = tree.order[tree.tetrahedra[leaf as usize].range.clone()].to_vec();
            triangles.sort_by_cached_key(|t| canonical_key(mesh, *t as usize));
            let mesh = submesh(mesh, &triangles);
            (leaf, Patch { bounds: vec![Bound::default(); mesh.triangle_count()], mesh })
        })
        .collect()
}

impl Shared {
    fn of_leaves(patches: &FxHashMap<u32, Patch>) -> Self {
        let mut all: Vec<(u128, u32)> =
            patches.par_iter().flat_map_iter(|(t, p)| p.mesh.positions.iter().map(|x| (point_key(*x), *t))).collect();
        all.par_sort_unstable();
        all.dedup();
        let records = all.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() > 1).flatten().copied().collect();
        Self(records)
    }

    /// The locked points of every diamond of a level. An owner is the diamond whose split made a tetrahedron, for
    /// tetrahedra one level below; every other tetrahedron is a leaf at this level or above and owns itself.
    fn locks(&mut self, tree: &Partition, level: u8) -> FxHashMap<u32, Vec<LatticePoint>> {
        self.0.par_sort_unstable();
        self.0.dedup();
        let mut out: FxHashMap<u32, Vec<LatticePoint>> = FxHashMap::default();
        let mut owners: Vec<(u8, u32)> = Vec::new();
        for group in self.0.chunk_by(|a, b| a.0 == b.0) {
            owners.clear();
            owners.extend(group.iter().map(|(_, t)| {
                let node = &tree.tetrahedra[*t as usize];
                if node.tetra.level == level + 1 { (0, node.parent_diamond) } else { (1, *t) }
            }));
            owners.sort_unstable();
            owners.dedup();
            if owners.len() < 2 {
                continue;
            }
            let key = group[0].0;
            let point = [(key >> 64) as i32, ((key >> 32) & 0xffff_ffff) as i32, (key & 0xffff_ffff) as i32];
            for &(_, d) in owners.iter().filter(|o| o.0 == 0) {
                out.entry(d).or_default().push(point);
            }
        }
        out
    }

    /// Replace the records of tetrahedra that were merged by those of what came out.
    fn retire(&mut self, tree: &Partition, finished: &[Done]) {
        let Some(level) = finished.first().map(|f| tree.diamonds[f.refined.diamond as usize].key.level) else { return };
        self.0.retain(|(_, t)| tree.tetrahedra[*t as usize].tetra.level != level + 1);
        for f in finished {
            self.0.extend(&f.records);
        }
    }
}

struct Job {
    diamond: u32,
    input: Vec<(u32, Patch)>,
    locked: Vec<LatticePoint>,
}

struct Done {
    refined: Refined,
    output: Vec<(u32, Patch)>,
    records: Vec<(u128, u32)>,
}

impl Job {
    fn run(self, tree: &Partition) -> Done {
        let c = coarsen(&self.input, &self.locked, tree, self.diamond);
        let patches = self.input.into_iter().map(|(t, p)| (t, p.mesh)).collect();
        let refined = Refined {
            diamond: self.diamond,
            patches,
            error: c.error,
            color_error: c.color_error,
            sphere: c.sphere,
            triangles: c.triangles,
        };
        Done { refined, output: c.output, records: c.records }
    }
}

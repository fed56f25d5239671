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

use crate::certify::{Bound, certify};
use crate::partition::Partition;
use crate::prepare::point_key;
use crate::progress::Progress;
use crate::simplify::simplify;
use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{LatticePoint, Mesh, Sphere};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::atomic::{AtomicU64, Ordering};

/// A mesh with bounds per triangle.
#[derive(Debug, Clone, Default)]
pub struct Patch {
    /// Geometry.
    pub mesh: Mesh,
    /// One per triangle, against the finest surface.
    pub bounds: Vec<Bound>,
}

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
pub fn coarsen(mesh: &Mesh, tree: &Partition, progress: &dyn Progress) -> Levels {
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

/// Vertices of `mesh` that `triangles` use, and these triangles, in a canonical order that depends on geometry alone.
fn submesh(mesh: &Mesh, triangles: &[u32]) -> Mesh {
    let mut out = Mesh { scalars: vec![Vec::new(); mesh.scalars.len()], ..Mesh::default() };
    let mut index: FxHashMap<u32, u32> = FxHashMap::default();
    for &t in triangles {
        let tri = mesh.triangles[t as usize].map(|v| {
            let next = out.positions.len() as u32;
            let i = *index.entry(v).or_insert(next);
            if i == next {
                out.push_vertex_of(mesh, v as usize);
            }
            i
        });
        out.triangles.push(tri);
        out.borders.push(mesh.borders[t as usize]);
    }
    out
}

/// Sort key of a triangle: its corners as they are, attributes included, so that ties are true duplicates.
fn canonical_key(mesh: &Mesh, t: usize) -> [VertexKey; 3] {
    mesh.triangles[t].map(|v| VertexKey::of(mesh, v as usize))
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
    fn locks(&mut self, tree: &Partition, level: u8) -> FxHashMap<u32, FxHashSet<LatticePoint>> {
        self.0.par_sort_unstable();
        self.0.dedup();
        let mut out: FxHashMap<u32, FxHashSet<LatticePoint>> = FxHashMap::default();
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
                out.entry(d).or_default().insert(point);
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
    locked: FxHashSet<LatticePoint>,
}

struct Done {
    refined: Refined,
    output: Vec<(u32, Patch)>,
    records: Vec<(u128, u32)>,
}

impl Job {
    fn run(self, tree: &Partition) -> Done {
        let merged = merge(&self.input);
        let fine = &merged.mesh;
        let coarse = simplify(fine, &self.locked, fine.triangle_count() / 2);
        let bounds = certify(fine, &merged.bounds, &coarse);
        let color_error = color_difference(fine, &coarse);
        let error = bounds.iter().map(|b| b.out.max(b.back)).fold(0.0, f32::max);
        let sphere = Sphere::of(&fine.positions).union(&Sphere::of(&coarse.positions));
        let triangles = (fine.triangle_count(), coarse.triangle_count());
        let output = split(&coarse, &bounds, tree, self.diamond);
        let records = records_of(&output, &self.locked);
        let patches = self.input.into_iter().map(|(t, p)| (t, p.mesh)).collect();
        let refined = Refined { diamond: self.diamond, patches, error, color_error, sphere, triangles };
        Done { refined, output, records }
    }
}

/// Weld patches into one mesh: wedges that are equal in position and attributes become one vertex. Triangles and
/// vertices come in canonical order.
fn merge(input: &[(u32, Patch)]) -> Patch {
    let mut order: Vec<(u32, u32)> = Vec::new();
    for (i, (_, p)) in input.iter().enumerate() {
        order.extend((0..p.mesh.triangle_count() as u32).map(|t| (i as u32, t)));
    }
    order.sort_by_cached_key(|(i, t)| canonical_key(&input[*i as usize].1.mesh, *t as usize));
    let mut out = Patch::default();
    let mut index: FxHashMap<VertexKey, u32> = FxHashMap::default();
    for (i, t) in order {
        let p = &input[i as usize].1;
        let tri = p.mesh.triangles[t as usize].map(|v| {
            let next = out.mesh.positions.len() as u32;
            let w = *index.entry(VertexKey::of(&p.mesh, v as usize)).or_insert(next);
            if w == next {
                out.mesh.push_vertex_of(&p.mesh, v as usize);
            }
            w
        });
        out.mesh.triangles.push(tri);
        out.mesh.borders.push(p.mesh.borders[t as usize]);
        out.bounds.push(p.bounds[t as usize]);
    }
    out
}

/// The identity of a vertex across patches.
#[derive(PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct VertexKey {
    position: LatticePoint,
    color: [u8; 3],
    normal: [i16; 2],
    scalars: Vec<u32>,
}

impl VertexKey {
    pub(crate) fn of(mesh: &Mesh, v: usize) -> Self {
        Self {
            position: mesh.positions[v],
            color: mesh.colors.get(v).copied().unwrap_or_default(),
            normal: mesh.normals[v],
            scalars: mesh.scalars.iter().map(|s| s[v].to_bits()).collect(),
        }
    }
}

/// Share the triangles out among the diamond's own tetrahedra: each to the one that its centroid is in, or least far
/// outside of; ties to the first.
fn split(coarse: &Mesh, bounds: &[Bound], tree: &Partition, diamond: u32) -> Vec<(u32, Patch)> {
    let tetrahedra = &tree.diamonds[diamond as usize].tetrahedra;
    let mut groups: Vec<Vec<u32>> = vec![Vec::new(); tetrahedra.len()];
    for t in 0..coarse.triangle_count() {
        let sum = corner_sum(coarse.corners(t));
        let mut best = (f64::INFINITY, 0);
        for (i, tetra) in tetrahedra.iter().enumerate() {
            let v = tree.tetrahedra[*tetra as usize].tetra.violation(sum);
            if v < best.0 {
                best = (v, i);
            }
        }
        groups[best.1].push(t as u32);
    }
    tetrahedra
        .iter()
        .zip(groups)
        .filter(|(_, g)| !g.is_empty())
        .map(|(t, g)| {
            let bounds = g.iter().map(|t| bounds[*t as usize]).collect();
            (*t, Patch { mesh: submesh(coarse, &g), bounds })
        })
        .collect()
}

/// Records of points that are locked or that two of the outputs use.
fn records_of(output: &[(u32, Patch)], locked: &FxHashSet<LatticePoint>) -> Vec<(u128, u32)> {
    let mut all: Vec<(u128, u32, bool)> = output
        .iter()
        .flat_map(|(t, p)| p.mesh.positions.iter().map(|x| (point_key(*x), *t, locked.contains(x))))
        .collect();
    all.sort_unstable();
    all.dedup();
    all.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() > 1 || g[0].2).flatten().map(|(key, t, _)| (*key, *t)).collect()
}

/// Root mean square difference, 0 to 255 over the three channels, between the colours of fine vertices and those of the
/// nearest coarse vertex: an estimate for choosing levels, not a bound.
fn color_difference(fine: &Mesh, coarse: &Mesh) -> f32 {
    if fine.colors.is_empty() {
        return 0.0;
    }
    let kept: FxHashMap<LatticePoint, usize> = coarse.positions.iter().enumerate().map(|(i, p)| (*p, i)).collect();
    let mut sum = 0.0f64;
    let mut count = 0u64;
    // Fine vertices that are gone are compared along the fine edges that lead to one that is still there.
    let mut add = |from: usize, to: usize| {
        sum += (0..3).map(|k| (f64::from(fine.colors[from][k]) - f64::from(coarse.colors[to][k])).powi(2)).sum::<f64>()
            / 3.0;
        count += 1;
    };
    for tri in &fine.triangles {
        for k in 0..3 {
            let (a, b) = (tri[k] as usize, tri[(k + 1) % 3] as usize);
            if let Some(&to) = kept.get(&fine.positions[b])
                && !kept.contains_key(&fine.positions[a])
            {
                add(a, to);
            }
            if let Some(&same) = kept.get(&fine.positions[a]) {
                add(a, same);
            }
        }
    }
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() as f32 }
}

//! What happens to one diamond's fragment, independent of every other: merge the patches of its tetrahedra's children,
//! simplify, certify, split among its own tetrahedra (design/hierarchy.md, construction step 4).
//!
//! Pure: the result depends on the patches and the locked points alone.

use crate::certify::{Bound, certify};
use crate::partition::Partition;
use crate::prepare::point_key;
use crate::simplify::simplify;
use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{LatticePoint, Mesh, Sphere};
use rustc_hash::{FxHashMap, FxHashSet};

/// A mesh with bounds per triangle.
#[derive(Debug, Clone, Default)]
pub struct Patch {
    /// Geometry.
    pub mesh: Mesh,
    /// One per triangle, against the finest surface.
    pub bounds: Vec<Bound>,
}

/// The coarse form of a fragment.
pub struct Coarsened {
    /// A patch for each tetrahedron of the diamond that is not empty.
    pub output: Vec<(u32, Patch)>,
    /// Points that another diamond may also use, or that several of the outputs do: key and tetrahedron of the output.
    pub records: Vec<(u128, u32)>,
    /// Certified error of the coarse form in lattice steps.
    pub error: f32,
    /// Root mean square colour difference of the coarse form, 0 to 255.
    pub color_error: f32,
    /// Round the fragment and its coarse form, in lattice steps.
    pub sphere: Sphere,
    /// Triangles before and after.
    pub triangles: (usize, usize),
}

/// Coarsen the fragment of a diamond to half its triangles. `input` are the patches of its tetrahedra's children,
/// `locked` the points that triangles outside of it use, in any order.
pub fn coarsen(input: &[(u32, Patch)], locked: &[LatticePoint], tree: &Partition, diamond: u32) -> Coarsened {
    let locked: FxHashSet<LatticePoint> = locked.iter().copied().collect();
    let merged = merge(input);
    let fine = &merged.mesh;
    let coarse = simplify(fine, &locked, fine.triangle_count() / 2);
    let bounds = certify(fine, &merged.bounds, &coarse);
    let output = split(&coarse, &bounds, tree, diamond);
    Coarsened {
        records: records_of(&output, &locked),
        output,
        error: bounds.iter().map(|b| b.out.max(b.back)).fold(0.0, f32::max),
        color_error: color_difference(fine, &coarse),
        sphere: Sphere::of(&fine.positions).union(&Sphere::of(&coarse.positions)),
        triangles: (fine.triangle_count(), coarse.triangle_count()),
    }
}

/// Vertices of `mesh` that `triangles` use, and these triangles, in a canonical order that depends on geometry alone.
pub(crate) fn submesh(mesh: &Mesh, triangles: &[u32]) -> Mesh {
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
pub(crate) fn canonical_key(mesh: &Mesh, t: usize) -> [VertexKey; 3] {
    mesh.triangles[t].map(|v| VertexKey::of(mesh, v as usize))
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

//! The work on one diamond's fragment, independent of every other: merge the patches of its tetrahedra's children,
//! simplify, certify, split among its own tetrahedra.
//!
//! Pure: the result depends on the patches and the locked points alone.

use crate::partition::Partition;
use crate::scratch::point_key;
use glam::DVec3;
use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::tetra::Faces;
use kilwa_geometry::{LatticePoint, Mesh, Sphere, normal};
use kilwa_simplify::Precision;
use kilwa_simplify::{Bound, PRUNED, Purpose, Simplified, Welder, certify, simplify};
use rustc_hash::FxHashSet;

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
    /// Certified error of the coarse form in lattice units.
    pub error: f32,
    /// Root mean square colour difference of the coarse form, 0 to 255.
    pub color_error: f32,
    /// Round the fragment and its coarse form, in lattice units.
    pub sphere: Sphere,
    /// Triangles before and after.
    pub triangles: (usize, usize),
}

/// A fragment is simplified to one in so many of its triangles, those at locked points not counted. The tetrahedra of a
/// level are 2^(2/3 * BISECTIONS) = 2.5 times as large, in surface, as those of the next.
pub const REDUCTION: u64 = 5;

/// Coarsen the fragment of a diamond to a part of its triangles, [`REDUCTION`]. `fragment` are the merged patches of its tetrahedra's children,
/// `locked` the points that triangles outside of it use, in any order. Normals that the inputs supplied are carried on; others follow from the
/// coarse triangles, where one output uses a point alone.
pub fn coarsen(
    fragment: &Patch,
    locked: &[LatticePoint],
    (tree, diamond): (&Partition, u32),
    precision: Precision,
    supplied_normals: bool,
) -> Coarsened {
    let locked: FxHashSet<LatticePoint> = locked.iter().copied().collect();
    let fine = &fragment.mesh;
    let target = target(fine.triangle_count(), locked.len());
    let mut simplified = simplify(fine, &locked, target, Purpose::Level(precision));
    let bounds = certify(fine, &fragment.bounds, &simplified);
    let groups = share_out(&simplified.mesh, tree, diamond);
    let shared = shared_points(&groups, &simplified);
    if !supplied_normals {
        set_normals(&mut simplified, &shared, precision);
    }
    let coarse = &simplified.mesh;
    let mut numbers = Numbers::new(coarse.vertex_count());
    let part = |(t, g): &(u32, Vec<u32>)| {
        let bounds = g.iter().map(|t| bounds[*t as usize]).collect();
        (*t, Patch { mesh: numbers.submesh(coarse, g), bounds })
    };
    let output = groups.iter().map(part).collect();
    let records = records_of(&groups, &simplified, &shared);

    Coarsened {
        records,
        output,
        error: bounds.iter().map(|b| b.out.max(b.back)).fold(0.0, f32::max),
        color_error: color_difference(fine, &simplified),
        sphere: Sphere::of(&fine.positions).union(&Sphere::of(&coarse.positions)),
        triangles: (fine.triangle_count(), coarse.triangle_count()),
    }
}

/// How many triangles to keep. A border has about a triangle for each of its points, and these stay: the inside must not
/// pay for them with a coarser form than its neighbours will have.
fn target(triangles: usize, locked: usize) -> usize {
    let free = triangles.saturating_sub(locked);
    triangles - (free - free / REDUCTION as usize)
}

/// Join patches into one mesh: wedges that are equal in position and attributes become one vertex. Triangles stand in
/// the order of the patches, which follows from geometry alone.
pub(crate) fn merge(input: &[(u32, Patch)], scalars: u8) -> Patch {
    let scalars = scalars.into();
    let mut welder = Welder::new(input.iter().map(|(_, p)| p.mesh.vertex_count()).sum(), scalars);
    let mut bounds = Vec::with_capacity(input.iter().map(|(_, p)| p.bounds.len()).sum());
    let mut number = Vec::new();
    for (_, p) in input {
        number.clear();
        number.extend((0..p.mesh.vertex_count()).map(|v| welder.vertex(&p.mesh, v)));
        welder.mesh.triangles.extend(p.mesh.triangles.iter().map(|t| t.map(|v| number[v as usize])));
        welder.mesh.borders.extend(&p.mesh.borders);
        bounds.extend(&p.bounds);
    }
    Patch { mesh: welder.mesh, bounds }
}

/// Share the triangles out among the diamond's own tetrahedra: each to the one that its centroid is in, or least far
/// outside of; ties to the first. Tetrahedra without triangles are left out.
fn share_out(coarse: &Mesh, tree: &Partition, diamond: u32) -> Vec<(u32, Vec<u32>)> {
    let mut groups: Vec<(u32, Vec<u32>)> =
        tree.diamonds[diamond as usize].tetrahedra.iter().map(|t| (*t, Vec::new())).collect();
    let faces: Vec<Faces> = groups.iter().map(|(t, _)| tree.tetrahedra[*t as usize].tetra.faces()).collect();
    for t in 0..coarse.triangle_count() {
        let sum = corner_sum(coarse.corners(t));
        let mut best = (f64::INFINITY, 0);
        for (i, f) in faces.iter().enumerate() {
            let v = f.violation(sum);
            if v < best.0 {
                best = (v, i);
            }
            if v <= 0.0 {
                break;
            }
        }
        groups[best.1].1.push(t as u32);
    }
    groups.retain(|(_, g)| !g.is_empty());
    groups
}

/// Renumbers vertices for one part of a mesh after the other.
pub(crate) struct Numbers {
    number: Vec<(u32, u32)>,
    part: u32,
}

impl Numbers {
    pub(crate) fn new(vertices: usize) -> Self {
        Self { number: vec![(0, 0); vertices], part: 0 }
    }

    /// The vertices of `mesh` that `triangles` use, and these triangles, both in order of appearance.
    pub(crate) fn submesh(&mut self, mesh: &Mesh, triangles: &[u32]) -> Mesh {
        self.part += 1;
        let mut out = Mesh { scalars: vec![Vec::new(); mesh.scalars.len()], ..Mesh::default() };
        for &t in triangles {
            let tri = mesh.triangles[t as usize].map(|v| {
                let n = &mut self.number[v as usize];
                if n.0 != self.part {
                    *n = (self.part, out.push_vertex_of(mesh, v as usize));
                }
                n.1
            });
            out.triangles.push(tri);
            out.borders.push(mesh.borders[t as usize]);
        }
        out
    }
}

/// For every coarse point, whether it is locked or two of the outputs use it.
fn shared_points(groups: &[(u32, Vec<u32>)], simplified: &Simplified) -> Vec<bool> {
    let mut shared = simplified.locked.clone();
    // The tetrahedron that used a point first.
    let mut first = vec![u32::MAX; shared.len()];
    for (tetrahedron, triangles) in groups {
        for p in triangles.iter().flat_map(|t| simplified.triangles[*t as usize]) {
            let first = &mut first[p as usize];
            if *first == u32::MAX {
                *first = *tetrahedron;
            }
            shared[p as usize] |= *first != *tetrahedron;
        }
    }
    shared
}

/// Give the points that one output uses alone the normals of the coarse triangles round them, by area. A decoder predicts these exactly (FORMAT
/// section 5.8), but for points with several vertices, at seams of colours or scalars. Shared points keep the mean of the fine normals, which is
/// the same on both sides of a border.
fn set_normals(simplified: &mut Simplified, shared: &[bool], precision: Precision) {
    let mut sums = vec![DVec3::ZERO; shared.len()];
    for (t, points) in simplified.triangles.iter().enumerate() {
        let [a, b, c] = simplified.mesh.corners(t).map(LatticePoint::as_dvec3);
        let n = (b - a).cross(c - a);
        for p in points {
            sums[*p as usize] += n;
        }
    }
    for (points, vertices) in simplified.triangles.iter().zip(&simplified.mesh.triangles) {
        for (p, v) in points.iter().zip(vertices) {
            let sum = sums[*p as usize];
            if !shared[*p as usize] && sum != DVec3::ZERO {
                simplified.mesh.normals[*v as usize] = precision.normal(normal::encode(sum));
            }
        }
    }
}

/// Records of the points that are shared.
fn records_of(groups: &[(u32, Vec<u32>)], simplified: &Simplified, shared: &[bool]) -> Vec<(u128, u32)> {
    let mut last = vec![u32::MAX; shared.len()];
    let mut out = Vec::new();
    for (tetrahedron, triangles) in groups {
        for t in triangles {
            let at = simplified.mesh.corners(*t as usize);
            for (p, at) in simplified.triangles[*t as usize].into_iter().zip(at) {
                if shared[p as usize] && last[p as usize] != *tetrahedron {
                    last[p as usize] = *tetrahedron;
                    out.push((point_key(at), *tetrahedron));
                }
            }
        }
    }
    out
}

/// Root mean square difference, 0 to 255 over the three channels, between the colours of fine vertices and those of the
/// coarse vertices that they were merged into: an estimate for choosing levels, not a bound.
fn color_difference(fine: &Mesh, simplified: &Simplified) -> f32 {
    if fine.colors.is_empty() {
        return 0.0;
    }
    // Of several wedges at a point the last; they differ where colours jump, which no average tells anyway.
    let mut color = vec![[0u8; 3]; simplified.points];
    for (points, vertices) in simplified.triangles.iter().zip(&simplified.mesh.triangles) {
        for k in 0..3 {
            color[points[k] as usize] = simplified.mesh.colors[vertices[k] as usize];
        }
    }
    let (mut sum, mut count) = (0u64, 0u64);
    for (c, p) in fine.colors.iter().zip(&simplified.fine_point) {
        let point = simplified.coarse_of_fine[*p as usize];
        if point == PRUNED {
            continue;
        }
        let to = color[point as usize];
        sum += (0..3).map(|k| u64::from(c[k].abs_diff(to[k])).pow(2)).sum::<u64>();
        count += 1;
    }
    (sum as f64 / 3.0 / count.max(1) as f64).sqrt() as f32
}

//! From a raw mesh to one welded mesh on the lattice: units and axes, choice of the step, snapping, welding by lattice
//! equality, true-border bits and normals. Everything later works on integers only.
//!
//! Invariants of the result: no triangle has two corners at one lattice point; every vertex is used; two vertices with
//! the same position differ in an attribute (they are wedges); a border bit is set exactly on the edges that one
//! triangle of the whole model uses.

use crate::options::{BuildError, BuildOptions, Up};
use crate::raw::{Findings, RawMesh};
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::{Lattice, LatticePoint, Mesh, normal};
use kilwa_pack::chunk::MAX_SCALARS;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Bits per octahedral coordinate kept of a normal: a tenth of a degree, well below what shading shows.
pub const NORMAL_BITS: u32 = 10;

/// The part of the median-to-small edge range that the step must resolve: 1/16 of the 1st-percentile edge.
const STEP_PER_EDGE: f64 = 1.0 / 16.0;

/// Models wider than this many metres are refused: a light second, and errors still fit `f32`.
const WIDEST: f64 = 3e8;

/// The welded mesh and what was learned on the way.
pub struct Prepared {
    /// The lattice of all positions.
    pub lattice: Lattice,
    /// The root cube is `0..=2^cube_log2`.
    pub cube_log2: u32,
    /// The finest surface.
    pub mesh: Mesh,
    /// Names of `mesh.scalars`.
    pub scalar_names: Vec<String>,
    /// Distinct lattice positions.
    pub points: u64,
    /// Edges used by exactly one triangle.
    pub border_edges: u64,
    /// Edges used by more than two triangles.
    pub non_manifold_edges: u64,
    /// Median edge length in metres.
    pub median_edge: f64,
    /// What reading and preparing found.
    pub findings: Findings,
}

/// A lattice point as one integer: 30 bits an axis, sorted by x, then y, then z.
pub fn point_key(p: LatticePoint) -> u128 {
    (u128::from(p[0] as u32) << 64) | (u128::from(p[1] as u32) << 32) | u128::from(p[2] as u32)
}

/// Prepare a mesh.
///
/// # Errors
/// [`BuildError::Empty`], [`BuildError::Step`] or [`BuildError::TooLarge`], each with what to do.
pub fn prepare(mut raw: RawMesh, options: &BuildOptions) -> Result<Prepared, BuildError> {
    let mut findings = std::mem::take(&mut raw.findings);
    if raw.triangles.is_empty() {
        return Err(BuildError::Empty { why: "the input has no triangles; give a mesh, not a point cloud".into() });
    }
    if raw.triangles.len() > u32::MAX as usize / 4 {
        return Err(BuildError::TooLarge { why: format!("{} triangles in memory; at most 2^30", raw.triangles.len()) });
    }
    if raw.scalars.len() > usize::from(MAX_SCALARS) {
        let names = raw.scalars.iter().map(|(n, _)| n.as_str()).collect::<Vec<_>>().join(", ");
        let why = format!("{} scalar channels together ({names}); a pack holds {}", raw.scalars.len(), MAX_SCALARS);
        return Err(BuildError::TooLarge { why });
    }
    to_metres(&mut raw, options);
    let edges = edge_lengths(&raw);
    let (lattice, cube_log2) = choose_lattice(&raw, options, &edges)?;
    let mesh = snap_and_weld(&raw, &lattice, &mut findings)?;
    let scalar_names = raw.scalars.iter().map(|(n, _)| n.clone()).collect();
    drop(raw);
    let mut prepared = Prepared {
        lattice,
        cube_log2,
        mesh,
        scalar_names,
        points: 0,
        border_edges: 0,
        non_manifold_edges: 0,
        median_edge: percentile(&edges, 0.5),
        findings,
    };
    prepared.finish();
    Ok(prepared)
}

/// Apply units and the up axis in place.
fn to_metres(raw: &mut RawMesh, options: &BuildOptions) {
    let s = options.units.metres();
    let y_up = options.up == Up::Y;
    raw.positions.par_iter_mut().for_each(|p| {
        let q = if y_up { [p[0], -p[2], p[1]] } else { *p };
        *p = q.map(|x| x * s);
    });
    if y_up {
        raw.normals.par_iter_mut().for_each(|n| *n = [n[0], -n[2], n[1]]);
    }
}

/// All edge lengths above zero, in metres, sorted.
fn edge_lengths(raw: &RawMesh) -> Vec<f32> {
    let mut lengths: Vec<f32> = raw
        .triangles
        .par_iter()
        .flat_map_iter(|t| {
            let [a, b, c] = t.map(|v| raw.positions[v as usize]);
            [(a, b), (b, c), (c, a)].map(|(p, q)| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt() as f32)
        })
        .filter(|l| *l > 0.0 && l.is_finite())
        .collect();
    lengths.par_sort_unstable_by(f32::total_cmp);
    lengths
}

fn percentile(sorted: &[f32], p: f64) -> f64 {
    let i = ((sorted.len().saturating_sub(1)) as f64 * p) as usize;
    sorted.get(i).copied().map_or(0.0, f64::from)
}

/// The lattice and the root cube: centred on the model and padded so that the model never touches the hull.
fn choose_lattice(raw: &RawMesh, options: &BuildOptions, edges: &[f32]) -> Result<(Lattice, u32), BuildError> {
    let mut used = vec![false; raw.positions.len()];
    raw.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for (p, _) in raw.positions.iter().zip(&used).filter(|(_, u)| **u) {
        for i in 0..3 {
            min[i] = min[i].min(p[i]);
            max[i] = max[i].max(p[i]);
        }
    }
    let extent = (0..3).map(|i| max[i] - min[i]).fold(0.0, f64::max);
    let magnitude = (0..3).map(|i| min[i].abs().max(max[i].abs())).fold(0.0, f64::max);
    if !extent.is_finite() || extent > WIDEST {
        let why =
            format!("it is {extent:e} m wide, with coordinates up to {magnitude:e} m; check --units and the export");
        return Err(BuildError::TooLarge { why });
    }
    if extent <= 0.0 {
        return Err(BuildError::Empty {
            why: format!(
                "all {} vertices of the triangles are at the same place; check the export",
                raw.positions.len()
            ),
        });
    }
    // The cube must hold the extent plus padding in 30 bits.
    let coarsest = libm::log2(extent * 1.1 / f64::from(MAX_COORDINATE)).ceil() as i32;
    // Finer than the doubles of the source can tell apart is no use (and f64 world coordinates must stay exact).
    let finest = (libm::log2(magnitude * f64::EPSILON).floor() as i32).max(-60);
    let median = percentile(edges, 0.5);
    if options.step.is_none() && 2f64.powi(coarsest) > median {
        let why = format!(
            "it is {extent:e} m wide, but half of its edges are shorter than {median:e} m, and a lattice has 2^30 steps: a \
             vertex is astray, between {min:?} and {max:?} m; remove it, or give --step"
        );
        return Err(BuildError::TooLarge { why });
    }
    let derived = || (libm::log2(percentile(edges, 0.01) * STEP_PER_EDGE).floor() as i32).max(coarsest).max(finest);
    let step_log2 = options.step.map_or_else(|| Ok(derived()), |step| given_step(step, extent, coarsest))?;
    let step = 2f64.powi(step_log2);
    let steps = extent / step;
    let cube_log2 = (libm::log2(steps * 1.05 + 4.0).ceil() as u32).clamp(2, 30);
    let half = f64::from(1u32 << (cube_log2 - 1));
    // A multiple of the step, so that world coordinates of lattice points are exact in f64 wherever 53 bits allow.
    let origin = std::array::from_fn(|i| (((min[i] + max[i]) * 0.5 / step).round() - half) * step);
    Ok((Lattice { origin, step_log2 }, cube_log2))
}

/// The logarithm of a step that the user asked for.
fn given_step(step: f64, extent: f64, coarsest: i32) -> Result<i32, BuildError> {
    if !(step > 0.0 && step.is_finite()) {
        return Err(BuildError::Step { step, why: "it must be above zero".to_owned() });
    }
    let log = libm::log2(step);
    if log.fract() != 0.0 {
        let below = 2f64.powf(log.floor());
        let why = format!("it must be a power of two of a metre; the next smaller one is {below}");
        return Err(BuildError::Step { step, why });
    }
    if (log as i32) < coarsest {
        let why = format!(
            "the model is {extent:e} m wide and a lattice has 2^30 steps; use {} m or more",
            2f64.powi(coarsest)
        );
        return Err(BuildError::Step { step, why });
    }
    Ok(log as i32)
}

/// The identity of a wedge: position and all attributes, bit for bit.
#[derive(PartialEq, Eq, Hash)]
struct WedgeKey {
    position: LatticePoint,
    color: [u8; 3],
    normal: [i16; 2],
    scalars: Vec<u32>,
}

fn snap_and_weld(raw: &RawMesh, lattice: &Lattice, findings: &mut Findings) -> Result<Mesh, BuildError> {
    let outside = || BuildError::TooLarge { why: "a vertex lies outside the lattice".into() };
    let mut mesh = Mesh { scalars: vec![Vec::new(); raw.scalars.len()], ..Mesh::default() };
    let mut index: FxHashMap<WedgeKey, u32> = FxHashMap::default();
    let mut wedge_of = vec![u32::MAX; raw.positions.len()];
    let mut vertex = |v: u32, mesh: &mut Mesh| -> Result<u32, BuildError> {
        let i = v as usize;
        if wedge_of[i] != u32::MAX {
            return Ok(wedge_of[i]);
        }
        let position = lattice.snap(raw.positions[i]).ok_or_else(outside)?;
        let color = raw.colors.get(i).copied().unwrap_or_default();
        let given = raw.normals.get(i).map(|n| n.map(f64::from));
        let normal = given.map_or([0, 0], |n| normal::quantize(normal::encode(n), NORMAL_BITS));
        let scalars: Vec<u32> = raw.scalars.iter().map(|(_, s)| s[i].to_bits()).collect();
        let next = mesh.positions.len() as u32;
        let w = *index.entry(WedgeKey { position, color, normal, scalars }).or_insert(next);
        if w == next {
            mesh.positions.push(position);
            if !raw.colors.is_empty() {
                mesh.colors.push(color);
            }
            if !raw.normals.is_empty() {
                mesh.normals.push(normal);
            }
            for (to, (_, from)) in mesh.scalars.iter_mut().zip(&raw.scalars) {
                to.push(from[i]);
            }
        }
        wedge_of[i] = w;
        Ok(w)
    };
    for (n, t) in raw.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|v| raw.positions[v as usize]);
        let snapped = [a, b, c].map(|p| lattice.snap(p));
        if snapped[0] == snapped[1] || snapped[1] == snapped[2] || snapped[2] == snapped[0] {
            findings.add("triangles dropped because they collapse on the lattice", || format!("triangle {n}"));
            continue;
        }
        let mut corners = [0; 3];
        for k in 0..3 {
            corners[k] = vertex(t[k], &mut mesh)?;
        }
        mesh.triangles.push(corners);
    }
    findings.add_many(
        "vertices that no triangle uses, dropped",
        wedge_of.iter().filter(|w| **w == u32::MAX).count() as u64,
    );
    let welded = wedge_of.iter().filter(|w| **w != u32::MAX).count() - mesh.positions.len();
    findings.add_many("vertices welded because they are equal on the lattice", welded as u64);
    if mesh.triangles.is_empty() {
        let why = format!(
            "all {} triangles collapse on a lattice of {:e} m; give a smaller --step or check --units",
            raw.triangles.len(),
            lattice.step()
        );
        return Err(BuildError::Empty { why });
    }
    Ok(mesh)
}

impl Prepared {
    /// Point identities, border bits and normals.
    fn finish(&mut self) {
        let mesh = &mut self.mesh;
        let mut point_of: FxHashMap<LatticePoint, u32> = FxHashMap::default();
        let points: Vec<u32> = mesh
            .positions
            .iter()
            .map(|p| {
                let next = point_of.len() as u32;
                *point_of.entry(*p).or_insert(next)
            })
            .collect();
        self.points = point_of.len() as u64;
        drop(point_of);
        mesh.borders = vec![0; mesh.triangles.len()];
        let mut edges: Vec<(u32, u32, u32)> = mesh
            .triangles
            .par_iter()
            .enumerate()
            .flat_map_iter(|(t, tri)| {
                let p = tri.map(|v| points[v as usize]);
                [0, 1, 2].map(|k| {
                    let (a, b) = (p[k], p[(k + 1) % 3]);
                    (a.min(b), a.max(b), (t as u32) * 4 + k as u32)
                })
            })
            .collect();
        edges.par_sort_unstable();
        for group in edges.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1) {
            if let [(_, _, slot)] = group {
                mesh.borders[(*slot / 4) as usize] |= 1 << (slot % 4);
                self.border_edges += 1;
            } else if group.len() > 2 {
                self.non_manifold_edges += 1;
            }
        }
        drop(edges);
        if mesh.normals.is_empty() {
            let sums = point_normals(mesh, &points, self.points as usize);
            mesh.normals =
                points.iter().map(|&p| normal::quantize(normal::encode(sums[p as usize]), NORMAL_BITS)).collect();
        }
    }
}

/// Area-weighted normal sums per point. Summed in integers, so that the order of triangles does not matter.
fn point_normals(mesh: &Mesh, points: &[u32], count: usize) -> Vec<[f64; 3]> {
    let mut sums = vec![[0i128; 3]; count];
    for (t, tri) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(t).map(|p| p.map(i64::from));
        let u: [i64; 3] = std::array::from_fn(|i| b[i] - a[i]);
        let v: [i64; 3] = std::array::from_fn(|i| c[i] - a[i]);
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for w in tri {
            let s = &mut sums[points[*w as usize] as usize];
            for i in 0..3 {
                s[i] += i128::from(n[i]);
            }
        }
    }
    sums.into_iter().map(|s| s.map(|x| x as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_files_with_more_channels_than_a_pack_holds_are_refused_by_name() {
        let raw = RawMesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            scalars: (0..20).map(|i| (format!("channel{i}"), vec![0.0; 3])).collect(),
            ..RawMesh::default()
        };
        let error = prepare(raw, &BuildOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("20 scalar channels") && error.contains("channel19"), "{error}");
    }

    #[test]
    fn a_vertex_far_astray_is_refused_instead_of_ruining_the_lattice() {
        let mut raw = RawMesh::default();
        for i in 0..100u32 {
            let x = f64::from(i) * 0.01;
            raw.positions.extend([[x, 0.0, 0.0], [x, 0.01, 0.0], [x + 0.01, 0.0, 0.0]]);
            raw.triangles.push([3 * i, 3 * i + 2, 3 * i + 1]);
        }
        assert!(prepare(raw.clone(), &BuildOptions::default()).is_ok());
        for astray in [1e8, 1e12, 1e300, f64::MAX] {
            raw.positions[0] = [astray, 0.0, 0.0];
            let error = prepare(raw.clone(), &BuildOptions::default()).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains("m wide"), "{astray}: {error}");
        }
    }

    #[test]
    fn the_step_that_a_refusal_names_can_be_built_with() {
        let mut raw = RawMesh::default();
        for i in 0..80u32 {
            for j in 0..80u32 {
                let v = raw.positions.len() as u32;
                let (x, y) = (f64::from(i) * 0.1, f64::from(j) * 0.1);
                raw.positions.extend([[x, y, 0.0], [x + 0.1, y, 0.0], [x, y + 0.1, 0.0]]);
                raw.triangles.push([v, v + 1, v + 2]);
            }
        }
        let given = |step| BuildOptions { step: Some(step), ..BuildOptions::default() };
        let error = prepare(raw.clone(), &given(2f64.powi(-40))).err().map(|e| e.to_string()).unwrap_or_default();
        let named: f64 =
            error.rsplit("use ").next().and_then(|s| s.split(' ').next()).and_then(|s| s.parse().ok()).expect("a step");
        assert!(crate::build_pack(raw, &given(named), &crate::Silent).is_ok(), "{named}");
        assert!(prepare(RawMesh::default(), &given(0.0)).is_err());
    }
}

//! A membrane across a hole: triangles with edges of about one voxel, whose heights, colours and intensities are diffused from the rim (harmonic).
//!
//! The rim is projected along its normal. Where it does not cross itself in this view, the hole is triangulated (constrained Delaunay), together with
//! islands of surface inside it. Every new edge has a new vertex at one end at least, so it cannot coincide with an edge of the surface.

use super::super::rims::RimVertex;
use glam::{DVec2, DVec3};
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};
use std::collections::{BTreeMap, HashSet};

/// The maximum number of new vertices of one membrane; larger holes get larger triangles.
const MOST: f64 = 2e6;
/// New vertices keep this distance from the rim, as a share of the spacing.
const CLEARANCE: f64 = 0.6;

/// A new vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Vertex {
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
    pub(super) color: Option<[u8; 3]>,
    /// NaN where there is none.
    pub(super) intensity: f32,
}

/// How close to each other vertices may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nearest {
    /// The minimum distance, metres.
    pub(super) distance: f64,
    /// Whether that holds for the sides of rims, too.
    pub(super) checks_rims: bool,
}

/// What closes a hole.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Membrane {
    pub(super) vertices: Vec<Vertex>,
    /// Indices into the vertices of the loops, in order, followed by the new ones; counterclockwise seen from where the surface was scanned.
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The unit normal of the side from which a loop runs clockwise: for a hole, that from which the surface was scanned.
pub(super) fn plane(rim: &[RimVertex]) -> Option<DVec3> {
    let origin = rim.first()?.position;
    let sides = rim.iter().zip(rim.iter().cycle().skip(1));
    let area: DVec3 = sides.map(|(a, b)| (a.position - origin).cross(b.position - origin)).sum();
    (-area).try_normalize()
}

/// Whether a place lies inside a rim, as seen along its normal.
pub(super) fn surrounds(rim: &[RimVertex], normal: DVec3, place: DVec3) -> bool {
    let (u, v) = normal.any_orthonormal_pair();
    let flat = |p: DVec3| DVec2::new((p - place).dot(u), (p - place).dot(v));
    let sides = rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| (flat(a.position), flat(b.position)));
    let is_crossed =
        |(a, b): &(DVec2, DVec2)| (a.y > 0.0) != (b.y > 0.0) && a.x - a.y * (b.x - a.x) / (b.y - a.y) > 0.0;
    sides.filter(is_crossed).count() % 2 == 1
}

/// Close the first loop, with the other loops as islands inside it. `None` where the loops cross themselves or
/// each other as seen along the normal of the first, or come too close to each other.
pub(super) fn membrane(loops: &[&[RimVertex]], spacing: f64, nearest: Nearest) -> Option<Membrane> {
    let normal = plane(loops[0])?;
    let frame = Frame::new(loops[0], normal, spacing);
    let rims: Vec<Vec<DVec2>> = loops.iter().map(|rim| rim.iter().map(|v| frame.flat(v.position)).collect()).collect();
    let mut flat: Vec<DVec2> = rims.iter().flatten().copied().collect();
    let fixed = flat.len();
    let area = rims.iter().map(|rim| area(rim)).sum::<f64>().abs();
    let step = (area / MOST).sqrt().max(1.0);
    flat.extend(lattice(&rims, step));
    let mut triangles = triangulate(&rims, &flat)?;
    divide(&mut triangles, &mut flat, fixed, &rims);
    let vertices: Vec<&RimVertex> = loops.iter().flat_map(|rim| rim.iter()).collect();
    let made = frame.lifted(&vertices, &flat, triangles);
    let place = |k: u32| match (k as usize).checked_sub(fixed) {
        Some(k) => made.vertices[k].position,
        None => vertices[k as usize].position,
    };
    // Vertices this close would be one in a file.
    let is_near = |[a, b]: [u32; 2]| {
        let is_rim = (a.max(b) as usize) < fixed;
        (nearest.checks_rims || !is_rim) && place(a).distance(place(b)) < nearest.distance
    };
    let sides = made.triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
    (!sides.into_iter().any(is_near)).then_some(made)
}

/// Twice the signed area.
fn area(rim: &[DVec2]) -> f64 {
    rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| (*a - rim[0]).perp_dot(*b - rim[0])).sum()
}

/// The points of a triangular lattice that lie inside the rims and not close to them.
fn lattice(rims: &[Vec<DVec2>], step: f64) -> Vec<DVec2> {
    let clearance = CLEARANCE * step;
    let cell = |p: DVec2| (p / clearance).floor().as_i64vec2();
    // Points of the rim less than the clearance apart, by cells of that size.
    let mut near: BTreeMap<[i64; 2], Vec<DVec2>> = BTreeMap::new();
    let mut crossings: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    let height = step * 0.75_f64.sqrt();
    for (a, b) in rims.iter().flat_map(|rim| rim.iter().zip(rim.iter().cycle().skip(1))) {
        let parts = (a.distance(*b) / (0.5 * clearance)).ceil().max(1.0) as u32;
        for k in 0..parts {
            let p = a.lerp(*b, f64::from(k) / f64::from(parts));
            near.entry(cell(p).to_array()).or_default().push(p);
        }
        // Rows in [low, high), so that a row through a vertex crosses one of its two sides.
        let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
        for row in (low.y / height).ceil() as i64..(high.y / height).ceil() as i64 {
            let t = (row as f64 * height - low.y) / (high.y - low.y);
            crossings.entry(row).or_default().push(low.x + (high.x - low.x) * t);
        }
    }
    let is_clear = |p: DVec2| {
        let at = cell(p);
        let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| [at.x + x, at.y + y]));
        around.filter_map(|cell| near.get(&cell)).flatten().all(|q| p.distance(*q) >= clearance)
    };
    let mut points = Vec::new();
    for (row, mut at) in crossings {
        at.sort_by(f64::total_cmp);
        let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
        for span in at.as_chunks::<2>().0 {
            for column in (span[0] / step - shift).ceil() as i64..=(span[1] / step - shift).floor() as i64 {
                let p = DVec2::new((column as f64 + shift) * step, row as f64 * height);
                if is_clear(p) {
                    points.push(p);
                }
            }
        }
    }
    points
}

/// The triangles inside the rims, counterclockwise; `points` begins with the vertices of the rims.
fn triangulate(rims: &[Vec<DVec2>], points: &[DVec2]) -> Option<Vec<[u32; 3]>> {
    let mut mesh = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
    let fixed = rims.iter().map(Vec::len).sum();
    let mut handles = Vec::with_capacity(fixed);
    for (k, p) in points[..fixed].iter().enumerate() {
        let handle = mesh.insert(Point2::new(p.x, p.y)).ok()?;
        // Two vertices in one place.
        if handle.index() != k {
            return None;
        }
        handles.push(handle);
    }
    let mut first = 0;
    for rim in rims {
        let own = &handles[first..first + rim.len()];
        for (a, b) in own.iter().zip(own.iter().cycle().skip(1)) {
            if !mesh.can_add_constraint(*a, *b) {
                return None;
            }
            mesh.add_constraint(*a, *b);
            // A side that passes through another vertex is divided there.
            if !mesh.exists_constraint(*a, *b) {
                return None;
            }
        }
        first += rim.len();
    }
    for (k, p) in points.iter().enumerate().skip(fixed) {
        if mesh.insert(Point2::new(p.x, p.y)).ok()?.index() != k {
            return None;
        }
    }
    // From outside, a face is inside when an odd number of constraints was crossed.
    let mut inside: Vec<Option<bool>> = vec![None; mesh.num_all_faces()];
    let mut stack: Vec<_> = Vec::new();
    for edge in mesh.convex_hull() {
        // One of them is the outer face, which is skipped.
        stack.extend([edge.face(), edge.rev().face()].map(|face| (face.fix(), edge.is_constraint_edge())));
    }
    let mut triangles = Vec::new();
    while let Some((face, is_inside)) = stack.pop() {
        let Some(face) = mesh.face(face).as_inner() else { continue };
        let known = &mut inside[face.fix().index()];
        if let Some(known) = *known {
            if known != is_inside {
                return None;
            }
            continue;
        }
        *known = Some(is_inside);
        for edge in face.adjacent_edges() {
            stack.push((edge.rev().face().fix(), is_inside ^ edge.is_constraint_edge()));
        }
        if is_inside {
            triangles.push((face.fix().index(), face.vertices().map(|v| v.fix().index() as u32)));
        }
    }
    triangles.sort_unstable();
    // Every rim must have the triangles on its right; islands outside the rim or inside each other do not.
    let sides: HashSet<[u32; 2]> = triangles.iter().flat_map(|(_, [a, b, c])| [[*a, *b], [*b, *c], [*c, *a]]).collect();
    let mut rest = 0..fixed as u32;
    for rim in rims {
        let own: Vec<u32> = rest.by_ref().take(rim.len()).collect();
        if own.iter().zip(own.iter().cycle().skip(1)).any(|(a, b)| !sides.contains(&[*b, *a])) {
            return None;
        }
    }
    Some(triangles.into_iter().map(|(_, corners)| corners).collect())
}

/// Divide edges that join two vertices of the rims without being part of them, and triangles without a new vertex.
fn divide(triangles: &mut Vec<[u32; 3]>, points: &mut Vec<DVec2>, fixed: usize, rims: &[Vec<DVec2>]) {
    let mut sides = HashSet::new();
    let mut first = 0;
    for rim in rims {
        let count = rim.len() as u32;
        for k in 0..count {
            let (a, b) = (first + k, first + (k + 1) % count);
            sides.insert([a.min(b), a.max(b)]);
        }
        first += count;
    }
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut out = Vec::with_capacity(triangles.len());
    for corners in triangles.drain(..) {
        // The corners and the middles of divided edges, in turn.
        let mut around = Vec::with_capacity(6);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            around.push(a);
            let key = [a.min(b), a.max(b)];
            if (key[1] as usize) < fixed && !sides.contains(&key) {
                let middle = *middles.entry(key).or_insert_with(|| {
                    points.push((points[a as usize] + points[b as usize]) / 2.0);
                    points.len() as u32 - 1
                });
                around.push(middle);
            }
        }
        if around.iter().all(|k| (*k as usize) < fixed) {
            let center = around.iter().map(|k| points[*k as usize]).sum::<DVec2>() / 3.0;
            points.push(center);
            around
                .iter()
                .zip(around.iter().cycle().skip(1))
                .for_each(|(a, b)| out.push([*a, *b, points.len() as u32 - 1]));
            continue;
        }
        // Cut the corners between two middles, then what is left as a fan from a middle.
        while around.len() > 3 {
            let count = around.len();
            let is_new = |k: usize| around[k % count] as usize >= fixed;
            let ear = (0..count).find(|k| !is_new(*k) && is_new(k + 1) && is_new(k + count - 1));
            let Some(ear) = ear.or_else(|| (0..count).find(|k| is_new(k + 1) && !is_new(*k))) else { break };
            out.push([around[(ear + count - 1) % count], around[ear], around[(ear + 1) % count]]);
            around.remove(ear);
        }
        out.push([around[0], around[1], around[2]]);
    }
    *triangles = out;
}

/// A plane with the unit of a voxel.
struct Frame {
    origin: DVec3,
    axes: [DVec3; 3],
    unit: f64,
}

impl Frame {
    fn new(rim: &[RimVertex], normal: DVec3, unit: f64) -> Self {
        let origin = rim.iter().map(|vertex| vertex.position).sum::<DVec3>() / rim.len() as f64;
        let (u, v) = normal.any_orthonormal_pair();
        Self { origin, axes: [u, v, normal], unit }
    }

    fn flat(&self, p: DVec3) -> DVec2 {
        let p = (p - self.origin) / self.unit;
        DVec2::new(p.dot(self.axes[0]), p.dot(self.axes[1]))
    }

    fn height(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.axes[2])
    }

    /// Give the flat triangles the heights and attributes that diffuse from the rims.
    fn lifted(&self, rim: &[&RimVertex], flat: &[DVec2], triangles: Vec<[u32; 3]>) -> Membrane {
        let laplacian = Laplacian::new(flat, &triangles, rim.len());
        let heights = laplacian.diffused(&rim.iter().map(|v| self.height(v.position)).collect::<Vec<_>>());
        let places: Vec<DVec3> = flat
            .iter()
            .zip(&heights)
            .map(|(p, h)| self.origin + (self.axes[0] * p.x + self.axes[1] * p.y) * self.unit + self.axes[2] * *h)
            .collect();
        let mut normals = vec![DVec3::ZERO; flat.len()];
        for [a, b, c] in &triangles {
            let [p, q, r] = [a, b, c].map(|k| places[*k as usize]);
            let across = (q - p).cross(r - p);
            for k in [a, b, c] {
                normals[*k as usize] += across;
            }
        }
        let known = |of: &dyn Fn(&RimVertex) -> Option<f64>| -> Option<Vec<f64>> {
            let values: Vec<Option<f64>> = rim.iter().map(|v| of(v)).collect();
            let count = values.iter().flatten().count();
            // Where a vertex of the rim has none, the mean of the others.
            let mean = values.iter().flatten().sum::<f64>() / count as f64;
            (count > 0).then(|| laplacian.diffused(&values.iter().map(|v| v.unwrap_or(mean)).collect::<Vec<_>>()))
        };
        let channels: Vec<Option<Vec<f64>>> =
            (0..3).map(|k| known(&|v| v.color.map(|color| f64::from(color[k])))).collect();
        let intensity = known(&|v| v.intensity.is_finite().then_some(f64::from(v.intensity)));
        let channel = |c: usize, k: usize| channels[c].as_ref().map(|values| values[k].round() as u8);
        let vertices = (rim.len()..flat.len())
            .map(|k| Vertex {
                position: places[k],
                normal: normals[k].normalize_or(self.axes[2]),
                color: channel(0, k).zip(channel(1, k)).zip(channel(2, k)).map(|((r, g), b)| [r, g, b]),
                intensity: intensity.as_ref().map_or(f32::NAN, |values| values[k] as f32),
            })
            .collect();
        Membrane { vertices, triangles }
    }
}

/// The Laplacian of a flat triangulation with cotangent weights (Pinkall and Polthier, 1993), for values that are known at the first vertices.
struct Laplacian {
    fixed: usize,
    /// For each vertex that is not fixed, its neighbours and their weights.
    rows: Vec<Vec<(u32, f64)>>,
    diagonal: Vec<f64>,
}

impl Laplacian {
    fn new(flat: &[DVec2], triangles: &[[u32; 3]], fixed: usize) -> Self {
        let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); flat.len() - fixed];
        let mut add = |a: u32, b: u32, weight: f64| {
            let Some(row) = (a as usize).checked_sub(fixed).and_then(|k| rows.get_mut(k)) else { return };
            match row.iter_mut().find(|(k, _)| *k == b) {
                Some((_, sum)) => *sum += weight,
                None => row.push((b, weight)),
            }
        };
        for corners in triangles {
            for k in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|j| corners[(k + j) % 3]);
                let [p, q, r] = [a, b, c].map(|k| flat[k as usize]);
                // The cotangent of the angle at c, opposite of a and b. Very flat triangles must not outweigh all others.
                let (e, f) = (p - r, q - r);
                let cotangent = (e.dot(f) / e.perp_dot(f).abs().max(1e-9)).clamp(-10.0, 10.0) / 2.0;
                add(a, b, cotangent);
                add(b, a, cotangent);
            }
        }
        // Weights must be positive, so that no value exceeds those of the rim.
        rows.iter_mut().flatten().for_each(|(_, weight)| *weight = weight.max(1e-3));
        let diagonal = rows.iter().map(|row| row.iter().map(|(_, weight)| weight).sum()).collect();
        Self { fixed, rows, diagonal }
    }

    /// The values at all vertices, given those at the fixed ones, by the method of conjugate gradients with the diagonal as preconditioner.
    fn diffused(&self, known: &[f64]) -> Vec<f64> {
        let count = self.rows.len();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        // Relative to the mean, so that the first guess is zero.
        let at = |k: u32| known.get(k as usize).map(|value| value - mean);
        let right: Vec<f64> =
            self.rows.iter().map(|row| row.iter().filter_map(|(k, w)| Some(w * at(*k)?)).sum()).collect();
        let times = |x: &[f64]| -> Vec<f64> {
            let inner = |row: &Vec<(u32, f64)>| -> f64 {
                row.iter().filter_map(|(k, w)| Some(w * x[(*k as usize).checked_sub(self.fixed)?])).sum()
            };
            self.rows.iter().zip(&self.diagonal).zip(x).map(|((row, d), x)| d * x - inner(row)).collect()
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scaled = |r: &[f64]| -> Vec<f64> { r.iter().zip(&self.diagonal).map(|(r, d)| r / d).collect() };
        let mut x = vec![0.0; count];
        let mut rest = right;
        let mut along = scaled(&rest);
        let mut length = dot(&rest, &along);
        let enough = length * 1e-14;
        for _ in 0..40 * (count as f64).sqrt() as usize + 100 {
            if length <= enough {
                break;
            }
            let image = times(&along);
            let step = length / dot(&along, &image);
            for k in 0..count {
                x[k] += step * along[k];
                rest[k] -= step * image[k];
            }
            let next = scaled(&rest);
            let longer = dot(&rest, &next);
            let turn = longer / length;
            length = longer;
            along.iter_mut().zip(next).for_each(|(along, next)| *along = next + turn * *along);
        }
        let range = known.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
        known.iter().copied().chain(x.into_iter().map(|x| (x + mean).clamp(range[0], range[1]))).collect()
    }
}

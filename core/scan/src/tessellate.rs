//! Triangles between neighbouring cells of a grid of samples.
//!
//! A cell of four samples gives two triangles, cut along its shorter diagonal; one of three gives one. An edge is kept where it is no
//! longer than the surface seen there explains: `edge_factor · spacing / cos θ`, and at most `max_edge`, if that is given. The spacing is the distance between
//! both rays at the nearer sample (range times angular step), θ the incidence there. A triangle seen at more than `grazing` is dropped, because
//! it is more likely a bridge between two surfaces than a surface.
//!
//! Each vertex has a confidence, `cos θ / (σ² + d²)` in 1/m², with the range noise σ and the diameter d of the beam at that range.
//!
//! The functions look at two or three columns at a time, so a scan of any size can be meshed in memory for a few columns.

use crate::sample::{Rays, Sample};
use glam::DVec3;

/// What an instrument measures with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instrument {
    /// Standard deviation of a range: constant part in metres, and part that grows with range in metres per metre.
    pub range_noise: [f64; 2],
    /// Diameter of the beam: at the instrument in metres, and growth in metres per metre (radians).
    pub beam: [f64; 2],
}

impl Default for Instrument {
    /// A common terrestrial scanner: 2 mm + 10 ppm, beam of 4 mm + 0.3 mrad.
    fn default() -> Self {
        Self { range_noise: [0.002, 1e-5], beam: [0.004, 3e-4] }
    }
}

impl Instrument {
    /// Variance of the position of a sample along and across the ray at a range, m².
    pub fn variance(&self, range: f64) -> f64 {
        let (sigma, beam) = (self.range_noise[0] + self.range_noise[1] * range, self.beam[0] + self.beam[1] * range);
        sigma * sigma + beam * beam
    }
}

/// Which edges and triangles are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How many times the expected spacing an edge may be long.
    pub edge_factor: f64,
    /// Longest edge, metres; infinite for no limit. A limit first drops what is far away and seen at an oblique angle: with 5 cm and rays 4 mrad apart, a station in
    /// the fort of the simulator kept a third of the surface that it saw.
    pub max_edge: f64,
    /// Largest incidence, radians from the normal of the surface. Noise tilts triangles, so this is 2° more than the incidence up to which surfaces are to be
    /// kept.
    pub grazing: f64,
    /// For the confidence.
    pub instrument: Instrument,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            edge_factor: 3.0,
            max_edge: f64::INFINITY,
            grazing: 87f64.to_radians(),
            instrument: Instrument::default(),
        }
    }
}

/// What is known of the surface at a measured sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Unit normal of the surface, towards the scanner; against the ray where the neighbours do not tell.
    pub normal: DVec3,
    /// Cosine of the incidence; `None` where the neighbours do not tell.
    pub cos_incidence: Option<f64>,
    /// `cos θ / (σ² + d²)`, 1/m².
    pub confidence: f32,
}

/// A corner of a triangle between two columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Corner {
    /// In the right column instead of the left.
    pub is_right: bool,
    /// Its row.
    pub row: usize,
}

/// The surface at every sample of a column, `None` where nothing was measured; `left` and `right` are its neighbours where it has some.
///
/// The normal comes from the nearer neighbour in each direction of the grid, so that at the border of a surface it is that of the surface and not
/// that of the jump behind it.
pub fn vertices(
    left: Option<&[Sample]>,
    here: &[Sample],
    right: Option<&[Sample]>,
    rays: Rays,
    options: &Options,
    out: &mut Vec<Option<Vertex>>,
) {
    out.clear();
    let measured = |column: Option<&[Sample]>, row: Option<usize>| {
        let sample = column?.get(row?)?;
        sample.is_measured().then(|| sample.position.as_dvec3())
    };
    for (row, sample) in here.iter().enumerate() {
        if !sample.is_measured() {
            out.push(None);
            continue;
        }
        let p = sample.position.as_dvec3();
        let direction = rays.direction(sample.position);
        let along = nearer(p, measured(Some(here), row.checked_sub(1)), measured(Some(here), Some(row + 1)));
        let across = nearer(p, measured(left, Some(row)), measured(right, Some(row)));
        let normal = match (along, across) {
            (Some(u), Some(v)) => u.cross(v).try_normalize(),
            _ => None,
        };
        let normal = normal.map(|n| if n.dot(direction) > 0.0 { -n } else { n });
        let cos_incidence = normal.map(|n| -n.dot(direction));
        let range = if rays == Rays::Central { p.length() } else { 0.0 };
        let cos = cos_incidence.unwrap_or_else(|| libm::cos(options.grazing));
        out.push(Some(Vertex {
            normal: normal.unwrap_or(-direction),
            cos_incidence,
            confidence: (cos / options.instrument.variance(range)) as f32,
        }));
    }
}

/// The step from `p` to the nearer of two neighbours, in the order of the grid.
fn nearer(p: DVec3, before: Option<DVec3>, after: Option<DVec3>) -> Option<DVec3> {
    match (before.map(|q| p - q), after.map(|q| q - p)) {
        (Some(a), Some(b)) => Some(if a.length_squared() <= b.length_squared() { a } else { b }),
        (a, b) => a.or(b),
    }
}

/// One column and its surface.
#[derive(Debug, Clone, Copy)]
pub struct Side<'a> {
    /// Its samples.
    pub samples: &'a [Sample],
    /// What [`vertices`] found of them.
    pub vertices: &'a [Option<Vertex>],
}

/// How many triangles were not made, and why.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dropped {
    /// An edge is too long.
    pub long: u64,
    /// The incidence is beyond the limit.
    pub grazing: u64,
    /// Corners coincide.
    pub degenerate: u64,
}

/// The triangles between two neighbouring columns of equally many rows, corners counterclockwise seen from the scanner.
pub fn triangles(
    left: Side<'_>,
    right: Side<'_>,
    rays: Rays,
    options: &Options,
    dropped: &mut Dropped,
    emit: &mut dyn FnMut([Corner; 3]),
) {
    let rows = left.samples.len().min(right.samples.len());
    let strip = Strip { left, right, rays, options, min_cos: libm::cos(options.grazing).max(1e-3) };
    for row in 1..rows {
        // Round the cell: lower left, upper left, upper right, lower right.
        let corners = [
            Corner { is_right: false, row: row - 1 },
            Corner { is_right: false, row },
            Corner { is_right: true, row },
            Corner { is_right: true, row: row - 1 },
        ];
        let is_there = corners.map(|c| strip.vertex(c).is_some());
        let made: [Option<[usize; 3]>; 2] = match is_there {
            [true, true, true, true] => {
                if strip.length_squared(corners[0], corners[2]) <= strip.length_squared(corners[1], corners[3]) {
                    [Some([0, 1, 2]), Some([0, 2, 3])]
                } else {
                    [Some([0, 1, 3]), Some([1, 2, 3])]
                }
            }
            [true, true, true, false] => [Some([0, 1, 2]), None],
            [true, true, false, true] => [Some([0, 1, 3]), None],
            [true, false, true, true] => [Some([0, 2, 3]), None],
            [false, true, true, true] => [Some([1, 2, 3]), None],
            _ => [None, None],
        };
        for triangle in made.into_iter().flatten() {
            if let Some(facing) = strip.checked(triangle.map(|k| corners[k]), dropped) {
                emit(facing);
            }
        }
    }
}

struct Strip<'a> {
    left: Side<'a>,
    right: Side<'a>,
    rays: Rays,
    options: &'a Options,
    min_cos: f64,
}

impl Strip<'_> {
    fn side(&self, corner: Corner) -> &Side<'_> {
        if corner.is_right { &self.right } else { &self.left }
    }

    fn vertex(&self, corner: Corner) -> Option<Vertex> {
        self.side(corner).vertices.get(corner.row).copied().flatten()
    }

    fn position(&self, corner: Corner) -> glam::Vec3 {
        self.side(corner).samples[corner.row].position
    }

    fn length_squared(&self, a: Corner, b: Corner) -> f32 {
        self.position(a).distance_squared(self.position(b))
    }

    /// The longest that an edge between two corners may be.
    fn limit(&self, a: Corner, b: Corner) -> f64 {
        let cos = |c: Corner| self.vertex(c).and_then(|v| v.cos_incidence);
        // The steeper view of both: at a jump one of them may look along the jump.
        let cos = cos(a).into_iter().chain(cos(b)).fold(0.0, f64::max);
        let cos = if cos > 0.0 { cos.max(self.min_cos) } else { 1.0 };
        let spacing = self.rays.spacing(self.position(a), self.position(b));
        (self.options.edge_factor * spacing / cos).min(self.options.max_edge)
    }

    /// The triangle, turned towards the scanner, if it is kept.
    fn checked(&self, corners: [Corner; 3], dropped: &mut Dropped) -> Option<[Corner; 3]> {
        let [a, b, c] = corners;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let limit = self.limit(p, q);
            if f64::from(self.length_squared(p, q)) > limit * limit {
                dropped.long += 1;
                return None;
            }
        }
        let [pa, pb, pc] = corners.map(|corner| self.position(corner).as_dvec3());
        let Some(normal) = (pb - pa).cross(pc - pa).try_normalize() else {
            dropped.degenerate += 1;
            return None;
        };
        let toward = normal.dot(self.rays.direction(((pa + pb + pc) / 3.0).as_vec3()));
        if toward.abs() < self.min_cos {
            dropped.grazing += 1;
            return None;
        }
        Some(if toward > 0.0 { [a, c, b] } else { corners })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Angular step of the simulated scanner, radians.
    const STEP: f64 = 0.002;

    fn direction(column: usize, row: usize) -> DVec3 {
        let (azimuth, elevation) = (column as f64 * STEP, (row as f64 - 20.0) * STEP);
        DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
    }

    /// A scan of 40 × 40 whose ranges are given by column and row.
    fn scan(range: impl Fn(usize, usize) -> Option<f64>) -> Vec<Vec<Sample>> {
        let sample = |c, r| range(c, r).map_or(Sample::EMPTY, |t| Sample::measured((direction(c, r) * t).as_vec3()));
        (0..40).map(|c| (0..40).map(|r| sample(c, r)).collect()).collect()
    }

    type Mesh = (Vec<[Vec3; 3]>, Dropped, Vec<Vec<Option<Vertex>>>);

    fn mesh(scan: &[Vec<Sample>], options: &Options) -> Mesh {
        let columns: Vec<Vec<Option<Vertex>>> = (0..scan.len())
            .map(|c| {
                let mut out = Vec::new();
                let at = |k: Option<usize>| k.and_then(|k| scan.get(k)).map(Vec::as_slice);
                vertices(at(c.checked_sub(1)), &scan[c], at(Some(c + 1)), Rays::Central, options, &mut out);
                out
            })
            .collect();
        let (mut all, mut dropped) = (Vec::new(), Dropped::default());
        for c in 1..scan.len() {
            let side = |k: usize| Side { samples: &scan[k], vertices: &columns[k] };
            triangles(side(c - 1), side(c), Rays::Central, options, &mut dropped, &mut |corners| {
                all.push(corners.map(|corner| scan[if corner.is_right { c } else { c - 1 }][corner.row].position));
            });
        }
        (all, dropped, columns)
    }

    /// A wall x = 10 · cos(turn) …: the plane with this normal at distance 10 along the x axis.
    fn plane(normal: DVec3) -> impl Fn(usize, usize) -> Option<f64> {
        move |c, r| Some(10.0 * normal.x / normal.dot(direction(c, r))).filter(|t| *t > 0.0)
    }

    #[test]
    fn a_plane_is_meshed_whole_also_when_seen_aslant_and_faces_the_scanner() {
        for angle in [0.0, 40f64, 70.0, 80.0] {
            let normal = DVec3::new(angle.to_radians().cos(), -angle.to_radians().sin(), 0.0);
            let (triangles, dropped, columns) = mesh(&scan(plane(normal)), &Options::default());
            assert_eq!((triangles.len(), dropped), (39 * 39 * 2, Dropped::default()), "{angle}°");
            for [a, b, c] in triangles {
                assert!((b - a).cross(c - a).dot(a) < 0.0);
            }
            for vertex in columns.iter().flatten().flatten() {
                assert!(vertex.normal.dot(-normal) > 0.9999, "{:?}", vertex.normal);
            }
        }
    }

    #[test]
    fn a_jump_in_depth_is_not_bridged() {
        // Two walls that face the scanner, 8 cm apart, at 10 m where rays are 2 cm apart.
        let step = scan(|c, _| Some(if c < 20 { 10.0 } else { 10.08 }));
        let (triangles, dropped, _) = mesh(&step, &Options::default());
        assert_eq!(triangles.len(), 38 * 39 * 2);
        assert_eq!(dropped.long, 39 * 2);
        let bridged = |t: &[Vec3; 3]| t.iter().any(|p| p.length() > 10.04) && t.iter().any(|p| p.length() < 10.04);
        assert!(!triangles.iter().any(bridged));
    }

    #[test]
    fn limits_of_edges_and_incidence_are_kept() {
        let options = Options { max_edge: 0.0225, ..Options::default() };
        let (triangles, dropped, _) = mesh(&scan(|_, _| Some(10.0)), &options);
        assert!(triangles.is_empty() && dropped.long == 39 * 39 * 2, "diagonals are longer than 2.8 cm");
        let aslant = scan(plane(DVec3::new(75f64.to_radians().cos(), -75f64.to_radians().sin(), 0.0)));
        let options = Options { max_edge: 1.0, grazing: 70f64.to_radians(), ..Options::default() };
        let (triangles, dropped, _) = mesh(&aslant, &options);
        assert!(triangles.is_empty() && dropped.grazing + dropped.long == 39 * 39 * 2, "{dropped:?}");
    }

    #[test]
    fn a_missing_sample_leaves_one_triangle_in_each_cell_around_it() {
        let (triangles, ..) = mesh(&scan(|c, r| Some(10.0).filter(|_| (c, r) != (10, 10))), &Options::default());
        assert_eq!(triangles.len(), 39 * 39 * 2 - 4);
        let lines = scan(|c, _| Some(10.0).filter(|_| c % 2 == 0));
        assert!(mesh(&lines, &Options::default()).0.is_empty());
    }

    #[test]
    fn confidence_falls_with_incidence_and_range() {
        let at = |scan: &[Vec<Sample>]| mesh(scan, &Options::default()).2[20][20].unwrap().confidence;
        let aslant = at(&scan(plane(DVec3::new(0.5, -(0.75f64.sqrt()), 0.0))));
        let (near, far) = (at(&scan(|_, _| Some(10.0))), at(&scan(|_, _| Some(100.0))));
        assert!(far < near / 5.0 && aslant < near * 0.6, "{near} {far} {aslant}");
        let variance = Instrument::default().variance(10.0);
        assert!((f64::from(near) * variance - 1.0).abs() < 1e-3);
    }
}

//! The surface that a station saw in each direction, at the resolution of its samples.
//!
//! Poses are adjusted by the distances of single samples from the surface of another station in the same direction. Planes through the samples of a
//! voxel are not suitable for this: a scanner sees only the tops of rough ground far away, so the mean of what it sees there is too high, and the error grows
//! with the distance. A single sample always lies on the surface.

use crate::mask::through::Seen;
use glam::{DVec3, Vec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rustc_hash::FxHashSet;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Fewest samples that define a surface.
const MIN_SAMPLES: usize = 6;
/// Neighbours are at most this many pixels apart along the surface.
const NEAR: f64 = 6.0;
/// Largest root mean square distance of samples from their plane, as a share of their spread along it.
const FLAT: f64 = 0.35;
/// Minimum cosine of the angle of incidence.
const MIN_FACING: f64 = 0.1;

/// A local plane of the surface, and how it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Unit normal towards the scanner.
    pub normal: DVec3,
    /// The offset of the plane: the dot product of its points with the normal, metres.
    pub offset: f64,
    /// Cosine of the incidence.
    pub facing: f64,
    /// The spacing of the samples along the surface, metres.
    pub spacing: f64,
}

/// A sample on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Position, metres.
    pub position: DVec3,
    /// The surface.
    pub surface: Surface,
}

/// How directions are divided into pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pixels {
    /// Equal steps of azimuth and elevation around a station, radians.
    Around { width: usize, height: usize, step: f64 },
    /// Equal steps across parallel rays, metres.
    Across { width: usize, height: usize, step: f64, axes: [DVec3; 3], low: DVec3 },
}

/// Maximum number of pixels of an image of parallel rays.
const MAX_PIXELS: f64 = 4e6;

impl Pixels {
    fn around(step: f64) -> Self {
        let width = (TAU / step).ceil().max(16.0) as usize;
        Self::Around { width, height: width.div_ceil(2), step: TAU / width as f64 }
    }

    /// `bounds`: a box that holds all samples.
    fn across(step: f64, direction: DVec3, bounds: [DVec3; 2]) -> Self {
        let (u, v) = direction.any_orthonormal_pair();
        let axes = [u, v, direction];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for k in 0..8 {
            let pick = |axis: usize| bounds[k >> axis & 1][axis];
            let p = DVec3::new(pick(0), pick(1), pick(2));
            let p = DVec3::from_array(axes.map(|axis| axis.dot(p)));
            (low, high) = (low.min(p), high.max(p));
        }
        let size = (high - low).max(DVec3::ZERO);
        // A narrow strip has a pixel more on either side, too.
        let step = step.max((size.x * size.y / MAX_PIXELS).sqrt()).max(9.0 * size.x.max(size.y) / MAX_PIXELS);
        let count = |length: f64| (length / step) as usize + 3;
        // A pixel more on every side.
        Self::Across { width: count(size.x), height: count(size.y), step, axes, low: low - DVec3::splat(step) }
    }

    fn size(self) -> [usize; 2] {
        match self {
            Self::Around { width, height, .. } | Self::Across { width, height, .. } => [width, height],
        }
    }

    /// The pixel of a direction, and the squared distance from the centre of the pixel.
    fn of(self, p: DVec3) -> Option<(usize, f64)> {
        let [width, height] = self.size();
        let (x, y) = match self {
            Self::Around { step, .. } => {
                let range = p.length();
                if range <= 0.0 {
                    return None;
                }
                let x = (libm::atan2(p.y, p.x) + PI) / step;
                (x, (libm::asin((p.z / range).clamp(-1.0, 1.0)) + FRAC_PI_2) / step)
            }
            Self::Across { step, axes, low, .. } => {
                let (x, y) = ((axes[0].dot(p) - low.x) / step, (axes[1].dot(p) - low.y) / step);
                if !(x >= 0.0 && x < width as f64 && y >= 0.0 && y < height as f64) {
                    return None;
                }
                (x, y)
            }
        };
        let (column, row) = ((x as usize).min(width - 1), (y as usize).min(height - 1));
        let (dx, dy) = (x - column as f64 - 0.5, y - row as f64 - 0.5);
        Some((row * width + column, dx * dx + dy * dy))
    }

    /// The direction of the ray to a position.
    fn ray(self, place: DVec3) -> DVec3 {
        match self {
            Self::Around { .. } => place.normalize_or_zero(),
            Self::Across { axes, .. } => axes[2],
        }
    }

    /// The spacing of the rays at a position, metres.
    fn spacing(self, place: DVec3) -> f64 {
        match self {
            Self::Around { step, .. } => step * place.length(),
            Self::Across { step, .. } => step,
        }
    }
}

/// Collects samples.
#[derive(Debug, Clone)]
pub struct Collector {
    pixels: Pixels,
    /// The sample nearest to the centre of each pixel; NaN where there is none.
    samples: Vec<Vec3>,
}

impl Collector {
    /// For a scanner whose rays start at the origin, in pixels of `step` radians.
    pub fn around(step: f64) -> Self {
        Self::with(Pixels::around(step))
    }

    /// For parallel rays along a unit vector, in pixels of `step` metres; `bounds`: a box that holds all samples.
    pub fn across(step: f64, direction: DVec3, bounds: [DVec3; 2]) -> Self {
        Self::with(Pixels::across(step, direction, bounds))
    }

    fn with(pixels: Pixels) -> Self {
        let [width, height] = pixels.size();
        Self { pixels, samples: vec![Vec3::NAN; width * height] }
    }

    /// Add a sample, in coordinates of the station.
    pub fn add(&mut self, sample: Vec3) {
        let Some((at, off)) = self.pixels.of(sample.as_dvec3()) else { return };
        let before = self.pixels.of(self.samples[at].as_dvec3());
        if self.samples[at].is_nan() || before.is_none_or(|(_, before)| off < before) {
            self.samples[at] = sample;
        }
    }

    /// The surface, and samples on it: one per cube of `edge` metres, the first in pixel order.
    pub fn finish(self, edge: f64) -> (Image, Vec<Point>) {
        let mut planes = vec![[f32::NAN; 4]; self.samples.len()];
        let (mut taken, mut points) = (FxHashSet::default(), Vec::new());
        for (at, sample) in self.samples.iter().enumerate() {
            let Some((normal, offset)) = self.plane(at) else { continue };
            planes[at] = [normal.x as f32, normal.y as f32, normal.z as f32, offset as f32];
            let position = sample.as_dvec3();
            let Some(surface) = surface(self.pixels, normal, offset, position) else { continue };
            if taken.insert((position / edge).floor().as_ivec3()) {
                points.push(Point { position, surface });
            }
        }
        (Image { pixels: self.pixels, planes }, points)
    }

    /// The plane through the samples around a pixel.
    fn plane(&self, at: usize) -> Option<(DVec3, f64)> {
        let [width, height] = self.pixels.size();
        let is_round = matches!(self.pixels, Pixels::Around { .. });
        let (column, row) = (at % width, at / width);
        let own = self.samples[at].as_dvec3();
        let is_rim = row == 0 || row + 1 == height || !is_round && (column == 0 || column + 1 == width);
        if own.is_nan() || is_rim {
            return None;
        }
        let near = NEAR * self.pixels.spacing(own);
        let (mut n, mut sum, mut around) = (0, DVec3::ZERO, [DVec3::ZERO; 9]);
        for k in 0..9 {
            let column = (column + width + k % 3 - 1) % width;
            let p = self.samples[(row + k / 3 - 1) * width + column].as_dvec3();
            if !p.is_nan() && p.distance_squared(own) <= near * near {
                around[n] = p;
                sum += p;
                n += 1;
            }
        }
        if n < MIN_SAMPLES {
            return None;
        }
        let mean = sum / n as f64;
        let mut spread = Matrix3::zeros();
        for p in &around[..n] {
            let d = Vector3::from(p.to_array()) - Vector3::from(mean.to_array());
            spread += d * d.transpose();
        }
        let eigen = SymmetricEigen::new(spread / n as f64);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let [least, middle, _] = order.map(|k| eigen.eigenvalues[k].max(0.0));
        if least > FLAT * FLAT * middle {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]);
        let normal = DVec3::new(normal[0], normal[1], normal[2]).normalize_or_zero();
        let normal = if normal.dot(self.pixels.ray(own)) > 0.0 { -normal } else { normal };
        Some((normal, normal.dot(mean)))
    }
}

/// The surface where the ray to a position meets a plane; `None` at grazing incidence.
fn surface(pixels: Pixels, normal: DVec3, offset: f64, place: DVec3) -> Option<Surface> {
    let ray = pixels.ray(place);
    let facing = -normal.dot(ray);
    if facing < MIN_FACING {
        return None;
    }
    // The intersection of the ray with the plane.
    let met = place + ray * ((normal.dot(place) - offset) / facing);
    Some(Surface { normal, offset, facing, spacing: pixels.spacing(met) / facing.sqrt() })
}

/// The surface that a station saw in every direction.
#[derive(Debug, Clone)]
pub struct Image {
    pixels: Pixels,
    /// Normal and offset; NaN where there is no surface.
    planes: Vec<[f32; 4]>,
}

impl Image {
    /// The surface in the direction of a position, in coordinates of the station.
    pub fn surface(&self, place: DVec3) -> Option<Surface> {
        let (at, _) = self.pixels.of(place)?;
        let [x, y, z, offset] = self.planes[at].map(f64::from);
        if offset.is_nan() { None } else { surface(self.pixels, DVec3::new(x, y, z), offset, place) }
    }

    /// What the station saw along the ray through a position (in its coordinates). The ray counts as passing through if it went at least `margin` metres farther. For scans with parallel rays; others
    /// have a range image ([`crate::mask::through::RangeImage`]), which also knows where nothing came back.
    pub fn look(&self, place: DVec3, margin: f64) -> Seen {
        let Some((at, _)) = self.pixels.of(place) else { return Seen::Outside };
        let [width, height] = self.pixels.size().map(|n| n as i64);
        let (column, row) = (at as i64 % width, at as i64 / width);
        let ray = self.pixels.ray(place);
        // How much farther than the position the surface is.
        let beyond = |column: i64, row: i64| -> Option<f64> {
            let is_inside = (0..width).contains(&column) && (0..height).contains(&row);
            let [x, y, z, offset] = is_inside.then(|| self.planes[(row * width + column) as usize].map(f64::from))?;
            let normal = DVec3::new(x, y, z);
            let facing = normal.dot(ray);
            (!offset.is_nan() && facing.abs() >= MIN_FACING).then(|| (offset - normal.dot(place)) / facing)
        };
        let around = (-1..=1).flat_map(|r| (-1..=1).map(move |c| (c, r)));
        let nearest = around.filter_map(|(c, r)| beyond(column + c, row + r)).min_by(f64::total_cmp);
        match (beyond(column, row).or(nearest), nearest) {
            (Some(own), _) if own < -margin => Seen::Hidden,
            (Some(own), _) if own <= margin => Seen::At,
            // Next to a nearer surface, which the ray just missed.
            (Some(_), Some(nearest)) if nearest <= margin => Seen::Hidden,
            (Some(_), _) => Seen::Through,
            (None, _) => Seen::NoReturn,
        }
    }
}

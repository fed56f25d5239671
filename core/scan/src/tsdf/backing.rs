//! What the surface may rest on where no scan covers it: another mesh, and the scans themselves at coarser voxels, whose pieces reach farther.

use super::extract::COVERAGE;
use super::field::{DISTANCE_LOG2, FULL, Field, Region, Voxel};
use super::{MARGIN, Piece, REACH};
use glam::{DVec3, IVec3};

/// The share of a sum of normals that must remain of the sum of their lengths. Where it is less, the two sides of a thin wall are mixed.
const COHERENT: f64 = 0.6;

/// Fields that back the field of a region.
pub struct Backing {
    region: Region,
    /// Whether the coarser voxels fill, too, or only indicate where the surface was measured.
    fills_coarser: bool,
    /// The mesh, at the voxels of the region; level 0.
    mesh: Option<Field>,
    /// Fields of voxels 2, 4, 8 … times as large; levels 1, 2, 3 …
    coarser: Vec<Field>,
}

/// The backing at a place.
pub(super) struct Sample {
    pub(super) level: u8,
    /// The mean of the sums of the voxels around.
    pub(super) sums: Sums,
}

/// Interpolated sums.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    coverage: f64,
    pub(super) normal: DVec3,
    pub(super) color: DVec3,
    pub(super) color_weight: f64,
    pub(super) intensity: f64,
    pub(super) intensity_weight: f64,
}

impl Sums {
    fn add(&mut self, voxel: &Voxel, share: f64) {
        self.coverage += voxel.coverage as f64 * share;
        self.normal += DVec3::from_array(voxel.normal.map(|n| n as f64)) * share;
        self.color += DVec3::from_array(voxel.color.map(|c| c as f64)) * share;
        self.color_weight += voxel.color_weight as f64 * share;
        self.intensity += voxel.intensity as f64 * share;
        self.intensity_weight += voxel.intensity_weight as f64 * share;
    }
}

impl Backing {
    /// Empty fields: for a mesh, if there is one, and for `levels` coarser levels, which fill gaps if `fills_coarser`.
    pub fn new(region: Region, has_mesh: bool, levels: u32, fills_coarser: bool) -> Self {
        let coarser = |level: u32| {
            let min = region.min >> level;
            let last = (region.min + (region.bricks - 1)) >> level;
            Field::new(Region { min, bricks: (last - min).max_element() + 1 })
        };
        Self {
            region,
            fills_coarser,
            mesh: has_mesh.then(|| Field::new(region)),
            coarser: (1..=levels).map(coarser).collect(),
        }
    }

    /// Add a piece of a station, as [`Field::add`].
    pub fn add(&mut self, station: u16, piece: &Piece) {
        for (field, level) in self.coarser.iter_mut().zip(1..) {
            if self.region.needs(piece, MARGIN << level) {
                field.add(station, &Piece { at: piece.at >> level, ..*piece }, None);
            }
        }
    }

    /// Add a piece of the mesh.
    pub fn add_mesh(&mut self, piece: &Piece) {
        if let Some(field) = &mut self.mesh {
            field.add(1, piece, None);
        }
    }

    /// The first level that is sure to fill: coarser voxels, or the mesh if these do not.
    pub(super) fn first_level(&self) -> u8 {
        u8::from(self.fills_coarser)
    }

    /// Bricks that have sums.
    pub fn bricks(&self) -> usize {
        self.fields().map(|(_, field)| field.bricks()).sum()
    }

    fn fields(&self) -> impl Iterator<Item = (u8, &Field)> {
        let mesh = self.mesh.as_ref().map(|field| (0, field));
        mesh.into_iter().chain((1..).zip(&self.coarser))
    }

    /// Whether there can be something in a brick.
    pub(super) fn reaches(&self, brick: IVec3) -> bool {
        let around = |at: IVec3| (0..27).map(move |k| at + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
        self.fields().any(|(level, field)| around(brick >> i32::from(level)).any(|at| field.brick(at).is_some()))
    }

    /// The finest level that has a surface at a place, in voxels of the region.
    pub(super) fn sample(&self, place: DVec3) -> Option<Sample> {
        self.filling().find_map(|(level, field)| {
            let size = f64::from(1 << level);
            let sums = interpolated(field, place / size)?;
            let is_hidden = level == 0 && self.is_measured(place, sums.normal);
            let is_covered = sums.coverage >= COVERAGE * FULL * size * size;
            (is_covered && !is_hidden).then_some(Sample { level, sums })
        })
    }

    /// The fields that fill.
    fn filling(&self) -> impl Iterator<Item = (u8, &Field)> {
        self.fields().filter(|(level, _)| *level == 0 || self.fills_coarser)
    }

    /// The distances that the fields know around the voxels from `first` to `first + side`, inclusive.
    pub(super) fn blocks(&self, first: IVec3, side: i32) -> Vec<Block> {
        let block = |(level, field): (u8, &Field)| {
            let low = first >> i32::from(level);
            let count = ((first + side) >> i32::from(level)) - low + 2;
            let places = (0..count.z).flat_map(|z| (0..count.y).map(move |y| (y, z)));
            let places = places.flat_map(|(y, z)| (0..count.x).map(move |x| low + IVec3::new(x, y, z)));
            let distance = |at: IVec3| {
                let voxel = field.voxel(at).filter(|voxel| is_usable(voxel))?;
                let normal = DVec3::from_array(voxel.normal.map(|n| n as f64));
                if level == 0 && self.is_measured(at.as_dvec3(), normal) {
                    return None;
                }
                Some(voxel.distance as f64 / voxel.weight as f64 / f64::from(1 << DISTANCE_LOG2))
            };
            Block { level, low, count, distances: places.map(|at| distance(at).unwrap_or(f64::NAN)).collect() }
        };
        self.filling().map(block).collect()
    }
}

/// The distances of a field in a box, in its voxels; NaN where they are not known.
pub(super) struct Block {
    level: u8,
    low: IVec3,
    count: IVec3,
    distances: Vec<f64>,
}

impl Block {
    /// Whether any distance is negative, and whether any is positive.
    pub(super) fn signs(&self) -> [bool; 2] {
        [self.distances.iter().any(|d| *d < 0.0), self.distances.iter().any(|d| *d >= 0.0)]
    }

    /// The distance at a voxel of the region, in its voxels and up to [`REACH`]; NaN where it is not known.
    pub(super) fn at(&self, place: IVec3) -> f64 {
        let level = i32::from(self.level);
        let first = place >> level;
        let size = f64::from(1 << level);
        let t = (place - (first << level)).as_dvec3() / size;
        let mut distance = 0.0;
        for k in 0..8 {
            let corner = IVec3::new(k & 1, k >> 1 & 1, k >> 2);
            let share = share(t, corner);
            if share > 0.0 {
                let at = first + corner - self.low;
                // NaN stays NaN.
                distance += self.distances[((at.z * self.count.y + at.y) * self.count.x + at.x) as usize] * share;
            }
        }
        (distance.clamp(-REACH, REACH) * size).clamp(-REACH, REACH)
    }
}

fn share(t: DVec3, corner: IVec3) -> f64 {
    let share = |t: f64, upper: i32| if upper == 1 { t } else { 1.0 - t };
    share(t.x, corner.x) * share(t.y, corner.y) * share(t.z, corner.z)
}

/// Whether the surfaces around a voxel face the same way.
fn is_usable(voxel: &Voxel) -> bool {
    // Normals are summed in parts of 2^10.
    let whole = voxel.weight as f64 * f64::from(Piece::NORMAL_ONE >> 4);
    voxel.weight > 0 && DVec3::from_array(voxel.normal.map(|n| n as f64)).length() >= COHERENT * whole
}

/// The coverage, relative to a plane, from which a place lies inside the measured surface; at its rim it is 0.5.
const INSIDE: f64 = 0.9;

impl Backing {
    /// Whether scans have measured the surface at a place or not far from it, though perhaps a little beside the mesh, which must not add a second layer there.
    fn is_measured(&self, place: DVec3, normal: DVec3) -> bool {
        let Some(field) = self.coarser.last() else { return false };
        let size = f64::from(1 << self.coarser.len());
        interpolated(field, place / size)
            .is_some_and(|sums| sums.coverage >= INSIDE * FULL * size * size && sums.normal.dot(normal) > 0.0)
    }
}

/// The sums between the eight voxels around a place, where all are usable.
fn interpolated(field: &Field, place: DVec3) -> Option<Sums> {
    let low = place.floor();
    let t = place - low;
    let first = low.as_ivec3();
    let mut sums = Sums::default();
    for k in 0..8 {
        let corner = IVec3::new(k & 1, k >> 1 & 1, k >> 2);
        let share = share(t, corner);
        if share > 0.0 {
            sums.add(field.voxel(first + corner).filter(|voxel| is_usable(voxel))?, share);
        }
    }
    Some(sums)
}

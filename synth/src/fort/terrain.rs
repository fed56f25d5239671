//! The ground that scans see: the heights of [`ground`] on a grid, bilinear between its points, so that rays meet it by arithmetic alone.
//!
//! Earth that silts up the feet of walls is part of the heights, and inside the well there is no ground. A pyramid of maxima lets rays
//! skip what they pass above.

use super::distance::{Beam, Masonry, Met};
use super::ground::{Ground, ground};
use super::plan::WELL;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Half the side of the ground, in metres, in the fort's frame.
pub(crate) const HALF: f64 = 28.0;
/// Points per metre.
const PER_METRE: f64 = 16.0;
const CELLS: usize = (2.0 * HALF * PER_METRE) as usize;
const POINTS: usize = CELLS + 1;
/// Levels of the pyramid; the coarsest has 14 by 14 cells.
const LEVELS: usize = 7;
/// Width over which earth silts up the foot of a wall, in metres, and how fast the ground's field grows there (as in the field of the mesh).
const SILT: f64 = 0.16;
const SILT_RATE: f64 = 0.85;
/// Radius inside which the well has no ground (in the middle of its lining), and the height there.
const WELL_RADIUS: f64 = 0.93;
const WELL_HEIGHT: f64 = -4.7;
/// Relief finer than this is left out of the ground, in metres.
const DETAIL: f64 = 0.05;

/// The ground.
pub(super) struct Terrain {
    seed: u64,
    heights: Vec<f32>,
    /// For each level the largest height of each cell and its neighbours.
    highest: Vec<Vec<f32>>,
}

impl Terrain {
    /// The ground of a seed (already derived for the fort).
    pub(super) fn new(seed: u64, masonry: &Masonry) -> Self {
        let place = |k: usize| k as f64 / PER_METRE - HALF;
        let heights: Vec<f32> = (0..POINTS * POINTS)
            .into_par_iter()
            .map(|k| silted(seed, place(k / POINTS), place(k % POINTS), masonry) as f32)
            .collect();
        let highest = pyramid(&heights);
        Self { seed, heights, highest }
    }

    /// What the ground is at a place, for its colour.
    pub(super) fn look(&self, x: f64, y: f64) -> Ground {
        ground(self.seed, x, y, DETAIL)
    }

    /// Height of the surface; far below everything outside the square.
    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        let (u, v) = ((x + HALF) * PER_METRE, (y + HALF) * PER_METRE);
        if !(0.0..CELLS as f64).contains(&u) || !(0.0..CELLS as f64).contains(&v) {
            return -1e3;
        }
        let (i, j) = (u as usize, v as usize);
        let [a, b, c, d] = self.patch(i, j);
        let (u, v) = (u - i as f64, v - j as f64);
        a + b * u + c * v + d * u * v
    }

    /// Whether all of the ground is above or below a ball, as far as a few heights show: between them it rises and falls by less than half a metre.
    pub(super) fn misses(&self, middle: DVec3, radius: f64) -> bool {
        const AROUND: i32 = 3;
        let along = (-AROUND..=AROUND).map(|k| radius * f64::from(k) / f64::from(AROUND));
        let heights = along.clone().flat_map(|x| along.clone().map(move |y| (x, y)));
        let (mut low, mut high) = (f64::MAX, f64::MIN);
        for (x, y) in heights {
            let height = self.height(middle.x + x, middle.y + y);
            (low, high) = (low.min(height), high.max(height));
        }
        middle.z - radius > high + 0.5 || middle.z + radius < low - 0.5
    }

    /// The height over a cell as `a + b u + c v + d u v`, u and v from 0 to 1.
    fn patch(&self, i: usize, j: usize) -> [f64; 4] {
        let h = |i: usize, j: usize| f64::from(self.heights[i * POINTS + j]);
        let (h00, h10, h01, h11) = (h(i, j), h(i + 1, j), h(i, j + 1), h(i + 1, j + 1));
        [h00, h10 - h00, h01 - h00, h11 - h10 - h01 + h00]
    }

    /// Follow a ray (origin, unit direction) from one distance to another: where it meets the surface from above, or, with a beam, where the
    /// beam may begin to touch it.
    pub(super) fn meet(&self, o: DVec3, d: DVec3, from: f64, to: f64, beam: Option<Beam>) -> Met {
        let flat = DVec2::new(d.x, d.y);
        let inverse = flat.recip();
        let (a, b) = ((DVec2::splat(-HALF) - o.truncate()) * inverse, (DVec2::splat(HALF) - o.truncate()) * inverse);
        let (mut t, end) = (from.max(a.min(b).max_element()), to.min(a.max(b).min_element()));
        let mut level = LEVELS - 1;
        while t < end {
            let side = f64::from(1_u32 << level) / PER_METRE;
            let cells = CELLS >> level;
            let at = (o + d * t).truncate() + HALF;
            let cell = |v: f64| ((v / side).max(0.0) as usize).min(cells - 1);
            let (i, j) = (cell(at.x), cell(at.y));
            // The inverse of a zero has the sign of the zero.
            let wall = |k: usize, inverse: f64| if inverse > 0.0 { (k + 1) as f64 * side } else { k as f64 * side };
            let exit = (DVec2::new(wall(i, inverse.x), wall(j, inverse.y)) - HALF - o.truncate()) * inverse;
            // A ray straight down never leaves its cell.
            let leave = if exit.min_element().is_finite() { exit.min_element().max(t) + 1e-6 } else { end }.min(end);
            let lowest = o.z + d.z * if d.z < 0.0 { leave } else { t };
            let radius = beam.map_or(0.0, |beam| beam.radius(leave));
            if lowest - radius > f64::from(self.highest[level][i * cells + j]) {
                t = leave;
                level = (level + 1).min(LEVELS - 1);
            } else if level > 0 {
                level -= 1;
            } else if beam.is_some() {
                return Met::Close(t);
            } else if let Some(t) = self.touch(i, j, o, d, t, leave) {
                return Met::Surface(t);
            } else {
                t = leave;
                level = 1;
            }
        }
        Met::Nothing
    }

    /// Where a ray comes down through a cell's patch between two distances.
    fn touch(&self, i: usize, j: usize, o: DVec3, d: DVec3, from: f64, to: f64) -> Option<f64> {
        let [a, b, c, e] = self.patch(i, j);
        let p = o + d * from;
        let (u, v) = ((p.x + HALF) * PER_METRE - i as f64, (p.y + HALF) * PER_METRE - j as f64);
        let (du, dv) = (d.x * PER_METRE, d.y * PER_METRE);
        // Height above the patch along the ray: k0 + k1 s + k2 s².
        let k0 = p.z - (a + b * u + c * v + e * u * v);
        let k1 = d.z - (b * du + c * dv + e * (u * dv + v * du));
        let k2 = -e * du * dv;
        let length = to - from;
        if k0 <= 0.0 {
            // Rounding at the border of a cell; a place well below the surface is behind it.
            return (k0 > -1e-3).then_some(from);
        }
        let s = if k2.abs() < 1e-12 {
            -k0 / k1
        } else {
            let root = k1 * k1 - 4.0 * k0 * k2;
            if root < 0.0 {
                return None;
            }
            let q = -0.5 * (k1 + root.sqrt().copysign(k1));
            let (one, two) = (q / k2, k0 / q);
            let (low, high) = (one.min(two), one.max(two));
            if low >= 0.0 { low } else { high }
        };
        (0.0..=length + 1e-6).contains(&s).then_some(from + s)
    }
}

/// The height with earth at the feet of walls: where the smooth union of wall and ground, which the mesh has, is zero.
fn silted(seed: u64, x: f64, y: f64, masonry: &Masonry) -> f64 {
    let (dx, dy) = (x - WELL[0], y - WELL[1]);
    if dx * dx + dy * dy < WELL_RADIUS * WELL_RADIUS {
        return WELL_HEIGHT;
    }
    let height = ground(seed, x, y, DETAIL).height;
    let wall = masonry.smooth_value(DVec3::new(x, y, height)).clamp(0.0, SILT);
    height + (wall + SILT - 2.0 * (wall * SILT).sqrt()) / SILT_RATE
}

fn pyramid(heights: &[f32]) -> Vec<Vec<f32>> {
    let around = |k: usize| k.saturating_sub(1)..=(k + 2).min(CELLS);
    let first: Vec<f32> = (0..CELLS * CELLS)
        .into_par_iter()
        .map(|k| {
            let points = around(k / CELLS).flat_map(|i| around(k % CELLS).map(move |j| heights[i * POINTS + j]));
            points.fold(f32::MIN, f32::max)
        })
        .collect();
    let mut levels = vec![first];
    for level in 1..LEVELS {
        let (fine, cells) = (&levels[level - 1], CELLS >> level);
        let four = |i: usize, j: usize| {
            let at = |i: usize, j: usize| fine[i * cells * 2 + j];
            at(2 * i, 2 * j).max(at(2 * i + 1, 2 * j)).max(at(2 * i, 2 * j + 1)).max(at(2 * i + 1, 2 * j + 1))
        };
        let coarse = (0..cells * cells).map(|k| four(k / cells, k % cells)).collect();
        levels.push(coarse);
    }
    levels
}

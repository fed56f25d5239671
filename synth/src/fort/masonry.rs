//! Weathered masonry: the relief of coral rag in lime mortar, and what its surface is at a place.
//!
//! The stones are cells in space, not on a wall: courses by height, and in each course jittered cells in plan. So every
//! face, corner and tower shows them without any unwrapping, and they run through the wall as real stones do.

use super::plan::{GATE_X, HALF_X, HALF_Y};
use crate::noise::{cell, derive, fractal3, hash3, lerp, noise3, smooth, unit};
use glam::DVec3;

/// The relief never stands out further than this, in metres.
pub(super) const MAX_OUT: f64 = 0.12;
/// The relief never goes in deeper than this, in metres.
pub(super) const MAX_IN: f64 = 0.34;

/// The surface of masonry at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// How far it stands out of the plan's surface, in metres.
    pub(super) relief: f64,
    /// Identity of the stone.
    pub(super) stone: u64,
    /// 1 in the middle of a mortar joint, 0 on the stone.
    pub(super) joint: f64,
    /// 1 where plaster holds, 0 where stone shows.
    pub(super) plaster: f64,
    /// How worn: 0 sound, 1 eaten away.
    pub(super) worn: f64,
    /// Whether this stone has fallen out.
    pub(super) missing: bool,
}

const COURSE: f64 = 0.31;
const LENGTH: f64 = 0.5;

/// The masonry at a place of the fort's frame, as far as a sampling `step` metres apart can show it: edges are no
/// sharper than the step, and the finest relief comes in only where it is sampled.
pub(super) fn face(seed: u64, p: DVec3, step: f64) -> Face {
    let decay = fractal3(derive(seed, 0x71), DVec3::new(p.x, p.y, p.z * 1.3), 3.1, 3, 0.55);
    // Salt eats the foot of the wall, rain its head.
    let worn = smooth(0.05, 0.85, decay + 0.35 * smooth(0.9, 0.0, p[2]) + 0.12 * smooth(4.0, 6.5, p[2]));
    let coat = fractal3(derive(seed, 0x72), p, 2.3, 3, 0.6) - 0.8 * worn + kept_plaster(p);
    let plaster = smooth(0.08, 0.16 + step, coat);
    let grain = smooth(0.16, 0.06, step) * fractal3(derive(seed, 0x73), p, 0.24, grain_octaves(step), 0.6);
    let (stone, gap) = stone(seed, p);
    let soft = lerp(0.018, 0.05, worn).max(0.75 * step);
    let joint = 1.0 - smooth(0.3 * soft, soft, gap);
    let pillow = smooth(0.0, 0.13_f64.max(1.2 * step), gap);
    let lot = unit(stone, 0);
    let missing = plaster < 0.5 && lot < 0.012 + 0.10 * worn;
    let bare = lerp(-0.016, 0.016 + 0.045 * (unit(stone, 1) - 0.5), pillow) - 0.022 * joint - 0.06 * worn
        + grain * lerp(0.010, 0.026, worn);
    let fallen = if missing { -(0.10 + 0.09 * unit(stone, 2)) * smooth(0.0, (0.9 * step).max(0.05), gap) } else { 0.0 };
    let coated = 0.034 + 0.004 * grain + 0.012 * decay;
    let relief = lerp(bare + fallen, coated, plaster).clamp(-MAX_IN, MAX_OUT);
    Face { relief, stone, joint, plaster, worn, missing }
}

/// [`gentle`] never stands out further than this, in metres.
pub(super) const GENTLE_OUT: f64 = 0.06;
/// [`gentle`] changes by no more than this per metre.
pub(super) const GENTLE_SLOPE: f64 = 0.8;

/// The relief of [`face`] with its steps drawn out into slopes, so that rays can be traced against it: the same stones, joints, plaster and
/// fallen stones, but no edge is steeper than [`GENTLE_SLOPE`], and nothing is finer than about 5 cm.
pub(super) fn gentle(seed: u64, p: DVec3) -> f64 {
    let decay = fractal3(derive(seed, 0x71), DVec3::new(p.x, p.y, p.z * 1.3), 3.1, 2, 0.55);
    let worn = smooth(-0.1, 1.0, decay + 0.35 * smooth(0.9, 0.0, p.z) + 0.12 * smooth(4.0, 6.5, p.z));
    let coat = fractal3(derive(seed, 0x72), p, 2.3, 2, 0.6) - 0.8 * worn + kept_plaster(p);
    let plaster = smooth(-0.15, 0.4, coat);
    let coated = 0.030 + 0.008 * decay;
    if plaster == 1.0 {
        return coated;
    }
    let grain = fractal3(derive(seed, 0x73), p, 0.24, 2, 0.6) * lerp(0.003, 0.008, worn);
    let (stone, gap) = bordered_stone(seed, p);
    let pillow = smooth(0.0, 0.12, gap);
    let bare = (0.028 + 0.03 * (unit(stone, 1) - 0.5)) * pillow - 0.02 - 0.045 * worn + grain;
    let missing = smooth(0.0, 0.03, 0.012 + 0.1 * worn - unit(stone, 0));
    let fallen = (0.05 + 0.04 * unit(stone, 2)) * missing * smooth(0.0, 0.15, gap);
    lerp(bare - fallen, coated, plaster).min(GENTLE_OUT)
}

/// How much better than elsewhere plaster has kept: well in the rooms and round the gate, badly on the weather sides.
fn kept_plaster(p: DVec3) -> f64 {
    let inside = smooth(0.3, -0.4, (p[0].abs() - HALF_X + 0.9).max(p[1].abs() - HALF_Y + 0.9));
    let gate = smooth(2.7, 1.7, (p[0] - GATE_X).abs()) * smooth(-HALF_Y + 1.5, -HALF_Y, p[1]) * smooth(5.4, 4.6, p[2]);
    -0.16 + 0.3 * inside * smooth(4.6, 3.6, p[2]) + 0.62 * gate * smooth(0.3, 1.2, p[2])
}

/// Octaves of the finest relief that a sampling can show.
pub(super) fn grain_octaves(step: f64) -> u32 {
    [0.04, 0.02, 0.01, 0.005].iter().fold(2, |n, limit| n + u32::from(step < *limit))
}

/// The stone at a place, and the distance to its border, which unlike that of [`stone`] nowhere jumps.
fn bordered_stone(seed: u64, p: DVec3) -> (u64, f64) {
    // Points of cells that are not looked at are at least so far away, in cells.
    const UNSEEN: f64 = 1.06;
    let stones = Stones::around(seed, p);
    let (mut nearest, mut own) = (f64::MAX, 0);
    for (k, [u, w]) in stones.places.iter().enumerate() {
        let d = u * u + w * w;
        if d < nearest {
            (nearest, own) = (d, k);
        }
    }
    let near = nearest.sqrt();
    let mut across = (UNSEEN - near) / 2.0;
    let [a, b] = stones.places[own];
    for (k, [u, w]) in stones.places.iter().enumerate() {
        let d = u * u + w * w;
        // The border is at least half of the difference away.
        let further = near + 2.0 * across;
        if k != own && d < further * further {
            let apart = ((u - a) * (u - a) + (w - b) * (w - b)).sqrt().max(1e-6);
            across = across.min((d - nearest) / (2.0 * apart));
        }
    }
    (stones.names[own].rotate_left(17) ^ 0x5bd1, (across * LENGTH).min(stones.bed))
}

/// The cells of stones around a place.
struct Stones {
    /// Where their middles are, from the place, in cells.
    places: [[f64; 2]; 9],
    names: [u64; 9],
    /// Distance to the nearer bed of the course, in metres.
    bed: f64,
}

impl Stones {
    fn around(seed: u64, p: DVec3) -> Self {
        let salt = derive(seed, 0x74);
        let sway = 0.1 * noise3(derive(seed, 0x75), DVec3::new(p.x * 0.7, p.y * 0.7, p.z * 0.9));
        let (course, v) = cell(p[2] + sway, COURSE);
        let (ix, x) = cell(p[0] + 0.37 * course as f64, LENGTH);
        let (iy, y) = cell(p[1] + 0.61 * course as f64, LENGTH);
        let names = std::array::from_fn(|k| hash3(salt, ix + k as i64 / 3 - 1, iy + k as i64 % 3 - 1, course));
        let places = std::array::from_fn(|k| {
            let (dx, dy) = ((k / 3) as f64 - 1.0, (k % 3) as f64 - 1.0);
            [dx + 0.06 + 0.88 * unit(names[k], 0) - x, dy + 0.06 + 0.88 * unit(names[k], 1) - y]
        });
        Self { places, names, bed: v.min(1.0 - v) * COURSE }
    }
}

/// The stone at a place, and the distance to its nearest neighbour's.
fn stone(seed: u64, p: DVec3) -> (u64, f64) {
    let Stones { places, names, bed } = Stones::around(seed, p);
    let mut nearest = [(f64::MAX, 0.0, 0.0, 0_u64); 2];
    for ([u, w], h) in places.into_iter().zip(names) {
        let d = u * u + w * w;
        if d < nearest[0].0 {
            nearest[1] = nearest[0];
            nearest[0] = (d, u, w, h);
        } else if d < nearest[1].0 {
            nearest[1] = (d, u, w, h);
        }
    }
    let [a, b] = nearest;
    let apart = ((a.1 - b.1) * (a.1 - b.1) + (a.2 - b.2) * (a.2 - b.2)).sqrt().max(1e-6);
    let across = (b.0 - a.0) / (2.0 * apart) * LENGTH;
    (a.3.rotate_left(17) ^ 0x5bd1, across.min(bed))
}

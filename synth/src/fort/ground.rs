//! The ground: a height field with the shore to the south, banks of rubble under the breaches, scattered stones.

use super::masonry::grain_octaves;
use super::plan::{DRUM, GATE_X, HALF_X, HALF_Y, KEEP, WELL};
use crate::noise::{derive, fractal2, hash2, lerp, noise2, smooth, unit};

/// A place where masonry has fallen: the walls sink to `low` there, and a bank of rubble lies before them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Breach {
    at: [f64; 2],
    /// Height of what is left of the wall in the middle.
    low: f64,
    /// How fast it rises away from the middle, metres per metre.
    rise: f64,
    /// Middle and height of the bank of rubble.
    bank: [f64; 3],
}

const BREACHES: [Breach; 5] = [
    Breach { at: [12.6, 2.6], low: 1.3, rise: 1.25, bank: [14.2, 2.6, 1.05] },
    Breach { at: [-15.6, 13.2], low: 2.4, rise: 1.15, bank: [-14.8, 14.4, 0.9] },
    Breach { at: [5.0, 11.4], low: 2.9, rise: 1.5, bank: [5.2, 12.9, 0.75] },
    Breach { at: [9.2, 3.6], low: 0.7, rise: 0.42, bank: [9.6, 3.2, 0.55] },
    Breach { at: [3.8, 6.9], low: 1.2, rise: 0.7, bank: [4.2, 6.4, 0.4] },
];

/// What the ground is at a place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ground {
    /// Height of the surface.
    pub(super) height: f64,
    /// 1 where rubble lies, 0 on plain earth.
    pub(super) rubble: f64,
    /// Identity of the stone that shows here, or 0.
    pub(super) stone: u64,
    /// Height to which ruined masonry stands here.
    pub(super) standing: f64,
}

/// Height without stones and fine relief: cheap, within 0.5 m of the whole.
pub(super) fn broad(seed: u64, x: f64, y: f64) -> f64 {
    let out = outside(x, y);
    let shore = -2.3 * smooth(-12.5, -25.0, y) - 0.5 * smooth(-12.0, -16.0, y);
    let roll = 0.42 * fractal2(derive(seed, 0x60), x, y, 13.0, 2, 0.5);
    let landward = 0.5 * smooth(13.0, 26.0, y);
    lerp(0.05 * roll, roll + shore + landward, out) + banks(x, y)
}

/// 0 in the court, 1 well outside the walls.
fn outside(x: f64, y: f64) -> f64 {
    let d = (x.abs() - HALF_X).max(y.abs() - HALF_Y);
    smooth(-1.0, 5.0, d)
}

fn banks(x: f64, y: f64) -> f64 {
    BREACHES.iter().map(|b| b.bank[2] * falloff(b, x, y)).sum()
}

fn falloff(b: &Breach, x: f64, y: f64) -> f64 {
    let (dx, dy) = (x - b.bank[0], y - b.bank[1]);
    let q = (dx * dx + dy * dy) / 11.0;
    1.0 / (1.0 + q * q + q)
}

/// Height to which ruined masonry still stands.
pub(super) fn standing(seed: u64, x: f64, y: f64) -> f64 {
    let rough = fractal2(derive(seed, 0x61), x, y, 2.6, 3, 0.6);
    let weather = 7.4 + 2.4 * fractal2(derive(seed, 0x62), x, y, 7.0, 2, 0.5) + 0.5 * rough;
    // The towers lose less.
    let near = |c: [f64; 2], r: f64| {
        let (dx, dy) = (x - c[0], y - c[1]);
        smooth(r + 2.0, r, (dx * dx + dy * dy).sqrt())
    };
    let kept = weather + 3.0 * near(DRUM, 4.6) + 2.0 * near(KEEP, 4.6) + 2.6 * near([GATE_X, -HALF_Y], 3.4);
    BREACHES.iter().fold(kept, |top, b| {
        let (dx, dy) = (x - b.at[0], y - b.at[1]);
        let distance = (dx * dx + dy * dy).sqrt();
        let here = b.low + b.rise * (distance - 1.2).max(0.0) * (1.0 + 0.35 * rough) + 0.45 * rough;
        top.min(here)
    })
}

/// The whole ground at a place, as far as a sampling `step` metres apart can show it.
pub(super) fn ground(seed: u64, x: f64, y: f64, step: f64) -> Ground {
    let mut rubble: f64 = BREACHES.iter().map(|b| 1.15 * falloff(b, x, y)).sum();
    let d = (x.abs() - HALF_X).abs().max(0.0).min((y.abs() - HALF_Y).abs());
    rubble = (rubble + 0.18 * smooth(2.5, 0.4, d)).min(1.0);
    let fine = fractal2(derive(seed, 0x63), x, y, 1.1, 2 + grain_octaves(step), 0.55);
    let tuft = 0.05 * smooth(0.15, 0.6, noise2(derive(seed, 0x64), x * 2.3, y * 2.3));
    let out = outside(x, y);
    let well = smooth(1.6, 1.1, {
        let (dx, dy) = (x - WELL[0], y - WELL[1]);
        (dx * dx + dy * dy).sqrt()
    });
    let plain = broad(seed, x, y) + fine * lerp(0.018, 0.055, out) + tuft * out + 0.03 * well;
    let (rise, stone) = stones(derive(seed, 0x65), x, y, rubble);
    Ground { height: plain + rise, rubble, stone, standing: standing(seed, x, y) }
}

/// Stones that lie on the ground: domes with broken facets, larger and denser where rubble lies.
fn stones(seed: u64, x: f64, y: f64, rubble: f64) -> (f64, u64) {
    let (mut best, mut id) = (0.0, 0);
    for (size, chance) in [(1.15, 0.06), (0.52, 0.12)] {
        let (cx, cy) = ((x / size).floor() as i64, (y / size).floor() as i64);
        for dx in -1..=1 {
            for dy in -1..=1 {
                let h = hash2(seed ^ (size * 100.0) as u64, cx + dx, cy + dy);
                if unit(h, 0) > chance * 0.35 + rubble * 0.85 {
                    continue;
                }
                let px = (cx + dx) as f64 + 0.2 + 0.6 * unit(h, 1);
                let py = (cy + dy) as f64 + 0.2 + 0.6 * unit(h, 2);
                let h = h.rotate_left(23);
                let (ux, uy) = (x - px * size, y - py * size);
                let turn = unit(h, 0) * 1.5;
                let (a, b) = (ux + turn * uy, uy - turn * ux);
                let norm = (1.0 + turn * turn).sqrt();
                let (a, b) = ((a / norm).abs() * (1.0 + 0.5 * unit(h, 1)), (b / norm).abs());
                let radius = size * (0.22 + 0.26 * unit(h, 2));
                // Between a box and a ball: facets with worn corners.
                let reach = (a.max(b) * 0.6 + (a * a + b * b).sqrt() * 0.4) / radius;
                let top = radius * (0.35 + 0.5 * unit(h, 0)) * (1.0 - smooth(0.62, 1.05, reach));
                let tilt = 1.0 + 0.35 * ((unit(h, 1) - 0.5) * ux + (unit(h, 2) - 0.5) * uy) / radius;
                if top * tilt > best + 0.004 {
                    (best, id) = (top * tilt, h | 1);
                }
            }
        }
    }
    (best, id)
}

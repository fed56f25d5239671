//! What the scanner did not see: the site's ragged outline, heads of walls, shadows at the foot of things, the well.

use super::field::Distance;
use super::plan::{DRUM, WELL};
use crate::noise::{derive, fractal2, fractal3, noise3, smooth};
use glam::DVec3;

/// Whether a place of the surface was seen. `p` and `normal` are in the fort's frame.
pub(super) fn seen(seed: u64, p: DVec3, normal: DVec3, d: &Distance) -> bool {
    let DVec3 { x, y, z } = p;
    // The outline of the survey: a rounded square, frayed.
    let (u, v) = (x / 24.2, y / 23.0);
    let reach = (u * u * u * u + v * v * v * v).sqrt().sqrt();
    let fray = 0.055 * fractal2(derive(seed, 0xa1), x, y, 5.0, 4, 0.6);
    if reach + fray > 1.0 {
        return false;
    }
    let (wx, wy) = (x - WELL[0], y - WELL[1]);
    if wx * wx + wy * wy < 1.0 && z < -1.9 - 0.25 * noise3(derive(seed, 0xa2), p * 2.0) {
        return false;
    }
    if d.walls < d.ground {
        // Heads of walls above the eye of the instrument.
        let (tx, ty) = (x - DRUM[0], y - DRUM[1]);
        // The round tower's platform had a set-up of its own.
        let platform = 0.4 * smooth(4.0, 3.2, (tx * tx + ty * ty).sqrt());
        let up = smooth(0.62, 0.9, normal[2]) * smooth(2.6, 5.0, z) - platform;
        if up > 0.0 && fractal2(derive(seed, 0xa3), x, y, 1.9, 4, 0.6) + 0.9 * up > 1.05 {
            return false;
        }
        return true;
    }
    // Shadows of low things on the ground, longer than wide.
    let (a, b) = (0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x);
    let patch = fractal3(derive(seed, 0xa4), DVec3::new(a * 0.55, b * 1.3, 0.0), 1.0, 3, 0.6);
    patch < shadow_limit(d.walls)
}

/// Shadows are frequent close to walls and rare in the open.
fn shadow_limit(to_wall: f64) -> f64 {
    0.86 + 0.5 * smooth(0.3, 2.5, to_wall)
}

//! A recorded flight: where the camera is at every moment.

use crate::view::{Projection, View};
use glam::DVec3;

/// Key frames in order of time; between two of them the eye goes straight and the direction turns evenly.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    keys: Vec<(f64, View)>,
}

impl Flight {
    /// A flight through these key frames (milliseconds, view), put in order of time; `first` is the view before and after it
    /// if there are none.
    pub fn new(first: View, mut keys: Vec<(f64, View)>) -> Self {
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        if keys.is_empty() {
            keys.push((0.0, first));
        }
        Self { keys }
    }

    /// When the last key frame is, milliseconds.
    pub fn end_ms(&self) -> f64 {
        self.keys.last().map_or(0.0, |k| k.0)
    }

    /// From when on the camera rests for at least `min_ms`, and until when: the stops of the flight.
    pub fn stops(&self, min_ms: f64) -> Vec<(f64, f64)> {
        let rests = self.keys.windows(2).filter(|w| w[0].1 == w[1].1 && w[1].0 - w[0].0 >= min_ms);
        rests.map(|w| (w[0].0, w[1].0)).collect()
    }

    /// The camera at a moment.
    pub fn at(&self, now_ms: f64) -> View {
        let after = self.keys.partition_point(|k| k.0 <= now_ms);
        let Some((from, a)) = self.keys.get(after.saturating_sub(1)) else { return self.keys[0].1 };
        let Some((to, b)) = self.keys.get(after).filter(|_| after > 0) else { return *a };
        let t = (now_ms - from) / (to - from).max(1e-9);
        between(a, b, t)
    }

    /// Whether nothing moves between two moments.
    pub fn rests(&self, from_ms: f64, to_ms: f64) -> bool {
        self.next_move(from_ms) >= to_ms
    }

    /// When the camera next begins to move, or `now_ms` where it is moving.
    pub fn next_move(&self, now_ms: f64) -> f64 {
        let first = self.keys.partition_point(|k| k.0 <= now_ms).saturating_sub(1);
        let moves = self.keys.windows(2).skip(first).find(|w| w[0].1 != w[1].1);
        moves.map_or(f64::INFINITY, |w| w[0].0.max(now_ms))
    }
}

fn unit(v: DVec3, otherwise: DVec3) -> DVec3 {
    let length = v.length();
    if length > 1e-9 { v / length } else { otherwise }
}

fn between(a: &View, b: &View, t: f64) -> View {
    if a == b || t <= 0.0 {
        return *a;
    }
    let forward = unit(a.forward.lerp_monotonic(b.forward, t), a.forward);
    let near_up = a.up.lerp_monotonic(b.up, t);
    let right = unit(forward.cross(near_up), a.right);
    let number = |x: f64, y: f64| if x == y { x } else { x + (y - x) * t };
    let projection = match (a.projection, b.projection) {
        (Projection::Perspective { tan_half_height: x }, Projection::Perspective { tan_half_height: y }) => {
            Projection::Perspective { tan_half_height: number(x, y) }
        }
        (Projection::Orthographic { half_height: x }, Projection::Orthographic { half_height: y }) => {
            Projection::Orthographic { half_height: number(x, y) }
        }
        _ => a.projection,
    };
    View {
        eye: a.eye.lerp_monotonic(b.eye, t),
        right,
        up: right.cross(forward),
        forward,
        anchor: a.anchor.lerp_monotonic(b.anchor, t),
        projection,
        near: number(a.near, b.near),
        far: number(a.far, b.far),
        target_pixels: number(a.target_pixels, b.target_pixels),
        size: a.size,
        clip: b.clip,
    }
}

//! Where the camera will be in a moment, from where it was: what is prefetched.
//!
//! A camera that glides keeps gliding for the time that a request takes; one that jumps (a bookmark, a search result)
//! or rests predicts nothing. Pure: views and times in, a view out.

use crate::view::{Projection, View};
use glam::DVec3;

/// How far ahead, milliseconds: about what a request and its decoding take.
const HORIZON_MS: f64 = 600.0;
/// Steps farther apart than this are no movement that continues.
const LONGEST_STEP_MS: f64 = 250.0;
/// A movement whose speed changes by more than this factor between two steps is a jump.
const STEADY: f64 = 4.0;

/// Remembers the last movement.
#[derive(Debug, Clone, Default)]
pub(crate) struct Predictor {
    last: Option<(f64, View)>,
    /// Speed of the last movement, in pixels of the picture per millisecond, 0 at rest.
    speed: f64,
}

impl Predictor {
    /// Take in where the camera is; where it will be, unless it rests or jumped.
    pub(crate) fn update(&mut self, now_ms: f64, view: &View) -> Option<View> {
        let (before, was) = self.last.replace((now_ms, *view))?;
        let elapsed = now_ms - before;
        let is_usual = elapsed > 0.0 && elapsed <= LONGEST_STEP_MS;
        let speed = if is_usual && was.size == view.size { distance(&was, view) / elapsed } else { 0.0 };
        let previous = std::mem::replace(&mut self.speed, speed);
        let is_steady = speed > 0.0 && previous > 0.0 && (1.0 / STEADY..STEADY).contains(&(speed / previous));
        if is_steady { ahead(&was, view, HORIZON_MS / elapsed) } else { None }
    }
}

/// How much the picture changed, in pixels, roughly.
fn distance(a: &View, b: &View) -> f64 {
    let half_pixels = f64::from(b.size[1].max(1)) * 0.5;
    let turned = b.forward.distance(a.forward) + b.up.distance(a.up);
    let moved = b.eye.distance(a.eye);
    match (a.projection, b.projection) {
        // `near` is a fixed share of the distance to what is looked at.
        (Projection::Perspective { tan_half_height }, Projection::Perspective { .. }) => {
            (turned + moved / (b.near * 1e3).max(1.0)) * half_pixels / tan_half_height
        }
        (Projection::Orthographic { half_height: x }, Projection::Orthographic { half_height: y }) => {
            (turned + moved / y + (x / y - 1.0).abs()) * half_pixels
        }
        _ => 0.0,
    }
}

/// The same movement, `times` as far again.
fn ahead(was: &View, is: &View, times: f64) -> Option<View> {
    let on = |a: DVec3, b: DVec3| -> DVec3 { b + (b - a) * times };
    let unit = |v: DVec3| {
        let length = v.length();
        (length > 1e-6).then(|| v / length)
    };
    let forward = unit(on(was.forward, is.forward))?;
    let right = unit(forward.cross(on(was.up, is.up)))?;
    let projection = match (was.projection, is.projection) {
        (Projection::Orthographic { half_height: x }, Projection::Orthographic { half_height: y }) => {
            // A zoom continues by the same factor per step, within reason.
            let factor = libm::pow(y / x, times).clamp(0.1, 10.0);
            Projection::Orthographic { half_height: y * factor }
        }
        (_, projection) => projection,
    };
    let eye = on(was.eye, is.eye);
    Some(View { eye, forward, right, up: right.cross(forward), projection, ..*is })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glide_is_extrapolated_and_a_camera_at_rest_predicts_nothing() {
        let mut p = Predictor::default();
        assert_eq!(p.update(0.0, &View::north_from(0.0)), None);
        assert_eq!(p.update(20.0, &View::north_from(1.0)), None, "one movement may be a jump");
        let next = p.update(40.0, &View::north_from(2.0)).unwrap();
        assert!((next.eye[0] - 32.0).abs() < 1e-9, "{:?}", next.eye);
        assert_eq!(p.update(60.0, &View::north_from(2.0)), None);
        assert_eq!(p.update(80.0, &View::north_from(2.0)), None);
    }

    #[test]
    fn a_jump_predicts_nothing() {
        let mut p = Predictor::default();
        for (k, x) in [0.0, 1.0, 2.0].into_iter().enumerate() {
            p.update(k as f64 * 20.0, &View::north_from(x));
        }
        assert_eq!(p.update(60.0, &View::north_from(5000.0)), None);
        assert_eq!(p.update(80.0, &View::north_from(5000.0)), None);
        assert_eq!(p.update(2000.0, &View::north_from(5001.0)), None);
    }

    #[test]
    fn axes_stay_orthogonal() {
        let mut p = Predictor::default();
        let mut turned = None;
        for k in 0..4 {
            let a = 0.1 * f64::from(k);
            let (s, c) = (libm::sin(a), libm::cos(a));
            let view = View { forward: DVec3::new(s, c, 0.0), right: DVec3::new(c, -s, 0.0), ..View::north_from(0.0) };
            turned = p.update(f64::from(k) * 100.0, &view);
        }
        let v = turned.unwrap();
        for (a, b) in [(v.right, v.up), (v.right, v.forward), (v.up, v.forward)] {
            assert!(a.dot(b).abs() < 1e-9);
        }
        assert!(v.forward[0] > libm::sin(0.3));
    }
}

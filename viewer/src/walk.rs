//! Walking: where an eye at a person's height comes to stand after a step.
//!
//! World metres, z up. The surface is asked for through a ray cast, so that this is pure and tested here. Invariants: the
//! eye never ends below the surface it stands over; where there is no surface below (the edge of a scan, a hole), it
//! keeps its height; it does not come nearer to a wall than a shoulder's breadth, and slides along walls that it meets
//! at an angle. Rises higher than a step stop it.

use glam::{DVec2, DVec3};

/// Parts of the eye's height: how near a wall may come, and what can be stepped upon.
const SHOULDER: f64 = 0.16;
const STEP: f64 = 0.4;
/// Seconds in which the eye makes up for two thirds of a difference in height.
const SETTLING: f64 = 0.12;
/// Tried in turn when the way ahead is closed, radians: along the wall at its left or right.
const SLIDES: [f64; 5] = [0.0, 0.5, -0.5, 1.0, -1.0];

/// The eye after a step of `across` metres (x, y) that takes `seconds`, for a person whose eye is `height` metres above
/// the ground. `cast` gives the distance to the nearest surface from a point along a unit vector.
pub fn step(eye: DVec3, across: DVec2, seconds: f64, height: f64, cast: impl Fn(DVec3, DVec3) -> Option<f64>) -> DVec3 {
    let length = libm::hypot(across.x, across.y);
    if length > 0.0 {
        for angle in SLIDES {
            let (sin, cos) = libm::sincos(angle);
            let way = DVec2::new(across.x * cos - across.y * sin, across.x * sin + across.y * cos) / length;
            let length = length * cos;
            if !is_free(eye, way, length, height, &cast) {
                continue;
            }
            let there = DVec3::new(eye.x + way.x * length, eye.y + way.y * length, eye.z);
            let ground = ground(there, &cast);
            if ground.is_none_or(|g| g <= eye.z - height * (1.0 - STEP)) {
                return settle(there, ground, seconds, height);
            }
        }
    }
    settle(eye, ground(eye, &cast), seconds, height)
}

/// Height of the surface below a point.
pub fn ground(point: DVec3, cast: impl Fn(DVec3, DVec3) -> Option<f64>) -> Option<f64> {
    cast(point, DVec3::NEG_Z).map(|down| point.z - down)
}

/// Whether nothing stands in the way at the height of the eyes and of the knees.
fn is_free(eye: DVec3, way: DVec2, length: f64, height: f64, cast: &impl Fn(DVec3, DVec3) -> Option<f64>) -> bool {
    [0.0, height * (1.0 - STEP)].into_iter().all(|down| {
        let from = DVec3::new(eye.x, eye.y, eye.z - down);
        cast(from, way.extend(0.0)).is_none_or(|free| free > length + height * SHOULDER)
    })
}

fn settle(mut eye: DVec3, ground: Option<f64>, seconds: f64, height: f64) -> DVec3 {
    if let Some(ground) = ground {
        let rest = ground + height;
        let kept = libm::exp(-seconds.max(0.0) / SETTLING);
        eye.z = (rest + (eye.z - rest) * kept).max(ground + height * (1.0 - STEP));
    }
    eye
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEIGHT: f64 = 1.6;

    /// Ground at z = 0 for x < 10, a step of 0.3 m from there on, an end at x = 20, and a wall at y = 5.
    fn room(from: DVec3, way: DVec3) -> Option<f64> {
        let down = || {
            let ground = if from[0] < 10.0 { 0.0 } else { 0.3 };
            (way[2] < -0.5 && from[0] < 20.0 && from[2] >= ground).then_some(from[2] - ground)
        };
        let wall = || (way[1] > 1e-9 && from[1] < 5.0).then(|| (5.0 - from[1]) / way[1]);
        down().or_else(wall)
    }

    fn walk(mut eye: DVec3, across: DVec2, steps: usize) -> DVec3 {
        for _ in 0..steps {
            eye = step(eye, across, 0.05, HEIGHT, room);
        }
        eye
    }

    #[test]
    fn the_eye_settles_at_its_height_above_the_ground_from_above_and_below() {
        for z in [0.5, 1.6, 7.0] {
            let eye = walk(DVec3::new(0.0, 0.0, z), DVec2::ZERO, 200);
            assert!((eye.z - HEIGHT).abs() < 1e-6, "{eye:?}");
        }
    }

    #[test]
    fn a_step_is_climbed_and_beyond_the_ground_the_height_is_kept() {
        let on_step = walk(DVec3::new(9.0, 0.0, HEIGHT), DVec2::new(0.1, 0.0), 60);
        assert!((on_step[0] - 15.0).abs() < 1e-9 && (on_step[2] - HEIGHT - 0.3).abs() < 1e-6, "{on_step:?}");
        let beyond = walk(on_step, DVec2::new(0.1, 0.0), 100);
        assert!(beyond[0] > 24.0 && (beyond[2] - on_step[2]).abs() < 1e-6, "{beyond:?}");
    }

    #[test]
    fn a_wall_stops_the_walk_and_the_walker_slides_along_it() {
        let ahead = walk(DVec3::new(0.0, 0.0, HEIGHT), DVec2::new(0.0, 0.1), 200);
        assert!(ahead[1] < 5.0 - HEIGHT * SHOULDER * 0.5, "{ahead:?}");
        let aslant = walk(DVec3::new(0.0, 4.0, HEIGHT), DVec2::new(0.1, 0.05), 60);
        assert!(aslant[0] > 3.0 && aslant[1] < 5.0, "{aslant:?}");
    }

    #[test]
    fn a_table_is_not_climbed() {
        let table = |from: DVec3, way: DVec3| {
            let top = if from[0] > 1.0 { 0.9 } else { 0.0 };
            (way[2] < -0.5).then_some(from[2] - top)
        };
        let mut eye = DVec3::new(0.0, 0.0, HEIGHT);
        for _ in 0..100 {
            eye = step(eye, DVec2::new(0.05, 0.0), 0.05, HEIGHT, table);
        }
        assert!(eye[0] <= 1.0 + 1e-9 && (eye.z - HEIGHT).abs() < 1e-9, "{eye:?}");
    }
}

//! The frame time steers the pixel error, never the other way round.
//!
//! In: when each frame was drawn, and with which view. Out: the pixel error to refine to. While the camera moves, the error grows
//! until frames come at 60 a second, up to [`COMFORT`] times what is asked for; beyond that, up to [`RESCUE`] times, only to
//! stay above 15. Once the camera rests, the error is what is asked for, however long a frame takes, and stays that.
//!
//! The number of triangles falls about with the error, so the error follows the square root of the excess time: it overshoots
//! on no scene, and reaches what is needed within a second. Screens show whole refreshes: at the edge a slightly finer picture
//! takes twice as long. So a factor that was too fine is not tried again for a while, ever longer.

use crate::view::View;

/// Frames a second that are aimed at.
const AIM_MS: f64 = 1000.0 / 60.0;
/// Fewer than 15 frames a second are too few for anything.
const FLOOR_MS: f64 = 1000.0 / 15.0;
/// How much coarser the picture may get for 60 frames a second.
pub const COMFORT: f64 = 4.0;
/// How much coarser it may get for 15.
pub const RESCUE: f64 = 32.0;
/// A frame later than this after the last one says nothing about the time it took.
const PAUSE_MS: f64 = 3000.0;
/// The camera rests when it has not moved for this long.
const REST_MS: f64 = 200.0;
/// How often the factor changes at most.
const EVERY_MS: f64 = 100.0;
/// First wait before a factor that was too fine is tried again; it doubles each time.
const RETRY_MS: f64 = 2000.0;

/// See the module.
#[derive(Debug, Clone)]
pub struct Pace {
    target: f64,
    /// Factor for a moving camera, remembered over rests.
    factor: f64,
    last: Option<(f64, View)>,
    moved_at: f64,
    changed_at: f64,
    /// Smoothed frame time, milliseconds.
    smooth: f64,
    /// Factors below this were too fine; until when that is believed, and for how long the next time.
    too_fine: f64,
    believed_until: f64,
    wait: f64,
}

impl Pace {
    /// For this pixel error.
    pub fn new(target_pixels: f64) -> Self {
        Self {
            target: target_pixels,
            factor: 1.0,
            last: None,
            moved_at: f64::NEG_INFINITY,
            changed_at: f64::NEG_INFINITY,
            smooth: AIM_MS,
            too_fine: 0.0,
            believed_until: f64::NEG_INFINITY,
            wait: RETRY_MS,
        }
    }

    /// Ask for another pixel error.
    pub fn set_target(&mut self, pixels: f64) {
        self.target = pixels;
    }

    /// The pixel error that is asked for.
    pub fn target(&self) -> f64 {
        self.target
    }

    /// How much coarser a moving picture is.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Smoothed time from frame to frame while the camera moves, milliseconds.
    pub fn frame_ms(&self) -> f64 {
        self.smooth
    }

    /// Whether the camera rested at the last frame, so that nothing changes by itself.
    pub fn is_at_rest(&self) -> bool {
        self.last.is_none_or(|(now, _)| now - self.moved_at >= REST_MS)
    }

    /// A frame is about to be drawn with this view (whose target does not matter): the pixel error to refine to.
    pub fn frame(&mut self, now_ms: f64, view: &View) -> f64 {
        let view = View { target_pixels: 0.0, ..*view };
        let Some((before, was)) = self.last.replace((now_ms, view)) else { return self.target };
        let elapsed = now_ms - before;
        let was_moving = before - self.moved_at < REST_MS;
        if was != view {
            self.moved_at = now_ms;
        }
        if now_ms - self.moved_at >= REST_MS {
            return self.target;
        }
        // Two frames of one movement: the time between them is what a frame takes.
        if was_moving && was != view && elapsed > 0.0 && elapsed < PAUSE_MS {
            self.smooth += (elapsed - self.smooth) * if elapsed > FLOOR_MS { 0.5 } else { 0.25 };
            self.steer(now_ms);
        }
        self.target * self.factor
    }

    fn steer(&mut self, now_ms: f64) {
        if now_ms - self.changed_at < EVERY_MS {
            return;
        }
        self.changed_at = now_ms;
        let excess = self.smooth / AIM_MS;
        if excess > 1.15 {
            let max = if self.smooth > FLOOR_MS { RESCUE } else { COMFORT.max(self.factor) };
            let next = (self.factor * libm::sqrt(excess).min(2.0)).min(max);
            if next > self.factor {
                self.remember(now_ms);
                self.factor = next;
            }
        } else if self.factor > 1.0 {
            let next = (self.factor * 0.95).max(1.0);
            if next > self.too_fine || now_ms >= self.believed_until {
                self.factor = next;
            }
        }
    }

    /// The factor in force is too fine.
    fn remember(&mut self, now_ms: f64) {
        if self.factor <= self.too_fine * 1.02 && now_ms >= self.believed_until {
            self.wait = (self.wait * 2.0).min(60_000.0);
        }
        self.too_fine = self.factor;
        self.believed_until = now_ms + self.wait;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device that needs `full_ms` for the picture at factor 1, less in proportion, and shows whole refreshes of a 60 Hz screen.
    fn device(full_ms: f64, factor: f64) -> f64 {
        let takes = full_ms / factor + 0.5;
        (takes / AIM_MS).ceil().max(1.0) * AIM_MS
    }

    /// Move for a while; the frame times of the last half.
    fn fly(pace: &mut Pace, full_ms: f64, from_ms: f64, to_ms: f64) -> Vec<f64> {
        let (mut now, mut times) = (from_ms, Vec::new());
        let mut x = from_ms;
        while now < to_ms {
            x += 1.0;
            let factor = pace.frame(now, &View::north_from(x)) / pace.target();
            let took = device(full_ms, factor);
            now += took;
            if now > f64::midpoint(from_ms, to_ms) {
                times.push(took);
            }
        }
        times
    }

    #[test]
    fn a_fast_device_never_gets_a_coarser_picture() {
        let mut pace = Pace::new(1.0);
        fly(&mut pace, 10.0, 0.0, 10_000.0);
        assert!((pace.factor() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_slower_device_reaches_sixty_frames_a_second_in_motion() {
        for full_ms in [20.0, 30.0, 45.0, 55.0] {
            let mut pace = Pace::new(1.0);
            let times = fly(&mut pace, full_ms, 0.0, 20_000.0);
            let late = times.iter().filter(|t| **t > AIM_MS * 1.5).count();
            assert!(late * 10 <= times.len(), "{full_ms}: {late} of {} frames are late", times.len());
            assert!(pace.factor() <= COMFORT);
            assert!(pace.factor() <= full_ms / AIM_MS * 1.6, "{full_ms}: coarser than needed: {}", pace.factor());
        }
    }

    #[test]
    fn a_very_slow_device_stays_above_fifteen() {
        for full_ms in [300.0, 1200.0] {
            let mut pace = Pace::new(2.0);
            let times = fly(&mut pace, full_ms, 0.0, 30_000.0);
            let late = times.iter().filter(|t| **t > FLOOR_MS * 1.05).count();
            assert!(late * 10 <= times.len(), "{full_ms}: {late} of {} frames are late", times.len());
            assert!(pace.factor() <= RESCUE);
        }
    }

    #[test]
    fn a_camera_at_rest_gets_and_keeps_the_requested_detail_however_long_frames_take() {
        let mut pace = Pace::new(1.5);
        fly(&mut pace, 200.0, 0.0, 5000.0);
        assert!(pace.factor() > 2.0);
        let rest = View::north_from(1e6);
        pace.frame(5100.0, &rest);
        assert!(!pace.is_at_rest());
        let mut answers = Vec::new();
        for k in 1..60 {
            answers.push(pace.frame(5100.0 + f64::from(k) * 250.0, &rest));
        }
        assert!(pace.is_at_rest());
        assert!(answers.iter().all(|a| (a - 1.5).abs() < 1e-12), "{answers:?}");
        // The factor found so far is kept, so that the first frames of the next movement are not slow again.
        assert!(pace.factor() > 2.0);
    }

    #[test]
    fn a_scene_that_becomes_cheap_becomes_fine_again() {
        let mut pace = Pace::new(1.0);
        fly(&mut pace, 60.0, 0.0, 10_000.0);
        assert!(pace.factor() > 2.0);
        fly(&mut pace, 5.0, 10_000.0, 40_000.0);
        assert!((pace.factor() - 1.0).abs() < 1e-12, "{}", pace.factor());
    }

    #[test]
    fn pauses_do_not_count_as_frame_times() {
        let mut pace = Pace::new(1.0);
        for k in 0..50 {
            // A key pressed every half second: a frame at once, and some until the camera counts as resting.
            let (now, here) = (f64::from(k) * 500.0, View::north_from(f64::from(k)));
            for at in [0.0, 16.0, 120.0, 230.0] {
                pace.frame(now + at, &here);
            }
        }
        assert!((pace.factor() - 1.0).abs() < 1e-12);
    }
}

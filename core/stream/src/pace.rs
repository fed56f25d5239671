//! The frame time steers the pixel error, never the other way round.
//!
//! In: when each frame was drawn, and with which view. Out: the pixel error to refine to. While the camera moves, the error grows
//! until frames come at 60 a second, up to [`COMFORT`] times what is asked for; beyond that, up to [`RESCUE`] times, only to
//! stay above 15. Once the camera rests, the error is what is asked for, however long a frame takes, and stays that.
//!
//! The number of triangles falls about with the error, so the error follows the square root of the excess time: it overshoots
//! on no scene, and reaches what is needed within a second. Screens show whole refreshes: at the edge a slightly finer picture
//! takes twice as long. So a factor that was too fine is not tried again for a while, ever longer.
//!
//! Where frames take long for another reason than triangles (a software renderer fills pixels, a busy page), a coarser picture gains
//! nothing. So coarsening is a trial: when the picture has become [`TRIAL`] times coarser and frames come hardly faster, it becomes as fine
//! as it was, and finer still while that costs nothing; for a while, ever longer, it is not tried again.

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
/// How much coarser the picture gets before the gain is judged. Twice would not do: where frames wait for the screen, half the
/// triangles can take as many refreshes.
const TRIAL: f64 = 2.5;
/// A frame time below this share of the one before is a gain.
const GAIN: f64 = 0.85;
/// Frames are measured from this long after the factor changed: before, two levels fade into each other, and the graphics queue holds
/// older frames.
const SETTLE_MS: f64 = 300.0;
/// Frames that are measured at least.
const MEASURED: u32 = 3;
/// First wait after a trial without gain; it doubles each time, up to [`LONGEST_MS`].
const USELESS_MS: f64 = 5000.0;
/// The longest wait until anything is tried again.
const LONGEST_MS: f64 = 60_000.0;
/// Frames that take this much longer than at a trial without gain have another reason: it is tried again at once.
const OTHERWISE: f64 = 1.5;

/// See the module.
#[derive(Debug, Clone)]
pub struct Pace {
    target: f64,
    /// Factor for a moving camera, remembered over rests.
    factor: f64,
    last: Option<(f64, View)>,
    moved_at: f64,
    /// When it was last thought about the factor, and when it changed.
    changed_at: f64,
    factor_at: f64,
    /// Smoothed frame time, milliseconds.
    smooth: f64,
    /// Factors below this were too fine; until when that is believed, and for how long the next time.
    too_fine: f64,
    believed_until: f64,
    wait: f64,
    /// Frames at this factor, in this movement.
    measured: Measured,
    trial: Option<Trial>,
    /// A coarser picture gained nothing.
    useless: Option<Useless>,
    useless_wait: f64,
}

/// Frame times at one factor.
#[derive(Debug, Clone, Copy, Default)]
struct Measured {
    frames: u32,
    sum_ms: f64,
}

impl Measured {
    fn mean_ms(&self) -> Option<f64> {
        (self.frames >= MEASURED).then(|| self.sum_ms / f64::from(self.frames))
    }
}

/// Another factor is tried.
#[derive(Debug, Clone, Copy)]
struct Trial {
    /// The factor before, and the time of a frame with it, milliseconds.
    from: f64,
    ms: f64,
    is_finer: bool,
}

/// What the last trial without gain found.
#[derive(Debug, Clone, Copy)]
struct Useless {
    until: f64,
    /// Time of a frame, milliseconds.
    ms: f64,
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
            factor_at: f64::NEG_INFINITY,
            smooth: AIM_MS,
            too_fine: 0.0,
            believed_until: f64::NEG_INFINITY,
            wait: RETRY_MS,
            measured: Measured::default(),
            trial: None,
            useless: None,
            useless_wait: USELESS_MS,
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
            self.measured = Measured::default();
            return self.target;
        }
        // Two frames of one movement: the time between them is what a frame takes.
        if was_moving && was != view && elapsed > 0.0 && elapsed < PAUSE_MS {
            self.smooth += (elapsed - self.smooth) * if elapsed > FLOOR_MS { 0.5 } else { 0.25 };
            if before - self.factor_at >= SETTLE_MS {
                self.measured.frames += 1;
                self.measured.sum_ms += elapsed;
            }
            self.steer(now_ms, elapsed);
        }
        self.target * self.factor
    }

    /// The last frame took `elapsed` milliseconds.
    fn steer(&mut self, now_ms: f64, elapsed: f64) {
        if now_ms - self.changed_at < EVERY_MS {
            return;
        }
        self.changed_at = now_ms;
        let excess = self.smooth / AIM_MS;
        if excess > 1.15 {
            let max = if self.smooth > FLOOR_MS { RESCUE } else { COMFORT.max(self.factor) };
            if self.judge(now_ms, max) {
                self.coarsen(now_ms, (self.factor * libm::sqrt(excess).min(2.0)).min(max), elapsed);
            }
            return;
        }
        self.trial = None;
        if self.factor > 1.0 {
            let next = (self.factor * 0.95).max(1.0);
            if next > self.too_fine || now_ms >= self.believed_until {
                self.set_factor(now_ms, next);
            }
        }
    }

    fn set_factor(&mut self, now_ms: f64, factor: f64) {
        self.factor = factor;
        self.factor_at = now_ms;
        self.measured = Measured::default();
    }

    fn coarsen(&mut self, now_ms: f64, next: f64, elapsed: f64) {
        if next <= self.factor {
            // At the limit: perhaps it was overshot, or frames take long for another reason by now.
            if self.measured.frames >= MEASURED {
                self.leave_alone(now_ms, self.smooth);
                self.try_finer(now_ms, self.smooth);
            }
            return;
        }
        if self.trial.is_none() {
            // The smoothed time lags behind a scene that has just become slower.
            self.trial = Some(Trial { from: self.factor, ms: elapsed.max(self.smooth), is_finer: false });
        }
        self.remember(now_ms);
        self.set_factor(now_ms, next);
    }

    /// Frames take too long. Whether the picture may become coarser now: no trial has to be measured, and none has shown that it is of no use.
    fn judge(&mut self, now_ms: f64, max: f64) -> bool {
        let Some(trial) = self.trial else {
            return self.useless.is_none_or(|u| now_ms >= u.until || self.smooth > u.ms * OTHERWISE);
        };
        if !trial.is_finer && self.factor < (trial.from * TRIAL).min(max) {
            return true;
        }
        let Some(ms) = self.measured.mean_ms() else { return false };
        self.trial = None;
        if trial.is_finer {
            let is_fast_enough = self.factor >= COMFORT && ms < FLOOR_MS;
            if ms * GAIN > trial.ms && !is_fast_enough {
                self.set_factor(now_ms, trial.from);
            } else {
                self.try_finer(now_ms, ms);
            }
            return false;
        }
        if ms < trial.ms * GAIN {
            self.useless = None;
            self.useless_wait = USELESS_MS;
            self.trial = Some(Trial { from: self.factor, ms, is_finer: false });
            return true;
        }
        self.leave_alone(now_ms, ms.max(trial.ms));
        self.set_factor(now_ms, trial.from);
        self.try_finer(now_ms, ms);
        false
    }

    /// A coarser picture is of no use for a while; a frame takes `ms`.
    fn leave_alone(&mut self, now_ms: f64, ms: f64) {
        self.useless = Some(Useless { until: now_ms + self.useless_wait, ms });
        self.useless_wait = (self.useless_wait * 2.0).min(LONGEST_MS);
    }

    /// Detail that an earlier scene could not afford may cost nothing in this one; a frame takes `ms` now.
    fn try_finer(&mut self, now_ms: f64, ms: f64) {
        if self.factor > 1.0 {
            self.trial = Some(Trial { from: self.factor, ms, is_finer: true });
            self.set_factor(now_ms, (self.factor / TRIAL).max(1.0));
        }
    }

    /// The factor in force is too fine.
    fn remember(&mut self, now_ms: f64) {
        if self.factor <= self.too_fine * 1.02 && now_ms >= self.believed_until {
            self.wait = (self.wait * 2.0).min(LONGEST_MS);
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
        let flown = fly_on(pace, |factor| device(full_ms, factor), from_ms, to_ms);
        flown.into_iter().map(|(_, took)| took).collect()
    }

    /// Move for a while on a device that takes `takes(factor)` milliseconds for a frame; factors and frame times of the last half.
    fn fly_on(pace: &mut Pace, takes: impl Fn(f64) -> f64, from_ms: f64, to_ms: f64) -> Vec<(f64, f64)> {
        let (mut now, mut frames) = (from_ms, Vec::new());
        let mut x = from_ms;
        while now < to_ms {
            x += 1.0;
            let factor = pace.frame(now, &View::north_from(x)) / pace.target();
            let took = takes(factor);
            now += took;
            if now > f64::midpoint(from_ms, to_ms) {
                frames.push((factor, took));
            }
        }
        frames
    }

    /// Share of the frames whose factor is at most this.
    fn share(frames: &[(f64, f64)], most: f64) -> f64 {
        frames.iter().filter(|(factor, _)| *factor <= most).count() as f64 / frames.len() as f64
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
    fn where_frames_take_as_long_with_few_triangles_the_picture_keeps_its_detail() {
        // A software renderer that fills pixels; 25 ms and 40 ms are within the limit of comfort, the others beyond it.
        for ms in [25.0, 40.0, 120.0, 300.0, 900.0] {
            let mut pace = Pace::new(1.0);
            let frames = fly_on(&mut pace, |_| ms, 0.0, 120_000.0);
            assert!(share(&frames, 1.0) > 0.9, "{ms}: at full detail only {} of the frames", share(&frames, 1.0));
            assert!(share(&frames, TRIAL * 2.0) >= 1.0, "{ms}: a trial goes too far");
        }
    }

    #[test]
    fn frame_times_that_vary_by_a_tenth_hide_neither_a_gain_nor_its_lack() {
        let count = std::cell::Cell::new(0_u32);
        let noise = || {
            count.set(count.get().wrapping_add(1));
            1.0 + 0.1 * libm::sin(f64::from(count.get()) * 2.4)
        };
        let mut pace = Pace::new(1.0);
        let frames = fly_on(&mut pace, |_| 250.0 * noise(), 0.0, 120_000.0);
        assert!(share(&frames, 1.0) > 0.9, "{}", share(&frames, 1.0));
        let mut pace = Pace::new(1.0);
        let frames = fly_on(&mut pace, |factor| 250.0 * noise() / factor, 0.0, 30_000.0);
        let late = frames.iter().filter(|(_, took)| *took > FLOOR_MS * 1.15).count();
        assert!(late * 10 <= frames.len(), "{late} of {} frames are late", frames.len());
    }

    #[test]
    fn only_so_much_detail_is_given_up_as_brings_faster_frames() {
        // 100 ms whatever is drawn, and 300 ms for all triangles.
        let mut pace = Pace::new(1.0);
        let frames = fly_on(&mut pace, |factor| 100.0 + 300.0 / factor, 0.0, 120_000.0);
        assert!(share(&frames, 1.5) < 0.1, "coarsening helps at first");
        assert!(share(&frames, 16.0) > 0.9, "and not any more at the end: {}", pace.factor());
    }

    #[test]
    fn detail_that_an_earlier_scene_could_not_afford_comes_back_where_it_costs_nothing() {
        let mut pace = Pace::new(1.0);
        fly(&mut pace, 600.0, 0.0, 20_000.0);
        assert!(pace.factor() > 4.0);
        let frames = fly_on(&mut pace, |_| 150.0, 20_000.0, 140_000.0);
        assert!(share(&frames, 1.0) > 0.9, "{}", share(&frames, 1.0));
    }

    #[test]
    fn a_scene_that_becomes_expensive_is_coarsened_although_that_was_of_no_use_before() {
        let mut pace = Pace::new(1.0);
        fly_on(&mut pace, |_| 100.0, 0.0, 60_000.0);
        let times = fly(&mut pace, 400.0, 60_000.0, 70_000.0);
        let late = times.iter().filter(|t| **t > FLOOR_MS * 1.05).count();
        assert!(late * 5 <= times.len(), "{late} of {} frames are late", times.len());
    }

    #[test]
    fn a_scene_that_becomes_slow_after_a_long_fast_flight_is_coarsened() {
        let mut pace = Pace::new(1.0);
        fly(&mut pace, 10.0, 0.0, 60_000.0);
        let times = fly(&mut pace, 45.0, 60_000.0, 64_000.0);
        let late = times.iter().filter(|t| **t > AIM_MS * 1.5).count();
        assert!(late * 5 <= times.len(), "{late} of {} frames are late", times.len());
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

//! How long jobs take, from those that were made: a range, from as fast as the fastest to as slow as the slowest of late, and nothing while too few were
//! measured.

use std::collections::VecDeque;
use std::time::Duration;

/// Jobs that are remembered, and how many it takes to say anything.
const REMEMBERED: usize = 16;
const ENOUGH: usize = 3;
/// The shortest estimate of a job, seconds: starting and writing take their time.
const MIN: f64 = 1.0;
/// Share of a job that must be done before its own progress says when it ends.
const TELLING: f64 = 0.1;
/// How far its own progress is trusted.
const TRUST: [f64; 2] = [0.7, 1.5];

/// A time in which something will probably have happened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Wait {
    pub(crate) from: Duration,
    pub(crate) to: Duration,
}

impl Wait {
    fn seconds(range: [f64; 2]) -> Self {
        // A year is more than anybody waits, and no overflow.
        let [from, to] = range.map(|s| Duration::from_secs_f64(s.clamp(0.0, 31_536_000.0)));
        Self { from, to }
    }
}

/// Seconds for each byte that a job was estimated to write, the last one at the end.
#[derive(Debug, Default)]
pub(super) struct Pace(VecDeque<f64>);

impl Pace {
    /// A job of so many bytes took so long.
    pub(super) fn add(&mut self, bytes: u64, took: Duration) {
        if self.0.len() >= REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back(took.as_secs_f64() / bytes.max(1) as f64);
    }

    /// Seconds that a job of so many bytes will take.
    fn whole(&self, bytes: u64) -> Option<[f64; 2]> {
        if self.0.len() < ENOUGH {
            return None;
        }
        let pick = |start: f64, pick: fn(f64, f64) -> f64| self.0.iter().copied().fold(start, pick);
        let range = [pick(f64::INFINITY, f64::min), pick(0.0, f64::max)];
        Some(range.map(|rate| (rate * bytes as f64).max(MIN)))
    }

    /// Seconds that are left of a job that runs, with the share of it that is done.
    fn left(&self, bytes: u64, (elapsed, done): (Duration, f64)) -> Option<[f64; 2]> {
        let elapsed = elapsed.as_secs_f64();
        if done >= TELLING {
            return Some(TRUST.map(|trust| elapsed * (1.0 - done).max(0.0) / done * trust));
        }
        self.whole(bytes).map(|range| range.map(|seconds| (seconds - elapsed).max(0.0)))
    }

    /// When a job that runs will have ended.
    pub(super) fn of_running(&self, bytes: u64, state: (Duration, f64)) -> Option<Wait> {
        self.left(bytes, state).map(Wait::seconds)
    }

    /// When a job of so many bytes will have ended that waits behind `running` and `waiting` ones for one of `workers`.
    pub(super) fn of_waiting(
        &self,
        bytes: u64,
        running: &[(u64, (Duration, f64))],
        waiting: &[u64],
        workers: usize,
    ) -> Option<Wait> {
        let mut before = [0.0; 2];
        let running = running.iter().map(|(bytes, state)| self.left(*bytes, *state));
        for range in running.chain(waiting.iter().map(|bytes| self.whole(*bytes))) {
            let range = range?;
            before = [before[0] + range[0], before[1] + range[1]];
        }
        let [from, to] = self.whole(bytes)?;
        let workers = workers.max(1) as f64;
        Some(Wait::seconds([before[0] / workers + from, before[1] / workers + to]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[expect(clippy::unnecessary_wraps, reason = "it is compared with what may say nothing")]
    fn wait(from: u64, to: u64) -> Option<Wait> {
        Some(Wait { from: Duration::from_secs(from), to: Duration::from_secs(to) })
    }

    #[test]
    fn no_estimate_is_given_before_enough_was_measured_and_then_a_range() {
        let mut pace = Pace::default();
        let second = Duration::from_secs(1);
        for seconds in [10, 40] {
            pace.add(1000, second * seconds);
            assert_eq!(pace.of_waiting(1000, &[], &[], 1), None);
        }
        pace.add(1000, second * 20);
        assert_eq!(pace.of_waiting(1000, &[], &[], 1), wait(10, 40));
        assert_eq!(pace.of_waiting(1000, &[], &[1000, 2000], 1), wait(40, 160));
        assert_eq!(pace.of_waiting(1000, &[(1000, (second * 5, 0.0))], &[], 1), wait(15, 75));
        assert_eq!(pace.of_waiting(1000, &[], &[1000, 1000], 2), wait(20, 80), "two workers");
        assert_eq!(pace.of_waiting(1, &[], &[], 1), wait(1, 1), "no job takes no time");
        (0..REMEMBERED).for_each(|_| pace.add(1000, second * 2));
        assert_eq!(pace.of_waiting(1000, &[], &[], 1), wait(2, 2), "what was long ago is forgotten");
    }

    #[test]
    fn a_running_job_is_estimated_from_its_own_progress() {
        let pace = Pace::default();
        let second = Duration::from_secs(1);
        assert_eq!(pace.of_running(1000, (second * 9, 0.05)), None);
        assert_eq!(pace.of_running(1000, (second * 10, 0.5)), wait(7, 15));
        assert_eq!(pace.of_running(u64::MAX, (second * 10, 1.0)), wait(0, 0));
    }
}

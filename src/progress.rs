//! Progress of long work for people: one bar on stderr over the whole of it, with the stage in progress and the time left, only where stderr is a terminal.

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Parts that a bar over the whole has.
const PARTS: f64 = 10_000.0;

/// One bar over the whole, with the stage in progress and the time left.
pub(crate) struct Bar {
    state: Mutex<State>,
    visible: bool,
}

struct State {
    stage: &'static str,
    bar: ProgressBar,
    /// When a share of the whole was first reported, and that share.
    first: Option<(Instant, f64)>,
}

impl Bar {
    /// A bar on stderr, or nothing where stderr is not a terminal.
    pub(crate) fn new() -> Self {
        let state = State { stage: "", bar: ProgressBar::hidden(), first: None };
        Self { state: Mutex::new(state), visible: std::io::stderr().is_terminal() }
    }

    /// What is being done.
    pub(crate) fn stage(&self, stage: &'static str) {
        if !self.visible {
            return;
        }
        let Ok(mut state) = self.state.lock() else { return };
        if state.stage != stage {
            if state.stage.is_empty() {
                state.bar = shown();
            }
            state.bar.set_prefix(stage);
            state.stage = stage;
        }
    }

    /// How much of the whole is done, 0 to 1.
    pub(crate) fn share(&self, share: f64) {
        if !self.visible {
            return;
        }
        let Ok(mut state) = self.state.lock() else { return };
        let (since, from) = *state.first.get_or_insert_with(|| (Instant::now(), share));
        state.bar.set_position((share * PARTS) as u64);
        if let Some(left) = time_left(since.elapsed(), share - from, 1.0 - share) {
            state.bar.set_message(format!("{} left", HumanDuration(left)));
        }
    }

    /// Print a line above the bar.
    pub(crate) fn say(&self, line: &str) {
        let Ok(state) = self.state.lock() else { return };
        state.bar.suspend(|| crate::terminal::say!("{line}"));
    }

    /// Take the bar away.
    pub(crate) fn clear(&self) {
        if let Ok(state) = self.state.lock() {
            state.bar.finish_and_clear();
        }
    }
}

/// The time for the rest of the work, estimated from the time that a part of it took, as shares of the whole; after too little work the estimate is useless.
fn time_left(elapsed: Duration, done: f64, rest: f64) -> Option<Duration> {
    (done > 0.02).then(|| elapsed.mul_f64(rest.max(0.0) / done))
}

fn shown() -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(PARTS as u64), ProgressDrawTarget::stderr_with_hz(5));
    if let Ok(style) = ProgressStyle::with_template("{prefix:>22} {wide_bar} {percent:>3} %  {msg}") {
        bar.set_style(style);
    }
    bar
}

impl kilwa_builder::Progress for Bar {
    fn update(&self, stage: &'static str, _done: u64, _total: u64) {
        self.stage(stage);
    }

    fn whole(&self, share: f64) {
        self.share(share);
    }

    fn note(&self, text: &str) {
        self.say(&format!("kilwa: {text}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_in_proportion_to_the_work_done() {
        let minute = Duration::from_secs(60);
        assert_eq!(time_left(minute, 0.01, 0.99), None, "too early");
        assert_eq!(time_left(minute, 0.25, 0.75), Some(3 * minute));
        // What was done before the clock began does not count.
        assert_eq!(time_left(minute, 0.5, 0.25), Some(minute / 2));
        assert_eq!(time_left(minute, 0.9, -0.1), Some(Duration::ZERO));
    }
}

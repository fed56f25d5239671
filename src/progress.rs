//! Progress of a build for people: one bar on stderr with the time left, only where stderr is a terminal.

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Parts that a bar over a whole build has.
const PARTS: f64 = 10_000.0;

/// One bar over a whole build, with the stage in progress and the time left.
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

    /// Take the bar away.
    pub(crate) fn clear(&self) {
        if let Ok(state) = self.state.lock() {
            state.bar.finish_and_clear();
        }
    }
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

    fn whole(&self, share: f64) {
        if !self.visible {
            return;
        }
        let Ok(mut state) = self.state.lock() else { return };
        let (since, from) = *state.first.get_or_insert_with(|| (Instant::now(), share));
        state.bar.set_position((share * PARTS) as u64);
        // The remaining time is estimated from the time so far; after too little work the estimate is useless.
        if share - from > 0.02 {
            let left = since.elapsed().as_secs_f64() * (1.0 - share).max(0.0) / (share - from);
            state.bar.set_message(format!("{} left", HumanDuration(Duration::from_secs_f64(left))));
        }
    }

    fn note(&self, text: &str) {
        let Ok(state) = self.state.lock() else { return };
        state.bar.suspend(|| crate::terminal::say!("kilwa: {text}"));
    }
}

//! Progress for people: one bar on stderr with the time left, only where stderr is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;

/// One bar that starts again with every stage.
pub(crate) struct Bar {
    state: Mutex<(&'static str, ProgressBar)>,
    visible: bool,
}

impl Bar {
    /// A bar on stderr, or nothing where stderr is no terminal.
    pub(crate) fn new() -> Self {
        Self { state: Mutex::new(("", ProgressBar::hidden())), visible: std::io::stderr().is_terminal() }
    }

    /// Take the bar away.
    pub(crate) fn clear(&self) {
        if let Ok(state) = self.state.lock() {
            state.1.finish_and_clear();
        }
    }
}

impl kilwa_builder::Progress for Bar {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        if !self.visible {
            return;
        }
        let Ok(mut state) = self.state.lock() else { return };
        if state.0 != stage {
            state.1.finish_and_clear();
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(5));
            let style = ProgressStyle::with_template("{prefix:>22} {wide_bar} {percent:>3} %  {eta} left");
            if let Ok(style) = style {
                bar.set_style(style);
            }
            bar.set_prefix(stage);
            *state = (stage, bar);
        }
        state.1.set_length(total);
        state.1.set_position(done);
    }
}

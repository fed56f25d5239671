//! Progress on standard error with the time left, only where that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use kilwa_pack::visible::visible;

/// One bar over all bytes that are to be read.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// A bar; it learns by and by how much there is.
    pub(crate) fn new() -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(5));
        let form = "{msg:>24!} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec} {eta} left";
        if let Ok(style) = ProgressStyle::with_template(form) {
            bar.set_style(style);
        }
        Self(bar)
    }

    /// Whether anybody sees it.
    pub(crate) fn is_shown(&self) -> bool {
        !self.0.is_hidden()
    }

    /// So many more bytes are to be read.
    pub(crate) fn expect(&self, bytes: u64) {
        self.0.inc_length(bytes);
    }

    /// So many were read.
    pub(crate) fn bytes(&self, bytes: u64) {
        self.0.inc(bytes);
    }

    /// What is being read.
    pub(crate) fn at(&self, what: &str) {
        self.0.set_message(visible(what).into_owned());
    }

    /// Print lines above the bar.
    pub(crate) fn above(&self, print: impl FnOnce()) {
        self.0.suspend(print);
    }

    /// Take the bar away.
    pub(crate) fn clear(&self) {
        self.0.finish_and_clear();
    }
}

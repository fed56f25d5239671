//! How long-running work reports its progress to the program. The library never prints.

use std::sync::atomic::{AtomicU64, Ordering};

/// Receives progress, from any thread, at most a few hundred thousand times in a build.
pub trait Progress: Sync {
    /// A stage has done `done` of `total` units of work; `stage` is a short phrase such as "simplifying".
    fn update(&self, stage: &'static str, done: u64, total: u64);

    /// About this share of the whole build is done, 0 to 1; never less than before.
    fn whole(&self, _share: f64) {}

    /// Something that a person should know while it happens, a sentence.
    fn note(&self, _text: &str) {}
}

/// Ignores everything.
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _stage: &'static str, _done: u64, _total: u64) {}
}

/// Where each stage lies in a whole build, estimated for a coloured mesh of some millions of triangles. Stages that are
/// not named here are short.
const SHARES: &[(&str, f64, f64)] = &[
    ("reading", 0.0, 0.03),
    ("hashing", 0.03, 0.04),
    ("finding corners", 0.04, 0.07),
    ("sorting into regions", 0.07, 0.10),
    ("joining triangles", 0.10, 0.14),
    ("filling leaves", 0.14, 0.16),
    ("simplifying", 0.16, 0.94),
    ("numbering", 0.94, 0.95),
    ("writing", 0.95, 0.96),
    ("checking", 0.96, 1.0),
];

/// Passes progress on and says how far the whole build is.
pub struct Whole<'a> {
    inner: &'a dyn Progress,
    /// The share reported last, in parts of 2^32.
    reported: AtomicU64,
}

impl<'a> Whole<'a> {
    /// Passes on to `inner`.
    pub fn new(inner: &'a dyn Progress) -> Self {
        Self { inner, reported: AtomicU64::new(0) }
    }
}

impl Progress for Whole<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.inner.update(stage, done, total);
        if let Some((_, from, to)) = SHARES.iter().find(|s| s.0 == stage) {
            let part = if total == 0 { 1.0 } else { (done as f64 / total as f64).min(1.0) };
            let share = ((from + (to - from) * part) * 2f64.powi(32)) as u64;
            let before = self.reported.fetch_max(share, Ordering::Relaxed);
            self.inner.whole(before.max(share) as f64 * 2f64.powi(-32));
        }
    }

    fn whole(&self, share: f64) {
        self.inner.whole(share);
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }
}

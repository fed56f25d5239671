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
    /// The share that delivering the input took, as the input reported it through [`Progress::whole`]; the stages share the rest.
    input: AtomicU64,
}

impl<'a> Whole<'a> {
    /// Passes on to `inner`.
    pub fn new(inner: &'a dyn Progress) -> Self {
        Self { inner, reported: AtomicU64::new(0), input: AtomicU64::new(0) }
    }
}

/// Fixed-point scale of shares.
const ONE: f64 = (1_u64 << 32) as f64;

impl Whole<'_> {
    /// Report a share of the whole, never less than before.
    fn report(&self, share: f64) {
        let share = (share * ONE) as u64;
        let before = self.reported.fetch_max(share, Ordering::Relaxed);
        self.inner.whole(before.max(share) as f64 / ONE);
    }
}

impl Progress for Whole<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.inner.update(stage, done, total);
        if let Some((_, from, to)) = SHARES.iter().find(|s| s.0 == stage) {
            let part = if total == 0 { 1.0 } else { (done as f64 / total as f64).min(1.0) };
            let input = self.input.load(Ordering::Relaxed) as f64 / ONE;
            self.report(input + (1.0 - input) * (from + (to - from) * part));
        }
    }

    fn whole(&self, share: f64) {
        self.input.fetch_max((share * ONE) as u64, Ordering::Relaxed);
        self.report(share);
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[derive(Default)]
    struct Kept(Mutex<Vec<f64>>);

    impl Progress for Kept {
        fn update(&self, _stage: &'static str, _done: u64, _total: u64) {}

        fn whole(&self, share: f64) {
            self.0.lock().unwrap().push(share);
        }
    }

    #[test]
    fn stages_share_the_progress_that_the_input_leaves() {
        let kept = Kept::default();
        let whole = Whole::new(&kept);
        whole.whole(0.25);
        whole.whole(0.5);
        whole.update("unknown", 1, 2);
        whole.update("simplifying", 0, 10);
        whole.update("reading", 0, 1);
        whole.update("checking", 1, 1);
        let shares = kept.0.into_inner().unwrap();
        let wanted = [0.25, 0.5, 0.58, 0.58, 1.0];
        assert!(shares.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6) && shares.len() == 5, "{shares:?}");
    }
}

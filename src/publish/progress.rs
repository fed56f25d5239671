//! Progress of `kilwa publish`: one bar from the first check to the last file, with the time left.
//!
//! Each stage has a share of the bar according to its expected time: stages that read the pack by its length, the pictures by their number. The figures
//! need only be right in proportion; the time left is estimated from how long the work has taken so far.

use crate::progress::Bar;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes per second at which a pack is checked, copied, hashed, rewritten and sent, on a laptop with an ordinary connection.
const CHECKED: f64 = 250e6;
const COPIED: f64 = 400e6;
const HASHED: f64 = 800e6;
const MOVED: f64 = 60e6;
const SENT: f64 = 5e6;
/// Bytes of the pack per second of which 3D Tiles are made.
const TILED: f64 = 10e6;
/// Bytes per second at which photographs are copied and read again.
const PHOTOGRAPHED: f64 = 250e6;
/// Bytes of photographs per second of which smaller copies are made.
const REDUCED: f64 = 30e6;
/// Seconds for the pictures of a small pack, and bytes of the pack for each further second: drawing time grows more slowly than the pack.
const PICTURES: f64 = 8.0;
const DRAWN: f64 = 200e6;
/// Seconds for the preview and for the records.
const PREVIEW: f64 = 2.0;
const RECORDS: f64 = 0.5;

/// Bytes that take time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lengths {
    pub(super) pack: u64,
    /// Those of photographs and masks.
    pub(super) photographs: u64,
}

impl From<u64> for Lengths {
    fn from(pack: u64) -> Self {
        Self { pack, photographs: 0 }
    }
}

/// What is being done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Check,
    CheckPhotographs,
    /// Making smaller copies of photographs.
    SmallerCopies,
    Copy,
    /// Writing the pack without its location, and checking the result.
    Redact,
    Hash,
    Pictures,
    Preview,
    Tiles,
    Photographs,
    Records,
    Send,
    /// Verification by the server that it was sent to.
    Verify,
}

impl Stage {
    fn name(self) -> &'static str {
        match self {
            Self::Check => "checking the pack",
            Self::CheckPhotographs => "checking the photographs",
            Self::SmallerCopies => "making smaller copies of the photographs",
            Self::Copy => "copying the pack",
            Self::Redact => "removing the location",
            Self::Hash => "hashing the pack",
            Self::Pictures => "drawing",
            Self::Preview => "making the preview",
            Self::Tiles => "writing 3D Tiles",
            Self::Photographs => "copying the photographs",
            Self::Records => "writing the records",
            Self::Send => "sending",
            Self::Verify => "verifying on the server",
        }
    }

    /// Seconds that it is expected to take for a pack and photographs of these lengths.
    fn seconds(self, lengths: Lengths) -> f64 {
        let (pack, photographs) = (lengths.pack as f64, lengths.photographs as f64);
        match self {
            Self::Check => pack / CHECKED,
            Self::Verify => pack / CHECKED + photographs / HASHED,
            Self::CheckPhotographs => photographs / HASHED,
            Self::SmallerCopies => photographs / REDUCED,
            Self::Photographs => photographs / PHOTOGRAPHED,
            Self::Copy => pack / COPIED,
            Self::Redact => pack / MOVED,
            Self::Hash => pack / HASHED,
            Self::Pictures => PICTURES + pack / DRAWN,
            Self::Preview => PREVIEW,
            Self::Tiles => pack / TILED,
            Self::Records => RECORDS,
            Self::Send => (pack + photographs) / SENT,
        }
    }
}

/// Shows a stage's name and how much of the whole is done, 0 to 1.
type Show = Box<dyn Fn(&'static str, f64) + Send + Sync>;

/// How far a publication has got.
pub(super) struct Progress {
    bar: Arc<Bar>,
    show: Show,
    /// Stages in their order, with the share of the whole at which each begins and ends.
    stages: Vec<(Stage, [f64; 2])>,
    now: Mutex<Now>,
}

struct Now {
    stage: Stage,
    /// How many parts of the stage are done, and how many there are; 0 if they are not counted.
    parts: [u64; 2],
    /// The share of the whole that is done; it never decreases.
    share: f64,
}

impl Progress {
    /// For a publication with these stages of a pack of this length in bytes, or with photographs; shown on standard error if that is a terminal.
    pub(super) fn new(stages: &[Stage], lengths: impl Into<Lengths>) -> Self {
        let bar = Arc::new(Bar::new());
        let shown = Arc::clone(&bar);
        let show = move |stage, share| {
            shown.stage(stage);
            shown.share(share);
        };
        Self::showing(stages, lengths.into(), bar, Box::new(show))
    }

    fn showing(stages: &[Stage], lengths: Lengths, bar: Arc<Bar>, show: Show) -> Self {
        let seconds: Vec<f64> = stages.iter().map(|stage| stage.seconds(lengths)).collect();
        let (all, mut at) = (seconds.iter().sum::<f64>(), 0.0);
        let mut stretch = |seconds: f64| {
            let from = at;
            at += seconds / all;
            [from, at]
        };
        let stages: Vec<_> = stages.iter().zip(seconds).map(|(stage, s)| (*stage, stretch(s))).collect();
        let stage = stages.first().map_or(Stage::Records, |(stage, _)| *stage);
        Self { bar, show, stages, now: Mutex::new(Now { stage, parts: [0; 2], share: 0.0 }) }
    }

    /// A stage begins, and those before it have ended.
    pub(super) fn begin(&self, stage: Stage) {
        self.change(|now| (now.stage, now.parts) = (stage, [0; 2]));
    }

    /// Report how many parts of the stage are done: bytes, rows or whatever it counts.
    pub(super) fn at(&self, done: u64, all: u64) {
        self.change(|now| now.parts = [done, all]);
    }

    /// Report that this many more bytes of a file of length `all` are done.
    pub(super) fn more(&self, bytes: u64, all: u64) {
        self.change(|now| now.parts = [now.parts[0] + bytes, all]);
    }

    fn change(&self, change: impl FnOnce(&mut Now)) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut now);
        let stage = now.stage;
        let Some((_, [from, to])) = self.stages.iter().find(|(s, _)| *s == stage) else { return };
        let [done, all] = now.parts;
        let part = if all == 0 { 0.0 } else { (done as f64 / all as f64).min(1.0) };
        now.share = now.share.max(from + (to - from) * part);
        (self.show)(stage.name(), now.share);
    }

    /// Print a line above the bar.
    pub(super) fn say(&self, line: &str) {
        self.bar.say(line);
    }

    /// Everything is done: remove the bar.
    pub(super) fn end(&self) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        now.share = 1.0;
        (self.show)(now.stage.name(), 1.0);
        self.bar.clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.clear();
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// What a reader would have seen: stages and shares.
    pub(in crate::publish) type Seen = Arc<Mutex<Vec<(&'static str, f64)>>>;

    /// Progress that only the test sees.
    pub(in crate::publish) fn watched(stages: &[Stage], pack: u64) -> (Progress, Seen) {
        let seen = Seen::default();
        let writer = Arc::clone(&seen);
        let show = move |stage, share| writer.lock().unwrap().push((stage, share));
        (Progress::showing(stages, pack.into(), Arc::new(Bar::new()), Box::new(show)), seen)
    }

    #[test]
    fn the_share_grows_from_stage_to_stage_and_is_whole_at_the_end() {
        let stages = [Stage::Check, Stage::Copy, Stage::Pictures, Stage::Records];
        let (progress, seen) = watched(&stages, 10_000_000_000);
        progress.begin(Stage::Check);
        progress.more(5_000_000_000, 10_000_000_000);
        progress.more(5_000_000_000, 10_000_000_000);
        progress.begin(Stage::Copy);
        progress.at(1, 2);
        // A stage that starts counting again never moves the bar back.
        progress.at(1, 4);
        progress.begin(Stage::Pictures);
        progress.at(3, 6);
        progress.begin(Stage::Records);
        progress.end();
        let seen = seen.lock().unwrap();
        let shares: Vec<f64> = seen.iter().map(|(_, share)| *share).collect();
        assert!(shares.is_sorted() && shares[0] == 0.0 && shares.last() == Some(&1.0), "{shares:?}");
        // 40 s, 25 s, 58 s and half a second are expected.
        let whole = 40.0 + 25.0 + 58.0 + 0.5;
        for (at, seconds) in [(1, 20.0), (2, 40.0), (3, 40.0), (4, 52.5), (5, 52.5), (6, 65.0), (7, 94.0), (8, 123.0)] {
            assert!((shares[at] - seconds / whole).abs() < 1e-9, "{at}: {shares:?}");
        }
    }

    #[test]
    fn a_small_pack_is_mostly_pictures_and_a_large_one_over_a_line_mostly_sending() {
        let stages = [Stage::Check, Stage::Hash, Stage::Pictures, Stage::Preview, Stage::Send, Stage::Verify];
        let share = |pack: u64, stage: Stage| {
            let (progress, _) = watched(&stages, pack);
            let (_, [from, to]) = progress.stages.iter().find(|(s, _)| *s == stage).copied().unwrap();
            to - from
        };
        assert!(share(1_000_000, Stage::Pictures) > 0.7);
        assert!(share(10_000_000_000, Stage::Send) > 0.8);
    }
}

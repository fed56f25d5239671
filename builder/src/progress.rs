//! How long work tells the program above how far it is. The library never prints.

/// Receives progress. Called from the building thread only, at most a few hundred times per stage.
pub trait Progress: Sync {
    /// A stage has done `done` of `total` units of work; `stage` is a short phrase such as "simplifying".
    fn update(&self, stage: &'static str, done: u64, total: u64);
}

/// Ignores everything.
pub struct Silent;

impl Progress for Silent {
    fn update(&self, _stage: &'static str, _done: u64, _total: u64) {}
}

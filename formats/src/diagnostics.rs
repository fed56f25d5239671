//! What was found and repaired while a mesh was read, counted.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How many places of each kind of diagnostic are kept for the report.
const PLACES_KEPT: usize = 5;

/// Pictures that vertices took their colours from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pictures {
    /// How many.
    pub count: u64,
    /// Their texels together.
    pub texels: u64,
}

impl Pictures {
    /// Add others.
    pub fn add(&mut self, other: Self) {
        self.count += other.count;
        self.texels += other.texels;
    }
}

/// Counted diagnostics, each with the first few places where it occurred.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Diagnostics {
    map: BTreeMap<&'static str, (u64, Vec<String>)>,
    /// Pictures that were decoded and used.
    pub pictures: Pictures,
}

impl Diagnostics {
    /// Count one diagnostic. `kind` is a sentence for people, for example "polygons triangulated"; `place` is made only
    /// while places are still being kept.
    pub fn add(&mut self, kind: &'static str, place: impl FnOnce() -> String) {
        let entry = self.map.entry(kind).or_default();
        entry.0 += 1;
        if entry.1.len() < PLACES_KEPT {
            entry.1.push(place());
        }
    }

    /// Count `n` diagnostics whose places are not kept.
    pub fn add_many(&mut self, kind: &'static str, n: u64) {
        if n > 0 {
            self.map.entry(kind).or_default().0 += n;
        }
    }

    /// All diagnostics: kind, count, first places.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64, &[String])> {
        self.map.iter().map(|(k, (n, places))| (*k, *n, places.as_slice()))
    }

    /// How often `kind` was found.
    pub fn count(&self, kind: &str) -> u64 {
        self.map.get(kind).map_or(0, |e| e.0)
    }

    /// Add all diagnostics of another.
    pub fn merge(&mut self, other: Self) {
        self.pictures.add(other.pictures);
        for (kind, (n, places)) in other.map {
            let entry = self.map.entry(kind).or_default();
            entry.0 += n;
            let room = PLACES_KEPT.saturating_sub(entry.1.len());
            entry.1.extend(places.into_iter().take(room));
        }
    }
}

//! Counted diagnostics that can be written down between stages.

use kilwa_formats::Diagnostics;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How many places of each kind are kept.
pub(super) const PLACES_KEPT: usize = 5;

/// Kinds of diagnostics with count and first places.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Tally(BTreeMap<String, (u64, Vec<String>)>);

impl Tally {
    /// Count `n` of a kind.
    pub(super) fn add_many(&mut self, kind: &str, n: u64) {
        if n > 0 {
            self.0.entry(kind.to_owned()).or_default().0 += n;
        }
    }

    /// Count one; `place` is made only while places are still kept.
    pub(super) fn add(&mut self, kind: &str, place: impl FnOnce() -> String) {
        if !self.0.contains_key(kind) {
            self.0.insert(kind.to_owned(), (0, Vec::new()));
        }
        if let Some(entry) = self.0.get_mut(kind) {
            entry.0 += 1;
            if entry.1.len() < PLACES_KEPT {
                entry.1.push(place());
            }
        }
    }

    /// Take over what a reader found.
    pub(super) fn take(&mut self, diagnostics: &Diagnostics) {
        for (kind, n, places) in diagnostics.iter() {
            self.merge_one(kind, n, places);
        }
    }

    /// Take over all of another.
    pub(super) fn merge(&mut self, other: &Self) {
        for (kind, (n, places)) in &other.0 {
            self.merge_one(kind, *n, places);
        }
    }

    fn merge_one(&mut self, kind: &str, n: u64, places: &[String]) {
        let entry = self.0.entry(kind.to_owned()).or_default();
        entry.0 += n;
        let remaining = PLACES_KEPT.saturating_sub(entry.1.len());
        entry.1.extend(places.iter().take(remaining).cloned());
    }

    /// How often `kind` was found.
    pub(super) fn count(&self, kind: &str) -> u64 {
        self.0.get(kind).map_or(0, |e| e.0)
    }

    /// Kind, count, first places; by kind.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&str, u64, &[String])> {
        self.0.iter().map(|(k, (n, places))| (k.as_str(), *n, places.as_slice()))
    }
}

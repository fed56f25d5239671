//! Prior knowledge of the poses of stations.

use super::doubt::{MAX_GROUP_CONTRADICTED, MAX_KNOWN_CONTRADICTED};
use super::group::Group;
use kilwa_scan_core::Pose;
use std::collections::BTreeMap;

/// Maximum error of a relative pose that counts as well known: metres, radians.
const WELL_KNOWN: [f64; 2] = [1.0, 0.175];
/// Tolerance for the errors of a fit before the adjustment: voxel edges, share of the distance, and radians.
const FIT: [f64; 3] = [2.0, 0.005, 0.02];

/// Prior knowledge of poses.
pub(super) struct Known {
    /// Stations whose poses are known, with these poses.
    pub(super) fixed: Vec<(usize, Pose)>,
    /// Approximate poses of stations.
    pub(super) guesses: Vec<Option<Guess>>,
    /// The pose of the second station relative to the first from control points; the first has the lower number.
    pub(super) controlled: BTreeMap<(usize, usize), Pose>,
    /// The edge of the smallest voxels, metres.
    pub(super) edge: f64,
}

impl Known {
    /// Whether a station is tied to others by control points.
    pub(super) fn is_controlled(&self, k: usize) -> bool {
        self.controlled.keys().any(|(a, b)| *a == k || *b == k)
    }

    pub(super) fn is_fixed(&self, k: usize) -> bool {
        self.fixed.iter().any(|(fixed, _)| *fixed == k)
    }

    fn reach(&self, k: usize) -> Option<(Pose, [f64; 2])> {
        self.guesses[k].and_then(|guess| Some((guess.pose, guess.reach?)))
    }

    /// Whether the poses of two stations are known so well that hardly any wrong pose agrees with them.
    pub(super) fn are_known(&self, a: usize, b: usize) -> bool {
        let reaches = self.reach(a).zip(self.reach(b)).map(|((_, a), (_, b))| [a[0] + b[0], a[1] + b[1]]);
        reaches.is_some_and(|reach| reach.iter().zip(WELL_KNOWN).all(|(own, most)| *own <= most))
    }

    /// The largest share of the surface of a station in the adjusted survey that may be contradicted.
    pub(super) fn most_contradicted(&self, k: usize) -> f64 {
        let is_known = (0..self.guesses.len()).any(|other| other != k && self.are_known(k, other));
        if is_known { MAX_KNOWN_CONTRADICTED } else { MAX_GROUP_CONTRADICTED }
    }

    /// The pose of the second station relative to the first from the approximate poses of both.
    pub(super) fn relative(&self, a: usize, b: usize) -> Option<Pose> {
        let (a, b) = self.guesses[a].zip(self.guesses[b])?;
        Some(b.pose.then(a.pose.inverse()))
    }

    /// Whether a pose of the second group relative to the first agrees with all known poses.
    pub(super) fn allows(&self, first: &Group, second: &Group, pose: Pose) -> bool {
        let known = |group: &Group| -> Vec<(Pose, Pose, [f64; 2])> {
            let of = |(k, own): &(usize, Pose)| self.reach(*k).map(|(pose, reach)| (*own, pose, reach));
            group.members.iter().filter_map(of).collect()
        };
        let (first, second) = (known(first), known(second));
        second.iter().all(|(own_b, b, reach_b)| {
            first.iter().all(|(own_a, a, reach_a)| {
                agrees(own_b.then(pose).then(own_a.inverse()), b.then(a.inverse()), *reach_a, *reach_b, self.edge)
            })
        })
    }

    /// The pose of the second group relative to the first that approximate poses suggest.
    pub(super) fn start(&self, first: &Group, second: &Group) -> Option<Pose> {
        let known = |group: &Group| group.members.iter().find_map(|(k, own)| Some((*own, self.guesses[*k]?.pose)));
        let ((own_a, a), (own_b, b)) = known(first).zip(known(second))?;
        Some(own_b.inverse().then(b).then(a.inverse()).then(own_a))
    }
}

/// An approximate pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guess {
    pub(super) pose: Pose,
    /// Its maximum error, if known: metres, radians.
    pub(super) reach: Option<[f64; 2]>,
}

/// Whether a candidate pose agrees with the approximate poses of both stations.
fn agrees(candidate: Pose, guess: Pose, a: [f64; 2], b: [f64; 2], edge: f64) -> bool {
    let (angle, off) = candidate.difference(guess);
    let distance = guess.translation.length();
    // An error in the heading of one station displaces the other.
    let reach = a[0] + b[0] + (a[1] + b[1]) * distance;
    angle <= a[1] + b[1] + FIT[2] && off <= reach + FIT[0] * edge + FIT[1] * distance
}

//! The report of a registration: links, the weakest chain, and the stations that could not be placed.

use super::doubt::{Doubt, Finding};
use super::group::{CandidatePose, Group};
use super::result::{Candidate, Link, Placement, Registration, Unplaced, quaternion};
use super::settle::Settled;
use super::view::{Verdict, View};
use crate::survey::Station;
use kilwa_scan_core::Pose;
use std::collections::BTreeMap;

/// Number of candidate poses listed for an unplaced station.
const CANDIDATES: usize = 3;

/// The data from which the report is made.
pub(super) struct Report<'a> {
    pub(super) views: &'a [View],
    pub(super) edge: f64,
    pub(super) stations: &'a [&'a Station],
    /// What was found for pairs of stations.
    pub(super) pairs: &'a BTreeMap<(usize, usize), Finding>,
    /// `survey_from_station` of those that are placed.
    pub(super) poses: BTreeMap<usize, Pose>,
    /// Stations that were placed at first and removed later.
    pub(super) dropped: BTreeMap<usize, Doubt>,
}

impl Report<'_> {
    fn name(&self, number: usize) -> String {
        self.stations[number].name.clone()
    }

    /// The links of a group, and its weakest chain.
    pub(super) fn links(&self, group: &Group, settled: &Settled, out: &mut Registration) {
        for ((a, b), link) in &settled.links {
            let [first, second] = [*a, *b].map(|k| group.members[k].0);
            let (va, vb) = (&self.views[first], &self.views[second]);
            let a_from_b = settled.poses[*b].then(settled.poses[*a].inverse());
            let forth = Verdict::one_way(va, &vb.samples, usize::MAX, a_from_b, self.edge);
            let back = Verdict::one_way(vb, &va.samples, usize::MAX, a_from_b.inverse(), self.edge);
            let share = |v: Verdict| f64::from(v.common()) / f64::from(v.planes.max(1));
            let sigma = link.covariance().map(|c| {
                let largest = |at: usize| c.fixed_view::<3, 3>(at, at).symmetric_eigenvalues().max().max(0.0).sqrt();
                [largest(3), largest(0)]
            });
            out.links.push(Link {
                stations: [self.name(first), self.name(second)],
                overlap: share(forth).max(share(back)),
                samples: link.matched as u64,
                residual: link.residual(),
                contradicted: forth.join(back).contradicted(),
                sigma: sigma.filter(|sigma| sigma.iter().all(|v| v.is_finite())),
            });
        }
        out.weakest_chain = weakest_chain(out);
    }

    /// The stations of a group that is not placed.
    pub(super) fn unplaced(&self, group: &Group, out: &mut Registration) {
        for (number, _) in &group.members {
            let mut found: Vec<(usize, Pose, &Finding, &CandidatePose)> = Vec::new();
            for ((a, b), finding) in self.pairs {
                let Some(best) = finding.candidates.first() else { continue };
                if a == number || b == number {
                    let (other, relative) = if a == number { (*b, best.pose.inverse()) } else { (*a, best.pose) };
                    found.push((other, relative, finding, best));
                }
            }
            found.sort_by(|x, y| y.3.score().total_cmp(&x.3.score()));
            // A candidate relative to a placed station is more useful than one relative to another unplaced station.
            let placed: Vec<_> = found.iter().filter(|(other, ..)| self.poses.contains_key(other)).copied().collect();
            let candidates = placed.iter().take(CANDIDATES).map(|(other, relative, _, best)| {
                let pose = relative.then(self.poses.get(other).copied().unwrap_or_default());
                self.candidate(*other, pose, best)
            });
            let candidates = candidates.collect();
            let companions = group.members.iter().filter(|(other, _)| other != number);
            let companions: Vec<String> = companions.map(|(other, _)| self.name(*other)).collect();
            let best = placed.first().or(found.first()).map(|f| (f.0, f.2));
            let (reason, remedy) = self.why(*number, best, &companions);
            out.unplaced.push(Unplaced {
                name: self.name(*number),
                scan: self.stations[*number].scan.clone(),
                reason,
                candidates,
                remedy,
            });
        }
    }

    fn candidate(&self, other: usize, pose: Pose, best: &CandidatePose) -> Candidate {
        let v = best.verdict;
        Candidate {
            matched_with: self.name(other),
            rotation: quaternion(pose),
            translation: pose.translation.to_array(),
            overlap: f64::from(v.common()) / f64::from(v.planes.max(1)),
            agreement: v.agreement(),
            contradicted: v.contradicted(),
            residual: v.residual(),
        }
    }

    /// The reason and the remedy.
    fn why(&self, own: usize, best: Option<(usize, &Finding)>, companions: &[String]) -> (String, String) {
        let points = "add three control points that this station and a placed station both observe to survey.toml, or add a pose with translation_sigma and rotation_sigma";
        let between = format!("scan from a position between it and the others, or {points}");
        let Some((other, finding)) = best else {
            return match self.views[own].image {
                Some(_) => ("it has no surface in common with any other station".to_owned(), between),
                None => (
                    "its rays are parallel, and such scans can only be placed near approximate poses".to_owned(),
                    "enter approximate poses (rotation and translation) for it and for another station in survey.toml"
                        .to_owned(),
                ),
            };
        };
        let other = self.name(other);
        let v = finding.candidates.first().map(|best| best.verdict).unwrap_or_default();
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let (reason, remedy) = match self.dropped.get(&own).copied().or(finding.doubt) {
            Some(Doubt::Unlinked) => (
                format!("the surface it shares with {other} and others is too small to determine its pose precisely"),
                between,
            ),
            Some(Doubt::Adjusted) => (
                format!("after the adjustment of all stations, its pose contradicts what {other} and others measured"),
                points.to_owned(),
            ),
            Some(Doubt::Known) => (
                format!(
                    "none of the poses in which it fits {other} agrees with the poses and standard deviations in survey.toml"
                ),
                "check rotation, translation and their standard deviations in survey.toml, or use `--ignore-poses`"
                    .to_owned(),
            ),
            Some(Doubt::None | Doubt::Little) => (
                format!(
                    "it has too little surface in common with other stations; the best match is {other}, where {} of {} samples agree",
                    v.agree, v.planes
                ),
                between,
            ),
            Some(Doubt::Contradicted) => (
                format!(
                    "its best pose relative to {other} is not reliable: {} of the surface that both should see agrees, and rays of one station pass through {} of it",
                    percent(v.agreement()),
                    percent(v.contradicted())
                ),
                between,
            ),
            Some(Doubt::Loose) => (
                format!(
                    "the surface it shares with {other} does not constrain its pose in every direction, as in a corridor or at a flat wall"
                ),
                between,
            ),
            Some(Doubt::Ambiguous) => (
                format!(
                    "it fits {other} in {} different poses, as in a symmetric tower or in similar rooms",
                    finding.candidates.len()
                ),
                points.to_owned(),
            ),
            Some(Doubt::Inconsistent) => (
                format!(
                    "its poses relative to {other} and to other stations contradict each other, as happens with similar rooms"
                ),
                points.to_owned(),
            ),
            None => {
                (format!("its pose relative to {other} contradicts what other stations measured"), points.to_owned())
            }
        };
        if companions.is_empty() {
            return (reason, remedy);
        }
        (format!("it was registered to {}, but not to the rest of the survey: {reason}", companions.join(", ")), remedy)
    }
}

/// The stations on the path from the anchor or a fixed station to the station with the largest standard deviation, along the links with the smallest total variance.
fn weakest_chain(found: &Registration) -> Vec<String> {
    let certain = Placement::is_given;
    let worst =
        found.stations.iter().filter(|s| !certain(s.placement)).max_by(|a, b| a.sigma()[0].total_cmp(&b.sigma()[0]));
    let Some(worst) = worst else { return Vec::new() };
    // Variances add up along a chain (Dijkstra, 1959).
    let mut best: BTreeMap<&str, (f64, Option<&str>)> = BTreeMap::new();
    let mut done: Vec<&str> = Vec::new();
    for station in found.stations.iter().filter(|s| certain(s.placement)) {
        best.insert(&station.name, (0.0, None));
    }
    while let Some((name, variance)) = best
        .iter()
        .filter(|(name, _)| !done.contains(*name))
        .min_by(|a, b| a.1.0.total_cmp(&b.1.0))
        .map(|(name, (variance, _))| (*name, *variance))
    {
        done.push(name);
        for link in &found.links {
            let [a, b] = &link.stations;
            let Some(sigma) = link.sigma else { continue };
            let other = if a == name {
                b
            } else if b == name {
                a
            } else {
                continue;
            };
            let sum = variance + sigma[0] * sigma[0];
            if best.get(other.as_str()).is_none_or(|(old, _)| sum < *old) {
                best.insert(other, (sum, Some(name)));
            }
        }
    }
    let mut chain = vec![worst.name.clone()];
    let mut at = worst.name.as_str();
    while let Some((_, Some(before))) = best.get(at) {
        chain.push((*before).to_owned());
        at = before;
    }
    chain.reverse();
    chain
}

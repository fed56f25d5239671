//! The last steps for the group that becomes the survey: it is aligned with known poses and points, its poses are adjusted together, and the result is checked.

use super::align::{align, survey_points};
use super::control::{self, Sighting, rigid};
use super::doubt::{Doubt, MIN_AGREE, MIN_AGREEMENT};
use super::group::{Group, verdict};
use super::known::{Guess, Known};
use super::report::Report;
use super::result::{Placed, Placement, Registration};
use super::settle::{Given, Settled, settle};
use super::view::{Verdict, View};
use super::{SURE, Work};
use crate::ScanError;
use crate::import::Progress;
use kilwa_scan_core::Pose;
use rayon::prelude::*;

/// Two stations whose poses are given contradict each other if rays of one pass through more than this share of what the other saw.
const MAX_GIVEN_CONTRADICTED: f64 = 0.15;
/// Maximum increase of the contradicted share of a surface during the adjustment.
const MAX_WORSE: f64 = 0.02;

impl Work<'_> {
    /// Reports an error if the given poses of two stations contradict each other.
    pub(super) fn check_known(&self, views: &[View], edge: f64, known: &Known) -> Result<(), ScanError> {
        let is_checked = |k: usize, other: usize| self.is_fixed[k] || self.is_fixed[other];
        for (n, (b, b_pose)) in known.fixed.iter().enumerate() {
            for (a, a_pose) in known.fixed[..n].iter().filter(|(a, _)| is_checked(*a, *b)) {
                let v = verdict(views, &[(*a, *a_pose)], &[(*b, *b_pose)], Pose::IDENTITY, edge, usize::MAX);
                if v.common() >= MIN_AGREE && v.contradicted() > MAX_GIVEN_CONTRADICTED {
                    return Err(ScanError::Request(format!(
                        "the poses of stations {} and {} contradict each other: rays of one pass through {:.0} % of what the other saw; fix only stations whose poses are correct",
                        self.stations[*a].name,
                        self.stations[*b].name,
                        100.0 * v.contradicted()
                    )));
                }
            }
        }
        Ok(())
    }

    /// Places the stations of a group, except those that the adjustment shows to be wrong or not connected to the others.
    pub(super) fn place(
        &self,
        mut group: Group,
        known: &Known,
        report: &mut Report<'_>,
        out: &mut Registration,
        progress: &(dyn Progress + Sync),
    ) -> Result<(), ScanError> {
        let mut are_points_unused = false;
        loop {
            if group.members.len() < 2 && !group.members.iter().any(|(k, _)| self.keeps_pose[*k]) {
                // The last member has lost all its partners.
                let left = group.members.first().filter(|_| !report.dropped.is_empty());
                report.dropped.extend(left.map(|(number, _)| (*number, Doubt::Unlinked)));
                return Ok(());
            }
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            progress.update("adjusting all poses", 0, 1);
            let mut given = self.given(&group);
            given.is_located = align(&mut group.members, &given);
            // The coordinate system of an earlier registration is arbitrary.
            let has_frame = !given.priors.is_empty() || group.members.iter().any(|(k, _)| self.is_fixed[*k]);
            let determine = rigid(&survey_points(&group.members, &given)).is_some();
            if !has_frame && !determine && given.controls.drop_survey_points() {
                are_points_unused = true;
            }
            let lost = match settle(report.views, &group, &given, report.edge) {
                Err(lost) => lost.into_iter().map(|member| (member, Doubt::Unlinked)).collect(),
                Ok(settled) => {
                    self.check_points(&group, &given, &settled)?;
                    let worst = self.worst(report.views, &group, &settled, known, report.edge);
                    if worst.is_none() {
                        if are_points_unused {
                            out.notes.push("there are fewer than three control points with survey coordinates, or they are collinear, so they do not determine the position of the survey and were not used".to_owned());
                        }
                        self.enter(&group, &given, settled, report, out);
                        return Ok(());
                    }
                    worst.map(|member| (member, Doubt::Adjusted)).into_iter().collect::<Vec<_>>()
                }
            };
            if lost.is_empty() {
                return Err(ScanError::Request(
                    "the poses cannot be adjusted, because the equations have no solution; try `--ignore-poses`, and check the control points in survey.toml".to_owned(),
                ));
            }
            let numbers: Vec<(usize, Doubt)> = lost.iter().map(|(k, doubt)| (group.members[*k].0, *doubt)).collect();
            for (number, doubt) in numbers {
                report.dropped.insert(number, doubt);
                group = group.without(number, report.views);
            }
        }
    }

    /// The known poses and control points of the members of a group, by their indices in it.
    fn given(&self, group: &Group) -> Given {
        let numbers = || group.members.iter().map(|(number, _)| *number);
        let kept_poses = numbers().map(|k| self.stations[k].pose.filter(|_| self.keeps_pose[k])).collect();
        let of_member = |k: usize| numbers().position(|own| own == k);
        let prior = |(member, k): (usize, usize)| self.prior(k).map(|(pose, sigma)| (member, pose, sigma));
        let mut priors: Vec<_> = numbers().enumerate().filter_map(prior).collect();
        let mut controls = self.controls.clone();
        for sightings in controls.points.values_mut() {
            sightings.retain_mut(|sighting| {
                let member = sighting.station.map(of_member);
                sighting.station = member.flatten();
                member.is_none_or(|member| member.is_some())
            });
        }
        controls.points.retain(|_, all| all.len() > 1);
        let is_exact = |k: usize| {
            let placed = self.before.as_ref().and_then(|before| before.of(self.stations[k]));
            self.is_fixed[k] || self.keeps_pose[k] && placed.is_some_and(|placed| placed.placement.is_given())
        };
        let are_exact: Vec<bool> = numbers().map(is_exact).collect();
        if !are_exact.contains(&true) {
            // The survey was located by known poses: they do not move what is registered, but it is only as certain as they are.
            let kept = numbers().enumerate().filter(|(_, k)| self.keeps_pose[*k]);
            priors.extend(kept.filter_map(|(member, k)| {
                let stated = self.stated[k]?;
                Some((member, stated.pose(), stated.sigma?))
            }));
        }
        Given { kept_poses, are_exact, priors, controls, is_located: false }
    }

    /// Reports an error if control points contradict the scans, or each other across several stations; the message names the worst one.
    fn check_points(&self, group: &Group, given: &Given, settled: &Settled) -> Result<(), ScanError> {
        let at = |s: &Sighting| s.station.map_or(s.at, |member| settled.poses[member].apply(s.at));
        let mut worst: Option<(f64, &str, [&Sighting; 2])> = None;
        for (point, sightings) in &given.controls.points {
            for (k, b) in sightings.iter().enumerate() {
                for a in &sightings[..k] {
                    let is_kept = |s: &Sighting| s.station.is_none_or(|member| given.kept_poses[member].is_some());
                    let excess = at(a).distance(at(b)) / control::tolerance(a, b);
                    // If neither station is being registered now, this run cannot reduce the difference.
                    let moves = !(is_kept(a) && is_kept(b));
                    if moves && excess > worst.as_ref().map_or(1.0, |worst| worst.0) {
                        worst = Some((excess, point, [a, b]));
                    }
                }
            }
        }
        let Some((_, point, [a, b])) = worst else { return Ok(()) };
        let is_kept = group.members.iter().any(|(k, _)| self.keeps_pose[*k] && !self.is_fixed[*k]);
        let hint = if is_kept { "; if they were added after the last registration, use `--again`" } else { "" };
        let name = |s: &Sighting| self.name(s.station.map(|member| group.members[member].0));
        Err(ScanError::Request(format!(
            "control point {point} does not fit: after the adjustment of all stations, its coordinates in {} and in {} differ by {:.3} m; check them in survey.toml{hint}",
            name(b),
            name(a),
            at(a).distance(at(b))
        )))
    }

    /// The member that contradicts the others most, if any does. Stations that keep their poses are not checked; for stations placed by control
    /// points, only rays that pass through the surface of others count.
    fn worst(&self, views: &[View], group: &Group, settled: &Settled, known: &Known, edge: f64) -> Option<usize> {
        let poses: Vec<(usize, Pose)> =
            group.members.iter().zip(&settled.poses).map(|((number, _), pose)| (*number, *pose)).collect();
        let of = |member: usize, poses: &[(usize, Pose)]| -> Verdict {
            let rest: Vec<(usize, Pose)> =
                poses.iter().enumerate().filter(|(k, _)| *k != member).map(|(_, own)| *own).collect();
            verdict(views, &rest, &poses[member..=member], Pose::IDENTITY, edge, usize::MAX)
        };
        let judge = |member: usize| -> Option<(usize, f64)> {
            let number = group.members[member].0;
            let before = (!self.keeps_pose[number]).then(|| of(member, &group.members))?;
            let now = of(member, &poses);
            if known.is_controlled(number) || known.is_fixed(number) {
                let is_wrong = now.common() >= MIN_AGREE && now.contradicted() > MAX_GIVEN_CONTRADICTED;
                return is_wrong.then(|| (member, now.contradicted()));
            }
            let most =
                known.most_contradicted(number).max((before.contradicted() + MAX_WORSE).min(MAX_GIVEN_CONTRADICTED));
            let is_wrong = now.contradicted() > most
                || now.agreement() < MIN_AGREEMENT.min(before.agreement() - MAX_WORSE)
                || now.agree < MIN_AGREE.min(before.agree / 2);
            is_wrong.then(|| (member, now.contradicted()))
        };
        let wrong: Vec<(usize, f64)> = (0..poses.len()).into_par_iter().filter_map(judge).collect();
        wrong.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).map(|(member, _)| member)
    }

    /// Enter the poses of a group into the result.
    fn enter(
        &self,
        group: &Group,
        given: &Given,
        mut settled: Settled,
        report: &mut Report<'_>,
        out: &mut Registration,
    ) {
        let anchor = settled.is_fixed.iter().position(|fixed| *fixed).filter(|_| !given.is_located);
        if let Some(anchor) = anchor {
            let guess: Option<Guess> = self.guess(group.members[anchor].0);
            settled.move_to(anchor, guess.map_or(Pose::IDENTITY, |guess| guess.pose));
        }
        let of_controls = |k: usize| {
            given.controls.points.values().filter(|all| all.iter().any(|s| s.station == Some(k))).count()
                >= control::MIN_POINTS
        };
        for (k, (pose, covariance)) in settled.poses.iter().zip(&settled.covariances).enumerate() {
            let number = group.members[k].0;
            let placement = match () {
                () if anchor == Some(k) => Placement::Anchor,
                () if settled.is_fixed[k] => Placement::Fixed,
                () if of_controls(k) => Placement::Control,
                () => Placement::Surface,
            };
            report.poses.insert(number, *pose);
            if let Some((known, sigma)) = self.prior(number) {
                let (angle, distance) = pose.difference(known);
                if distance > SURE * sigma[0] || angle > SURE * sigma[1] {
                    out.notes.push(format!(
                        "the pose of station {} in survey.toml differs by {distance:.3} m and {:.2}° from the pose in which it fits the others, which is more than {SURE} standard deviations; check the pose and its standard deviations",
                        self.stations[number].name,
                        angle.to_degrees()
                    ));
                }
            }
            let station = self.stations[number];
            let is_kept = settled.is_fixed[k] && !self.options.again && !self.is_fixed[number];
            let kept = self.before.as_ref().filter(|_| is_kept).and_then(|before| before.of(station));
            let kept = kept.map(|placed| Placed { name: station.name.clone(), ..placed.clone() });
            out.stations.push(kept.unwrap_or_else(|| Placed {
                stated: self.stated[number].filter(|stated| {
                    let (angle, distance) = stated.pose().difference(*pose);
                    placement != Placement::Fixed || stated.sigma.is_some() || angle > 1e-9 || distance > 1e-9
                }),
                ..Placed::new(
                    station,
                    placement,
                    *pose,
                    std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
                )
            }));
        }
        report.links(group, &settled, out);
    }
}

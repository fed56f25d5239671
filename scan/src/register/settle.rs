//! The last step: joint adjustment of all poses of a group, with their covariances.

use super::SURE;
use super::align::align;
use super::control::{Controls, rigid, tolerance};
use super::group::Group;
use super::view::View;
use glam::{DMat3, DQuat, DVec3};
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::adjust::{Link, Party, Prior, Reach, System};
use nalgebra::{Matrix3, Matrix6, Vector6};
use rayon::prelude::*;

/// Maximum distances of matching surfaces, in voxel edges, and the number of rounds for each.
const REACHES: [(f64, usize); 4] = [(2.0, 3), (1.0, 3), (0.5, 4), (0.35, 8)];
/// Index of the first reach at which known poses and control points are used. Before that, distances are large and have little weight, so one wrong
/// point would pull a station away from its neighbours.
const KNOWN_FROM: usize = 2;
/// The number of neighbouring distances that carry as much information as a single independent one, because their errors are correlated; the weight of known poses and points is larger by this factor.
const CORRELATED: f64 = 25.0;
/// Factor by which the tolerance for known poses and points is larger at first: a long chain of stations may have to bend.
const PATIENCE: f64 = 4.0;
/// Minimum number of planes of a link.
const MIN_MATCHED: usize = 60;
/// The edge of the cubes within which errors may be correlated, in voxel edges.
const CLUSTER: f64 = 12.0;

/// Factor by which covariances are multiplied: errors that all stations have in common do not show in the distances between them. The value is chosen so that the true errors
/// of simulated surveys lie in the stated regions (docs/bench, `cargo xtask bench register`).
const CAUTION: f64 = 2.5;

/// The adjusted poses.
pub(super) struct Settled {
    pub(super) poses: Vec<Pose>,
    pub(super) covariances: Vec<Matrix6<f64>>,
    /// Stations that did not move: the fixed ones, or the anchor.
    pub(super) is_fixed: Vec<bool>,
    /// Pairs of members (their indices in the group), with their equations.
    pub(super) links: Vec<((usize, usize), Link)>,
}

impl Settled {
    /// Move everything so that this member has this pose.
    pub(super) fn move_to(&mut self, member: usize, pose: Pose) {
        let step = self.poses[member].inverse().then(pose);
        self.poses.iter_mut().for_each(|own| *own = own.then(step));
        let turn = DMat3::from_quat(step.rotation);
        let turn = Matrix3::from_fn(|row, column| turn.col(column)[row]);
        let mut both = Matrix6::zeros();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
        both.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        self.covariances.iter_mut().for_each(|c| *c = both * *c * both.transpose());
    }
}

/// Constraints on poses other than the surface.
pub(super) struct Given {
    /// The poses of members that keep them.
    pub(super) kept_poses: Vec<Option<Pose>>,
    /// Whether these poses are exact; poses kept from an earlier registration have errors.
    pub(super) are_exact: Vec<bool>,
    /// Poses of members that are known with standard deviations (metres, radians).
    pub(super) priors: Vec<(usize, Pose, [f64; 2])>,
    /// Control points; stations are numbers of members.
    pub(super) controls: Controls,
    /// Whether kept poses, known poses or control points determine the position of the group.
    pub(super) is_located: bool,
}

/// The members of a group while they are adjusted.
struct Adjustment<'a> {
    views: &'a [View],
    group: &'a Group,
    given: &'a Given,
    is_fixed: Vec<bool>,
    poses: Vec<Pose>,
    pairs: Vec<(usize, usize)>,
    uses_known: bool,
    /// Factor by which the tolerance for known poses and points is currently larger; see [`PATIENCE`].
    patience: f64,
    /// The scale of the robust weights, metres.
    sigma: f64,
}

impl Adjustment<'_> {
    fn compare(&self, reach: f64, cluster: f64) -> Vec<((usize, usize), Link)> {
        let party = |k: usize| {
            let view = &self.views[self.group.members[k].0];
            Party { shape: &view.shape, samples: &view.points, pose: self.poses[k] }
        };
        let reach = Reach { reach, sigma: self.sigma, cluster };
        let of_pair = |(a, b): &(usize, usize)| ((*a, *b), Link::compare(party(*a), party(*b), reach));
        let mut links: Vec<_> = self.pairs.par_iter().map(of_pair).collect();
        links.retain(|(_, link)| link.matched >= MIN_MATCHED);
        links
    }

    /// Aligns the stations, which fit each other by now, with the known poses and points, and uses these from now on.
    fn use_known(&mut self) {
        self.uses_known = true;
        if !self.given.is_located {
            return;
        }
        self.is_fixed = self.given.kept_poses.iter().map(Option::is_some).collect();
        let mut members: Vec<(usize, Pose)> = self.poses.iter().copied().enumerate().collect();
        align(&mut members, self.given);
        self.poses = members.into_iter().map(|(_, pose)| pose).collect();
    }

    /// The Geman–McClure weight of a known pose or point whose error is `excess` times the tolerance: one wrong point must not pull a station away
    /// from its neighbours. The error is reported afterwards.
    fn robust(&self, excess: f64) -> f64 {
        let w = 1.0 / (1.0 + (excess / self.patience).powi(2));
        w * w
    }

    /// The variance of a distance, square metres.
    fn variance(&self) -> f64 {
        0.25 * self.sigma * self.sigma
    }

    fn system(&self, links: &[((usize, usize), Link)], is_fixed: &[bool]) -> System {
        let mut system = System::new(is_fixed);
        for ((a, b), link) in links {
            system.add(*a, *b, link);
        }
        if !self.uses_known {
            return system;
        }
        let variance = CORRELATED * self.variance();
        for (member, pose, [metres, radians]) in &self.given.priors {
            let own = self.poses[*member];
            let turn = rotation_vector(own.rotation * pose.rotation.inverse());
            let shift = own.translation - pose.translation;
            let robust = self.robust((turn.length() / radians).max(shift.length() / metres) / SURE);
            let weights = [radians, metres].map(|sigma| robust / (sigma * sigma));
            let information = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| weights[k / 3]));
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            system.add_prior(&Prior { station: *member, error, information }, variance);
        }
        for sightings in self.given.controls.points.values() {
            // All differences of n observations together carry as much information as n - 1 independent ones.
            let share = (sightings.len() as f64 / 2.0).sqrt();
            for (k, b) in sightings.iter().enumerate() {
                let Some(second) = b.station.map(|member| (member, self.poses[member], b.at)) else { continue };
                for a in &sightings[..k] {
                    let first = a.station.map(|member| (member, self.poses[member], a.at));
                    let place = |(_, pose, at): (usize, Pose, DVec3)| pose.apply(at);
                    let distance = place(second).distance(first.map_or(a.at, place));
                    let share = share / self.robust(distance / tolerance(a, b)).sqrt();
                    system.add_point(first, second, a.at, share * a.sigma.hypot(b.sigma), variance);
                }
            }
        }
        system
    }

    /// Members that neither links nor control points connect to a known pose or point.
    fn loose(&self, links: &[((usize, usize), Link)]) -> Vec<usize> {
        let n = self.poses.len();
        let mut parts: Vec<usize> = (0..n).collect();
        let mut join = |a: usize, b: usize| {
            let (from, to) = (parts[a].max(parts[b]), parts[a].min(parts[b]));
            parts.iter_mut().filter(|part| **part == from).for_each(|part| *part = to);
        };
        for ((a, b), _) in links {
            join(*a, *b);
        }
        let is_tied = |a: Option<usize>, b: usize| self.given.controls.are_tied(a, Some(b));
        for b in 0..n {
            (0..b).filter(|a| is_tied(Some(*a), b)).for_each(|a| join(a, b));
        }
        let is_known =
            |k: usize| self.is_fixed[k] || self.given.priors.iter().any(|prior| prior.0 == k) || is_tied(None, k);
        let mut known: Vec<usize> = (0..n).filter(|k| is_known(*k)).map(|k| parts[k]).collect();
        // Several stations may each have seen one or two points with survey coordinates.
        let points = self.given.controls.with_survey_coordinates();
        for part in parts.iter().filter(|_| self.given.is_located) {
            let own = points.iter().filter(|(k, ..)| parts[*k] == *part);
            let own: Vec<(DVec3, DVec3)> = own.map(|(k, at, known, _)| (*known, self.poses[*k].apply(*at))).collect();
            known.extend(rigid(&own).is_some().then_some(*part));
        }
        (0..n).filter(|k| !known.contains(&parts[*k])).collect()
    }

    /// The covariance of each member's pose. Stations that keep their poses from an earlier registration do not move, but their poses have errors, which the others share.
    fn covariances(&self, links: &[((usize, usize), Link)]) -> Option<Vec<Matrix6<f64>>> {
        let is_exact =
            |k: usize| if self.given.kept_poses[k].is_some() { self.given.are_exact[k] } else { self.is_fixed[k] };
        let mut exact: Vec<bool> = (0..self.poses.len()).map(is_exact).collect();
        let has_points = !self.given.controls.with_survey_coordinates().is_empty();
        if !exact.contains(&true) && self.given.priors.is_empty() && !has_points {
            exact.clone_from(&self.is_fixed);
        }
        let variance = CORRELATED * self.variance();
        self.system(links, &exact).covariances(variance, CAUTION)
    }
}

/// The rotation as an axis times an angle of at most half a turn: a quaternion and its negative are the same rotation.
pub(super) fn rotation_vector(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    rotation.to_scaled_axis()
}

/// Adjust the members of a group.
///
/// # Errors
/// The members that are not connected to a station that keeps its pose, a known pose, or the anchor: their poses would be undetermined.
pub(super) fn settle(views: &[View], group: &Group, given: &Given, edge: f64) -> Result<Settled, Vec<usize>> {
    let n = group.members.len();
    let all: Vec<(usize, usize)> = (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    let mut work = Adjustment {
        views,
        group,
        given,
        is_fixed: given.kept_poses.iter().map(Option::is_some).collect(),
        poses: group.members.iter().map(|(_, pose)| *pose).collect(),
        pairs: all.clone(),
        uses_known: false,
        patience: PATIENCE,
        sigma: edge / 3.0,
    };
    for (number, (reach, rounds)) in REACHES.into_iter().enumerate() {
        // Stations may have come near each other since, as at the ends of a loop.
        work.pairs.clone_from(&all);
        if number == KNOWN_FROM {
            work.use_known();
        }
        if number + 1 == REACHES.len() {
            work.patience = 1.0;
        }
        for _ in 0..rounds {
            let links = work.compare(reach * edge, 0.0);
            if number > 0 {
                work.pairs = links.iter().map(|(pair, _)| *pair).collect();
            }
            if !(work.is_fixed.contains(&true) || given.is_located && work.uses_known) {
                work.is_fixed[anchor(n, &links)] = true;
            }
            let moved = work.system(&links, &work.is_fixed).solve(&mut work.poses);
            // Without links, control points may still connect the stations.
            let Some([angle, distance]) = moved else { break };
            let mut all: Vec<f32> = links.iter().flat_map(|(_, link)| &link.distances).copied().collect();
            all.sort_unstable_by(f32::total_cmp);
            if let Some(median) = all.get(all.len() / 2) {
                // Twice the standard deviation, if errors are normal but for outliers.
                work.sigma = (2.0 * 1.483 * f64::from(*median)).clamp(1e-4 * edge, reach * edge / 2.0);
            }
            if angle < 1e-7 && distance < 1e-6 * edge {
                break;
            }
        }
    }
    let links = work.compare(REACHES[REACHES.len() - 1].0 * edge, CLUSTER * edge);
    let loose = work.loose(&links);
    if !loose.is_empty() {
        return Err(loose);
    }
    let covariances =
        work.covariances(&links).ok_or_else(|| (0..n).filter(|k| !work.is_fixed[*k]).collect::<Vec<_>>())?;
    Ok(Settled { poses: work.poses, covariances, links, is_fixed: work.is_fixed })
}

/// The station with the most surface in common with others: poses relative to it are the most certain.
fn anchor(n: usize, links: &[((usize, usize), Link)]) -> usize {
    let mut sums = vec![0.0; n];
    for ((a, b), link) in links {
        sums[*a] += link.squares[1];
        sums[*b] += link.squares[1];
    }
    (0..n).rev().max_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0)
}

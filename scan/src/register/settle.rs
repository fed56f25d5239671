//! The last step: joint adjustment of all poses of a group, with their covariances.

use super::control::Controls;
use super::group::Group;
use super::view::View;
use glam::{DMat3, DQuat, DVec3};
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::adjust::{Link, Party, Prior, Reach, System};
use nalgebra::{Matrix3, Matrix6, Vector6};
use rayon::prelude::*;

/// Maximum distances of matching surfaces, in voxel edges, and the number of rounds for each.
const REACHES: [(f64, usize); 4] = [(2.0, 3), (1.0, 3), (0.5, 4), (0.35, 8)];
/// Fewest planes of a link.
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
    /// Pairs of members (their places in the group), with their equations.
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
    /// Which members keep their poses.
    pub(super) is_fixed: Vec<bool>,
    /// Poses of members that are known with standard deviations (metres, radians).
    pub(super) priors: Vec<(usize, Pose, [f64; 2])>,
    /// Control points; stations are numbers of members.
    pub(super) controls: Controls,
}

/// The members of a group while they are adjusted.
struct Adjustment<'a> {
    views: &'a [View],
    group: &'a Group,
    given: &'a Given,
    is_fixed: Vec<bool>,
    poses: Vec<Pose>,
    pairs: Vec<(usize, usize)>,
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

    fn system(&self, links: &[((usize, usize), Link)]) -> System {
        let mut system = System::new(&self.is_fixed);
        for ((a, b), link) in links {
            system.add(*a, *b, link);
        }
        let variance = 0.25 * self.sigma * self.sigma;
        for (member, pose, [metres, radians]) in &self.given.priors {
            let own = self.poses[*member];
            let turn = rotation_vector(own.rotation * pose.rotation.inverse());
            let shift = own.translation - pose.translation;
            let weights = [radians, metres].map(|sigma| 1.0 / (sigma * sigma));
            let information = Matrix6::from_diagonal(&Vector6::from_fn(|k, _| weights[k / 3]));
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            system.add_prior(&Prior { station: *member, error, information }, variance);
        }
        for sightings in self.given.controls.points.values() {
            for (k, b) in sightings.iter().enumerate() {
                let Some(second) = b.station.map(|member| (member, self.poses[member], b.at)) else { continue };
                for a in &sightings[..k] {
                    let first = a.station.map(|member| (member, self.poses[member], a.at));
                    system.add_point(first, second, a.at, a.sigma.hypot(b.sigma), variance);
                }
            }
        }
        system
    }
}

/// The rotation as an axis times an angle of at most half a turn: a quaternion and its negative are the same rotation.
fn rotation_vector(rotation: DQuat) -> DVec3 {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    rotation.to_scaled_axis()
}

/// Adjust the members of a group. `None` if the equations have no solution.
pub(super) fn settle(views: &[View], group: &Group, given: &Given, edge: f64) -> Option<Settled> {
    let n = group.members.len();
    let mut work = Adjustment {
        views,
        group,
        given,
        is_fixed: given.is_fixed.clone(),
        poses: group.members.iter().map(|(_, pose)| *pose).collect(),
        pairs: (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).collect(),
        sigma: edge / 3.0,
    };
    let is_located = !given.priors.is_empty() || given.controls.locate();
    for (reach, rounds) in REACHES {
        for _ in 0..rounds {
            let links = work.compare(reach * edge, 0.0);
            work.pairs = links.iter().map(|(pair, _)| *pair).collect();
            if !work.is_fixed.contains(&true) && !is_located {
                work.is_fixed[anchor(n, &links)] = true;
            }
            let [angle, distance] = work.system(&links).solve(&mut work.poses)?;
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
    let covariances = work.system(&links).covariances(0.25 * work.sigma * work.sigma)?;
    let covariances = covariances.into_iter().map(|c| c * CAUTION).collect();
    Some(Settled { poses: work.poses, covariances, links, is_fixed: work.is_fixed })
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

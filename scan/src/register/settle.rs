//! The last step: all poses of a group together, with their covariances.

use super::group::Group;
use super::view::View;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::adjust::{Link, Party, Prior, Reach, System};
use glam::DMat3;
use nalgebra::{Matrix3, Matrix6};
use rayon::prelude::*;

/// Largest distances of planes that are the same surface, in edges of voxels, and how often each is used.
const REACHES: [(f64, usize); 4] = [(2.0, 3), (1.0, 3), (0.5, 4), (0.35, 8)];
/// Fewest planes of a link.
const MIN_MATCHED: usize = 60;
/// The edge of the cubes whose errors may be correlated, in edges of voxels.
const CLUSTER: f64 = 12.0;

/// Poses that fit all stations best.
pub(super) struct Settled {
    pub(super) poses: Vec<Pose>,
    pub(super) covariances: Vec<Matrix6<f64>>,
    /// Which did not move: those that were to stay, or the anchor.
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

/// Adjust the members of a group; `is_fixed`: which of them stay. `None` if the equations have no solution.
pub(super) fn settle(
    views: &[View],
    group: &Group,
    is_fixed: &[bool],
    priors: &dyn Fn(&[Pose]) -> Vec<Prior>,
    edge: f64,
) -> Option<Settled> {
    let mut poses: Vec<Pose> = group.members.iter().map(|(_, pose)| *pose).collect();
    let n = poses.len();
    let mut pairs: Vec<(usize, usize)> = (0..n).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    let compare = |poses: &[Pose], pairs: &[(usize, usize)], reach: Reach| -> Vec<((usize, usize), Link)> {
        let party = |k: usize| {
            let view = &views[group.members[k].0];
            Party { image: &view.surface, samples: &view.points, pose: poses[k] }
        };
        pairs.par_iter().map(|(a, b)| ((*a, *b), Link::compare(party(*a), party(*b), reach))).collect()
    };
    let mut sigma = edge / 3.0;
    let mut is_fixed = is_fixed.to_vec();
    for (number, (reach, rounds)) in REACHES.into_iter().enumerate() {
        for _ in 0..rounds {
            let links = compare(&poses, &pairs, Reach { reach: reach * edge, sigma, cluster: 0.0 });
            if number == 0 {
                pairs = links.iter().filter(|(_, link)| link.matched >= MIN_MATCHED).map(|(pair, _)| *pair).collect();
            }
            let links: Vec<_> = links.iter().filter(|(_, link)| link.matched >= MIN_MATCHED).collect();
            if !is_fixed.contains(&true) {
                is_fixed[anchor(n, &links)] = true;
            }
            let mut system = System::new(&is_fixed);
            links.iter().for_each(|((a, b), link)| system.add(*a, *b, link));
            for prior in priors(&poses) {
                system.add_prior(&prior, sigma * sigma);
            }
            let [angle, distance] = system.solve(&mut poses)?;
            let mut all: Vec<f32> = links.iter().flat_map(|(_, link)| &link.distances).copied().collect();
            all.sort_unstable_by(f32::total_cmp);
            // The standard deviation of the errors, if they are normal but for outliers.
            sigma = (1.483 * f64::from(*all.get(all.len() / 2)?) * 2.0).max(1e-4 * edge).min(reach * edge / 2.0);
            if angle < 1e-7 && distance < 1e-6 * edge {
                break;
            }
        }
    }
    let reach = Reach { reach: REACHES[3].0 * edge, sigma, cluster: CLUSTER * edge };
    let links: Vec<((usize, usize), Link)> =
        compare(&poses, &pairs, reach).into_iter().filter(|(_, link)| link.matched >= MIN_MATCHED).collect();
    let mut system = System::new(&is_fixed);
    links.iter().for_each(|((a, b), link)| system.add(*a, *b, link));
    for prior in priors(&poses) {
        system.add_prior(&prior, sigma * sigma);
    }
    let covariances = system.covariances(sigma * sigma)?;
    Some(Settled { poses, covariances, links, is_fixed })
}

/// The station that has most surface in common with others: what is known of the others beside it is most certain.
fn anchor(n: usize, links: &[&((usize, usize), Link)]) -> usize {
    let mut sums = vec![0.0; n];
    for ((a, b), link) in links {
        sums[*a] += link.squares[1];
        sums[*b] += link.squares[1];
    }
    (0..n).rev().max_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0)
}

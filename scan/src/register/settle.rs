//! The last step: all poses of a group together, with their covariances.

use super::group::Group;
use super::view::View;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::adjust::{Link, Party, Prior, Reach, System};
use nalgebra::Matrix6;
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
    /// Pairs of members (their places in the group), with their equations.
    pub(super) links: Vec<((usize, usize), Link)>,
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
            Party { surfels: &view.surfels, planes: &view.fine, pose: poses[k] }
        };
        pairs.par_iter().map(|(a, b)| ((*a, *b), Link::compare(party(*a), party(*b), reach))).collect()
    };
    let mut sigma = edge / 3.0;
    for (number, (reach, rounds)) in REACHES.into_iter().enumerate() {
        for _ in 0..rounds {
            let links = compare(&poses, &pairs, Reach { reach: reach * edge, sigma, cluster: 0.0 });
            if number == 0 {
                pairs = links.iter().filter(|(_, link)| link.matched >= MIN_MATCHED).map(|(pair, _)| *pair).collect();
            }
            let mut system = System::new(is_fixed);
            let links: Vec<_> = links.iter().filter(|(_, link)| link.matched >= MIN_MATCHED).collect();
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
    let mut system = System::new(is_fixed);
    links.iter().for_each(|((a, b), link)| system.add(*a, *b, link));
    for prior in priors(&poses) {
        system.add_prior(&prior, sigma * sigma);
    }
    let covariances = system.covariances(sigma * sigma)?;
    Some(Settled { poses, covariances, links })
}

//! The fit of one group of stations to another: least squares of the distances between their planes along the mean of both normals.

use super::surfels::{LEVELS, Surfel, Surfels};
use crate::Pose;
use glam::{DQuat, DVec3};
use nalgebra::{Cholesky, Matrix6, Vector6};
use std::f64::consts::SQRT_2;

/// Fewest planes that define a pose.
const LEAST: usize = 12;
/// Maximum number of steps for one reach.
const ROUNDS: usize = 12;

/// A pair of matching planes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// The position of the source's plane in the coordinates of the target, metres.
    pub position: DVec3,
    /// The mean of both normals (Rusinkiewicz, "A symmetric objective function for ICP", 2019).
    pub normal: DVec3,
    /// The signed distance of the source's plane in front of the target's, metres.
    pub distance: f64,
    /// The weight of the distance before robust weighting.
    pub share: f64,
    /// The variance of the direction of the normal, square radians.
    pub normal_variance: f64,
}

impl Match {
    /// The plane of `target` that matches `source`. `level`: the finest level of the target that is used; `reach`: the maximum distance, metres.
    pub fn find(target: &Surfels, level: usize, source: &Surfel, target_from_source: Pose, reach: f64) -> Option<Self> {
        let position = target_from_source.apply(source.position);
        let normal = target_from_source.rotation * source.normal;
        let same_size = (0..LEVELS - 1).take_while(|k| source.edge > SQRT_2 * target.edge(*k)).count();
        let found = target.find(level.max(same_size).min(LEVELS - 1), position, normal, reach)?;
        let mean = (found.normal + normal).normalize_or_zero();
        let distance = (position - found.position).dot(mean);
        let share = share(source, found);
        let normal_variance = 0.25 * (source.normal_variance() + found.normal_variance());
        (distance.abs() <= reach).then_some(Self { position, normal: mean, distance, share, normal_variance })
    }

    /// The derivative of the distance with respect to a rotation of the source about `center` and a translation.
    pub fn jacobian(&self, center: DVec3) -> Vector6<f64> {
        let c = (self.position - center).cross(self.normal);
        Vector6::new(c.x, c.y, c.z, self.normal.x, self.normal.y, self.normal.z)
    }

    /// The robust weight of the distance at the scale `sigma`, metres: that of Geman and McClure, which suppresses outliers.
    pub fn weight(&self, sigma: f64) -> f64 {
        let t = self.distance / sigma;
        let w = 1.0 / (1.0 + t * t);
        w * w * self.share
    }

    /// The same seen from another frame.
    #[must_use]
    pub fn seen_from(&self, pose: Pose) -> Self {
        Self { position: pose.apply(self.position), normal: pose.rotation * self.normal, ..*self }
    }
}

/// Surface seen at grazing incidence counts less, because part of it is hidden.
fn share(a: &Surfel, b: &Surfel) -> f64 {
    (a.facing * b.facing).max(0.0)
}

/// Planes of a station, and the pose of the station in the frame of its group.
#[derive(Debug, Clone, Copy)]
pub struct Posed<T> {
    /// `group_from_station`.
    pub pose: Pose,
    /// The planes.
    pub planes: T,
}

/// A fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// `target_from_source`.
    pub pose: Pose,
    /// The information matrix: the weighted sum of the outer products of the Jacobians, with the rotation about the origin of the source (square metres) first, then the translation.
    pub information: Matrix6<f64>,
    /// The part of the information in each direction that is due to noisy normals alone: a flat wall seems to constrain a pose along itself because its normals are not exact.
    pub noise: f64,
    /// Planes that were matched.
    pub matched: usize,
    /// The median of their absolute distances, metres.
    pub median: f64,
}

/// A pose after a small step: a rotation about its own position, then a translation.
pub fn moved(pose: Pose, step: &Vector6<f64>) -> Pose {
    let omega = DVec3::new(step[0], step[1], step[2]);
    Pose {
        rotation: (DQuat::from_scaled_axis(omega) * pose.rotation).normalize(),
        translation: pose.translation + DVec3::new(step[3], step[4], step[5]),
    }
}

/// All matches between two groups of stations; `pose` is that of the sources in the frame of the targets.
pub fn matches(
    targets: &[Posed<&Surfels>],
    sources: &[Posed<&[Surfel]>],
    pose: Pose,
    level: usize,
    reach: f64,
    out: &mut Vec<Match>,
) {
    out.clear();
    for source in sources {
        for target in targets {
            let target_from_source = source.pose.then(pose).then(target.pose.inverse());
            // Planes outside the surface that the other station saw have no match.
            let found = source
                .planes
                .iter()
                .filter_map(|surfel| Match::find(target.planes, level, surfel, target_from_source, reach));
            out.extend(found.map(|found| found.seen_from(target.pose)));
        }
    }
}

/// Fit a group of stations to another. `pose`: the initial pose, in error by less than the first of `reaches` (metres), all of which are used in
/// turn. `level`: the finest level of the target that is used. Returns `None` if the
/// two have too little surface in common.
pub fn fit(
    targets: &[Posed<&Surfels>],
    sources: &[Posed<&[Surfel]>],
    mut pose: Pose,
    level: usize,
    reaches: &[f64],
) -> Option<Fit> {
    let edge = targets.first()?.planes.edge(0);
    let (mut found, mut last) = (Vec::new(), None);
    for reach in reaches {
        // Matches are sought among planes about as large as the distance between the surfaces.
        let wanted = (reach / edge).log2().ceil().max(0.0) as usize;
        let level = level.max(wanted.min(LEVELS - 1));
        for _ in 0..ROUNDS {
            matches(targets, sources, pose, level, *reach, &mut found);
            if found.len() < LEAST {
                return None;
            }
            let (mut information, mut gradient, mut noise) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
            for found in &found {
                let (j, w) = (found.jacobian(pose.translation), found.weight(reach / 3.0));
                information += j * j.transpose() * w;
                gradient += j * (w * found.distance);
                noise += w * found.normal_variance;
            }
            // Undetermined directions stay as they are.
            let damping = 1e-6 * information.trace() / 6.0;
            let step = -Cholesky::new(information + Matrix6::identity() * damping)?.solve(&gradient);
            pose = moved(pose, &step);
            let is_last = step.fixed_rows::<3>(3).norm() < 1e-3 * reach && step.fixed_rows::<3>(0).norm() < 1e-5;
            last = Some((pose, information, noise, found.len()));
            if is_last {
                break;
            }
        }
    }
    let (pose, information, noise, matched) = last?;
    let mut distances: Vec<f64> = found.iter().map(|found| found.distance.abs()).collect();
    distances.sort_unstable_by(f64::total_cmp);
    Some(Fit { pose, information, noise, matched, median: distances[distances.len() / 2] })
}

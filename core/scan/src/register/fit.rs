//! The fit of stations against others: the distances of the planes of the ones from those of the others, in least squares along both normals.

use super::surfels::{LEVELS, Surfel, Surfels};
use crate::Pose;
use glam::{DQuat, DVec3};
use nalgebra::{Cholesky, Matrix6, Vector6};

/// Fewest planes that define a pose.
const LEAST: usize = 12;
/// Most steps with one reach.
const ROUNDS: usize = 12;

/// A pair of planes that are the same surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// The place of the source's plane in the coordinates of the target, metres.
    pub position: DVec3,
    /// The mean of both normals (Rusinkiewicz, "A symmetric objective function for ICP", 2019).
    pub normal: DVec3,
    /// How far the source's plane is before the target's, metres.
    pub distance: f64,
    /// What the distance counts.
    pub share: f64,
    /// The variance of the direction of the normal, square radians.
    pub normal_variance: f64,
}

impl Match {
    /// The plane of `target` that continues `source`. `level`: the smallest of the target's planes that are used; `reach`: the largest distance, metres.
    pub fn find(target: &Surfels, level: usize, source: &Surfel, target_from_source: Pose, reach: f64) -> Option<Self> {
        let position = target_from_source.apply(source.position);
        let normal = target_from_source.rotation * source.normal;
        let same_size = (source.edge / target.edge(0)).log2().round().max(0.0) as usize;
        let found = target.find(level.max(same_size).min(LEVELS - 1), position, normal, reach)?;
        let mean = (found.normal + normal).normalize_or_zero();
        let distance = (position - found.position).dot(mean);
        let share = share(source, found);
        let normal_variance = 0.25 * (source.normal_variance() + found.normal_variance());
        (distance.abs() <= reach).then_some(Self { position, normal: mean, distance, share, normal_variance })
    }

    /// How the distance changes with a rotation of the source about `center` and a translation.
    pub fn jacobian(&self, center: DVec3) -> Vector6<f64> {
        let c = (self.position - center).cross(self.normal);
        Vector6::new(c.x, c.y, c.z, self.normal.x, self.normal.y, self.normal.z)
    }

    /// The weight of the distance where distances are spread by `sigma`, metres: that of Geman and McClure, which forgets outliers.
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

/// What is seen at a small angle counts less: a part of it is hidden.
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
    /// The sum of the weighted products of the Jacobians: rotation about the origin of the source (square metres), then translation.
    pub information: Matrix6<f64>,
    /// What of it the errors of normals alone amount to in each direction: a flat wall seems to fix a place along itself, because its normals are not exact.
    pub noise: f64,
    /// Planes that were matched.
    pub matched: usize,
    /// The median of their distances without signs, metres.
    pub median: f64,
}

/// A pose moved a little: rotation about its translation, then translation.
pub fn moved(pose: Pose, step: &Vector6<f64>) -> Pose {
    let omega = DVec3::new(step[0], step[1], step[2]);
    Pose {
        rotation: (DQuat::from_scaled_axis(omega) * pose.rotation).normalize(),
        translation: pose.translation + DVec3::new(step[3], step[4], step[5]),
    }
}

/// All matches of two groups of stations where one stands at `pose` beside the other.
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
            // Beyond what the other saw there is nothing to find.
            let found = source
                .planes
                .iter()
                .filter_map(|surfel| Match::find(target.planes, level, surfel, target_from_source, reach));
            out.extend(found.map(|found| found.seen_from(target.pose)));
        }
    }
}

/// Fit a group of stations against another, from a pose that is wrong by less than the first of `reaches` (metres), through all of them. `level`: the smallest planes of the target that are used. `None` if the
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
            // What the planes do not determine stays as it is.
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

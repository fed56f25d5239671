//! Control points: points that several stations observed, or whose survey coordinates are known.

use crate::ScanError;
use crate::survey::{Station, Survey};
use glam::DVec3;
use kilwa_scan_core::Pose;
use kilwa_scan_core::kabsch::{best_rotation, is_line};
use nalgebra::Matrix3;
use std::collections::BTreeMap;

/// The standard deviation of a control point where none is given, metres.
pub(super) const SIGMA: f64 = 0.005;
/// Minimum number of points that define a pose.
pub(super) const MIN_POINTS: usize = 3;

/// A control point as observed by a station, or with known survey coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    /// The index of the station; `None`: survey coordinates.
    pub(super) station: Option<usize>,
    pub(super) at: DVec3,
    pub(super) sigma: f64,
}

/// The control points of a survey by name, each with at least two sightings.
#[derive(Debug, Clone, Default)]
pub(super) struct Controls {
    pub(super) points: BTreeMap<String, Vec<Sighting>>,
}

impl Controls {
    /// The control points of a survey; station numbers are indices into `stations`.
    pub(super) fn new(survey: &Survey, stations: &[&Station]) -> Self {
        let mut points: BTreeMap<String, Vec<Sighting>> = BTreeMap::new();
        for control in &survey.controls {
            let station = match &control.station {
                Some(name) => match stations.iter().position(|s| s.name == *name) {
                    Some(number) => Some(number),
                    None => continue,
                },
                None => None,
            };
            let sighting = Sighting { station, at: control.at, sigma: control.sigma.unwrap_or(SIGMA) };
            points.entry(control.name.clone()).or_default().push(sighting);
        }
        for all in points.values_mut() {
            all.sort_by_key(|sighting| sighting.station);
        }
        points.retain(|_, all| all.len() > 1);
        Self { points }
    }

    /// Observations of points with known survey coordinates: the station, the coordinates of the point in the station and in the survey, and the standard deviation of their difference, metres.
    pub(super) fn with_survey_coordinates(&self) -> Vec<(usize, DVec3, DVec3, f64)> {
        let of_point = |all: &Vec<Sighting>| {
            let known = all.iter().find(|s| s.station.is_none()).copied();
            let observed = |s: &Sighting| {
                let known = known?;
                Some((s.station?, s.at, known.at, s.sigma.hypot(known.sigma)))
            };
            all.iter().filter_map(observed).collect::<Vec<_>>()
        };
        self.points.values().flat_map(of_point).collect()
    }

    /// Forget the survey coordinates of all points. Returns whether there were any.
    pub(super) fn drop_survey_points(&mut self) -> bool {
        let had = self.points.values().any(|all| all.iter().any(|s| s.station.is_none()));
        for all in self.points.values_mut() {
            all.retain(|s| s.station.is_some());
        }
        self.points.retain(|_, all| all.len() > 1);
        had
    }

    /// Whether the points that both stations observed determine their relative pose; `None` stands for the survey coordinates.
    pub(super) fn are_tied(&self, a: Option<usize>, b: Option<usize>) -> bool {
        let of = |all: &[Sighting], station| all.iter().find(|s: &&Sighting| s.station == station).map(|s| s.at);
        let pairs: Vec<(DVec3, DVec3)> =
            self.points.values().filter_map(|all| Some((of(all, a)?, of(all, b)?))).collect();
        rigid(&pairs).is_some()
    }

    /// `a_from_b` from the points that both observed; for `a` or `b`, `None` means survey coordinates. Returns `None` if there are too few points, or if they are collinear.
    ///
    /// # Errors
    /// [`ScanError::Request`] if the points contradict each other.
    pub(super) fn pose(
        &self,
        a: Option<usize>,
        b: Option<usize>,
        name: &dyn Fn(Option<usize>) -> String,
    ) -> Result<Option<Pose>, ScanError> {
        let of = |all: &[Sighting], station| all.iter().find(|s: &&Sighting| s.station == station).copied();
        let common: Vec<(&String, Sighting, Sighting)> =
            self.points.iter().filter_map(|(name, all)| Some((name, of(all, a)?, of(all, b)?))).collect();
        let pairs: Vec<(DVec3, DVec3)> = common.iter().map(|(_, a, b)| (a.at, b.at)).collect();
        let Some(pose) = rigid(&pairs) else { return Ok(None) };
        for (point, own, other) in &common {
            let distance = own.at.distance(pose.apply(other.at));
            if distance > tolerance(own, other) {
                return Err(ScanError::Request(format!(
                    "control point {point} does not fit: its coordinates in {} and in {} differ by {distance:.3} m after alignment; check them in survey.toml",
                    name(b),
                    name(a)
                )));
            }
        }
        Ok(Some(pose))
    }
}

/// How far two observations of a point may be apart, metres.
pub(super) fn tolerance(a: &Sighting, b: &Sighting) -> f64 {
    (5.0 * a.sigma.hypot(b.sigma)).max(0.01)
}

/// The pose that best aligns the second point of each pair with the first (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976); `None` if there are fewer than three
/// pairs, or if the points are collinear.
pub(super) fn rigid(pairs: &[(DVec3, DVec3)]) -> Option<Pose> {
    if pairs.len() < MIN_POINTS {
        return None;
    }
    let n = pairs.len() as f64;
    let (mut to, mut from) = (DVec3::ZERO, DVec3::ZERO);
    for (a, b) in pairs {
        to += *a;
        from += *b;
    }
    let (to, from) = (to / n, from / n);
    let (mut product, mut spread) = (Matrix3::zeros(), Matrix3::zeros());
    for (a, b) in pairs {
        let (a, b) = (nalgebra::Vector3::from((*a - to).to_array()), nalgebra::Vector3::from((*b - from).to_array()));
        product += a * b.transpose();
        spread += b * b.transpose();
    }
    if is_line(&spread) {
        return None;
    }
    let rotation = best_rotation(&product)?.rotation;
    Some(Pose { rotation, translation: to - rotation * from })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    const PLACES: [DVec3; 4] =
        [DVec3::new(1.0, 2.0, 0.5), DVec3::new(-3.0, 4.0, 1.5), DVec3::new(2.0, -5.0, 2.5), DVec3::new(7.0, 1.0, -0.5)];

    #[test]
    fn three_points_give_the_pose_and_points_on_a_line_do_not() {
        let pose = Pose { rotation: DQuat::from_rotation_z(2.0), translation: DVec3::new(10.0, -3.0, 1.0) };
        for n in 3..=4 {
            let pairs: Vec<_> = PLACES[..n].iter().map(|p| (pose.apply(*p), *p)).collect();
            let (angle, distance) = rigid(&pairs).unwrap().difference(pose);
            assert!(angle < 1e-6 && distance < 1e-9, "{angle} {distance}");
        }
        let line: Vec<_> = (0..5).map(|k| DVec3::X * f64::from(k)).map(|p| (pose.apply(p), p)).collect();
        assert_eq!(rigid(&line), None);
        assert_eq!(rigid(&[(DVec3::X, DVec3::X), (DVec3::Y, DVec3::Y)]), None);
    }
}

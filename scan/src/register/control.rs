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
pub const MIN_POINTS: usize = 3;

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

/// A place that two stations observed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    /// Its coordinates in both stations, metres.
    pub at: [DVec3; 2],
    /// The standard deviations of these coordinates, metres.
    pub sigma: [f64; 2],
}

impl PointPair {
    fn tolerance(&self) -> f64 {
        let [a, b] = [0, 1].map(|k| Sighting { station: None, at: self.at[k], sigma: self.sigma[k] });
        tolerance(&a, &b)
    }

    fn distance(&self, pose: Pose) -> f64 {
        self.at[0].distance(pose.apply(self.at[1]))
    }
}

/// How well pairs of points fit each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// The distance between the two points of each pair after the best rigid alignment, metres.
    pub residuals: Vec<f64>,
    /// The pair that is most likely wrong, if registration would refuse the pairs.
    pub suspect: Option<usize>,
}

/// Align the second points of pairs with the first, as the registration of two stations from control points does. Returns `None` if there are fewer than three pairs,
/// if the points are collinear in either station, or if a coordinate is not finite.
pub fn align_points(pairs: &[PointPair]) -> Option<Alignment> {
    let pose = pose_of(pairs)?;
    let residuals: Vec<f64> = pairs.iter().map(|pair| pair.distance(pose)).collect();
    Some(Alignment { suspect: suspect(pairs, pose), residuals })
}

/// The control points in `survey.toml` that both stations observed, with their names, sorted by name.
pub fn common_points(survey: &Survey, a: &Station, b: &Station) -> Vec<(String, PointPair)> {
    let controls = Controls::new(survey, &[a, b]);
    let pair = |all: &[Sighting]| {
        let of = |k: usize| all.iter().find(|sighting| sighting.station == Some(k));
        let (a, b) = (of(0)?, of(1)?);
        Some(PointPair { at: [a.at, b.at], sigma: [a.sigma, b.sigma] })
    };
    controls.points.into_iter().filter_map(|(name, all)| Some((name, pair(&all)?))).collect()
}

fn pose_of(pairs: &[PointPair]) -> Option<Pose> {
    if pairs.iter().any(|pair| pair.at.iter().any(|at| !at.is_finite())) {
        return None;
    }
    let [forwards, backwards]: [Vec<(DVec3, DVec3)>; 2] =
        [[0, 1], [1, 0]].map(|[to, from]| pairs.iter().map(|pair| (pair.at[to], pair.at[from])).collect());
    rigid(&backwards)?;
    rigid(&forwards)
}

/// The pair without which the others fit best. A wrong pair also moves the points that fit, so its own residual need not be the largest.
fn suspect(pairs: &[PointPair], pose: Pose) -> Option<usize> {
    let excess = |pose: Pose, pair: &PointPair| pair.distance(pose) / pair.tolerance();
    if pairs.iter().all(|pair| excess(pose, pair) <= 1.0) {
        return None;
    }
    let without = |k: usize| {
        let mut others = pairs.to_vec();
        others.remove(k);
        let pose = pose_of(&others)?;
        Some(others.iter().map(|pair| excess(pose, pair)).fold(0.0, f64::max))
    };
    let fits = (0..pairs.len()).filter_map(|k| Some((k, without(k)?))).min_by(|a, b| a.1.total_cmp(&b.1));
    let largest = || {
        let all = pairs.iter().map(|pair| excess(pose, pair)).enumerate();
        all.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
    };
    fits.filter(|(_, excess)| *excess <= 1.0).map(|(k, _)| k).or_else(largest)
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

    /// Pairs of the same places in two stations, the second turned and moved.
    fn pairs(places: &[DVec3]) -> Vec<PointPair> {
        let pose = Pose { rotation: DQuat::from_rotation_z(2.0), translation: DVec3::new(10.0, -3.0, 1.0) };
        places.iter().map(|p| PointPair { at: [pose.apply(*p), *p], sigma: [0.002; 2] }).collect()
    }

    #[test]
    fn a_wrong_pair_is_found_although_it_moves_the_others() {
        let mut all = pairs(&PLACES);
        let found = align_points(&all).unwrap();
        assert!(found.residuals.iter().all(|residual| *residual < 1e-9) && found.suspect.is_none(), "{found:?}");
        for wrong in 0..4 {
            all = pairs(&PLACES);
            all[wrong].at[0].x += 0.12;
            let found = align_points(&all).unwrap();
            assert!(found.suspect == Some(wrong), "{wrong}: {found:?}");
            assert!(found.residuals.iter().filter(|residual| **residual > 0.01).count() > 1, "{found:?}");
        }
        // Of three pairs, none can be told from the others.
        all = pairs(&PLACES[..3]);
        all[1].at[0].x += 0.12;
        assert!(align_points(&all).unwrap().suspect.is_some());
    }

    #[test]
    fn pairs_that_determine_no_pose_have_no_residuals() {
        assert_eq!(align_points(&pairs(&PLACES[..2])), None);
        let line: Vec<DVec3> = (0..5).map(|k| DVec3::X * f64::from(k)).collect();
        assert_eq!(align_points(&pairs(&line)), None);
        // On a line in one of the two stations.
        let mut bent = pairs(&PLACES);
        for (pair, at) in bent.iter_mut().zip(&line) {
            pair.at[0] = *at;
        }
        assert_eq!(align_points(&bent), None);
        let mut bad = pairs(&PLACES);
        bad[0].at[1].y = f64::NAN;
        assert_eq!(align_points(&bad), None);
    }
}

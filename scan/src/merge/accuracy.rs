//! The accuracy of the merged surface: the contributions of station poses and range noise to the standard deviation of a coordinate.

use super::Scale;
use super::cut::{Part, Station};
use crate::register::{KnownSigma, Placed, Registration};
use crate::survey;
use glam::{DMat3, DVec3};
use kilwa_scan_core::tsdf::{Patch, Piece, Sigma, Variance};
use kilwa_scan_core::{Pose, Rays};

/// What is known about the accuracy of a merged surface.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Accuracy {
    /// Unknown: no station was registered, and the survey states no standard deviations.
    #[default]
    Unknown,
    /// Not enough: the uncertainties of the poses of these stations are unknown.
    Incomplete(Vec<UnknownPose>),
    /// Known, with its parts.
    Known(Parts),
}

/// Standard deviations of a coordinate, root mean squares over the surface, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parts {
    /// Due to the poses of the stations.
    pub registration: f64,
    /// Due to their range noise.
    pub instrument: f64,
}

/// A station whose pose uncertainty is unknown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownPose {
    /// Its name.
    pub station: String,
    /// Why it is unknown.
    pub reason: Reason,
}

/// Why the uncertainty of a pose is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// The pose was changed after it had been registered.
    Changed,
    /// The registration did not place the station, so it does not confirm the pose.
    Unplaced,
    /// The station was not registered, and the survey states no standard deviations.
    Unstated,
}

/// The uncertainty of the pose of a station.
#[derive(Debug, Clone)]
pub(super) enum PoseSigma {
    /// Unknown, for this reason.
    Unknown(Reason),
    /// The pose is the one that was registered, or the survey states its standard deviations.
    Known(PoseVariance),
}

impl PoseSigma {
    pub(super) fn of(entry: &survey::Station, registration: Option<&Registration>) -> Self {
        match (Registration::known_sigma(registration, entry), entry.pose) {
            (Some(KnownSigma::Registered(placed)), _) => Self::Known(PoseVariance::new(placed)),
            (Some(KnownSigma::Stated(sigma)), Some(pose)) => Self::Known(PoseVariance::stated(sigma, pose)),
            _ if registration.is_some_and(|all| all.is_unplaced(entry)) => Self::Unknown(Reason::Unplaced),
            _ if registration.is_some_and(|all| all.entry(entry).is_some()) => Self::Unknown(Reason::Changed),
            _ => Self::Unknown(Reason::Unstated),
        }
    }
}

/// The variance that the uncertainty of a pose adds to a coordinate of a point (the mean over the three axes) as a polynomial, because it is needed for every piece.
#[derive(Debug, Clone)]
pub(super) struct PoseVariance {
    station: DVec3,
    square: DMat3,
    linear: DVec3,
    constant: f64,
}

impl PoseVariance {
    fn new(placed: &Placed) -> Self {
        let c = |i: usize, j: usize| f64::midpoint(placed.covariance[i][j], placed.covariance[j][i]);
        // A point r from the station moves by ω × r + τ. Its mean square is tr(R) r² - rᵀRr + 2 r · E(τ × ω) + tr(T) with the covariances R of ω and T of τ.
        let rotation = DMat3::from_cols_array_2d(&[0, 1, 2].map(|i| [0, 1, 2].map(|j| c(i, j))));
        let trace = c(0, 0) + c(1, 1) + c(2, 2);
        let cross = DVec3::new(c(4, 2) - c(5, 1), c(5, 0) - c(3, 2), c(3, 1) - c(4, 0));
        Self {
            station: DVec3::from_array(placed.translation),
            square: DMat3::from_diagonal(DVec3::splat(trace)) - rotation,
            linear: 2.0 * cross,
            constant: c(3, 3) + c(4, 4) + c(5, 5),
        }
    }

    /// From standard deviations of the position (of each coordinate, metres) and of the rotation (about each axis, radians).
    fn stated([metres, radians]: [f64; 2], pose: Pose) -> Self {
        Self {
            station: pose.translation,
            square: DMat3::from_diagonal(DVec3::splat(2.0 * radians * radians)),
            linear: DVec3::ZERO,
            constant: 3.0 * metres * metres,
        }
    }

    /// The mean of the variances of the three coordinates of a point, square metres.
    fn at(&self, point: DVec3) -> f64 {
        let r = point - self.station;
        (r.dot(self.square * r) + r.dot(self.linear) + self.constant) / 3.0
    }
}

/// The uncertainty of a station's measurements at each point.
pub(super) struct StationSigma<'a> {
    pose: &'a PoseVariance,
    /// See [`kilwa_scan_core::tessellate::Instrument::range_noise`].
    range_noise: [f64; 2],
    has_center: bool,
    scale: Scale,
}

impl<'a> StationSigma<'a> {
    /// `None` if the uncertainty of its pose is not known.
    pub(super) fn new(station: &'a Station<'_>, scale: Scale) -> Option<Self> {
        let PoseSigma::Known(pose) = &station.pose_sigma else { return None };
        let range_noise = station.options.tessellate.instrument.range_noise;
        Some(Self { pose, range_noise, has_center: station.rays == Rays::Central, scale })
    }

    pub(super) fn at(&self, piece: &Piece) -> Sigma {
        let point = self.scale.to_survey(piece.position());
        // Without a centre, the range is unknown and taken as 0, as for the confidence of samples.
        let range = if self.has_center { point.distance(self.pose.station) } else { 0.0 };
        Sigma::new(self.pose.at(point), self.range_noise[0] + self.range_noise[1] * range)
    }
}

/// The uncertainties of all stations, if they are known for each station that contributes to the surface.
pub(super) struct Sigmas<'a> {
    stations: Vec<Option<StationSigma<'a>>>,
    /// The largest standard deviation due to a pose, as stored.
    largest: f32,
    /// Whether it is the same everywhere.
    is_uniform: bool,
}

impl<'a> Sigmas<'a> {
    /// The uncertainties of these stations; `parts` are their contributions to the surface.
    pub(super) fn of(stations: &'a [Station<'_>], parts: &[Part], scale: Scale) -> Result<Self, Accuracy> {
        let merged = || stations.iter().zip(parts).filter(|(_, part)| part.pieces > 0).map(|(station, _)| station);
        let unknown = |station: &Station<'_>| match station.pose_sigma {
            PoseSigma::Unknown(reason) => Some(UnknownPose { station: station.name().to_owned(), reason }),
            PoseSigma::Known(_) => None,
        };
        let unknown: Vec<UnknownPose> = merged().filter_map(unknown).collect();
        if !unknown.is_empty() {
            // If nothing was registered or stated, no message is needed.
            let is_bare =
                unknown.len() == merged().count() && unknown.iter().all(|pose| pose.reason == Reason::Unstated);
            return Err(if is_bare { Accuracy::Unknown } else { Accuracy::Incomplete(unknown) });
        }
        let ranges = || parts.iter().filter_map(|part| part.variances);
        let least = ranges().map(|[least, _]| least).fold(f64::INFINITY, f64::min);
        let greatest = ranges().map(|[_, greatest]| greatest).fold(0.0, f64::max);
        Ok(Self {
            stations: stations.iter().map(|station| StationSigma::new(station, scale)).collect(),
            largest: kept(greatest),
            is_uniform: kept(least.min(greatest)) == kept(greatest),
        })
    }

    /// The uncertainty of a station (numbered from 1) at one of its pieces.
    pub(super) fn at(&self, station: u16, piece: &Piece) -> Option<Sigma> {
        Some(self.stations.get(usize::from(station) - 1)?.as_ref()?.at(piece))
    }

    /// The largest standard deviation due to a pose, metres, as stored; `None` if it is the same everywhere.
    pub(super) fn largest(&self) -> Option<f32> {
        (!self.is_uniform).then_some(self.largest)
    }
}

/// The standard deviation of a vertex due to the poses, metres, as stored: in steps of 0.4 % or less. More digits would be noise and take up space.
pub(super) fn kept(variance: f64) -> f32 {
    const DROPPED: u32 = 15;
    let bits = (variance.sqrt() as f32).to_bits();
    f32::from_bits(((bits >> (DROPPED - 1)) + 1) >> 1 << DROPPED)
}

/// Sums over the surface, in integers like the surface itself.
#[derive(Debug, Default)]
pub(super) struct Sum {
    area: u128,
    registration: u128,
    instrument: u128,
}

impl Sum {
    /// Fixed-point scale of areas, per square voxel.
    const AREA_ONE: f64 = (1 << 20) as f64;
    /// Fixed-point scale of variances, per square metre.
    const VARIANCE_ONE: f64 = 1e14;

    /// Add the measured triangles of a patch.
    pub(super) fn add(&mut self, patch: &Patch) {
        for corners in &patch.triangles {
            let corners = corners.map(|k| &patch.vertices[k as usize]);
            let [Some(p), Some(q), Some(r)] = corners.map(|vertex| vertex.variance) else { continue };
            let [a, b, c] = corners.map(|vertex| vertex.position);
            let area = ((b - a).cross(c - a).length() / 2.0 * Self::AREA_ONE).round() as u128;
            let mean = |of: fn(Variance) -> f64| ((of(p) + of(q) + of(r)) / 3.0 * Self::VARIANCE_ONE).round() as u128;
            self.area += area;
            self.registration += area * mean(|variance| variance.pose);
            self.instrument += area * mean(|variance| variance.range);
        }
    }

    /// The root mean squares over what was added; `None` if nothing was.
    pub(super) fn parts(&self) -> Option<Parts> {
        let of = |sum: u128| (sum as f64 / self.area as f64 / Self::VARIANCE_ONE).sqrt();
        (self.area > 0).then(|| Parts { registration: of(self.registration), instrument: of(self.instrument) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::Placement;

    /// Covariance of a point that the station measured, 3 × 3, square metres: only the contribution of the pose uncertainty.
    fn covariance_at(placed: &Placed, point: DVec3) -> [[f64; 3]; 3] {
        let r = point - DVec3::from_array(placed.translation);
        // ω × r = −[r]× ω.
        let jacobian =
            [[0.0, r.z, -r.y, 1.0, 0.0, 0.0], [-r.z, 0.0, r.x, 0.0, 1.0, 0.0], [r.y, -r.x, 0.0, 0.0, 0.0, 1.0]];
        let mut out = [[0.0; 3]; 3];
        for (i, row) in out.iter_mut().enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                for a in 0..6 {
                    for b in 0..6 {
                        *value += jacobian[i][a] * placed.covariance[a][b] * jacobian[j][b];
                    }
                }
            }
        }
        out
    }

    /// Standard deviation of a coordinate of a point that the station measured, metres: the root mean square over the three axes of what the
    /// uncertainty of the pose contributes.
    fn sigma_at(placed: &Placed, point: DVec3) -> f64 {
        let c = covariance_at(placed, point);
        ((c[0][0] + c[1][1] + c[2][2]) / 3.0).max(0.0).sqrt()
    }

    #[test]
    fn the_polynomial_equals_the_variance_from_the_covariance() {
        let mut random = fastrand::Rng::with_seed(7);
        for _ in 0..100 {
            // A covariance is a matrix times its transpose.
            let factor: [[f64; 6]; 6] = std::array::from_fn(|_| std::array::from_fn(|_| random.f64() - 0.5));
            let entry = |i: usize, j: usize| (0..6).map(|k| factor[i][k] * factor[j][k]).sum::<f64>();
            let placed = Placed {
                name: String::new(),
                placement: Placement::Surface,
                rotation: [1.0, 0.0, 0.0, 0.0],
                translation: [3.0, -2.0, 1.0],
                covariance: std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j))),
                scan: String::new(),
                stated: None,
            };
            let point = DVec3::new(random.f64(), random.f64(), random.f64()) * 40.0 - 20.0;
            let [ours, theirs] = [PoseVariance::new(&placed).at(point).sqrt(), sigma_at(&placed, point)];
            assert!((ours / theirs - 1.0).abs() < 1e-9, "{ours} {theirs}");
            // The same with stated standard deviations.
            let stated: [f64; 2] = [random.f64(), random.f64()];
            let entry = |i: usize, j: usize| if i == j { stated[usize::from(i < 3)].powi(2) } else { 0.0 };
            let covariance = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            let theirs = sigma_at(&Placed { covariance, ..placed.clone() }, point);
            let ours = PoseVariance::stated(stated, placed.pose()).at(point).sqrt();
            assert!((ours / theirs - 1.0).abs() < 1e-9, "{ours} {theirs}");
        }
    }

    #[test]
    fn a_standard_deviation_is_stored_to_within_0_2_percent() {
        assert_eq!(kept(0.0), 0.0);
        for sigma in [1e-6, 0.000_123_4, 0.002, 0.999_9, 12.3] {
            let kept = f64::from(kept(sigma * sigma));
            assert!((kept / sigma - 1.0).abs() < 1.0 / 500.0, "{sigma} {kept}");
        }
        assert_eq!(kept(0.002_f64.powi(2)), kept(0.002_000_1_f64.powi(2)));
    }
}

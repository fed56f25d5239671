//! The uncertainty of the merged surface: sums of the stations' contributions to the variance at a point, in integers like those of the surface.
//!
//! An error of a pose moves everything that a station saw nearby in the same way, and stations that were registered to each other often share
//! errors. Variances of poses are therefore averaged, by the weights of the surface, and do not become smaller where several stations saw a place. The noise of
//! ranges is independent between stations and averages out over them; all samples of one station count as one observation.

/// The uncertainty of a station's measurement at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sigma {
    /// Variance of a coordinate due to the pose, in 1/[`Self::ONE`]² square metre.
    pose: u64,
    /// Standard deviation of the range, in 1/[`Self::ONE`] metre.
    range: u64,
}

impl Sigma {
    /// Fixed-point scale of lengths: a tenth of a micrometre.
    const ONE: f64 = 1e7;
    /// Maximum standard deviation, metres; larger values are clamped.
    const MAX: f64 = 100.0;

    /// From the variance of a coordinate due to the pose, square metres, and the standard deviation of the range, metres.
    pub fn new(pose: f64, range: f64) -> Self {
        // NaN counts as the maximum.
        let limited = |v: f64, max: f64| if v <= max { v.max(0.0) } else { max };
        // At most 10^18 and 10^9.
        let pose = limited(pose, Self::MAX * Self::MAX) * (Self::ONE * Self::ONE);
        Self { pose: pose.round() as u64, range: (limited(range, Self::MAX) * Self::ONE).round() as u64 }
    }

    /// The variance of a coordinate due to the pose, square metres, as used in the sums.
    pub fn pose(self) -> f64 {
        self.pose as f64 / (Self::ONE * Self::ONE)
    }
}

/// The sums at a voxel, in addition to its weight.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Weighted variances of poses.
    pose: u128,
    /// Weighted standard deviations of the ranges of the last station.
    range: u128,
    /// The squares of these sums for the earlier stations. Saturated sums do not depend on the order either.
    squares: u128,
}

impl Sums {
    pub(super) fn add(&mut self, sigma: Sigma, weight: u64, is_next_station: bool) {
        if is_next_station {
            self.squares = self.all_squares();
            self.range = 0;
        }
        self.pose += u128::from(sigma.pose) * u128::from(weight);
        self.range += u128::from(sigma.range) * u128::from(weight);
    }

    fn all_squares(&self) -> u128 {
        self.squares.saturating_add(self.range.saturating_mul(self.range))
    }

    /// The variances at a voxel of this weight, which must not be 0.
    pub(super) fn variance(&self, weight: u64) -> Variance {
        let weight = weight as f64 * Sigma::ONE;
        Variance {
            pose: self.pose as f64 / (weight * Sigma::ONE),
            range: self.all_squares() as f64 / (weight * weight),
        }
    }
}

/// The components of the variance of a coordinate of the surface, square metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variance {
    /// Due to the poses of the stations that saw the point.
    pub pose: f64,
    /// Due to their range noise.
    pub range: f64,
}

impl Variance {
    /// The mean of variances with weights; `None` without any.
    pub(super) fn mean(parts: impl Iterator<Item = (Self, f64)>) -> Option<Self> {
        let (mut sum, mut whole) = (Self { pose: 0.0, range: 0.0 }, 0.0);
        for (variance, weight) in parts {
            sum.pose += variance.pose * weight;
            sum.range += variance.range * weight;
            whole += weight;
        }
        (whole > 0.0).then(|| Self { pose: sum.pose / whole, range: sum.range / whole })
    }
}

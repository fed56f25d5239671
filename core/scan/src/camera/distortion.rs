//! Lens distortion: models, their derivatives, how far from the axis they are one-to-one, and their inverse.

use glam::{DMat2, DVec2};

/// How a lens bends rays, as a map of the plane at distance 1 in front of the camera (x right, y down).
///
/// The coefficients are those of OpenCV and COLMAP, in their order: `k` acts along the radius, `p` is tangential, with p1 first:
/// x' = x·radial + 2·p1·x·y + p2·(r² + 2x²), y' = y·radial + p1·(r² + 2y²) + 2·p2·x·y.
///
/// Sources: OpenCV, "Camera Calibration and 3D Reconstruction" (modules calib3d and fisheye); COLMAP, `src/colmap/sensor/models.h`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Distortion {
    /// None: straight lines stay straight.
    #[default]
    None,
    /// Brown's: radial = 1 + k1·r² + k2·r⁴ + k3·r⁶ + k4·r⁸.
    Brown {
        /// k1 to k4.
        k: [f64; 4],
        /// p1 and p2.
        p: [f64; 2],
    },
    /// The rational model of OpenCV: radial = (1 + k1·r² + k2·r⁴ + k3·r⁶) / (1 + k4·r² + k5·r⁴ + k6·r⁶).
    OpenCv {
        /// k1 to k6.
        k: [f64; 6],
        /// p1 and p2.
        p: [f64; 2],
    },
    /// The model of Kannala and Brandt: as [`Self::Brown`], but r is the angle from the axis, radians, instead of its tangent. OpenCV and
    /// COLMAP (`OPENCV_FISHEYE`) have no tangential part (`p` = 0); Metashape and `THIN_PRISM_FISHEYE` have one.
    Fisheye {
        /// k1 to k4.
        k: [f64; 4],
        /// p1 and p2.
        p: [f64; 2],
    },
}

/// Where the stretch of the map falls below this, it is not used: there a lens would squeeze a picture to a fiftieth of its scale at the
/// centre, shortly before the polynomial folds back.
const MIN_STRETCH: f64 = 0.02;
/// Spacing at which the map is examined, radians from the axis.
const SPACING: f64 = 0.25 / 180.0 * std::f64::consts::PI;
/// Directions in which a map with a tangential part is examined.
const DIRECTIONS: u32 = 32;
/// The widest angle from the axis of a map of the plane, radians (89.9°).
const WIDEST: f64 = 89.9 / 180.0 * std::f64::consts::PI;

impl Distortion {
    /// Whether r is an angle.
    pub(super) fn is_fisheye(&self) -> bool {
        matches!(self, Self::Fisheye { .. })
    }

    fn coefficients(&self) -> impl Iterator<Item = f64> {
        let (k, p): (&[f64], &[f64]) = match self {
            Self::None => (&[], &[]),
            Self::Brown { k, p } | Self::Fisheye { k, p } => (k, p),
            Self::OpenCv { k, p } => (k, p),
        };
        k.iter().chain(p).copied()
    }

    /// Whether all coefficients are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.coefficients().all(f64::is_finite)
    }

    /// [`Self::None`] for the identity.
    pub(super) fn simplified(self) -> Self {
        let is_none = !self.is_fisheye() && self.coefficients().all(|c| c == 0.0);
        if is_none { Self::None } else { self }
    }

    /// p1 and p2.
    fn tangential(&self) -> [f64; 2] {
        match self {
            Self::None => [0.0; 2],
            Self::Brown { p, .. } | Self::OpenCv { p, .. } | Self::Fisheye { p, .. } => *p,
        }
    }

    /// The radial factor at r², and its derivative with respect to r². NaN beyond a pole.
    fn radial(&self, r2: f64) -> (f64, f64) {
        match *self {
            Self::None => (1.0, 0.0),
            Self::Brown { k: [k1, k2, k3, k4], .. } | Self::Fisheye { k: [k1, k2, k3, k4], .. } => (
                1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4))),
                k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4)),
            ),
            Self::OpenCv { k: [k1, k2, k3, k4, k5, k6], .. } => {
                let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
                let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
                if below <= 0.0 {
                    return (f64::NAN, f64::NAN);
                }
                let d_above = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
                let d_below = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
                (above / below, (d_above * below - above * d_below) / (below * below))
            }
        }
    }

    /// The image of a point of the plane, and the derivative, which is symmetric.
    pub(super) fn apply(&self, u: DVec2) -> (DVec2, DMat2) {
        let (x, y, r2) = (u.x, u.y, u.length_squared());
        let [p1, p2] = self.tangential();
        let (radial, slope) = self.radial(r2);
        let to = DVec2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let off = 2.0 * (x * y * slope + p1 * x + p2 * y);
        let xx = radial + 2.0 * (x * x * slope + p1 * y + 3.0 * p2 * x);
        let yy = radial + 2.0 * (y * y * slope + 3.0 * p1 * y + p2 * x);
        (to, DMat2::from_cols(DVec2::new(xx, off), DVec2::new(off, yy)))
    }

    /// The radius up to which the map is one-to-one: on this disc its derivative is symmetric and positive definite, which is sufficient
    /// on a convex domain. Infinite without distortion.
    pub(super) fn limit(&self) -> f64 {
        if *self == Self::None {
            return f64::INFINITY;
        }
        let radius = |angle: f64| if self.is_fisheye() { angle } else { libm::tan(angle) };
        let widest = if self.is_fisheye() { std::f64::consts::PI - 1e-3 } else { WIDEST };
        let directions = self.directions();
        let mut good = 0.0;
        while good < widest {
            let next = (good + SPACING).min(widest);
            if !self.is_regular(radius(next), &directions) {
                let mut bad = next;
                for _ in 0..50 {
                    let middle = 0.5 * (good + bad);
                    if self.is_regular(radius(middle), &directions) {
                        good = middle;
                    } else {
                        bad = middle;
                    }
                }
                break;
            }
            good = next;
        }
        radius(good)
    }

    /// Directions in which the map is examined.
    fn directions(&self) -> Vec<DVec2> {
        let count = if self.tangential() == [0.0; 2] { 1 } else { DIRECTIONS };
        let turn = |k: u32| f64::from(k) * std::f64::consts::TAU / f64::from(DIRECTIONS);
        (0..count).map(turn).map(|turn| DVec2::new(libm::cos(turn), libm::sin(turn))).collect()
    }

    /// Whether the stretch is large enough in these directions at a radius.
    fn is_regular(&self, radius: f64, directions: &[DVec2]) -> bool {
        directions.iter().all(|direction| min_eigenvalue(self.apply(*direction * radius).1) >= MIN_STRETCH)
    }

    /// The point within `limit` that is mapped to `to`, if there is one: Newton's iteration with halved steps, from the
    /// solution without
    /// the tangential part. Exact to about 1e-14 of the distance from the axis.
    pub(super) fn invert(&self, to: DVec2, limit: f64) -> Option<DVec2> {
        if *self == Self::None {
            return Some(to);
        }
        let length = to.length();
        if length == 0.0 {
            return Some(to);
        }
        let mut u = to * (self.invert_radial(length, limit) / length);
        let mut error = self.apply(u).0 - to;
        for _ in 0..60 {
            let step = self.apply(u).1.inverse() * error;
            let mut share = 1.0;
            let next = loop {
                let next = (u - step * share).clamp_length_max(limit);
                let left = self.apply(next).0 - to;
                if left.length_squared() < error.length_squared() {
                    break Some((next, left));
                }
                share *= 0.5;
                if share < 1e-3 {
                    break None;
                }
            };
            // No step improves it: it is exact, or there is no solution.
            let Some(next) = next else { break };
            (u, error) = next;
        }
        (error.length() <= 1e-13 * (1.0 + length)).then_some(u)
    }

    /// The radius that the radial part maps to `length`, or `limit` if no smaller radius does: Newton's iteration kept
    /// in a bracket.
    fn invert_radial(&self, length: f64, limit: f64) -> f64 {
        let (mut low, mut high) = (0.0, limit);
        let mut r = length.min(0.5 * limit);
        for _ in 0..80 {
            let (radial, slope) = self.radial(r * r);
            let error = r * radial - length;
            if error > 0.0 {
                high = r;
            } else {
                low = r;
            }
            let newton = r - error / (radial + 2.0 * r * r * slope);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - r).abs() <= 1e-15 * r {
                return next;
            }
            r = next;
        }
        r
    }
}

/// The smaller eigenvalue of a symmetric matrix. NaN if an entry is.
fn min_eigenvalue(m: DMat2) -> f64 {
    let (a, b, c) = (m.x_axis.x, m.x_axis.y, m.y_axis.y);
    let half = 0.5 * (a - c);
    0.5 * (a + c) - (half * half + b * b).sqrt()
}

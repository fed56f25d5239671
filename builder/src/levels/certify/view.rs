//! Looking at triangles along one direction: a frame, and triangles in it.

use super::polygon::{Line, Point2};
use super::surface::Triangle;
use kilwa_geometry::distance::{Vec3, dot, sub};

/// Distance in lattice units within which a point counts as on a line. Far below [`kilwa_geometry::distance::ABSOLUTE_SLACK`],
/// far above the rounding of coordinates.
pub(super) const ON_LINE: f64 = 1e-7;
/// A triangle is seen only where it is less steep than this (height over run, squared), and faces the viewer.
const STEEPEST: f64 = 16.0;
/// An area of less than this share of the square of the sides has no plane to speak of.
const THINNEST: f64 = 1e-6;
/// Up to this steepness (squared) the height difference is taken for the distance: at most a tenth more.
const FLAT: f64 = 0.2;

/// The direction in which two surfaces are compared, as the third of three axes.
pub(super) struct Frame {
    origin: Vec3,
    axes: [Vec3; 3],
}

impl Frame {
    /// Looking along `direction`, from `origin`. `None` where there is no direction.
    pub(super) fn along(direction: Vec3, origin: Vec3) -> Option<Self> {
        let l = dot(direction, direction).sqrt();
        if !(l > 0.0 && l.is_finite()) {
            return None;
        }
        let z = direction.map(|c| c / l);
        // Duff et al., "Building an orthonormal basis, revisited", JCGT 2017.
        let sign = 1f64.copysign(z[2]);
        let a = -1.0 / (sign + z[2]);
        let b = z[0] * z[1] * a;
        let x = [1.0 + sign * z[0] * z[0] * a, sign * b, -sign * z[0]];
        let y = [b, sign + z[1] * z[1] * a, -z[1]];
        Some(Self { origin, axes: [x, y, z] })
    }

    /// Coordinates in the frame.
    pub(super) fn inside(&self, p: Vec3) -> Vec3 {
        let d = sub(p, self.origin);
        [dot(d, self.axes[0]), dot(d, self.axes[1]), dot(d, self.axes[2])]
    }
}

/// A triangle as seen in a frame.
pub(super) struct Seen {
    pub(super) flat: [Point2; 3],
    pub(super) edges: [Line; 3],
    /// Height over the frame's plane: `plane[0] + plane[1] x + plane[2] y`.
    plane: [f64; 3],
    steepness: f64,
}

impl Seen {
    /// Of its corners in the frame; `None` where it is seen from behind or is too steep.
    pub(super) fn of([a, b, c]: Triangle) -> Option<Self> {
        let (u, v) = (sub(b, a), sub(c, a));
        let area = u[0] * v[1] - u[1] * v[0];
        let squares = u[0] * u[0] + u[1] * u[1] + v[0] * v[0] + v[1] * v[1];
        if area <= THINNEST * squares {
            return None;
        }
        let over = 1.0 / area;
        let gx = (u[2] * v[1] - v[2] * u[1]) * over;
        let gy = (u[0] * v[2] - v[0] * u[2]) * over;
        let steepness = gx * gx + gy * gy;
        if steepness > STEEPEST || steepness.is_nan() {
            return None;
        }
        let flat = [[a[0], a[1]], [b[0], b[1]], [c[0], c[1]]];
        let edges = [
            Line::through(flat[0], flat[1], ON_LINE),
            Line::through(flat[1], flat[2], ON_LINE),
            Line::through(flat[2], flat[0], ON_LINE),
        ];
        Some(Self { flat, edges, plane: [a[2] - gx * a[0] - gy * a[1], gx, gy], steepness })
    }

    /// Whether a height difference may be much more than the distance.
    pub(super) fn is_steep(&self) -> bool {
        self.steepness > FLAT
    }

    /// The point of this triangle's plane over a point of the frame's.
    pub(super) fn lift(&self, p: &Point2, frame: &Frame) -> Vec3 {
        let h = self.plane[0] + self.plane[1] * p[0] + self.plane[2] * p[1];
        let [x, y, z] = &frame.axes;
        std::array::from_fn(|i| frame.origin[i] + x[i] * p[0] + y[i] * p[1] + z[i] * h)
    }

    /// The height of this triangle's plane over a point of the frame's.
    pub(super) fn height(&self, p: &Point2) -> f64 {
        self.plane[0] + self.plane[1] * p[0] + self.plane[2] * p[1]
    }

    /// The largest height difference between the planes of two triangles at some points.
    pub(super) fn height_over(&self, own: &Self, points: &[Point2]) -> f64 {
        let d: [f64; 3] = std::array::from_fn(|i| self.plane[i] - own.plane[i]);
        points.iter().map(|p| (d[0] + d[1] * p[0] + d[2] * p[1]).abs()).fold(0.0, f64::max)
    }
}

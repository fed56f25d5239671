//! Looking at triangles along one direction: a frame, and triangles in it.

use super::polygon::{Line, Point2};
use super::surface::Triangle;
use glam::DVec3;

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
    origin: DVec3,
    axes: [DVec3; 3],
}

impl Frame {
    /// Looking along `direction`, from `origin`. `None` where there is no direction.
    pub(super) fn along(direction: DVec3, origin: DVec3) -> Option<Self> {
        let l = direction.length();
        if !(l > 0.0 && l.is_finite()) {
            return None;
        }
        let z = direction / l;
        // Duff et al., "Building an orthonormal basis, revisited", JCGT 2017.
        let sign = 1f64.copysign(z.z);
        let a = -1.0 / (sign + z.z);
        let b = z.x * z.y * a;
        let x = DVec3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x);
        let y = DVec3::new(b, sign + z.y * z.y * a, -z.y);
        Some(Self { origin, axes: [x, y, z] })
    }

    /// Coordinates in the frame.
    pub(super) fn inside(&self, p: DVec3) -> DVec3 {
        let d = p - self.origin;
        DVec3::new(d.dot(self.axes[0]), d.dot(self.axes[1]), d.dot(self.axes[2]))
    }
}

/// A triangle as seen in a frame.
pub(super) struct Seen {
    pub(super) flat: [Point2; 3],
    pub(super) edges: [Line; 3],
    /// Height over the frame's plane: `plane.x + plane.y x + plane.z y`.
    plane: DVec3,
    steepness: f64,
}

impl Seen {
    /// Of its corners in the frame; `None` where it is seen from behind or is too steep.
    pub(super) fn of([a, b, c]: Triangle) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let area = u.x * v.y - u.y * v.x;
        let squares = u.x * u.x + u.y * u.y + v.x * v.x + v.y * v.y;
        if area <= THINNEST * squares {
            return None;
        }
        let over = 1.0 / area;
        let gx = (u.z * v.y - v.z * u.y) * over;
        let gy = (u.x * v.z - v.x * u.z) * over;
        let steepness = gx * gx + gy * gy;
        if steepness > STEEPEST || steepness.is_nan() {
            return None;
        }
        let flat = [a, b, c].map(DVec3::truncate);
        let edges = [
            Line::through(flat[0], flat[1], ON_LINE),
            Line::through(flat[1], flat[2], ON_LINE),
            Line::through(flat[2], flat[0], ON_LINE),
        ];
        Some(Self { flat, edges, plane: DVec3::new(a.z - gx * a.x - gy * a.y, gx, gy), steepness })
    }

    /// Whether a height difference may be much more than the distance.
    pub(super) fn is_steep(&self) -> bool {
        self.steepness > FLAT
    }

    /// The point of this triangle's plane over a point of the frame's.
    pub(super) fn lift(&self, p: &Point2, frame: &Frame) -> DVec3 {
        let h = self.plane.x + self.plane.y * p.x + self.plane.z * p.y;
        let [x, y, z] = frame.axes;
        frame.origin + x * p.x + y * p.y + z * h
    }

    /// The height of this triangle's plane over a point of the frame's.
    pub(super) fn height(&self, p: &Point2) -> f64 {
        self.plane.x + self.plane.y * p.x + self.plane.z * p.y
    }

    /// The largest height difference between the planes of two triangles at some points.
    pub(super) fn height_over(&self, own: &Self, points: &[Point2]) -> f64 {
        let d = self.plane - own.plane;
        points.iter().map(|p| (d.x + d.y * p.x + d.z * p.y).abs()).fold(0.0, f64::max)
    }
}

//! Planes: through three points, fitted to many, and coordinates in them.

use crate::refusal::{Refusal, at_least};
use crate::vector::{norm, scale, unit};
use kilwa_geometry::distance::{Vec3, cross, dot, sub};
use serde::{Deserialize, Serialize};

/// Below this share of the largest spread, points count as lying on a line.
const FLAT: f64 = 1e-9;

/// A plane: all `p` with `normal · (p − point) = 0`. In metres, counted from the same origin as the points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// A point of it.
    pub point: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// A plane fitted to points, and how well.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlaneFit {
    /// The plane through the points' centroid that has the least sum of squared distances. Its normal points up, or
    /// north, or east: the first of these that it is not at right angles to.
    pub plane: Plane,
    /// Root mean square distance of the points, metres.
    pub rms: f64,
    /// Largest distance of a point, metres.
    pub largest: f64,
}

impl Plane {
    /// A plane from a point and any normal.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] where the normal has no direction.
    pub fn new(point: Vec3, normal: Vec3) -> Result<Self, Refusal> {
        at_least("a plane", 1, &[point, normal])?;
        let normal = unit(normal).ok_or(Refusal::Coincident { what: "the direction of a plane" })?;
        Ok(Self { point, normal })
    }

    /// Through three points; seen from the side that the normal points to they go round counter-clockwise.
    ///
    /// # Errors
    /// [`Refusal::Collinear`] and [`Refusal::NotFinite`].
    pub fn through(points: [Vec3; 3]) -> Result<Self, Refusal> {
        at_least("a plane", 3, &points)?;
        let (u, v) = (sub(points[1], points[0]), sub(points[2], points[0]));
        let n = cross(u, v);
        let longest = norm(u).max(norm(v)).max(norm(sub(points[2], points[1])));
        if norm(n) <= FLAT * longest * longest {
            return Err(Refusal::Collinear { what: "a plane" });
        }
        Self::new(points[0], n)
    }

    /// Fitted to three points or more (orthogonal least squares: the eigenvector of the smallest eigenvalue of the
    /// covariance; Shakarji, "Least-Squares Fitting Algorithms of the NIST Algorithm Testing System", 1998).
    ///
    /// # Errors
    /// [`Refusal::TooFew`], [`Refusal::Collinear`] and [`Refusal::NotFinite`].
    pub fn fit(points: &[Vec3]) -> Result<PlaneFit, Refusal> {
        at_least("a fitted plane", 3, points)?;
        let count = points.len() as f64;
        // Counted from the first point: the sums stay small also far from the origin.
        let shift = points[0];
        let centre: Vec3 =
            std::array::from_fn(|i| shift[i] + points.iter().map(|p| p[i] - shift[i]).sum::<f64>() / count);
        let mut covariance = [[0.0; 3]; 3];
        for p in points {
            let d = sub(*p, centre);
            for (row, a) in covariance.iter_mut().zip(d) {
                for (cell, b) in row.iter_mut().zip(d) {
                    *cell += a * b;
                }
            }
        }
        let (values, vectors) = eigen(covariance);
        if values[1] <= FLAT * FLAT * values[2] || values[2] == 0.0 {
            return Err(Refusal::Collinear { what: "a plane" });
        }
        let plane = Self { point: centre, normal: upward(vectors[0]) };
        let distances = points.iter().map(|p| plane.distance(*p));
        let (mut squares, mut largest) = (0.0, 0.0f64);
        for d in distances {
            squares += d * d;
            largest = largest.max(d.abs());
        }
        Ok(PlaneFit { plane, rms: libm::sqrt(squares / count), largest })
    }

    /// Signed distance: positive on the side that the normal points to.
    pub fn distance(&self, p: Vec3) -> f64 {
        dot(self.normal, sub(p, self.point))
    }

    /// The foot of the perpendicular from `p`.
    pub fn foot(&self, p: Vec3) -> Vec3 {
        let d = self.distance(p);
        std::array::from_fn(|i| p[i] - d * self.normal[i])
    }

    /// Two unit vectors in the plane, right-handed with the normal: the first horizontal, the second as upright as can
    /// be; in a horizontal plane east and north.
    pub fn axes(&self) -> [Vec3; 2] {
        let n = self.normal;
        let level = if n[0].abs() + n[1].abs() < 1e-12 { None } else { unit([-n[1], n[0], 0.0]) };
        let across = level.unwrap_or([1.0, 0.0, 0.0]);
        [across, cross(n, across)]
    }

    /// Coordinates in the plane, along [`Plane::axes`], from its point.
    pub fn coordinates(&self, p: Vec3) -> [f64; 2] {
        let d = sub(p, self.point);
        self.axes().map(|axis| dot(axis, d))
    }
}

/// The same line of direction, pointing up, or north, or east.
fn upward(n: Vec3) -> Vec3 {
    let first = [2, 1, 0].into_iter().map(|i| n[i]).find(|x| x.abs() > 1e-12).unwrap_or(1.0);
    if first < 0.0 { scale(n, -1.0) } else { n }
}

/// Eigenvalues, smallest first, and unit eigenvectors of a symmetric matrix: cyclic Jacobi rotations (Golub and Van
/// Loan, "Matrix Computations", section 8.5), which converge for every such matrix.
fn eigen(mut a: [[f64; 3]; 3]) -> ([f64; 3], [Vec3; 3]) {
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..32 {
        let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        let diagonal = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
        if off <= 1e-36 * diagonal {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i].max(0.0)), order.map(|i| std::array::from_fn(|row| v[row][i])))
}

/// The rotation that makes `a[p][q]` zero.
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = libm::copysign(1.0, theta) / (theta.abs() + libm::sqrt(theta * theta + 1.0));
    let c = 1.0 / libm::sqrt(t * t + 1.0);
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    let (of_p, of_q) = (a[p], a[q]);
    for k in 0..3 {
        a[p][k] = c * of_p[k] - s * of_q[k];
        a[q][k] = s * of_p[k] + c * of_q[k];
    }
    for row in v.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_plane_is_fitted_exactly_to_its_points(
            at in prop::array::uniform3(-1e3f64..1e3), n in prop::array::uniform3(-1.0f64..1.0),
            spread in prop::collection::vec((-50.0f64..50.0, -50.0f64..50.0), 6..40), far in prop::bool::ANY,
        ) {
            prop_assume!(norm(n) > 0.1);
            let shift = if far { [500_000.0, 4_649_776.0, 123.456] } else { [0.0; 3] };
            let at: Vec3 = std::array::from_fn(|i| at[i] + shift[i]);
            let plane = Plane::new(at, n).unwrap();
            let [u, v] = plane.axes();
            prop_assert!((dot(u, v)).abs() < 1e-12 && dot(cross(u, v), plane.normal) > 1.0 - 1e-12);
            let points: Vec<Vec3> =
                spread.iter().map(|(a, b)| std::array::from_fn(|i| at[i] + u[i] * a + v[i] * b)).collect();
            let Ok(fit) = Plane::fit(&points) else { return Ok(()) };
            prop_assert!(fit.largest < 1e-6, "{fit:?}");
            if Plane::through([points[0], points[1], points[2]]).is_ok() {
                let wide = points.iter().map(|p| norm(sub(*p, points[0]))).fold(0.0, f64::max);
                prop_assume!(wide > 5.0);
                prop_assert!(dot(fit.plane.normal, plane.normal).abs() > 1.0 - 1e-4);
            }
        }
    }

    #[test]
    fn an_upright_plane_has_a_level_and_an_upright_axis_and_a_horizontal_one_east_and_north() {
        let wall = Plane::new([0.0; 3], [0.0, -1.0, 0.0]).unwrap();
        assert_eq!(wall.axes(), [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "seen from the south, east is to the right");
        let floor = Plane::new([0.0; 3], [0.0, 0.0, 2.0]).unwrap();
        assert_eq!(floor.axes(), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(floor.coordinates([3.0, 4.0, 9.0]), [3.0, 4.0]);
    }

    #[test]
    fn collinear_points_define_no_plane() {
        let line = [[0.0; 3], [1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [4.0, 8.0, 12.0]];
        assert!(matches!(Plane::fit(&line), Err(Refusal::Collinear { .. })));
        assert!(matches!(Plane::through([line[0], line[1], line[3]]), Err(Refusal::Collinear { .. })));
        assert!(matches!(Plane::fit(&line[..2]), Err(Refusal::TooFew { given: 2, .. })));
        assert!(matches!(Plane::fit(&[[f64::NAN; 3]; 3]), Err(Refusal::NotFinite)));
    }
}

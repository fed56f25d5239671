//! Planes: through three points, fitted to many, and coordinates in them.

use crate::refusal::{Refusal, at_least};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Below this share of the largest spread, points count as lying on a line.
const FLAT: f64 = 1e-9;

/// A plane: all `p` with `normal · (p − point) = 0`. In metres, counted from the same origin as the points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Plane {
    /// A point of it.
    pub point: DVec3,
    /// Unit normal.
    pub normal: DVec3,
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
    pub fn new(point: DVec3, normal: DVec3) -> Result<Self, Refusal> {
        at_least("a plane", 1, &[point, normal])?;
        let normal = normal.try_normalize().ok_or(Refusal::Coincident { what: "the direction of a plane" })?;
        Ok(Self { point, normal })
    }

    /// Through three points; seen from the side that the normal points to they go round counter-clockwise.
    ///
    /// # Errors
    /// [`Refusal::Collinear`] and [`Refusal::NotFinite`].
    pub fn through(points: [DVec3; 3]) -> Result<Self, Refusal> {
        at_least("a plane", 3, &points)?;
        let (u, v) = (points[1] - points[0], points[2] - points[0]);
        let n = u.cross(v);
        let longest = u.length().max(v.length()).max((points[2] - points[1]).length());
        if n.length() <= FLAT * longest * longest {
            return Err(Refusal::Collinear { what: "a plane" });
        }
        Self::new(points[0], n)
    }

    /// Fitted to three points or more (orthogonal least squares: the eigenvector of the smallest eigenvalue of the
    /// covariance; Shakarji, "Least-Squares Fitting Algorithms of the NIST Algorithm Testing System", 1998).
    ///
    /// # Errors
    /// [`Refusal::TooFew`], [`Refusal::Collinear`] and [`Refusal::NotFinite`].
    pub fn fit(points: &[DVec3]) -> Result<PlaneFit, Refusal> {
        at_least("a fitted plane", 3, points)?;
        let count = points.len() as f64;
        // Counted from the first point: the sums stay small also far from the origin.
        let shift = points[0];
        let centre = shift + points.iter().map(|p| *p - shift).sum::<DVec3>() / count;
        let mut covariance = [DVec3::ZERO; 3];
        for p in points {
            let d = *p - centre;
            for (row, a) in covariance.iter_mut().zip(d.to_array()) {
                *row += a * d;
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
    pub fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.point)
    }

    /// The foot of the perpendicular from `p`.
    pub fn foot(&self, p: DVec3) -> DVec3 {
        let d = self.distance(p);
        p - d * self.normal
    }

    /// Two unit vectors in the plane, right-handed with the normal: the first horizontal, the second as upright as can
    /// be; in a horizontal plane east and north.
    pub fn axes(&self) -> [DVec3; 2] {
        let n = self.normal;
        let level = if n.x.abs() + n.y.abs() < 1e-12 { None } else { DVec3::new(-n.y, n.x, 0.0).try_normalize() };
        let across = level.unwrap_or(DVec3::X);
        [across, n.cross(across)]
    }

    /// Coordinates in the plane, along [`Plane::axes`], from its point.
    pub fn coordinates(&self, p: DVec3) -> DVec2 {
        let d = p - self.point;
        self.axes().map(|axis| axis.dot(d)).into()
    }
}

/// The same line of direction, pointing up, or north, or east.
fn upward(n: DVec3) -> DVec3 {
    let first = [2, 1, 0].into_iter().map(|i| n[i]).find(|x| x.abs() > 1e-12).unwrap_or(1.0);
    if first < 0.0 { -n } else { n }
}

/// Eigenvalues, smallest first, and unit eigenvectors of a symmetric matrix: cyclic Jacobi rotations (Golub and Van
/// Loan, "Matrix Computations", section 8.5), which converge for every such matrix.
fn eigen(mut a: [DVec3; 3]) -> (DVec3, [DVec3; 3]) {
    let mut v = [DVec3::X, DVec3::Y, DVec3::Z];
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
    (order.map(|i| a[i][i].max(0.0)).into(), order.map(|i| DVec3::new(v[0][i], v[1][i], v[2][i])))
}

/// The rotation that makes `a[p][q]` zero.
fn rotate(a: &mut [DVec3; 3], v: &mut [DVec3; 3], p: usize, q: usize) {
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
            at in prop::array::uniform3(-1e3f64..1e3).prop_map(DVec3::from), n in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from),
            spread in prop::collection::vec((-50.0f64..50.0, -50.0f64..50.0), 6..40), far in prop::bool::ANY,
        ) {
            prop_assume!(n.length() > 0.1);
            let shift = if far { DVec3::new(500_000.0, 4_649_776.0, 123.456) } else { DVec3::ZERO };
            let at = at + shift;
            let plane = Plane::new(at, n).unwrap();
            let [u, v] = plane.axes();
            prop_assert!((u.dot(v)).abs() < 1e-12 && u.cross(v).dot(plane.normal) > 1.0 - 1e-12);
            let points: Vec<DVec3> =
                spread.iter().map(|(a, b)| at + u * a + v * b).collect();
            let Ok(fit) = Plane::fit(&points) else { return Ok(()) };
            prop_assert!(fit.largest < 1e-6, "{fit:?}");
            if Plane::through([points[0], points[1], points[2]]).is_ok() {
                let wide = points.iter().map(|p| (*p - points[0]).length()).fold(0.0, f64::max);
                prop_assume!(wide > 5.0);
                prop_assert!(fit.plane.normal.dot(plane.normal).abs() > 1.0 - 1e-4);
            }
        }
    }

    #[test]
    fn an_upright_plane_has_a_level_and_an_upright_axis_and_a_horizontal_one_east_and_north() {
        let wall = Plane::new(DVec3::ZERO, DVec3::new(0.0, -1.0, 0.0)).unwrap();
        assert_eq!(wall.axes(), [DVec3::X, DVec3::Z], "seen from the south, east is to the right");
        let floor = Plane::new(DVec3::ZERO, DVec3::new(0.0, 0.0, 2.0)).unwrap();
        assert_eq!(floor.axes(), [DVec3::X, DVec3::Y]);
        assert_eq!(floor.coordinates(DVec3::new(3.0, 4.0, 9.0)), DVec2::new(3.0, 4.0));
    }

    #[test]
    fn collinear_points_define_no_plane() {
        let line = [DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 4.0, 6.0), DVec3::new(4.0, 8.0, 12.0)];
        assert!(matches!(Plane::fit(&line), Err(Refusal::Collinear { .. })));
        assert!(matches!(Plane::through([line[0], line[1], line[3]]), Err(Refusal::Collinear { .. })));
        assert!(matches!(Plane::fit(&line[..2]), Err(Refusal::TooFew { given: 2, .. })));
        assert!(matches!(Plane::fit(&[DVec3::splat(f64::NAN); 3]), Err(Refusal::NotFinite)));
    }
}

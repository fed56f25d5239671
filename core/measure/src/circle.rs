//! A circle through points: radius and diameter of columns, arches and wells.

use crate::plane::{Plane, PlaneFit};
use crate::refusal::{Refusal, at_least};
use glam::{DMat3, DVec2, DVec3};
use serde::Serialize;

/// A fitted circle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Circle {
    /// Its centre.
    pub centre: DVec3,
    /// Its radius, metres.
    pub radius: f64,
    /// The plane that it lies in, and how far the points are from it.
    pub plane: PlaneFit,
    /// Root mean square distance of the points from the circle within its plane, metres.
    pub rms: f64,
    /// How much the radius changes when every point moves by one unit at random: its standard uncertainty is this times that of a point.
    pub spread: f64,
}

impl Circle {
    /// Fitted to three points or more: the plane first, in it the circle with the least sum of squared distances, by
    /// Gauss and Newton from the algebraic circle (Kåsa 1976; Gander, Golub and Strebel, "Least-squares fitting of
    /// circles and ellipses", 1994).
    ///
    /// # Errors
    /// [`Refusal::TooFew`], [`Refusal::Collinear`], [`Refusal::NotFinite`].
    pub fn fit(points: &[DVec3]) -> Result<Self, Refusal> {
        at_least("a circle", 3, points)?;
        let plane = Plane::fit(points).map_err(|e| match e {
            Refusal::Collinear { .. } => Refusal::Collinear { what: "a circle" },
            other => other,
        })?;
        let flat: Vec<DVec2> = points.iter().map(|p| plane.plane.coordinates(*p)).collect();
        let straight = Refusal::Collinear { what: "a circle" };
        let mut circle = algebraic(&flat).ok_or(straight.clone())?;
        let mut inverse = DMat3::ZERO;
        for _ in 0..50 {
            let (step, covariance) = gauss_newton(&flat, circle).ok_or(straight.clone())?;
            inverse = covariance;
            circle += step;
            if step.abs().cmple(DVec3::splat(1e-14 * circle.z.abs())).all() {
                break;
            }
        }
        let DVec3 { x, y, z: radius } = circle;
        if !(radius.is_finite() && radius > 0.0) {
            return Err(straight);
        }
        let [u, v] = plane.plane.axes();
        let squares: f64 = flat.iter().map(|p| distance(*p, circle)).map(|d| d * d).sum();
        Ok(Self {
            centre: plane.plane.point + (u * x + v * y),
            radius,
            plane,
            rms: libm::sqrt(squares / points.len() as f64),
            spread: libm::sqrt(inverse.z_axis.z),
        })
    }
}

/// How far outside of the circle `(x, y, radius)` a point is.
fn distance(p: DVec2, circle: DVec3) -> f64 {
    libm::hypot(p.x - circle.x, p.y - circle.y) - circle.z
}

/// Kåsa's circle: least squares of `x² + y² = 2 a x + 2 b y + c`.
fn algebraic(points: &[DVec2]) -> Option<DVec3> {
    let (mut m, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for p in points {
        let row = DVec3::new(2.0 * p.x, 2.0 * p.y, 1.0);
        accumulate(&mut m, &mut right, row, p.length_squared());
    }
    let inverse = invert(m)?;
    let DVec3 { x: a, y: b, z: c } = inverse * right;
    Some(DVec3::new(a, b, libm::sqrt(c + a * a + b * b)))
}

/// One step, and the inverse of the normal matrix.
fn gauss_newton(points: &[DVec2], circle: DVec3) -> Option<(DVec3, DMat3)> {
    let (mut m, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for p in points {
        let far = libm::hypot(p.x - circle.x, p.y - circle.y);
        if far == 0.0 {
            return None;
        }
        let row = DVec3::new((circle.x - p.x) / far, (circle.y - p.y) / far, -1.0);
        accumulate(&mut m, &mut right, row, -distance(*p, circle));
    }
    let inverse = invert(m)?;
    Some((inverse * right, inverse))
}

fn accumulate(m: &mut DMat3, right: &mut DVec3, row: DVec3, value: f64) {
    *m += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
    *right += row * value;
}

/// Inverse of a symmetric matrix by cofactors; `None` where it has none. Each cofactor is divided by the determinant: glam multiplies by
/// its reciprocal, which rounds twice.
fn invert(m: DMat3) -> Option<DMat3> {
    let [a, b, c] = [m.x_axis, m.y_axis, m.z_axis];
    let cofactors = DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b));
    let det = a.dot(cofactors.x_axis);
    let size = [a, b, c].into_iter().fold(0.0, |size: f64, column| size.max(column.abs().max_element()));
    (det.abs() > 1e-14 * size * size * size.min(1.0)).then(|| cofactors / det)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_circle_is_fitted_exactly_at_any_position_and_tilt(
            r in 0.5f64..50.0, n in prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from), from in 0.0f64..6.0, arc in 1.5f64..5.0,
            count in 3usize..40, far in prop::bool::ANY,
        ) {
            prop_assume!(n.length() > 0.1);
            let at = if far { DVec3::new(500_000.0, 4_649_776.0, 123.456) } else { DVec3::new(1.0, 2.0, 3.0) };
            let plane = Plane::new(at, n).unwrap();
            let [u, v] = plane.axes();
            let points: Vec<DVec3> = (0..count).map(|i| {
                let a = from + arc * i as f64 / (count - 1) as f64;
                at + (u * (r * a.cos()) + v * (r * a.sin()))
            }).collect();
            let c = Circle::fit(&points).unwrap();
            prop_assert!((c.radius - r).abs() < 1e-6, "{} {}", c.radius, r);
            prop_assert!((c.centre - at).length() < 1e-6 && c.rms < 1e-6);
        }
    }

    #[test]
    fn a_circle_of_n_points_is_as_certain_as_the_mean_of_n_and_collinear_points_are_refused() {
        let points: Vec<DVec3> = (0..100)
            .map(|i| {
                let a = f64::from(i) * 0.062_831_853;
                DVec3::new(a.cos(), a.sin(), 0.0)
            })
            .collect();
        let c = Circle::fit(&points).unwrap();
        assert!((c.spread - 0.1).abs() < 1e-3, "{}", c.spread);
        let line: Vec<DVec3> = (0..9).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        assert_eq!(Circle::fit(&line), Err(Refusal::Collinear { what: "a circle" }));
    }
}

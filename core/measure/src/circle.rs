//! A circle through points: radius and diameter of columns, arches and wells.

use crate::plane::{Plane, PlaneFit};
use crate::refusal::{Refusal, at_least};
use crate::vector::{add, scale};
use kilwa_geometry::distance::Vec3;
use serde::Serialize;

/// A fitted circle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Circle {
    /// Its centre.
    pub centre: Vec3,
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
    pub fn fit(points: &[Vec3]) -> Result<Self, Refusal> {
        at_least("a circle", 3, points)?;
        let plane = Plane::fit(points).map_err(|e| match e {
            Refusal::Collinear { .. } => Refusal::Collinear { what: "a circle" },
            other => other,
        })?;
        let flat: Vec<[f64; 2]> = points.iter().map(|p| plane.plane.coordinates(*p)).collect();
        let straight = Refusal::Collinear { what: "a circle" };
        let mut circle = algebraic(&flat).ok_or(straight.clone())?;
        let mut inverse = [[0.0; 3]; 3];
        for _ in 0..50 {
            let (step, covariance) = gauss_newton(&flat, circle).ok_or(straight.clone())?;
            inverse = covariance;
            for (x, d) in circle.iter_mut().zip(step) {
                *x += d;
            }
            if step.iter().all(|d| d.abs() <= 1e-14 * circle[2].abs()) {
                break;
            }
        }
        let [x, y, radius] = circle;
        if !(radius.is_finite() && radius > 0.0) {
            return Err(straight);
        }
        let [u, v] = plane.plane.axes();
        let squares: f64 = flat.iter().map(|p| distance(*p, circle)).map(|d| d * d).sum();
        Ok(Self {
            centre: add(plane.plane.point, add(scale(u, x), scale(v, y))),
            radius,
            plane,
            rms: libm::sqrt(squares / points.len() as f64),
            spread: libm::sqrt(inverse[2][2]),
        })
    }
}

fn distance(p: [f64; 2], [x, y, r]: [f64; 3]) -> f64 {
    libm::hypot(p[0] - x, p[1] - y) - r
}

/// Kåsa's circle: least squares of `x² + y² = 2 a x + 2 b y + c`.
fn algebraic(points: &[[f64; 2]]) -> Option<[f64; 3]> {
    let (mut m, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    for p in points {
        let row = [2.0 * p[0], 2.0 * p[1], 1.0];
        accumulate(&mut m, &mut right, row, p[0] * p[0] + p[1] * p[1]);
    }
    let inverse = invert(m)?;
    let [a, b, c] = apply(inverse, right);
    Some([a, b, libm::sqrt(c + a * a + b * b)])
}

/// One step, and the inverse of the normal matrix.
fn gauss_newton(points: &[[f64; 2]], circle: [f64; 3]) -> Option<([f64; 3], [[f64; 3]; 3])> {
    let (mut m, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
    for p in points {
        let far = libm::hypot(p[0] - circle[0], p[1] - circle[1]);
        if far == 0.0 {
            return None;
        }
        let row = [(circle[0] - p[0]) / far, (circle[1] - p[1]) / far, -1.0];
        accumulate(&mut m, &mut right, row, -distance(*p, circle));
    }
    let inverse = invert(m)?;
    Some((apply(inverse, right), inverse))
}

fn accumulate(m: &mut [[f64; 3]; 3], right: &mut [f64; 3], row: [f64; 3], value: f64) {
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] += row[i] * row[j];
        }
        right[i] += row[i] * value;
    }
}

fn apply(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row.iter().zip(v).map(|(a, b)| a * b).sum())
}

/// Inverse of a symmetric matrix by cofactors; `None` where it has none.
fn invert(m: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let minor = |i: usize, j: usize| {
        let (r, c) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        m[r[0]][c[0]] * m[r[1]][c[1]] - m[r[0]][c[1]] * m[r[1]][c[0]]
    };
    let det: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let size: f64 = m.iter().flatten().fold(0.0, |a: f64, x| a.max(x.abs()));
    if det.abs() <= 1e-14 * size * size * size.min(1.0) {
        return None;
    }
    Some(std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / det)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::norm;
    use kilwa_geometry::distance::sub;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_circle_is_fitted_exactly_at_any_position_and_tilt(
            r in 0.5f64..50.0, n in prop::array::uniform3(-1.0f64..1.0), from in 0.0f64..6.0, arc in 1.5f64..5.0,
            count in 3usize..40, far in prop::bool::ANY,
        ) {
            prop_assume!(norm(n) > 0.1);
            let at = if far { [500_000.0, 4_649_776.0, 123.456] } else { [1.0, 2.0, 3.0] };
            let plane = Plane::new(at, n).unwrap();
            let [u, v] = plane.axes();
            let points: Vec<Vec3> = (0..count).map(|i| {
                let a = from + arc * i as f64 / (count - 1) as f64;
                add(at, add(scale(u, r * a.cos()), scale(v, r * a.sin())))
            }).collect();
            let c = Circle::fit(&points).unwrap();
            prop_assert!((c.radius - r).abs() < 1e-6, "{} {}", c.radius, r);
            prop_assert!(norm(sub(c.centre, at)) < 1e-6 && c.rms < 1e-6);
        }
    }

    #[test]
    fn a_circle_of_n_points_is_as_certain_as_the_mean_of_n_and_collinear_points_are_refused() {
        let points: Vec<Vec3> = (0..100)
            .map(|i| {
                let a = f64::from(i) * 0.062_831_853;
                [a.cos(), a.sin(), 0.0]
            })
            .collect();
        let c = Circle::fit(&points).unwrap();
        assert!((c.spread - 0.1).abs() < 1e-3, "{}", c.spread);
        let line: Vec<Vec3> = (0..9).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        assert_eq!(Circle::fit(&line), Err(Refusal::Collinear { what: "a circle" }));
    }
}

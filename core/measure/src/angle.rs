//! Angles: at a corner, and between two planes. Radians.

use crate::plane::Plane;
use crate::refusal::{Refusal, at_least};
use glam::DVec3;

/// The angle at the second of three points, 0 to π. By the arctangent of cross and dot product, which keeps its
/// precision near 0 and π where the arccosine loses half of its digits.
///
/// # Errors
/// [`Refusal::Coincident`] where a leg has no length.
pub fn at_corner([a, corner, b]: [DVec3; 3]) -> Result<f64, Refusal> {
    at_least("an angle", 3, &[a, corner, b])?;
    let (u, v) = (a - corner, b - corner);
    if u.length() == 0.0 || v.length() == 0.0 {
        return Err(Refusal::Coincident { what: "an angle" });
    }
    Ok(libm::atan2(u.cross(v).length(), u.dot(v)))
}

/// The smaller angle between two planes, 0 to π/2.
pub fn between_planes(a: &Plane, b: &Plane) -> f64 {
    libm::atan2(a.normal.cross(b.normal).length(), a.normal.dot(b.normal).abs())
}

/// How steep a plane is: 0 level, π/2 upright.
pub fn slope(plane: &Plane) -> f64 {
    between_planes(plane, &Plane { point: plane.point, normal: DVec3::Z })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI};

    #[test]
    fn angles_of_known_corners_are_exact_also_tiny_and_flat_ones() {
        let o = DVec3::ZERO;
        assert_eq!(at_corner([DVec3::X, o, DVec3::new(0.0, 2.0, 0.0)]).unwrap(), FRAC_PI_2);
        assert_eq!(at_corner([DVec3::X, o, DVec3::new(-3.0, 0.0, 0.0)]).unwrap(), PI);
        let tiny = at_corner([DVec3::X, o, DVec3::new(1.0, 1e-9, 0.0)]).unwrap();
        assert!((tiny - 1e-9).abs() < 1e-20);
        assert!(matches!(at_corner([o, o, DVec3::X]), Err(Refusal::Coincident { .. })));
        let ramp = Plane::new(o, DVec3::new(-0.5, 0.0, 3f64.sqrt() / 2.0)).unwrap();
        assert!((slope(&ramp) - FRAC_PI_6).abs() < 1e-15);
    }
}

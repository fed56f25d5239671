//! Areas of triangle sets: along the surface, and in plan. Two numbers, never one for the other: a wall has much of the
//! first and almost none of the second.

use kilwa_geometry::distance::{Vec3, cross, dot, sub};

/// Areas in the square of the unit of the triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
pub struct Areas {
    /// Along the surface.
    pub surface: f64,
    /// Projected to the horizontal plane, both sides counted (a roof over a floor counts twice).
    pub plan: f64,
}

impl Areas {
    /// Add one triangle.
    pub fn add(&mut self, [a, b, c]: [Vec3; 3]) {
        let n = cross(sub(b, a), sub(c, a));
        self.surface += libm::sqrt(dot(n, n)) * 0.5;
        self.plan += n[2].abs() * 0.5;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_wall_has_its_full_area_along_the_surface_and_none_in_plan() {
        let mut a = Areas::default();
        a.add([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 0.0, 3.0]]);
        a.add([[0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 0.0, 3.0]]);
        assert_eq!(a, Areas { surface: 12.0, plan: 0.0 });
    }
}

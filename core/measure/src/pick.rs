//! Rays and what they meet.

use kilwa_geometry::distance::Vec3;

/// A half line: `origin + t * direction`, `t >= 0`. The direction need not be of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes.
    pub direction: Vec3,
}

impl Ray {
    /// The point at parameter `t`.
    pub fn at(&self, t: f64) -> Vec3 {
        std::array::from_fn(|i| self.origin[i] + self.direction[i] * t)
    }
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Parameter along the ray.
    pub t: f64,
    /// Number of the triangle.
    pub triangle: u32,
    /// The point.
    pub point: Vec3,
}

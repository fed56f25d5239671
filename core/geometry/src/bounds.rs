//! Axis-aligned boxes on the lattice and bounding spheres in lattice units.

use crate::lattice::LatticePoint;
use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

/// A closed box of lattice points. The empty box has `min > max`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Aabb {
    /// Smallest coordinate on each axis.
    pub min: LatticePoint,
    /// Largest coordinate on each axis.
    pub max: LatticePoint,
}

impl Aabb {
    /// The empty box: the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self { min: IVec3::MAX, max: IVec3::MIN };

    /// The smallest box round some points.
    pub fn of<'a>(points: impl IntoIterator<Item = &'a LatticePoint>) -> Self {
        let mut b = Self::EMPTY;
        for p in points {
            b.add(*p);
        }
        b
    }

    /// Grow to contain a point.
    pub fn add(&mut self, p: LatticePoint) {
        self.min = self.min.min(p);
        self.max = self.max.max(p);
    }

    /// The smallest box round both.
    #[must_use]
    pub fn union(&self, o: &Self) -> Self {
        Self { min: self.min.min(o.min), max: self.max.max(o.max) }
    }

    /// Whether no point lies inside.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }
}

/// A ball in lattice units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre, in lattice units.
    pub center: DVec3,
    /// Radius, in lattice units; negative for the empty ball.
    pub radius: f64,
}

impl Sphere {
    /// The empty ball: the neutral element of [`Sphere::union`].
    pub const EMPTY: Self = Self { center: DVec3::ZERO, radius: -1.0 };

    /// A ball round points: box centre, exact largest distance, inflated by 1e-12 relative against rounding.
    pub fn of(points: &[LatticePoint]) -> Self {
        let b = Aabb::of(points);
        if b.is_empty() {
            return Self::EMPTY;
        }
        let center = (b.min.as_dvec3() + b.max.as_dvec3()) * 0.5;
        let r2 = points.iter().map(|p| center.distance_squared(p.as_dvec3())).fold(0.0, f64::max);
        Self { center, radius: inflate(libm::sqrt(r2)) }
    }

    /// The smallest ball round two balls (inflated by 1e-12 relative against rounding).
    #[must_use]
    pub fn union(&self, o: &Self) -> Self {
        if self.radius < 0.0 {
            return *o;
        }
        if o.radius < 0.0 {
            return *self;
        }
        let d = self.center.distance(o.center);
        if d + o.radius <= self.radius {
            return *self;
        }
        if d + self.radius <= o.radius {
            return *o;
        }
        let r = (d + self.radius + o.radius) * 0.5;
        let t = (r - self.radius) / d;
        let center = self.center + (o.center - self.center) * t;
        Self { center, radius: inflate(r) }
    }

    /// Whether `o` lies inside, with the tolerance `slack` in lattice units.
    pub fn contains(&self, o: &Self, slack: f64) -> bool {
        o.radius < 0.0 || self.center.distance(o.center) + o.radius <= self.radius + slack
    }
}

fn inflate(r: f64) -> f64 {
    r * (1.0 + 1e-12) + 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_union_ball_contains_both() {
        let a = Sphere { center: DVec3::ZERO, radius: 2.0 };
        let b = Sphere { center: DVec3::new(5.0, 1.0, 0.0), radius: 0.5 };
        let u = a.union(&b);
        assert!(u.contains(&a, 0.0) && u.contains(&b, 0.0));
        assert_eq!(Sphere::EMPTY.union(&a), a);
    }
}

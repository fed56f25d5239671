//! The global power-of-two lattice. Positions are snapped to it once, before anything else; every level and every
//! chunk uses it, so that equal positions are equal integers and no cut can crack.

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

/// A point of the lattice, in steps from the lattice origin. Valid coordinates lie in `0..=MAX_COORDINATE`.
pub type LatticePoint = IVec3;

/// Largest coordinate a snapped vertex may have: 30 bits, so that sums of three vertices and differences fit `i64`
/// comfortably and differences of two fit `i32`.
pub const MAX_COORDINATE: i32 = (1 << 30) - 1;

/// A lattice: `world = origin + step * point`, all in metres, axes as stored in the pack (z up unless stated).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// World position of the lattice point `[0, 0, 0]`, in metres.
    pub origin: DVec3,
    /// The step is `2^step_log2` metres.
    pub step_log2: i32,
}

impl Lattice {
    /// The step in metres, exact (a power of two).
    pub fn step(&self) -> f64 {
        libm::scalbn(1.0, self.step_log2)
    }

    /// World position of a lattice point, in metres.
    pub fn world_from_lattice(&self, p: LatticePoint) -> DVec3 {
        let step = self.step();
        self.origin + step * p.as_dvec3()
    }

    /// World position of a point given in (fractional) lattice units.
    pub fn world_from_steps(&self, p: DVec3) -> DVec3 {
        let step = self.step();
        self.origin + step * p
    }

    /// A world position in (fractional) lattice units.
    pub fn steps_from_world(&self, w: DVec3) -> DVec3 {
        let inv = libm::scalbn(1.0, -self.step_log2);
        (w - self.origin) * inv
    }

    /// The nearest lattice point (ties away from zero), or `None` when the position is not finite or lies outside
    /// `0..=MAX_COORDINATE`.
    pub fn snap(&self, w: DVec3) -> Option<LatticePoint> {
        let nearest = self.steps_from_world(w).round();
        let valid = 0.0..=f64::from(MAX_COORDINATE);
        nearest.to_array().iter().all(|x| valid.contains(x)).then(|| nearest.as_ivec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snapping_moves_points_by_at_most_half_a_spacing_also_at_utm_offsets() {
        let lattice = Lattice { origin: DVec3::new(500_000.0, 4_649_776.0, 123.456), step_log2: -13 };
        for i in 0..1000 {
            let w = lattice.origin + f64::from(i) * DVec3::new(0.0137, 0.011, 1e-4);
            let p = lattice.snap(w).expect("inside");
            let back = lattice.world_from_lattice(p);
            for k in 0..3 {
                assert!((back[k] - w[k]).abs() <= lattice.step() * 0.5 + 1e-9);
            }
        }
    }

    #[test]
    fn snapping_refuses_nan_and_points_outside() {
        let lattice = Lattice { origin: DVec3::ZERO, step_log2: 0 };
        assert_eq!(lattice.snap(DVec3::new(f64::NAN, 0.0, 0.0)), None);
        assert_eq!(lattice.snap(DVec3::NEG_X), None);
        assert_eq!(lattice.snap(DVec3::new(0.0, f64::INFINITY, 0.0)), None);
        assert_eq!(lattice.snap(DVec3::new(0.0, 2f64.powi(31), 0.0)), None);
    }
}

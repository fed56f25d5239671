//! The global power-of-two lattice. Positions are snapped to it once, before anything else; every level and every
//! chunk uses it, so that equal positions are equal integers and no cut can crack.

use serde::{Deserialize, Serialize};

/// A point of the lattice, in steps from the lattice origin. Valid coordinates lie in `0..=MAX_COORDINATE`.
pub type LatticePoint = [i32; 3];

/// Largest coordinate a snapped vertex may have: 30 bits, so that sums of three vertices and differences fit `i64`
/// comfortably and differences of two fit `i32`.
pub const MAX_COORDINATE: i32 = (1 << 30) - 1;

/// A lattice: `world = origin + step * point`, all in metres, axes as stored in the pack (z up unless stated).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// World position of the lattice point `[0, 0, 0]`, in metres.
    pub origin: [f64; 3],
    /// The step is `2^step_log2` metres.
    pub step_log2: i32,
}

impl Lattice {
    /// The step in metres, exact (a power of two).
    pub fn step(&self) -> f64 {
        libm::scalbn(1.0, self.step_log2)
    }

    /// World position of a lattice point, in metres.
    pub fn world_from_lattice(&self, p: LatticePoint) -> [f64; 3] {
        let step = self.step();
        std::array::from_fn(|i| self.origin[i] + step * f64::from(p[i]))
    }

    /// World position of a point given in (fractional) lattice units.
    pub fn world_from_steps(&self, p: [f64; 3]) -> [f64; 3] {
        let step = self.step();
        std::array::from_fn(|i| self.origin[i] + step * p[i])
    }

    /// A world position in (fractional) lattice units.
    pub fn steps_from_world(&self, w: [f64; 3]) -> [f64; 3] {
        let inv = libm::scalbn(1.0, -self.step_log2);
        std::array::from_fn(|i| (w[i] - self.origin[i]) * inv)
    }

    /// The nearest lattice point (ties away from zero), or `None` when the position is not finite or lies outside
    /// `0..=MAX_COORDINATE`.
    pub fn snap(&self, w: [f64; 3]) -> Option<LatticePoint> {
        let s = self.steps_from_world(w);
        let mut out = [0; 3];
        for i in 0..3 {
            let r = libm::round(s[i]);
            if !(0.0..=f64::from(MAX_COORDINATE)).contains(&r) {
                return None;
            }
            out[i] = r as i32;
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snapping_moves_points_by_at_most_half_a_spacing_also_at_utm_offsets() {
        let lattice = Lattice { origin: [500_000.0, 4_649_776.0, 123.456], step_log2: -13 };
        for i in 0..1000 {
            let w =
                [500_000.0 + f64::from(i) * 0.0137, 4_649_776.0 + f64::from(i) * 0.011, 123.456 + f64::from(i) * 1e-4];
            let p = lattice.snap(w).expect("inside");
            let back = lattice.world_from_lattice(p);
            for k in 0..3 {
                assert!((back[k] - w[k]).abs() <= lattice.step() * 0.5 + 1e-9);
            }
        }
    }

    #[test]
    fn snapping_refuses_nan_and_points_outside() {
        let lattice = Lattice { origin: [0.0; 3], step_log2: 0 };
        assert_eq!(lattice.snap([f64::NAN, 0.0, 0.0]), None);
        assert_eq!(lattice.snap([-1.0, 0.0, 0.0]), None);
        assert_eq!(lattice.snap([0.0, f64::INFINITY, 0.0]), None);
        assert_eq!(lattice.snap([0.0, 2f64.powi(31), 0.0]), None);
    }
}

//! Where measured points live: *local metres*, counted from the lattice origin. A lattice point has them exactly (the step is a
//! power of two), at any distance from the origin of the world; differences of world coordinates do not.

use kilwa_geometry::distance::Vec3;
use kilwa_geometry::{Lattice, LatticePoint};

/// Conversions of one pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Space {
    lattice: Lattice,
}

impl Space {
    /// The space of a pack's lattice.
    pub fn new(lattice: Lattice) -> Self {
        Self { lattice }
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The lattice spacing, metres.
    pub fn step(&self) -> f64 {
        self.lattice.step()
    }

    /// Local metres of a lattice point; exact.
    pub fn local_from_lattice(&self, p: LatticePoint) -> Vec3 {
        let step = self.lattice.step();
        p.map(|x| f64::from(x) * step)
    }

    /// Local metres of a point in lattice units; exact.
    pub fn local_from_steps(&self, p: Vec3) -> Vec3 {
        let step = self.lattice.step();
        p.map(|x| x * step)
    }

    /// Lattice units of local metres; exact.
    pub fn steps_from_local(&self, p: Vec3) -> Vec3 {
        let inverse = libm::scalbn(1.0, -self.lattice.step_log2);
        p.map(|x| x * inverse)
    }

    /// Local metres of a world position.
    pub fn local_from_world(&self, w: Vec3) -> Vec3 {
        std::array::from_fn(|i| w[i] - self.lattice.origin[i])
    }

    /// World position of local metres.
    pub fn world_from_local(&self, p: Vec3) -> Vec3 {
        std::array::from_fn(|i| p[i] + self.lattice.origin[i])
    }
}

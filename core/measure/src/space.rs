//! Where measured points live: *local metres*, counted from the lattice origin. A lattice point has them exactly (the step is a
//! power of two), at any distance from the origin of the world; differences of world coordinates do not.

use glam::DVec3;
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
    pub fn local_from_lattice(&self, p: LatticePoint) -> DVec3 {
        let step = self.lattice.step();
        p.as_dvec3() * step
    }

    /// Local metres of a point in lattice units; exact.
    pub fn local_from_steps(&self, p: DVec3) -> DVec3 {
        let step = self.lattice.step();
        p * step
    }

    /// Lattice units of local metres; exact.
    pub fn steps_from_local(&self, p: DVec3) -> DVec3 {
        let inverse = libm::scalbn(1.0, -self.lattice.step_log2);
        p * inverse
    }

    /// Local metres of a world position.
    pub fn local_from_world(&self, w: DVec3) -> DVec3 {
        w - self.lattice.origin
    }

    /// World position of local metres.
    pub fn world_from_local(&self, p: DVec3) -> DVec3 {
        p + self.lattice.origin
    }
}

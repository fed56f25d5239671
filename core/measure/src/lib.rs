//! Measuring on decoded lattice geometry, in `f64`, on the CPU: what a researcher cites.
//!
//! Every value comes from the finest surface, so it does not depend on zoom, cache, network or GPU, and carries its
//! standard uncertainty: the lattice step, and the capture accuracy where the metadata knows it. Pure: geometry in,
//! numbers out. Failures are geometric (an empty surface) and are `None`.

pub mod area;
pub mod pick;
pub mod quantity;
pub mod surface;

pub use area::Areas;
pub use pick::{Hit, Ray};
pub use quantity::{Length, Quantity, Uncertainty};
pub use surface::Surface;

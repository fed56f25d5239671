//! Registration: stations find their places by themselves.

mod result;

pub use result::{Candidate, FILE, Link, Placed, Placement, Registration, Unplaced};

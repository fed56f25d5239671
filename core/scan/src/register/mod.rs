//! Arithmetic of registration, without I/O: the surface of a station as small planes ([`surfels`]), where two stations could stand beside each other
//! ([`correlate`]), the fit of one against the other ([`fit`]), and of all against all ([`adjust`]).

pub mod adjust;
pub mod cloud;
pub mod correlate;
pub mod fit;
pub mod image;
pub mod surfels;

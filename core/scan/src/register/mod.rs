//! The arithmetic of registration, without I/O: the surface of a station as small planes ([`surfels`]), candidate relative poses of two stations
//! ([`correlate`]), the fit of one station to another ([`fit`]), and the joint adjustment of all stations ([`adjust`]).

pub mod adjust;
pub mod cloud;
pub mod correlate;
pub mod fit;
pub mod image;
pub mod surfels;

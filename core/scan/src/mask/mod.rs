//! Which samples a mask takes out: tests of each sample against its neighbours in the grid ([`mixed`], [`components`]), against limits ([`limits`]), and
//! against what other stations saw ([`through`]).
//!
//! A test looks at a few lines of the grid at a time, or keeps a few bytes a sample; nothing here changes a sample.

pub mod components;
pub mod limits;
pub mod mixed;
pub mod through;

//! Poses of photographs, without I/O: the frame of a reconstruction brought to the survey's ([`similarity`] from pairs of points, [`icp`] from sparse points on the [`surface`]), and
//! each photograph refined against what a model shows ([`refine()`]).
//!
//! A rigid fit of a reconstruction alone leaves errors of some pixels to some tens of pixels, because reconstructions bend. Each photograph is therefore
//! compared with the model by itself, and used only if most of its patches agree on a pose.

mod grey;
pub mod icp;
mod motion;
mod patch;
mod predict;
mod refine;
mod search;
pub mod similarity;
pub mod surface;
#[cfg(test)]
mod tests;

pub use grey::Grey;
pub use predict::Shown;
pub use refine::{NotRefined, Options, Quality, Refined, RefusalReason, Render, refine};
pub use similarity::Similarity;
pub use surface::Surface;

//! Poses of photographs: the frame of a reconstruction brought to the survey's ([`similarity`], [`icp`]), and each photograph refined against a model ([`refine`]).

mod grey;
mod motion;
pub mod patch;
mod predict;
mod refine;
mod search;

pub use grey::Grey;
pub use predict::{Prediction, Shown};
pub use refine::{NotRefined, Options, Quality, Refined, Why, refine};

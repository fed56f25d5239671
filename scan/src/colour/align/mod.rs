//! Fits the poses of photographs to a model.
//!
//! A reconstruction from photographs has its own frame. [`frame()`] transforms it to that of the survey: from control points ([`pairs`]), known positions of cameras, or a given
//! similarity, and then from its sparse points, which must lie on the surface of the model. That leaves errors of some pixels to some tens of pixels, because reconstructions bend. [`refine_photograph`] therefore compares each
//! photograph with what the model shows, and refuses those of which too few patches agree. [`Overlay`] shows a refused photograph with the borders of the model.

mod frame;
mod model_surface;
mod overlay;
pub mod pairs;
mod refine;
#[cfg(test)]
mod tests;

pub use frame::{Aligned, Residual, Start, frame, near_surface};
pub use model_surface::surface_of;
pub use overlay::Overlay;
pub use refine::{draw, refine_photograph};

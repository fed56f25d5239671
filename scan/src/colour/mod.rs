//! Colouring a model from photographs.
pub(crate) mod model;
pub(crate) mod picture;
pub(crate) mod view;

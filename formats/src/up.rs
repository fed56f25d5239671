//! The up axis of a mesh file.

/// The axis that points up in the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub enum Up {
    /// z is up: stored as it is.
    Z,
    /// y is up: (x, y, z) is stored as (x, -z, y).
    Y,
}

//! A chunk: all child patches of one diamond, which is what one refinement loads. FORMAT section 5.

use crate::error::PackError;
use kilwa_geometry::Mesh;

/// A run of triangles of a chunk that belongs to one tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PatchRange {
    /// First triangle in the chunk.
    pub first: u32,
    /// Number of triangles.
    pub count: u32,
    /// Directory index of the diamond that splits this patch's tetrahedron, or [`crate::NO_DIAMOND`] for a leaf: the
    /// patch is drawn while that diamond is not refined.
    pub diamond: u32,
}

/// A decoded chunk.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chunk {
    /// The geometry of all patches, with one shared vertex array.
    pub mesh: Mesh,
    /// The patches; they tile `0..mesh.triangle_count()` in order.
    pub patches: Vec<PatchRange>,
}

/// Which attributes every chunk of a pack carries; from the metadata.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attributes {
    /// Colours are present.
    pub colors: bool,
    /// Number of scalar channels (at most 16).
    pub scalars: u8,
}

/// What the directory promises about a chunk; decoding checks it and never allocates more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Declared {
    /// Vertices.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
}

/// Encode a chunk. Triangle order inside a patch and vertex order may change (for the vertex cache); what each triangle
/// is, its corner order up to rotation, border bits and attributes do not. Deterministic.
///
/// # Errors
/// [`PackError::Invalid`] when the mesh contradicts itself or `attributes`.
pub fn encode(_chunk: &Chunk, _attributes: Attributes) -> Result<Vec<u8>, PackError> {
    todo!()
}

/// Decode a chunk that [`encode`] wrote.
///
/// # Errors
/// [`PackError`] for every byte sequence that no encoder wrote; never panics, never allocates more than a small
/// multiple of what `declared` implies, which is itself checked against a hard cap and against `bytes.len()`.
pub fn decode(_bytes: &[u8], _declared: Declared, _attributes: Attributes) -> Result<Chunk, PackError> {
    todo!()
}

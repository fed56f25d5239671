//! How a decoded chunk lies in GPU memory: shared by the decoding worker and the native renderer.
//!
//! A vertex is [`VERTEX_BYTES`] bytes, little-endian: `i32 x, y, z` (lattice), `u8 red, green, blue, has`,
//! `i16 u, v` (octahedral normal); `has` is 255 where the model has colours, 0 where it has none and is lit as clay. Positions stay integers so that the shader subtracts the eye exactly.

use crate::{Chunk, PatchRange};
use glam::IVec3;

/// Bytes of one vertex.
pub const VERTEX_BYTES: usize = 20;
/// The colour of a model without colours: a neutral grey of lit limestone, sRGB.
pub const NEUTRAL: [u8; 3] = [200, 196, 188];

/// A chunk ready for upload.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GpuChunk {
    /// Vertices, [`VERTEX_BYTES`] each.
    pub vertices: Vec<u8>,
    /// Indices into the chunk's vertices, three per triangle.
    pub indices: Vec<u32>,
    /// The patches; they tile the triangles in order.
    pub patches: Vec<PatchRange>,
    /// Scalars of all vertices, one channel behind the other.
    pub scalars: Vec<f32>,
    /// Number of vertices.
    pub vertex_count: u32,
    /// Number of triangles.
    pub triangle_count: u32,
}

/// Lay a chunk out for the GPU.
pub fn interleave(chunk: &Chunk) -> GpuChunk {
    let mesh = &chunk.mesh;
    let mut vertices = Vec::with_capacity(mesh.vertex_count().saturating_mul(VERTEX_BYTES));
    for (v, &IVec3 { x, y, z }) in mesh.positions.iter().enumerate() {
        let color = mesh.colors.get(v);
        let [r, g, b] = color.copied().unwrap_or(NEUTRAL);
        let color = u32::from_le_bytes([r, g, b, if color.is_some() { 255 } else { 0 }]);
        let [[a, b], [c, d]] = mesh.normals.get(v).copied().unwrap_or_default().map(i16::to_le_bytes);
        // Words at once: a byte at a time takes a tenth of the decoder's time.
        let words = [x.cast_unsigned(), y.cast_unsigned(), z.cast_unsigned(), color, u32::from_le_bytes([a, b, c, d])];
        vertices.extend_from_slice(words.map(u32::to_le_bytes).as_flattened());
    }
    GpuChunk {
        vertices,
        indices: mesh.triangles.as_flattened().to_vec(),
        patches: chunk.patches.clone(),
        scalars: mesh.scalars.concat(),
        vertex_count: u32::try_from(mesh.vertex_count()).unwrap_or(u32::MAX),
        triangle_count: u32::try_from(mesh.triangle_count()).unwrap_or(u32::MAX),
    }
}

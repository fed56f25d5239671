//! Primitives of `KHR_draco_mesh_compression`, decoded whole by `draco-core`, a decoder in Rust.

use super::super::ReadError;
use super::Context;
use super::buffers::Buffers;
use super::schema::{Draco, Root};
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};

/// Decoded bytes allowed for each compressed byte: constant attributes compress without limit.
const GROWTH: u64 = 1 << 12;
/// Decoded bytes allowed whatever the compressed ones, and at the most.
const DECODED: std::ops::Range<u64> = (16 << 20)..(8 << 30);

/// A decoded primitive.
pub(super) struct Decoded {
    mesh: Mesh,
    part: String,
}

impl Decoded {
    /// Decode the view of a primitive; `part` names the primitive in messages.
    pub(super) fn open(
        root: &Root,
        buffers: &mut Buffers<'_>,
        draco: &Draco,
        part: String,
        context: &Context<'_>,
    ) -> Result<Self, ReadError> {
        let view = buffers.view(root, draco.buffer_view, context)?;
        let bytes = buffers.whole(&view, context)?;
        let decoded = (bytes.len() as u64).saturating_mul(GROWTH).clamp(DECODED.start, DECODED.end).min(buffers.max());
        let limits = DecodeLimits::default()
            .with_max_points(decoded / 12)
            .with_max_faces(decoded / 12)
            .with_max_decoded_bytes(decoded);
        let mut buffer = DecoderBuffer::new(&bytes).with_limits(limits);
        let mut mesh = Mesh::new();
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|e| {
            let found = format!("a Draco stream in bufferViews[{}] that does not decode ({e})", draco.buffer_view);
            let expected =
                "a sound stream; export the file again without Draco, for example with `gltf-transform copy`";
            context.part(part.clone(), found, expected)
        })?;
        Ok(Self { mesh, part })
    }

    pub(super) fn vertex_count(&self) -> u64 {
        self.mesh.num_points() as u64
    }

    /// The triangles by vertex numbers, checked.
    pub(super) fn triangles(&self, context: &Context<'_>) -> Result<Vec<[u64; 3]>, ReadError> {
        let count = self.vertex_count();
        let triangles: Vec<[u64; 3]> = self.mesh.faces().iter().map(|f| f.map(|p| u64::from(p.0))).collect();
        match triangles.iter().flatten().find(|v| **v >= count) {
            None => Ok(triangles),
            Some(v) => {
                let found = format!("the vertex {v} in its Draco stream, which has {count}");
                Err(context.part(self.part.clone(), found, "vertices that are there; export the file again"))
            }
        }
    }

    /// The values of an attribute by its number in the stream: components of an element and all values.
    pub(super) fn values(&self, id: u32, context: &Context<'_>) -> Result<(usize, Vec<f32>), ReadError> {
        let Some(attribute) = self.mesh.attribute_by_unique_id(id) else {
            let found = format!("attribute {id}, which its Draco stream does not have");
            return Err(context.part(self.part.clone(), found, "an attribute of the stream; export the file again"));
        };
        let width = usize::from(attribute.num_components());
        Ok((width, attribute.read_f32s(self.mesh.num_points(), width)))
    }
}

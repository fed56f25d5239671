//! GPU memory of chunks: one vertex and one index buffer each, as `kilwa_pack::vertex_layout` lays them out.

use kilwa_pack::GpuChunk;
use kilwa_pack::vertex_layout::VERTEX_BYTES;
use std::collections::BTreeMap;

/// Attributes of the vertex buffer: position, colour, normal. 20 bytes.
pub const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Sint32x3, 1 => Unorm8x4, 2 => Snorm16x2];

/// The vertex buffer's layout.
pub fn vertex_buffer_layout(attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout { array_stride: VERTEX_BYTES as u64, step_mode: wgpu::VertexStepMode::Vertex, attributes }
}

/// One chunk's buffers.
pub(crate) struct ChunkBuffers {
    pub(crate) vertices: wgpu::Buffer,
    pub(crate) indices: wgpu::Buffer,
    pub(crate) triangles: u32,
}

/// All resident chunks, by directory index.
#[derive(Default)]
pub(crate) struct Pool {
    chunks: BTreeMap<u32, ChunkBuffers>,
    bytes: u64,
}

impl Pool {
    pub(crate) fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, index: u32, chunk: &GpuChunk) {
        self.evict(index);
        let make = |bytes: &[u8], usage| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("chunk"),
                // An empty chunk keeps a buffer that can be bound.
                size: (bytes.len() as u64).max(4),
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            if !bytes.is_empty() {
                queue.write_buffer(&buffer, 0, bytes);
            }
            buffer
        };
        let vertices = make(&chunk.vertices, wgpu::BufferUsages::VERTEX);
        let indices = make(bytemuck::cast_slice(&chunk.indices), wgpu::BufferUsages::INDEX);
        self.bytes += vertices.size() + indices.size();
        self.chunks.insert(index, ChunkBuffers { vertices, indices, triangles: chunk.triangle_count });
    }

    pub(crate) fn evict(&mut self, index: u32) {
        if let Some(old) = self.chunks.remove(&index) {
            self.bytes -= old.vertices.size() + old.indices.size();
            old.vertices.destroy();
            old.indices.destroy();
        }
    }

    pub(crate) fn get(&self, index: u32) -> Option<&ChunkBuffers> {
        self.chunks.get(&index)
    }

    pub(crate) fn clear(&mut self) {
        for index in self.chunks.keys().copied().collect::<Vec<_>>() {
            self.evict(index);
        }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    pub(crate) fn len(&self) -> usize {
        self.chunks.len()
    }
}

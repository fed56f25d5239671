//! GPU memory of chunks: one vertex and one index buffer each, as `kilwa_pack::vertex_layout` lays them out.

use crate::filled::drawn;
use glam::{DVec3, IVec3};
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

/// The scalars' buffer: the value (0 if there is none) and whether there is one, both scaled to 65535.
pub(crate) fn scalar_buffer_layout() -> wgpu::VertexBufferLayout<'static> {
    const SCALAR: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![3 => Unorm16x2];
    wgpu::VertexBufferLayout { array_stride: 4, step_mode: wgpu::VertexStepMode::Vertex, attributes: &SCALAR }
}

/// One chunk's buffers.
pub(crate) struct ChunkBuffers {
    pub(crate) vertices: wgpu::Buffer,
    pub(crate) indices: wgpu::Buffer,
    /// Where a scalar is shown.
    pub(crate) scalars: Option<wgpu::Buffer>,
    pub(crate) triangles: u32,
    /// Middle of the box of its vertices, in lattice units.
    pub(crate) middle: DVec3,
}

impl ChunkBuffers {
    fn bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size() + self.scalars.as_ref().map_or(0, wgpu::Buffer::size)
    }

    fn destroy(&self) {
        self.vertices.destroy();
        self.indices.destroy();
        if let Some(scalars) = &self.scalars {
            scalars.destroy();
        }
    }
}

/// A scalar channel that is shown: its number and its range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShownScalar {
    /// Number of the channel.
    pub channel: usize,
    /// Smallest value.
    pub min: f32,
    /// Largest value.
    pub max: f32,
}

impl ShownScalar {
    /// The scalars of a chunk as the GPU gets them: the value (0 if there is none) and whether there is one, both scaled to 65535. NaN counts as no value.
    fn bytes(&self, chunk: &GpuChunk) -> Vec<u8> {
        let length = self.max - self.min;
        let scale = if length > 0.0 { 65535.0 / length } else { 0.0 };
        let count = chunk.vertex_count as usize;
        let values = chunk.scalars.get(self.channel * count..(self.channel + 1) * count).unwrap_or_default();
        let mut out = Vec::with_capacity(count * 4);
        for k in 0..count {
            let value = values.get(k).copied().filter(|v| v.is_finite());
            let share = value.map_or(0, |v| ((v - self.min) * scale).clamp(0.0, 65535.0).round() as u16);
            out.extend(share.to_le_bytes());
            out.extend(if value.is_some() { u16::MAX } else { 0 }.to_le_bytes());
        }
        out
    }
}

/// All resident chunks, by directory index.
#[derive(Default)]
pub(crate) struct Pool {
    chunks: BTreeMap<u32, ChunkBuffers>,
    bytes: u64,
}

impl Pool {
    pub(crate) fn upload(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        index: u32,
        chunk: &GpuChunk,
        scalar: Option<ShownScalar>,
    ) {
        self.evict(index);
        let vertices = filled(device, queue, &chunk.vertices, wgpu::BufferUsages::VERTEX);
        let indices = drawn(&chunk.indices);
        let indices = filled(device, queue, bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX);
        let buffers = ChunkBuffers {
            vertices,
            indices,
            scalars: None,
            triangles: chunk.triangle_count,
            middle: middle(&chunk.vertices),
        };
        self.bytes += buffers.bytes();
        self.chunks.insert(index, buffers);
        self.upload_scalars(device, queue, index, chunk, scalar);
    }

    /// Show another scalar of a chunk that is here, or none.
    pub(crate) fn upload_scalars(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        index: u32,
        chunk: &GpuChunk,
        scalar: Option<ShownScalar>,
    ) {
        let Some(buffers) = self.chunks.get_mut(&index) else { return };
        self.bytes -= buffers.bytes();
        if let Some(old) = buffers.scalars.take() {
            old.destroy();
        }
        let make = |s: ShownScalar| filled(device, queue, &s.bytes(chunk), wgpu::BufferUsages::VERTEX);
        buffers.scalars = scalar.filter(|_| !chunk.scalars.is_empty()).map(make);
        self.bytes += buffers.bytes();
    }

    pub(crate) fn evict(&mut self, index: u32) {
        if let Some(old) = self.chunks.remove(&index) {
            self.bytes -= old.bytes();
            old.destroy();
        }
    }

    pub(crate) fn get(&self, index: u32) -> Option<&ChunkBuffers> {
        self.chunks.get(&index)
    }

    /// Whether every chunk that is here has a scalar.
    pub(crate) fn has_scalars(&self) -> bool {
        !self.chunks.is_empty() && self.chunks.values().all(|c| c.scalars.is_some())
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

fn filled(device: &wgpu::Device, queue: &wgpu::Queue, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
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
}

/// Middle of the box of vertices as they lie in the vertex buffer.
fn middle(vertices: &[u8]) -> DVec3 {
    let (mut low, mut high) = (IVec3::MAX, IVec3::MIN);
    for vertex in vertices.chunks_exact(VERTEX_BYTES) {
        let position: [i32; 3] = bytemuck::pod_read_unaligned(&vertex[..12]);
        (low, high) = (low.min(position.into()), high.max(position.into()));
    }
    if low.x > high.x { DVec3::ZERO } else { (low.as_dvec3() + high.as_dvec3()) * 0.5 }
}

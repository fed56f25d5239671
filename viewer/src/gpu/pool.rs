//! GPU memory of chunks: parts of a few large buffers, whose vertices are as `kilwa_pack::vertex_layout` lays them out.

use crate::filled::drawn;
use glam::{DVec3, IVec3};
use kilwa_pack::GpuChunk;
use kilwa_pack::vertex_layout::VERTEX_BYTES;
use range_alloc::RangeAllocator;
use std::collections::{BTreeMap, btree_map};
use std::ops::Range;

/// Attributes of the vertex buffer: position, colour, normal. 20 bytes.
pub const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Sint32x3, 1 => Unorm8x4, 2 => Snorm16x2];

/// The vertex buffer's layout.
pub fn vertex_buffer_layout(attributes: &[wgpu::VertexAttribute]) -> wgpu::VertexBufferLayout<'_> {
    wgpu::VertexBufferLayout { array_stride: VERTEX_BYTES as u64, step_mode: wgpu::VertexStepMode::Vertex, attributes }
}

/// Bytes of the scalar of a vertex.
const SCALAR_BYTES: u64 = 4;

/// The scalars' buffer: the value (0 if there is none) and whether there is one, both scaled to 65535.
pub(crate) fn scalar_buffer_layout() -> wgpu::VertexBufferLayout<'static> {
    const SCALAR: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![3 => Unorm16x2];
    wgpu::VertexBufferLayout {
        array_stride: SCALAR_BYTES,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &SCALAR,
    }
}

/// Vertices of the first slab; every further one has twice as many, up to the largest.
const FIRST_SLAB: u32 = 1 << 16;
const LARGEST_SLAB: u32 = 1 << 18;

/// Buffers that hold many chunks, so that a frame binds few of them.
struct Slab {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    /// Where a scalar is shown.
    scalars: Option<wgpu::Buffer>,
    free_vertices: RangeAllocator<u32>,
    free_indices: RangeAllocator<u32>,
}

impl Slab {
    fn new(device: &wgpu::Device, vertices: u32, indices: u32) -> Self {
        let (vertex, index) = (wgpu::BufferUsages::VERTEX, wgpu::BufferUsages::INDEX);
        Self {
            vertices: buffer(device, u64::from(vertices) * VERTEX_BYTES as u64, vertex),
            indices: buffer(device, u64::from(indices) * 4, index),
            scalars: None,
            free_vertices: RangeAllocator::new(0..vertices),
            free_indices: RangeAllocator::new(0..indices),
        }
    }

    fn allocate(&mut self, vertices: u32, indices: u32) -> Option<(Range<u32>, Range<u32>)> {
        // The allocator does not accept empty ranges.
        let vertices = self.free_vertices.allocate_range(vertices.max(1)).ok()?;
        if let Ok(indices) = self.free_indices.allocate_range(indices.max(1)) {
            return Some((vertices, indices));
        }
        self.free_vertices.free_range(vertices);
        None
    }

    fn destroy(&self) {
        for buffer in [Some(&self.vertices), Some(&self.indices), self.scalars.as_ref()].into_iter().flatten() {
            buffer.destroy();
        }
    }
}

/// Where a chunk is.
pub(crate) struct ResidentChunk {
    /// Number of its slab.
    pub(crate) slab: usize,
    vertices: Range<u32>,
    /// Of its triangles, which count vertices from the beginning of the slab: WebGL2 has no base vertex.
    pub(crate) indices: Range<u32>,
    has_scalars: bool,
    pub(crate) triangles: u32,
    /// Middle of the box of its vertices, in lattice units.
    pub(crate) middle: DVec3,
}

impl ResidentChunk {
    fn bytes(&self) -> u64 {
        let per_vertex = VERTEX_BYTES as u64 + if self.has_scalars { SCALAR_BYTES } else { 0 };
        self.vertices.len() as u64 * per_vertex + self.indices.len() as u64 * 4
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
    /// `None` for one that was freed.
    slabs: Vec<Option<Slab>>,
    chunks: BTreeMap<u32, ResidentChunk>,
    bytes: u64,
    /// The indices of the last chunk that was uploaded, kept so that an upload allocates nothing.
    in_slab: Vec<u32>,
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
        let local = drawn(&chunk.indices);
        let place = self.allocate(device, chunk.vertex_count, local.len() as u32);
        let Some((slab, vertices, indices)) = place else { return };
        let Some(Some(buffers)) = self.slabs.get(slab) else { return };
        self.in_slab.clear();
        self.in_slab.extend(local.iter().map(|vertex| vertices.start + vertex));
        queue.write_buffer(&buffers.vertices, u64::from(vertices.start) * VERTEX_BYTES as u64, &chunk.vertices);
        queue.write_buffer(&buffers.indices, u64::from(indices.start) * 4, bytemuck::cast_slice(&self.in_slab));
        let (triangles, middle) = (chunk.triangle_count, middle(&chunk.vertices));
        let resident = ResidentChunk { slab, vertices, indices, has_scalars: false, triangles, middle };
        self.bytes += resident.bytes();
        self.chunks.insert(index, resident);
        self.upload_scalars(device, queue, index, chunk, scalar);
    }

    /// A place for a chunk, in a slab that has room or in a new one.
    fn allocate(
        &mut self,
        device: &wgpu::Device,
        vertices: u32,
        indices: u32,
    ) -> Option<(usize, Range<u32>, Range<u32>)> {
        for (number, slab) in self.slabs.iter_mut().enumerate() {
            if let Some((vertices, indices)) = slab.as_mut().and_then(|s| s.allocate(vertices, indices)) {
                return Some((number, vertices, indices));
            }
        }
        let count = self.slabs.iter().flatten().count() as u32;
        let usual = FIRST_SLAB.checked_shl(count).filter(|n| (1..LARGEST_SLAB).contains(n)).unwrap_or(LARGEST_SLAB);
        // The chunk's number of indices per vertex, and an eighth more: meshes have about five, points one and a half.
        let share = u64::from(usual) * u64::from(indices) * 9 / (u64::from(vertices.max(1)) * 8);
        let max_vertices = usual.max(vertices).max(1);
        let max_indices = (share.min(u64::from(usual) * 6) as u32).max(indices).max(1);
        let mut slab = Slab::new(device, max_vertices, max_indices);
        let (vertices, indices) = slab.allocate(vertices, indices)?;
        let number = self.slabs.iter().position(Option::is_none).unwrap_or(self.slabs.len());
        if number == self.slabs.len() {
            self.slabs.push(None);
        }
        self.slabs[number] = Some(slab);
        Some((number, vertices, indices))
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
        let Some(resident) = self.chunks.get_mut(&index) else { return };
        let Some(Some(slab)) = self.slabs.get_mut(resident.slab) else { return };
        self.bytes -= resident.bytes();
        let shown = scalar.filter(|_| !chunk.scalars.is_empty());
        // An empty chunk lacks none.
        resident.has_scalars = shown.is_some() || scalar.is_some() && chunk.vertex_count == 0;
        self.bytes += resident.bytes();
        let Some(shown) = shown else { return };
        let size = slab.vertices.size() / VERTEX_BYTES as u64 * SCALAR_BYTES;
        let buffer = slab.scalars.get_or_insert_with(|| buffer(device, size, wgpu::BufferUsages::VERTEX));
        queue.write_buffer(buffer, u64::from(resident.vertices.start) * SCALAR_BYTES, &shown.bytes(chunk));
    }

    /// Free the scalar buffers, because no scalar is shown.
    pub(crate) fn free_scalars(&mut self) {
        for chunk in self.chunks.values_mut() {
            self.bytes -= chunk.bytes();
            chunk.has_scalars = false;
            self.bytes += chunk.bytes();
        }
        for scalars in self.slabs.iter_mut().flatten().filter_map(|s| s.scalars.take()) {
            scalars.destroy();
        }
    }

    pub(crate) fn evict(&mut self, index: u32) {
        let Some(old) = self.chunks.remove(&index) else { return };
        self.bytes -= old.bytes();
        let Some(slot) = self.slabs.get_mut(old.slab) else { return };
        let Some(slab) = slot else { return };
        slab.free_vertices.free_range(old.vertices);
        slab.free_indices.free_range(old.indices);
        if slab.free_vertices.is_empty() {
            slab.destroy();
            *slot = None;
        }
    }

    /// For looking up chunks one after the other, mostly in order of their indices.
    pub(crate) fn cursor(&self) -> Cursor<'_> {
        let mut rest = self.chunks.range(0..);
        let next = rest.next();
        Cursor { chunks: &self.chunks, rest, next, last: 0 }
    }

    pub(crate) fn get(&self, index: u32) -> Option<&ResidentChunk> {
        self.chunks.get(&index)
    }

    /// Bind the buffers of a slab, including its scalars if `scalars` is set. Returns whether they exist.
    pub(crate) fn bind(&self, pass: &mut wgpu::RenderPass<'_>, slab: usize, scalars: bool) -> bool {
        let Some(Some(slab)) = self.slabs.get(slab) else { return false };
        if scalars {
            let Some(values) = &slab.scalars else { return false };
            pass.set_vertex_buffer(1, values.slice(..));
        }
        pass.set_vertex_buffer(0, slab.vertices.slice(..));
        pass.set_index_buffer(slab.indices.slice(..), wgpu::IndexFormat::Uint32);
        true
    }

    /// Whether every chunk that is here has a scalar.
    pub(crate) fn has_scalars(&self) -> bool {
        !self.chunks.is_empty() && self.chunks.values().all(|c| c.has_scalars)
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

/// Looks up chunks without a search where they are asked for in order of their indices.
pub(crate) struct Cursor<'a> {
    chunks: &'a BTreeMap<u32, ResidentChunk>,
    rest: btree_map::Range<'a, u32, ResidentChunk>,
    /// The first one that was not passed yet.
    next: Option<(&'a u32, &'a ResidentChunk)>,
    /// What was asked for last.
    last: u32,
}

impl<'a> Cursor<'a> {
    pub(crate) fn find(&mut self, index: u32) -> Option<&'a ResidentChunk> {
        if index < self.last {
            self.rest = self.chunks.range(index..);
            self.next = self.rest.next();
        }
        self.last = index;
        while self.next.is_some_and(|(at, _)| *at < index) {
            self.next = self.rest.next();
        }
        self.next.filter(|(at, _)| **at == index).map(|(_, chunk)| chunk)
    }
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("chunks"),
        size,
        usage: usage | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
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

//! Draw calls that the GPU reads from a buffer: many of them are one command, where the processor would otherwise prepare each. Only natively:
//! WebGPU and WebGL 2 have no such command.

use crate::draw_list::Call;

/// The arguments of an indexed draw call, as all graphics APIs have them.
#[derive(Debug, Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct Arguments {
    index_count: u32,
    instance_count: u32,
    first_index: u32,
    base_vertex: i32,
    first_instance: u32,
}

const BYTES: u64 = size_of::<Arguments>() as u64;

/// The arguments of a frame's calls.
#[derive(Debug, Default)]
pub(crate) struct Indirect {
    buffer: Option<wgpu::Buffer>,
    /// The last frame's, kept so that a frame allocates nothing.
    arguments: Vec<Arguments>,
}

impl Indirect {
    /// Whether a device draws several calls with one command.
    pub(crate) fn suits(device: &wgpu::Device) -> bool {
        // Metal draws them one by one, and DirectX 12 was not tried.
        device.adapter_info().backend == wgpu::Backend::Vulkan
    }

    /// Write the arguments of a frame's calls.
    pub(crate) fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, calls: &[Call]) {
        self.arguments.clear();
        self.arguments.extend(calls.iter().map(|call| Arguments {
            index_count: call.indices.end - call.indices.start,
            instance_count: 1,
            first_index: call.indices.start,
            base_vertex: 0,
            first_instance: 0,
        }));
        if calls.is_empty() {
            return;
        }
        let needed = calls.len() as u64 * BYTES;
        let buffer = match &self.buffer {
            Some(buffer) if buffer.size() >= needed => buffer,
            _ => self.buffer.insert(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("draw calls"),
                size: needed.next_power_of_two(),
                usage: wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })),
        };
        queue.write_buffer(buffer, 0, bytemuck::cast_slice(&self.arguments));
    }

    /// Draw `count` of the calls written last, from the one at `first` on.
    pub(crate) fn record(&self, pass: &mut wgpu::RenderPass<'_>, first: usize, count: usize) {
        if let Some(buffer) = &self.buffer {
            pass.multi_draw_indexed_indirect(buffer, first as u64 * BYTES, count as u32);
        }
    }
}

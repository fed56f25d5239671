//! The uniforms of `shaders/frame.wgsl`, written byte by byte, and the buffers that hold them.

use crate::clip::ClipTransform;
use crate::options::{Background, RenderOptions};
use kilwa_stream::View;

/// Range of the error view's scale: a tenth of a millimetre to a metre, log2 of metres.
pub(crate) const ERROR_SCALE: (f32, f32) = (-13.0, 0.0);

/// A uniform struct as bytes, with the fields' names and offsets for the layout test.
#[derive(Debug, Clone, Default)]
pub struct UniformBytes {
    /// The bytes, little-endian.
    pub bytes: Vec<u8>,
    /// Name, offset and length of every field.
    pub fields: Vec<(&'static str, usize, usize)>,
}

impl UniformBytes {
    fn floats(&mut self, name: &'static str, values: &[f32]) {
        self.fields.push((name, self.bytes.len(), values.len() * 4));
        self.bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }

    fn uint(&mut self, name: &'static str, value: u32) {
        self.fields.push((name, self.bytes.len(), 4));
        self.bytes.extend(value.to_le_bytes());
    }

    fn ints(&mut self, name: &'static str, values: &[i32]) {
        self.fields.push((name, self.bytes.len(), values.len() * 4));
        self.bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }
}

/// The struct `Frame`.
pub fn frame_uniform(view: &View, options: &RenderOptions, encode_srgb: bool) -> UniformBytes {
    let clip = ClipTransform::new(view, options.tile);
    let light: [f64; 3] = std::array::from_fn(|i| 0.62 * view.up[i] - 0.48 * view.right[i] - 0.62 * view.forward[i]);
    let (top, bottom) = match options.background {
        Background::Flat(c) => (opaque(c), opaque(c)),
        Background::Gradient(top, bottom) => (opaque(top), opaque(bottom)),
        Background::Transparent => ([0.0; 4], [0.0; 4]),
    };
    let (scale, shift) = options.tile.map_or((1.0, 0.0), |t| {
        let full = f64::from(view.size[1].max(1));
        ((f64::from(t.size[1]) / full) as f32, (f64::from(t.offset[1]) / full) as f32)
    });
    let mode = crate::Mode::ALL.iter().position(|(m, _)| *m == options.mode).unwrap_or(0);
    let mut out = UniformBytes::default();
    out.floats("clip_from_cell", clip.clip_from_cell.as_flattened());
    out.floats("eye_from_cell", &clip.eye_from_cell);
    out.floats("light", &[light[0] as f32, light[1] as f32, light[2] as f32, 0.0]);
    out.floats("top", &top);
    out.floats("bottom", &bottom);
    out.ints("cell", &clip.cell);
    out.uint("mode", mode as u32);
    out.floats("tile_scale", &[scale]);
    out.floats("tile_shift", &[shift]);
    out.uint("encode_srgb", u32::from(encode_srgb));
    out.floats("shading", &[options.shading]);
    out.floats("back_tint", &[if options.mark_back_faces { 1.0 } else { 0.0 }]);
    out.floats("error_low", &[ERROR_SCALE.0]);
    out.floats("error_high", &[ERROR_SCALE.1]);
    out.floats("unused", &[0.0]);
    out
}

/// The struct `Draw`.
pub fn draw_uniform(id: u32, level: u32, error: f32) -> UniformBytes {
    let mut out = UniformBytes::default();
    out.uint("id", id);
    out.uint("level", level);
    out.floats("error", &[error]);
    out.uint("unused", 0);
    out
}

/// Linear values of an opaque sRGB colour.
fn opaque(c: [u8; 3]) -> [f32; 4] {
    let linear = |x: u8| {
        let x = f64::from(x) / 255.0;
        (if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }) as f32
    };
    [linear(c[0]), linear(c[1]), linear(c[2]), 1.0]
}

/// The uniform buffers and their bind groups: one `Frame`, and a `Draw` per draw call, by dynamic offset.
pub(crate) struct Uniforms {
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) draw_layout: wgpu::BindGroupLayout,
    frame: wgpu::Buffer,
    pub(crate) frame_group: wgpu::BindGroup,
    draws: wgpu::Buffer,
    pub(crate) draw_group: wgpu::BindGroup,
    /// Bytes from one `Draw` to the next.
    pub(crate) stride: u32,
    capacity: usize,
}

const FRAME_BYTES: u64 = 176;
const DRAW_BYTES: u64 = 16;

impl Uniforms {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let frame_layout = layout(device, "frame", false, FRAME_BYTES);
        let draw_layout = layout(device, "draw", true, DRAW_BYTES);
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(DRAW_BYTES as u32);
        let frame = buffer(device, "frame", FRAME_BYTES);
        let frame_group = group(device, &frame_layout, &frame, FRAME_BYTES);
        let capacity = 256;
        let draws = buffer(device, "draws", capacity as u64 * u64::from(stride));
        let draw_group = group(device, &draw_layout, &draws, DRAW_BYTES);
        Self { frame_layout, draw_layout, frame, frame_group, draws, draw_group, stride, capacity }
    }

    /// Write a frame's uniforms; `draws` in order of their dynamic offsets.
    pub(crate) fn write(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        frame: &UniformBytes,
        draws: &[UniformBytes],
    ) {
        queue.write_buffer(&self.frame, 0, &frame.bytes);
        if draws.len() > self.capacity {
            self.capacity = draws.len().next_power_of_two();
            self.draws = buffer(device, "draws", self.capacity as u64 * u64::from(self.stride));
            self.draw_group = group(device, &self.draw_layout, &self.draws, DRAW_BYTES);
        }
        let mut bytes = vec![0; draws.len() * self.stride as usize];
        for (slot, draw) in bytes.chunks_exact_mut(self.stride as usize).zip(draws) {
            for (to, from) in slot.iter_mut().zip(&draw.bytes) {
                *to = *from;
            }
        }
        if !bytes.is_empty() {
            queue.write_buffer(&self.draws, 0, &bytes);
        }
    }

    pub(crate) fn pipeline_layout(&self, device: &wgpu::Device) -> wgpu::PipelineLayout {
        device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("frame and draw"),
            bind_group_layouts: &[Some(&self.frame_layout), Some(&self.draw_layout)],
            immediate_size: 0,
        })
    }
}

fn layout(device: &wgpu::Device, label: &str, dynamic: bool, bytes: u64) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: dynamic,
                min_binding_size: wgpu::BufferSize::new(bytes),
            },
            count: None,
        }],
    })
}

fn buffer(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn group(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, buffer: &wgpu::Buffer, bytes: u64) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: 0,
                size: wgpu::BufferSize::new(bytes),
            }),
        }],
    })
}

//! The uniforms of `shaders/frame.wgsl`, written byte by byte, and the buffers that hold them.

use super::RELIEF_FORMAT;
use super::target::{texture, view_of};
use crate::clip::ClipTransform;
use crate::options::{Background, RenderOptions};
use crate::section::Clip;
use kilwa_geometry::color::light_from_srgb;
use kilwa_geometry::distance::dot;
use kilwa_stream::{Projection, View};

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
pub fn frame_uniform(view: &View, options: &RenderOptions, target: TargetTraits) -> UniformBytes {
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
    let (per_depth, per_pixel, depth) = footprint(view);
    let cell = clip.cell.map(f64::from);
    let range_scale = reciprocal(options.scale.range[1] - options.scale.range[0]);
    let scalar_scale = reciprocal(f64::from(options.scalar_range[1] - options.scalar_range[0]));
    let flags = u32::from(options.clip.plane.is_some())
        | u32::from(options.clip.bounds.is_some()) << 1
        | u32::from(options.clip.bounds.is_some_and(|b| b.remove_inside)) << 2;
    let mut out = UniformBytes::default();
    out.floats("clip_from_cell", clip.clip_from_cell.as_flattened());
    out.floats("eye_from_cell", &clip.eye_from_cell);
    out.floats("light", &four(light, 0.0));
    out.floats("rake", &four(options.light.direction(view), 0.0));
    out.floats("top", &top);
    out.floats("bottom", &bottom);
    out.floats("right", &four(view.right, per_depth));
    out.floats("up", &four(view.up, per_pixel));
    out.floats("depth", &depth);
    out.floats("plane", &four(options.scale.normal, dot(options.scale.normal, cell) - options.scale.offset));
    out.floats("clip", half_spaces(&options.clip, cell).as_flattened());
    out.ints("cell", &clip.cell);
    out.uint("mode", mode as u32);
    out.floats("tile_scale", &[scale]);
    out.floats("tile_shift", &[shift]);
    out.floats("shading", &[options.shading]);
    out.floats("back_tint", &[if options.mark_back_faces { 1.0 } else { 0.0 }]);
    out.floats("error_low", &[ERROR_SCALE.0]);
    out.floats("error_high", &[ERROR_SCALE.1]);
    out.floats("range_low", &[options.scale.range[0] as f32]);
    out.floats("range_scale", &[range_scale]);
    out.floats("strength", &[options.strength]);
    out.floats("radius", &[options.radius]);
    out.floats("feature", &[options.feature as f32]);
    out.uint("unused", 0);
    out.ints("relief_shift", &target.relief_shift);
    out.uint("clip_flags", flags);
    out.uint("on_color", u32::from(options.on_color));
    out.floats("outline", &[options.outline]);
    out.floats("scalar_low", &[options.scalar_range[0]]);
    out.floats("scalar_scale", &[scalar_scale]);
    out.uint("smooth_cut", u32::from(target.smooth_cut));
    out
}

/// What a frame's target adds to the view and the options.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TargetTraits {
    /// From a pixel of the target to its pixel in the relief map.
    pub relief_shift: [i32; 2],
    /// The edge of a cut is smoothed by the samples that it covers.
    pub smooth_cut: bool,
}

fn four(v: [f64; 3], w: f64) -> [f32; 4] {
    [v[0] as f32, v[1] as f32, v[2] as f32, w as f32]
}

/// 1 over the length of a scale; a scale without length is a step.
fn reciprocal(length: f64) -> f32 {
    if length == 0.0 { 1e30 } else { (1.0 / length) as f32 }
}

/// Steps per pixel and step of depth, steps per pixel, and how depth values become depth.
fn footprint(view: &View) -> (f64, f64, [f32; 4]) {
    let half_pixels = f64::from(view.size[1].max(1)) * 0.5;
    match view.projection {
        Projection::Perspective { tan_half_height } => {
            (tan_half_height / half_pixels, 0.0, [view.near as f32, 0.0, 0.0, 1.0])
        }
        Projection::Orthographic { half_height } => {
            let depth = view.far - view.near;
            (0.0, half_height / half_pixels, [view.near as f32, view.far as f32, depth as f32, 0.0])
        }
    }
}

/// The half-spaces of a cut, counted from the cell: the plane, then the box.
fn half_spaces(clip: &Clip, cell: [f64; 3]) -> [[f32; 4]; 7] {
    let mut out = [[0.0; 4]; 7];
    let plane = clip.plane.iter().map(|p| (0, p));
    let faces = clip.bounds.iter().flat_map(|b| (1..).zip(&b.faces));
    for (slot, half) in plane.chain(faces) {
        // The subtraction in f64: close to the cell, where f32 is fine, stays what matters.
        out[slot] = four(half.normal, half.offset - dot(half.normal, cell));
    }
    out
}

/// All pixels: the draw does not fade.
pub const NO_FADE: [f32; 2] = [0.0, 1.0];

/// The struct `Draw`. `fade`: it has the pixels whose noise lies between two shares.
pub fn draw_uniform(id: u32, level: u32, error: f32, fade: [f32; 2]) -> UniformBytes {
    let [low, high] = fade.map(|x| (x.clamp(0.0, 1.0) * 65535.0).round() as u32);
    let mut out = UniformBytes::default();
    out.uint("id", id);
    out.uint("level", level);
    out.floats("error", &[error]);
    out.uint("fade", low | high << 16);
    out
}

/// Linear values of an opaque sRGB colour.
fn opaque(c: [u8; 3]) -> [f32; 4] {
    let [r, g, b] = c.map(|level| light_from_srgb(level) as f32);
    [r, g, b, 1.0]
}

/// The uniform buffers and their bind groups: a `Frame` for the picture and one for the relief pass before it, and a `Draw` per
/// draw call, by dynamic offset.
pub(crate) struct Uniforms {
    frame_layout: wgpu::BindGroupLayout,
    draw_layout: wgpu::BindGroupLayout,
    frame: wgpu::Buffer,
    pub(crate) frame_group: wgpu::BindGroup,
    relief_frame: wgpu::Buffer,
    pub(crate) relief_group: wgpu::BindGroup,
    draws: wgpu::Buffer,
    pub(crate) draw_group: wgpu::BindGroup,
    /// Bytes from one `Draw` to the next.
    pub(crate) stride: u32,
    capacity: usize,
}

const FRAME_BYTES: u64 = 416;
const DRAW_BYTES: u64 = 16;

impl Uniforms {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let frame_layout = frame_layout(device);
        let draw_layout = draw_layout(device);
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(DRAW_BYTES as u32);
        let frame = buffer(device, "frame", FRAME_BYTES);
        let relief_frame = buffer(device, "relief frame", FRAME_BYTES);
        // Passes that look at no neighbourhood have a map of one pixel.
        let usage = wgpu::TextureUsages::TEXTURE_BINDING;
        let nothing = view_of(&texture(device, "no relief", [1, 1], 1, RELIEF_FORMAT, usage));
        let [frame_group, relief_group] =
            [&frame, &relief_frame].map(|f| frame_group(device, &frame_layout, f, &nothing));
        let capacity = 256;
        let draws = buffer(device, "draws", capacity as u64 * u64::from(stride));
        let group = draw_group(device, &draw_layout, &draws);
        Self {
            frame_layout,
            draw_layout,
            frame,
            frame_group,
            relief_frame,
            relief_group,
            draws,
            draw_group: group,
            stride,
            capacity,
        }
    }

    /// The picture looks into this relief map from now on.
    pub(crate) fn set_relief(&mut self, device: &wgpu::Device, map: &wgpu::TextureView) {
        self.frame_group = frame_group(device, &self.frame_layout, &self.frame, map);
    }

    /// Write the uniforms of the relief pass.
    pub(crate) fn write_relief(&self, queue: &wgpu::Queue, frame: &UniformBytes) {
        queue.write_buffer(&self.relief_frame, 0, &frame.bytes);
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
            self.draw_group = draw_group(device, &self.draw_layout, &self.draws);
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

fn frame_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("frame"),
        entries: &[
            uniform_entry(false, FRAME_BYTES),
            wgpu::BindGroupLayoutEntry {
                binding: 1,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Uint,
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
                count: None,
            },
        ],
    })
}

fn draw_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("draw"),
        entries: &[uniform_entry(true, DRAW_BYTES)],
    })
}

fn uniform_entry(dynamic: bool, bytes: u64) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: dynamic,
            min_binding_size: wgpu::BufferSize::new(bytes),
        },
        count: None,
    }
}

fn buffer(device: &wgpu::Device, label: &str, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn frame_group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    frame: &wgpu::Buffer,
    relief: &wgpu::TextureView,
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("frame"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(relief) },
        ],
    })
}

fn draw_group(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, draws: &wgpu::Buffer) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("draw"),
        layout,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: draws,
                offset: 0,
                size: wgpu::BufferSize::new(DRAW_BYTES),
            }),
        }],
    })
}

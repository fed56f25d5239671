//! The uniforms of `shaders/frame.wgsl`, as structs of the same layout, and the buffers that hold them.

use super::DEPTH_NORMAL_FORMAT;
use super::target::{texture, view_of};
use crate::clip::ClipTransform;
use crate::options::{Background, RenderOptions};
use crate::section::Clip;
use glam::{DVec3, IVec3, Mat4, Vec4};
use kilwa_geometry::color::light_from_srgb;
use kilwa_stream::{Projection, View};

/// Range of the error view's scale: a tenth of a millimetre to a metre, log2 of metres.
pub(crate) const ERROR_SCALE: (f32, f32) = (-13.0, 0.0);

/// The struct `Frame` of `shaders/frame.wgsl`, field by field as it lies in memory; a test compares the layouts.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::NoUninit)]
#[repr(C)]
#[allow(missing_docs)] // the shader explains the fields
pub struct Frame {
    pub clip_from_cell: Mat4,
    pub eye_from_cell: Vec4,
    pub light: Vec4,
    pub rake: Vec4,
    pub top: Vec4,
    pub bottom: Vec4,
    pub right: Vec4,
    pub up: Vec4,
    pub depth: Vec4,
    pub plane: Vec4,
    pub clip: [Vec4; 7],
    pub cell: IVec3,
    pub smooth_cut: u32,
    pub tile_scale: f32,
    pub tile_shift: f32,
    pub shading: f32,
    pub back_tint: f32,
    pub error_low: f32,
    pub error_high: f32,
    pub range_low: f32,
    pub range_scale: f32,
    pub strength: f32,
    pub radius: f32,
    pub feature: f32,
    pub outline: f32,
    pub depth_normal_shift: [i32; 2],
    pub clip_flags: u32,
    pub on_color: u32,
    pub scalar_low: f32,
    pub scalar_scale: f32,
    pub unused: [u32; 2],
}

/// The struct `Draw` of `shaders/frame.wgsl`, likewise.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::NoUninit)]
#[repr(C)]
#[allow(missing_docs)] // the shader explains the fields
pub struct Draw {
    pub id: u32,
    pub level: u32,
    pub error: f32,
    pub fade: u32,
}

/// The uniforms of a frame.
pub fn frame_uniform(view: &View, options: &RenderOptions, target: TargetTraits) -> Frame {
    let clip = match options.own_frustum() {
        Some(frustum) => ClipTransform::with_frustum(view, options.tile, frustum),
        None => ClipTransform::new(view, options.tile),
    };
    let light = 0.62 * view.up - 0.48 * view.right - 0.62 * view.forward;
    let (top, bottom) = match options.background {
        Background::Flat(c) => (opaque(c), opaque(c)),
        Background::Gradient(top, bottom) => (opaque(top), opaque(bottom)),
        Background::Transparent => (Vec4::ZERO, Vec4::ZERO),
    };
    let (scale, shift) = options.tile.map_or((1.0, 0.0), |t| {
        let full = f64::from(view.size[1].max(1));
        ((f64::from(t.size[1]) / full) as f32, (f64::from(t.offset[1]) / full) as f32)
    });
    let (per_depth, per_pixel, depth) = footprint(view);
    let cell = clip.cell.as_dvec3();
    let range_scale = reciprocal(options.scale.range[1] - options.scale.range[0]);
    let scalar_scale = reciprocal(f64::from(options.scalar_range[1] - options.scalar_range[0]));
    let flags = u32::from(options.clip.plane.is_some())
        | u32::from(options.clip.bounds.is_some()) << 1
        | u32::from(options.clip.bounds.is_some_and(|b| b.remove_inside)) << 2;
    Frame {
        clip_from_cell: clip.clip_from_cell,
        eye_from_cell: clip.eye_from_cell,
        light: four(light, 0.0),
        rake: four(options.light.direction(view), 0.0),
        top,
        bottom,
        right: four(view.right, per_depth),
        up: four(view.up, per_pixel),
        depth,
        plane: four(options.scale.normal, options.scale.normal.dot(cell) - options.scale.offset),
        clip: half_spaces(&options.clip, cell),
        cell: clip.cell,
        smooth_cut: u32::from(target.smooth_cut),
        tile_scale: scale,
        tile_shift: shift,
        shading: options.shading,
        back_tint: if options.mark_back_faces { 1.0 } else { 0.0 },
        error_low: ERROR_SCALE.0,
        error_high: ERROR_SCALE.1,
        range_low: options.scale.range[0] as f32,
        range_scale,
        strength: options.strength,
        radius: options.radius,
        feature: options.feature as f32,
        outline: options.outline,
        depth_normal_shift: target.depth_normal_shift,
        clip_flags: flags,
        on_color: u32::from(options.on_color),
        scalar_low: options.scalar_range[0],
        scalar_scale,
        unused: [0; 2],
    }
}

/// What a frame's target adds to the view and the options.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TargetTraits {
    /// From a pixel of the target to its pixel in the depth and normal buffer.
    pub depth_normal_shift: [i32; 2],
    /// The edge of a cut is smoothed by the samples that it covers.
    pub smooth_cut: bool,
}

fn four(v: DVec3, w: f64) -> Vec4 {
    v.extend(w).as_vec4()
}

/// 1 over the length of a scale; a scale without length is a step.
fn reciprocal(length: f64) -> f32 {
    if length == 0.0 { 1e30 } else { (1.0 / length) as f32 }
}

/// Steps per pixel and step of depth, steps per pixel, and how depth values become depth.
fn footprint(view: &View) -> (f64, f64, Vec4) {
    let half_pixels = f64::from(view.size[1].max(1)) * 0.5;
    match view.projection {
        Projection::Perspective { tan_half_height } => {
            (tan_half_height / half_pixels, 0.0, Vec4::new(view.near as f32, 0.0, 0.0, 1.0))
        }
        Projection::Orthographic { half_height } => {
            let depth = view.far - view.near;
            (0.0, half_height / half_pixels, Vec4::new(view.near as f32, view.far as f32, depth as f32, 0.0))
        }
    }
}

/// The half-spaces of a cut, counted from the cell: the plane, then the box.
fn half_spaces(clip: &Clip, cell: DVec3) -> [Vec4; 7] {
    let mut out = [Vec4::ZERO; 7];
    let plane = clip.plane.iter().map(|p| (0, p));
    let faces = clip.bounds.iter().flat_map(|b| (1..).zip(&b.faces));
    for (slot, half) in plane.chain(faces) {
        // The subtraction in f64: close to the cell, where f32 is fine, stays what matters.
        out[slot] = four(half.normal, half.offset - half.normal.dot(cell));
    }
    out
}

/// All pixels: the draw does not fade.
pub const NO_FADE: [f32; 2] = [0.0, 1.0];

/// The uniforms of a draw call. `fade`: it has the pixels whose noise lies between two shares.
pub fn draw_uniform(id: u32, level: u32, error: f32, fade: [f32; 2]) -> Draw {
    let [low, high] = fade.map(|x| (x.clamp(0.0, 1.0) * 65535.0).round() as u32);
    Draw { id, level, error, fade: low | high << 16 }
}

/// Linear values of an opaque sRGB colour.
fn opaque(c: [u8; 3]) -> Vec4 {
    let [r, g, b] = c.map(|level| light_from_srgb(level) as f32);
    Vec4::new(r, g, b, 1.0)
}

/// The uniform buffers and their bind groups: a `Frame` for the picture and one for the depth and normal pass before it, and a `Draw` per
/// draw call, by dynamic offset.
pub(crate) struct Uniforms {
    frame_layout: wgpu::BindGroupLayout,
    draw_layout: wgpu::BindGroupLayout,
    frame: wgpu::Buffer,
    pub(crate) frame_group: wgpu::BindGroup,
    depth_normal_frame: wgpu::Buffer,
    pub(crate) depth_normal_group: wgpu::BindGroup,
    draws: wgpu::Buffer,
    pub(crate) draw_group: wgpu::BindGroup,
    /// Bytes from one `Draw` to the next.
    pub(crate) stride: u32,
    capacity: usize,
    /// The bytes of the last frame's draws, kept so that a frame allocates nothing.
    staging: Vec<u8>,
}

const FRAME_BYTES: u64 = size_of::<Frame>() as u64;
const DRAW_BYTES: u64 = size_of::<Draw>() as u64;

impl Uniforms {
    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let frame_layout = frame_layout(device);
        let draw_layout = draw_layout(device);
        let stride = device.limits().min_uniform_buffer_offset_alignment.max(DRAW_BYTES as u32);
        let frame = buffer(device, "frame", FRAME_BYTES);
        let depth_normal_frame = buffer(device, "depth and normal frame", FRAME_BYTES);
        // Passes that look at no neighbourhood have a map of one pixel.
        let usage = wgpu::TextureUsages::TEXTURE_BINDING;
        let nothing = view_of(&texture(device, "no depth and normals", [1, 1], 1, DEPTH_NORMAL_FORMAT, usage));
        let [frame_group, depth_normal_group] =
            [&frame, &depth_normal_frame].map(|f| frame_group(device, &frame_layout, f, &nothing));
        let capacity = 256;
        let draws = buffer(device, "draws", capacity as u64 * u64::from(stride));
        let group = draw_group(device, &draw_layout, &draws);
        Self {
            frame_layout,
            draw_layout,
            frame,
            frame_group,
            depth_normal_frame,
            depth_normal_group,
            draws,
            draw_group: group,
            stride,
            capacity,
            staging: Vec::new(),
        }
    }

    /// The picture looks into this depth and normal buffer from now on.
    pub(crate) fn set_depth_normal(&mut self, device: &wgpu::Device, map: &wgpu::TextureView) {
        self.frame_group = frame_group(device, &self.frame_layout, &self.frame, map);
    }

    /// Write the uniforms of the depth and normal pass.
    pub(crate) fn write_depth_normal(&self, queue: &wgpu::Queue, frame: &Frame) {
        queue.write_buffer(&self.depth_normal_frame, 0, bytemuck::bytes_of(frame));
    }

    /// Write a frame's uniforms; `draws` in order of their dynamic offsets.
    pub(crate) fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, frame: &Frame, draws: &[Draw]) {
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        if draws.len() > self.capacity {
            self.capacity = draws.len().next_power_of_two();
            self.draws = buffer(device, "draws", self.capacity as u64 * u64::from(self.stride));
            self.draw_group = draw_group(device, &self.draw_layout, &self.draws);
        }
        self.staging.clear();
        for draw in draws {
            let end = self.staging.len() + self.stride as usize;
            self.staging.extend_from_slice(bytemuck::bytes_of(draw));
            self.staging.resize(end, 0);
        }
        if !draws.is_empty() {
            queue.write_buffer(&self.draws, 0, &self.staging);
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
    depth_normal: &wgpu::TextureView,
) -> wgpu::BindGroup {
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("frame"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(depth_normal) },
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

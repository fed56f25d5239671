//! The id pass: which draw covers a pixel, at which depth. `shaders/id.wgsl`.

use super::frame::Uniforms;
use super::pipeline::{Pass, fragment};
use super::pool::{ATTRIBUTES, vertex_buffer_layout};
use super::{ID_FORMAT, depth_state};

/// The pass's pipeline: one sample, the same positions as the surface pass; `cut` where something is cut away.
pub(crate) fn pipeline(device: &wgpu::Device, uniforms: &Uniforms, cut: bool) -> wgpu::RenderPipeline {
    Pass {
        name: "id",
        layout: &uniforms.pipeline_layout(device),
        vertex: "vertex",
        buffers: &[Some(vertex_buffer_layout(&ATTRIBUTES[..1]))],
        fragment: fragment(cut),
        constants: &[],
        format: ID_FORMAT,
        depth: Some(depth_state(true)),
        multisample: wgpu::MultisampleState::default(),
    }
    .pipeline(device)
}

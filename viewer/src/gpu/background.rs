//! The background pass: one triangle, drawn first, without depth. `shaders/background.wgsl`.

use super::depth_state;
use super::frame::Uniforms;
use super::pipeline::Pass;

/// The pass's pipeline for a target format and sample count.
pub(crate) fn pipeline(
    device: &wgpu::Device,
    uniforms: &Uniforms,
    format: wgpu::TextureFormat,
    samples: u32,
) -> wgpu::RenderPipeline {
    Pass {
        name: "background",
        layout: &uniforms.pipeline_layout(device),
        vertex: "vertex",
        buffers: &[],
        fragment: "fragment",
        constants: &[],
        format,
        depth: Some(depth_state(false)),
        multisample: wgpu::MultisampleState { count: samples, ..wgpu::MultisampleState::default() },
    }
    .pipeline(device)
}

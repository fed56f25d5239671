//! The surface pass: draws patches lit and coloured after the mode. `shaders/surface.wgsl`.

use super::frame::Uniforms;
use super::pool::{ATTRIBUTES, vertex_buffer_layout};
use super::{depth_state, shader};

/// The pass's pipeline for a target format and sample count. Both sides of the surface are drawn.
pub(crate) fn pipeline(
    device: &wgpu::Device,
    uniforms: &Uniforms,
    format: wgpu::TextureFormat,
    samples: u32,
) -> wgpu::RenderPipeline {
    let module = shader(device, 0);
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("surface"),
        layout: Some(&uniforms.pipeline_layout(device)),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(vertex_buffer_layout(&ATTRIBUTES))],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(depth_state(true)),
        multisample: wgpu::MultisampleState { count: samples, ..wgpu::MultisampleState::default() },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

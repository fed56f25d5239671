//! The id pass: which draw covers a pixel, at which depth. `shaders/id.wgsl`.

use super::frame::Uniforms;
use super::pool::{ATTRIBUTES, vertex_buffer_layout};
use super::{ID_FORMAT, depth_state, shader};

/// The pass's pipeline: one sample, the same positions as the surface pass; `cut` where something is cut away.
pub(crate) fn pipeline(device: &wgpu::Device, uniforms: &Uniforms, cut: bool) -> wgpu::RenderPipeline {
    let module = shader(device, "id");
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("id"),
        layout: Some(&uniforms.pipeline_layout(device)),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(vertex_buffer_layout(&ATTRIBUTES[..1]))],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(depth_state(true)),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(if cut { "fragment_cut" } else { "fragment" }),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(ID_FORMAT.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

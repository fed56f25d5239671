//! The surface pass: draws patches lit and coloured after the mode. `shaders/surface.wgsl`.

use super::depth_state;
use super::frame::Uniforms;
use super::pipeline::{Pass, fragment};
use super::pool::{ATTRIBUTES, scalar_buffer_layout, vertex_buffer_layout};
use crate::options::Mode;

/// What a pipeline of the surface pass is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Variant {
    /// What colours the surface.
    pub(crate) mode: Mode,
    /// Something is cut away, or levels fade: pixels are discarded.
    pub(crate) cut: bool,
    /// The edge of the cut is smoothed by the samples that it covers.
    pub(crate) smooth: bool,
    /// A scalar per vertex comes with the vertices.
    pub(crate) scalar: bool,
}

/// The pass's pipeline for a target format and sample count. Both sides of the surface are drawn.
pub(crate) fn pipeline(
    device: &wgpu::Device,
    uniforms: &Uniforms,
    format: wgpu::TextureFormat,
    samples: u32,
    variant: Variant,
) -> wgpu::RenderPipeline {
    let vertices = Some(vertex_buffer_layout(&ATTRIBUTES));
    let buffers = [vertices, Some(scalar_buffer_layout())];
    Pass {
        name: "surface",
        layout: &uniforms.pipeline_layout(device),
        vertex: if variant.scalar { "vertex_scalar" } else { "vertex" },
        buffers: if variant.scalar { &buffers } else { &buffers[..1] },
        fragment: fragment(variant.cut),
        constants: &[("mode", variant.mode.number() as f64)],
        format,
        depth: Some(depth_state(true)),
        multisample: wgpu::MultisampleState {
            count: samples,
            alpha_to_coverage_enabled: variant.smooth,
            ..wgpu::MultisampleState::default()
        },
    }
    .pipeline(device)
}

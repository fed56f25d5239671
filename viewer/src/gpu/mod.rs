//! What runs on the GPU: the context, the memory of chunks, and one file per pass.

pub mod background;
pub mod context;
pub mod frame;
pub mod id;
pub mod pool;
pub mod readback;
pub mod surface;
pub mod target;

/// Depth of every pass: 32-bit float, reversed.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Target of the id pass.
pub const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;

/// WGSL of every pass with the shared part in front, by name: what the pipelines and the tests use.
pub const SHADERS: [(&str, &str); 3] = [
    ("surface", concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/surface.wgsl"))),
    (
        "background",
        concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/background.wgsl")),
    ),
    ("id", concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/id.wgsl"))),
];

/// Reversed depth: nearer is larger.
pub(crate) fn depth_state(write: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(write),
        depth_compare: Some(if write { wgpu::CompareFunction::GreaterEqual } else { wgpu::CompareFunction::Always }),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// The module of a pass.
pub(crate) fn shader(device: &wgpu::Device, number: usize) -> wgpu::ShaderModule {
    let (name, source) = SHADERS[number];
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

//! What runs on the GPU: the context, the memory of chunks, and one file per pass.

pub mod background;
pub mod context;
pub mod depth_normal;
pub mod frame;
pub mod id;
#[cfg(not(target_arch = "wasm32"))]
pub(crate) mod indirect;
pub(crate) mod pipeline;
pub mod pool;
pub(crate) mod present;
pub mod readback;
pub mod surface;
pub mod target;
#[cfg(not(target_arch = "wasm32"))]
pub mod timer;
pub(crate) mod timing;

/// Depth of every pass: 32-bit float, reversed.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Target of the id pass.
pub const ID_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;

/// Target of the depth and normal pass.
pub const DEPTH_NORMAL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;

/// A shader of the parts named, in this order, as `build.rs` leaves them: without comments.
macro_rules! wgsl {
    ($($part:literal),+) => { concat!($(include_str!(concat!(env!("OUT_DIR"), "/", $part, ".wgsl"))),+) };
}

/// WGSL of every pass with the shared parts in front, by name: what the pipelines and the tests use.
pub const SHADERS: [(&str, &str); 5] = [
    ("surface", wgsl!("srgb", "frame", "normal", "neighbourhood", "surface")),
    ("background", wgsl!("srgb", "frame", "background")),
    ("id", wgsl!("frame", "id")),
    ("depth_normal", wgsl!("frame", "normal", "depth_normal")),
    ("present", wgsl!("srgb", "present")),
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
pub(crate) fn shader(device: &wgpu::Device, name: &str) -> wgpu::ShaderModule {
    let source = SHADERS.iter().find(|(n, _)| *n == name).map_or("", |(_, source)| source);
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

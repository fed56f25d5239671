//! The depth and normal pass: depth and normal of every pixel, one sample, drawn before the surface for modes that look at the
//! neighbourhood. `shaders/depth_normal.wgsl`.

use super::frame::Uniforms;
use super::pipeline::{Pass, fragment};
use super::pool::{ATTRIBUTES, vertex_buffer_layout};
use super::target::{texture, view_of};
use super::{DEPTH_NORMAL_FORMAT, depth_state};
use crate::options::Tile;
use kilwa_stream::View;

/// Farthest that a mode looks, pixels: 24 for curvature, and twice the largest radius of eye-dome lighting.
pub(crate) const REACH: u32 = 32;

/// The pass's pipeline; `cut` where something is cut away or levels fade.
pub(crate) fn pipeline(device: &wgpu::Device, uniforms: &Uniforms, cut: bool) -> wgpu::RenderPipeline {
    let attributes = [ATTRIBUTES[0], ATTRIBUTES[2]];
    Pass {
        name: "depth_normal",
        layout: &uniforms.pipeline_layout(device),
        vertex: "vertex",
        buffers: &[Some(vertex_buffer_layout(&attributes))],
        fragment: fragment(cut),
        constants: &[],
        format: DEPTH_NORMAL_FORMAT,
        depth: Some(depth_state(true)),
        multisample: wgpu::MultisampleState::default(),
    }
    .pipeline(device)
}

/// The part of the picture that a map for `tile` covers: the tile and what modes look at round it, inside of the picture. And the way
/// from a pixel of the tile to its pixel in the map.
pub(crate) fn covered(view: &View, tile: Option<Tile>) -> (Tile, [i32; 2]) {
    let tile = tile.unwrap_or(Tile { offset: [0, 0], size: view.size });
    let offset = tile.offset.map(|x| x.saturating_sub(REACH));
    let end: [u32; 2] = std::array::from_fn(|i| {
        let end = tile.offset[i].saturating_add(tile.size[i]);
        end.saturating_add(REACH).min(view.size[i]).max(end)
    });
    let map = Tile { offset, size: std::array::from_fn(|i| end[i] - offset[i]) };
    (map, std::array::from_fn(|i| (tile.offset[i] - offset[i]) as i32))
}

/// The map of a frame, kept from frame to frame.
#[derive(Default)]
pub(crate) struct DepthNormalBuffer {
    size: [u32; 2],
    map: Option<wgpu::TextureView>,
}

impl DepthNormalBuffer {
    /// A map of this size, and whether it is a new one.
    pub(crate) fn fit(&mut self, device: &wgpu::Device, size: [u32; 2]) -> (wgpu::TextureView, bool) {
        if let Some(map) = self.map.clone().filter(|_| self.size == size) {
            return (map, false);
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let map = view_of(&texture(device, "depth_normal", size, 1, DEPTH_NORMAL_FORMAT, usage));
        (self.size, self.map) = (size, Some(map.clone()));
        (map, true)
    }
}

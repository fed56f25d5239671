//! Textures that a frame is drawn into: depth, the multisampled colour, and offscreen targets.

/// Depth and multisampled colour for one target size, kept from frame to frame.
#[derive(Default)]
pub(crate) struct Attachments {
    size: [u32; 2],
    samples: u32,
    depth: Option<wgpu::TextureView>,
    color: Option<wgpu::TextureView>,
}

impl Attachments {
    /// Make them fit; returns depth, and the multisampled colour where there is one.
    pub(crate) fn fit(
        &mut self,
        device: &wgpu::Device,
        size: [u32; 2],
        samples: u32,
        format: wgpu::TextureFormat,
    ) -> (wgpu::TextureView, Option<wgpu::TextureView>) {
        let old = self.depth.clone().filter(|_| self.size == size && self.samples == samples);
        let depth = old.unwrap_or_else(|| {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            self.color = (samples > 1).then(|| view_of(&texture(device, "samples", size, samples, format, usage)));
            (self.size, self.samples) = (size, samples);
            view_of(&texture(device, "depth", size, samples, super::DEPTH_FORMAT, usage))
        });
        self.depth = Some(depth.clone());
        (depth, self.color.clone())
    }
}

/// A two-dimensional texture.
pub(crate) fn texture(
    device: &wgpu::Device,
    label: &str,
    size: [u32; 2],
    samples: u32,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size[0].max(1), height: size[1].max(1), depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: samples,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

/// The whole texture as a view.
pub(crate) fn view_of(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

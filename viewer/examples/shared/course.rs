//! The cameras of the examples, and what they draw to.

use kilwa_viewer::{Bounds, Camera, Gpu, StandardView};

/// All of the model, from the south and a little from above.
pub(crate) fn whole(bounds: &Bounds, size: [u32; 2]) -> Camera {
    let mut camera = Camera::standard(StandardView::South, bounds, size);
    camera.orthographic = false;
    camera.elevation = 0.2;
    camera
}

/// The camera of a recorded flight, `share` from 0 to 1: from `all` of the model to its surface, along it, and away again.
pub(crate) fn flight(all: &Camera, bounds: &Bounds, share: f64) -> Camera {
    let ease = |x: f64| x * x * (3.0 - 2.0 * x);
    let near = ease((share * 4.0).min(1.0).min((1.0 - share) * 4.0));
    let along = ease(((share - 0.25) * 2.0).clamp(0.0, 1.0)) - 0.5;
    let mut camera = *all;
    camera.distance = all.distance * 0.06_f64.powf(near);
    camera.target[0] += along * 0.7 * (bounds.max[0] - bounds.min[0]) * near;
    camera.azimuth += 0.6 * along;
    camera
}

/// A texture to draw to.
pub(crate) fn target(gpu: &Gpu, size: [u32; 2], format: wgpu::TextureFormat) -> wgpu::TextureView {
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("target"),
        size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

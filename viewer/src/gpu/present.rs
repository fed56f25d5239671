//! The last pass where the target has no sRGB format of its own, as canvases have not: the picture is drawn and its samples are averaged in
//! a texture of linear light, then encoded. `shaders/present.wgsl`.

use super::pipeline::Pass;
use super::target::{texture, view_of};

/// Format of the texture between: eight bits per channel, encoded by the hardware.
const BETWEEN: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// The pass, and the picture before it, kept from frame to frame.
pub(crate) struct Present {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    size: [u32; 2],
    between: Option<(wgpu::TextureView, wgpu::BindGroup)>,
}

impl Present {
    /// For a target of `format`; `None` where it encodes by itself.
    pub(crate) fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Option<Self> {
        if format.is_srgb() {
            return None;
        }
        let layout = layout(device);
        let pipeline = pipeline(device, &layout, format);
        Some(Self { pipeline, layout, size: [0, 0], between: None })
    }

    /// The format that pictures are drawn in for a target of `format`.
    pub(crate) fn drawn_format(format: wgpu::TextureFormat) -> wgpu::TextureFormat {
        if format.is_srgb() { format } else { BETWEEN }
    }

    /// Where to draw a picture of this size.
    pub(crate) fn fit(&mut self, device: &wgpu::Device, size: [u32; 2]) -> wgpu::TextureView {
        let old = self.between.take().filter(|_| self.size == size);
        let (view, group) = old.unwrap_or_else(|| {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
            let view = view_of(&texture(device, "before encoding", size, 1, BETWEEN, usage));
            let resource = wgpu::BindingResource::TextureView(&view);
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("present"),
                layout: &self.layout,
                entries: &[wgpu::BindGroupEntry { binding: 0, resource }],
            });
            (view, group)
        });
        self.size = size;
        self.between = Some((view.clone(), group));
        view
    }

    /// Encode what was drawn.
    pub(crate) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        target: &wgpu::TextureView,
        timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    ) {
        let Some((_, group)) = &self.between else { return };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("present"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            timestamp_writes,
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("present"),
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        }],
    })
}

fn pipeline(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("present"),
        bind_group_layouts: &[Some(layout)],
        immediate_size: 0,
    });
    Pass {
        name: "present",
        layout: &layout,
        vertex: "vertex",
        buffers: &[],
        fragment: "fragment",
        constants: &[],
        format,
        depth: None,
        multisample: wgpu::MultisampleState::default(),
    }
    .pipeline(device)
}

//! Render pipelines: every pass draws triangles into one colour target.

use super::shader;

/// What differs between the passes.
pub(crate) struct Pass<'a> {
    /// Name of the pass and of its shader: see [`super::SHADERS`].
    pub(crate) name: &'static str,
    pub(crate) layout: &'a wgpu::PipelineLayout,
    /// Entry point of the vertex shader.
    pub(crate) vertex: &'static str,
    pub(crate) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// Entry point of the fragment shader.
    pub(crate) fragment: &'static str,
    /// Values of the shader's `override`s, by name.
    pub(crate) constants: &'a [(&'a str, f64)],
    pub(crate) format: wgpu::TextureFormat,
    pub(crate) depth: Option<wgpu::DepthStencilState>,
    pub(crate) multisample: wgpu::MultisampleState,
}

impl Pass<'_> {
    pub(crate) fn pipeline(self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let module = shader(device, self.name);
        let options = wgpu::PipelineCompilationOptions {
            constants: self.constants,
            ..wgpu::PipelineCompilationOptions::default()
        };
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.name),
            layout: Some(self.layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some(self.vertex),
                compilation_options: options.clone(),
                buffers: self.buffers,
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: self.depth,
            multisample: self.multisample,
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(self.fragment),
                compilation_options: options,
                targets: &[Some(self.format.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Entry point of the fragment shader; `cut` where pixels are discarded.
pub(crate) fn fragment(cut: bool) -> &'static str {
    if cut { "fragment_cut" } else { "fragment" }
}

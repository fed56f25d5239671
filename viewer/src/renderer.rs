//! The renderer: GPU memory of chunks, and pictures of a cut.

use crate::draw_list::{Call, DrawList, PerCall, Place};
use crate::gpu::context::{Gpu, GpuError};
use crate::gpu::depth_normal::{self, DepthNormalBuffer};
use crate::gpu::frame::{TargetTraits, Uniforms, frame_uniform};
#[cfg(not(target_arch = "wasm32"))]
use crate::gpu::indirect::Indirect;
use crate::gpu::pool::{Pool, ShownScalar};
use crate::gpu::present::Present;
use crate::gpu::readback::Readback;
use crate::gpu::surface::Variant;
use crate::gpu::target::{Attachments, texture, view_of};
#[cfg(not(target_arch = "wasm32"))]
use crate::gpu::timer::PassTimer;
use crate::gpu::timing::Timing;
use crate::gpu::{DEPTH_NORMAL_FORMAT, ID_FORMAT, background, id, surface};
use crate::options::{Background, Mode, RenderOptions, Tile};
use crate::section::Clip;
use kilwa_geometry::color::{decode_f32, encode_f32};
use kilwa_pack::GpuChunk;
use kilwa_stream::{DrawPatch, View};
use std::collections::BTreeMap;

/// Format of pictures that are read back.
pub const IMAGE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A picture, rows from the top, four sRGB bytes (red, green, blue, alpha) per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Width and height.
    pub size: [u32; 2],
    /// `4 × width × height` bytes.
    pub pixels: Vec<u8>,
}

impl Image {
    /// Colours that are not multiplied by alpha, as PNG has them. The picture's own are: along edges over a transparent background
    /// they are the average of linear samples, or of encoded ones where `linear` is false.
    #[must_use]
    pub fn with_straight_alpha(mut self, linear: bool) -> Self {
        for pixel in self.pixels.chunks_exact_mut(4) {
            let alpha = f32::from(pixel[3]) / 255.0;
            if pixel[3] == 0 || pixel[3] == 255 {
                continue;
            }
            for value in &mut pixel[..3] {
                let encoded = f32::from(*value) / 255.0;
                let straight = if linear { encode_f32(decode_f32(encoded) / alpha) } else { encoded / alpha };
                *value = (straight.clamp(0.0, 1.0) * 255.0).round() as u8;
            }
        }
        self
    }
}

/// What covers every pixel, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct IdImage {
    /// Width and height.
    pub size: [u32; 2],
    /// Index into the list of patches that was drawn, or `None` for the background; and the depth value (reversed: see
    /// [`crate::clip::distance_from_depth`]).
    pub pixels: Vec<(Option<u32>, f32)>,
}

/// Draws cuts with one device. Chunks are uploaded and evicted as the streamer says.
pub struct Renderer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pool: Pool,
    uniforms: Uniforms,
    /// Of the target.
    format: wgpu::TextureFormat,
    /// That pictures are drawn in.
    drawn: wgpu::TextureFormat,
    present: Option<Present>,
    samples: u32,
    surface: BTreeMap<Variant, wgpu::RenderPipeline>,
    background: wgpu::RenderPipeline,
    /// Without and with a cut; made when they are first asked for, which the page never does.
    id: BTreeMap<bool, wgpu::RenderPipeline>,
    depth_normal_pipelines: BTreeMap<bool, wgpu::RenderPipeline>,
    depth_normal: DepthNormalBuffer,
    scalar: Option<ShownScalar>,
    attachments: Attachments,
    id_attachments: Attachments,
    depth_normal_attachments: Attachments,
    /// Calls of the last frame.
    list: DrawList,
    /// Where calls are read from a buffer.
    #[cfg(not(target_arch = "wasm32"))]
    indirect: Option<Indirect>,
    timing: Timing,
}

impl Renderer {
    /// A renderer for targets of `format`, with `samples` samples per pixel ([`Gpu::samples`] says how many are
    /// possible). Formats without sRGB get encoded values.
    pub fn new(device: wgpu::Device, queue: wgpu::Queue, format: wgpu::TextureFormat, samples: u32) -> Self {
        let uniforms = Uniforms::new(&device);
        // What most pictures need; other pipelines are made when a picture needs them.
        let plain = Variant { mode: Mode::default(), cut: false, smooth: false, scalar: false };
        let drawn = Present::drawn_format(format);
        let present = Present::new(&device, format);
        let surface = BTreeMap::from([(plain, surface::pipeline(&device, &uniforms, drawn, samples, plain))]);
        let background = background::pipeline(&device, &uniforms, drawn, samples);
        #[cfg(not(target_arch = "wasm32"))]
        let indirect = Indirect::suits(&device).then(Indirect::default);
        Self {
            device,
            queue,
            pool: Pool::default(),
            uniforms,
            format,
            drawn,
            present,
            samples,
            surface,
            background,
            id: BTreeMap::new(),
            depth_normal_pipelines: BTreeMap::new(),
            depth_normal: DepthNormalBuffer::default(),
            scalar: None,
            attachments: Attachments::default(),
            id_attachments: Attachments::default(),
            depth_normal_attachments: Attachments::default(),
            list: DrawList::default(),
            #[cfg(not(target_arch = "wasm32"))]
            indirect,
            timing: Timing::default(),
        }
    }

    /// A renderer for pictures that are read back ([`Renderer::image`]).
    pub fn headless(gpu: &Gpu) -> Self {
        Self::new(gpu.device.clone(), gpu.queue.clone(), IMAGE_FORMAT, gpu.samples(IMAGE_FORMAT))
    }

    /// Put a chunk into GPU memory, replacing what was there of it.
    pub fn upload(&mut self, index: u32, chunk: &GpuChunk) {
        self.pool.upload(&self.device, &self.queue, index, chunk, self.scalar);
    }

    /// Upload a chunk that is in GPU memory again, because some of its triangles were hidden or are shown again.
    pub fn renew(&mut self, index: u32, chunk: &GpuChunk) {
        if self.pool.get(index).is_some() {
            self.upload(index, chunk);
        }
    }

    /// The scalar that [`Mode::Scalar`] shows, or none, which frees its memory. Returns whether it is another one: then every chunk
    /// that is held has to be handed to [`Renderer::upload_scalars`].
    pub fn set_scalar(&mut self, scalar: Option<ShownScalar>) -> bool {
        let is_new = self.scalar != scalar;
        self.scalar = scalar;
        if scalar.is_none() {
            self.pool.free_scalars();
        }
        is_new
    }

    /// Give a chunk that was uploaded before the scalar that is shown now.
    pub fn upload_scalars(&mut self, index: u32, chunk: &GpuChunk) {
        self.pool.upload_scalars(&self.device, &self.queue, index, chunk, self.scalar);
    }

    /// Start timing passes, or stop with `None`. ID images and picking are not timed.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn set_timer(&mut self, timer: Option<PassTimer>) {
        self.timing.timer = timer;
    }

    /// The timer, to take times from.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn timer(&mut self) -> Option<&mut PassTimer> {
        self.timing.timer.as_mut()
    }

    /// Whether draw calls are read from a buffer, as they are by default where the device is made for it; otherwise they are recorded one by one. The
    /// pictures are the same.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn set_indirect(&mut self, is_on: bool) {
        self.indirect = is_on.then(Indirect::default);
    }

    /// Draw calls of the last pass: of a frame, or of what was drawn to find an id.
    pub fn call_count(&self) -> usize {
        self.list.calls().len()
    }

    /// Free a chunk's GPU memory.
    pub fn evict(&mut self, index: u32) {
        self.pool.evict(index);
    }

    /// Free all chunks.
    pub fn clear(&mut self) {
        self.pool.clear();
    }

    /// Whether a chunk is in GPU memory.
    pub fn has_chunk(&self, index: u32) -> bool {
        self.pool.get(index).is_some()
    }

    /// GPU memory held by chunks, bytes.
    pub fn chunk_bytes(&self) -> u64 {
        self.pool.bytes()
    }

    /// Number of chunks in GPU memory.
    pub fn chunk_count(&self) -> usize {
        self.pool.len()
    }

    /// Draw a cut into `target`, a view of the renderer's format whose size is the tile's, or the view's where there
    /// is none. Patches that are not visible, and those whose chunk is not uploaded, are left out.
    pub fn draw(&mut self, view: &View, patches: &[DrawPatch], options: &RenderOptions, target: &wgpu::TextureView) {
        self.draw_fading(view, patches, &[], options, target);
    }

    /// [`Renderer::draw`] while levels fade into each other: `fades` says for each patch which pixels it has, as two shares of their
    /// noise; patches beyond its end have all of them.
    pub fn draw_fading(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        fades: &[[f32; 2]],
        options: &RenderOptions,
        target: &wgpu::TextureView,
    ) {
        let size = target_size(view, options.tile);
        let (depth, samples) = self.attachments.fit(&self.device, size, self.samples, self.drawn);
        let picture = self.present.as_mut().map(|p| p.fit(&self.device, size));
        let drawn_to = picture.as_ref().unwrap_or(target);
        self.collect(view, patches, fades, PerCall::of(options.mode));
        let cut = options.clip.is_on() || self.list.is_fading();
        let smooth = options.clip.is_on() && self.samples > 1 && options.background != Background::Transparent;
        let scalar = options.mode == Mode::Scalar && self.pool.has_scalars();
        let variant = Variant { mode: options.mode, cut, smooth, scalar };
        let mut traits = TargetTraits { smooth_cut: smooth, depth_normal_shift: [0, 0] };
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let map = options.mode.needs_depth_normal().then(|| depth_normal::covered(view, options.tile));
        if let Some((map, shift)) = map {
            traits.depth_normal_shift = shift;
            self.prepare_depth_normal(view, options, map, traits, cut);
        }
        self.uniforms.write(&self.device, &self.queue, &frame_uniform(view, options, traits), self.list.draws());
        if let Some((map, _)) = map {
            self.draw_depth_normal(&mut encoder, map.size, cut);
        }
        let (device, uniforms, format) = (&self.device, &self.uniforms, self.drawn);
        let make = || surface::pipeline(device, uniforms, format, self.samples, variant);
        let surface = self.surface.entry(variant).or_insert_with(make).clone();
        let (attached, resolve) = match &samples {
            Some(samples) => (samples, Some(drawn_to)),
            None => (drawn_to, None),
        };
        {
            let timestamps = self.timing.begin("surface");
            let mut pass = begin(&mut encoder, attached, resolve, &depth, timestamps);
            pass.set_bind_group(0, &self.uniforms.frame_group, &[]);
            pass.set_bind_group(1, &self.uniforms.draw_group, &[0]);
            pass.set_pipeline(&self.background);
            pass.draw(0..3, 0..1);
            pass.set_pipeline(&surface);
            self.recorder().record(&mut pass, variant.scalar);
        }
        self.timing.end();
        if let Some(present) = &self.present {
            present.record(&mut encoder, target, self.timing.begin("present"));
            self.timing.end();
        }
        self.timing.submit(&self.queue, encoder);
    }

    /// Uniforms, map and pipeline of the depth and normal pass.
    fn prepare_depth_normal(
        &mut self,
        view: &View,
        options: &RenderOptions,
        map: Tile,
        traits: TargetTraits,
        cut: bool,
    ) {
        let (texture, is_new) = self.depth_normal.fit(&self.device, map.size);
        if is_new {
            self.uniforms.set_depth_normal(&self.device, &texture);
        }
        let options = RenderOptions { tile: Some(map), ..*options };
        self.uniforms.write_depth_normal(&self.queue, &frame_uniform(view, &options, traits));
        let (device, uniforms) = (&self.device, &self.uniforms);
        self.depth_normal_pipelines.entry(cut).or_insert_with(|| depth_normal::pipeline(device, uniforms, cut));
    }

    fn draw_depth_normal(&mut self, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], cut: bool) {
        let (map, _) = self.depth_normal.fit(&self.device, size);
        let (depth, _) = self.depth_normal_attachments.fit(&self.device, size, 1, DEPTH_NORMAL_FORMAT);
        let Some(pipeline) = self.depth_normal_pipelines.get(&cut) else { return };
        let timestamps = self.timing.begin("depth_normal");
        let mut pass = begin(encoder, &map, None, &depth, timestamps);
        pass.set_bind_group(0, &self.uniforms.depth_normal_group, &[]);
        pass.set_pipeline(pipeline);
        self.recorder().record(&mut pass, false);
        drop(pass);
        self.timing.end();
    }

    /// A picture of a cut.
    ///
    /// # Errors
    /// [`GpuError::Readback`] when the device was lost. Only for renderers made by [`Renderer::headless`] or with
    /// [`IMAGE_FORMAT`].
    pub async fn image(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        options: &RenderOptions,
    ) -> Result<Image, GpuError> {
        self.image_fading(view, patches, &[], options).await
    }

    /// A picture of levels that fade into each other ([`Renderer::draw_fading`]).
    ///
    /// # Errors
    /// As [`Renderer::image`].
    pub async fn image_fading(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        fades: &[[f32; 2]],
        options: &RenderOptions,
    ) -> Result<Image, GpuError> {
        let size = target_size(view, options.tile);
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let picture = texture(&self.device, "picture", size, 1, self.format, usage);
        self.draw_fading(view, patches, fades, options, &view_of(&picture));
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let readback = Readback::record(&self.device, &mut encoder, &picture, 4);
        self.queue.submit([encoder.finish()]);
        Ok(Image { size, pixels: readback.bytes(&self.device).await? })
    }

    /// Which patch covers every pixel, at which depth, without multisampling and without a cut.
    ///
    /// # Errors
    /// [`GpuError::Readback`] when the device was lost.
    pub async fn ids(&mut self, view: &View, patches: &[DrawPatch], tile: Option<Tile>) -> Result<IdImage, GpuError> {
        self.ids_of_cut(view, patches, tile, &Clip::default()).await
    }

    /// [`Renderer::ids`] of what a cut leaves.
    ///
    /// # Errors
    /// [`GpuError::Readback`] when the device was lost.
    pub async fn ids_of_cut(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        tile: Option<Tile>,
        clip: &Clip,
    ) -> Result<IdImage, GpuError> {
        let size = target_size(view, tile);
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let ids = texture(&self.device, "ids", size, 1, ID_FORMAT, usage);
        let (depth, _) = self.id_attachments.fit(&self.device, size, 1, ID_FORMAT);
        self.collect(view, patches, &[], PerCall::Patches);
        let options = RenderOptions { tile, clip: *clip, ..RenderOptions::default() };
        let frame = frame_uniform(view, &options, TargetTraits::default());
        self.uniforms.write(&self.device, &self.queue, &frame, self.list.draws());
        let cut = clip.is_on();
        let pipeline = self.id.entry(cut).or_insert_with(|| id::pipeline(&self.device, &self.uniforms, cut)).clone();
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = begin(&mut encoder, &view_of(&ids), None, &depth, None);
            pass.set_bind_group(0, &self.uniforms.frame_group, &[]);
            pass.set_pipeline(&pipeline);
            self.recorder().record(&mut pass, false);
        }
        let readback = Readback::record(&self.device, &mut encoder, &ids, 8);
        self.queue.submit([encoder.finish()]);
        let bytes = readback.bytes(&self.device).await?;
        let word = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let pixels =
            bytes.chunks_exact(8).map(|b| (word(&b[..4]).checked_sub(1), f32::from_bits(word(&b[4..])))).collect();
        Ok(IdImage { size, pixels })
    }

    /// What is under one pixel: the index of the patch in `patches`, and the depth along the view axis in steps. The
    /// place is then computed from the decoded chunk: the GPU only says where to look.
    ///
    /// # Errors
    /// [`GpuError::Readback`] when the device was lost.
    pub async fn pick(
        &mut self,
        view: &View,
        patches: &[DrawPatch],
        pixel: [u32; 2],
    ) -> Result<Option<(u32, f64)>, GpuError> {
        let ids = self.ids(view, patches, Some(Tile { offset: pixel, size: [1, 1] })).await?;
        Ok(ids.pixels.first().and_then(|(id, depth)| Some(((*id)?, crate::clip::distance_from_depth(view, *depth)))))
    }

    /// The calls of a cut, nearest first so that what is hidden is not shaded.
    fn collect(&mut self, view: &View, patches: &[DrawPatch], fades: &[[f32; 2]], per_call: PerCall) {
        let mut chunks = self.pool.cursor();
        self.list.collect(view, patches, fades, per_call, |index| {
            let chunk = chunks.find(index)?;
            Some(Place {
                slab: chunk.slab as u32,
                first_index: chunk.indices.start,
                triangles: chunk.triangles,
                middle: chunk.middle,
            })
        });
        #[cfg(not(target_arch = "wasm32"))]
        if let Some(indirect) = &mut self.indirect {
            indirect.write(&self.device, &self.queue, self.list.calls());
        }
    }

    fn recorder(&self) -> Recorder<'_> {
        Recorder {
            pool: &self.pool,
            uniforms: &self.uniforms,
            list: &self.list,
            #[cfg(not(target_arch = "wasm32"))]
            indirect: self.indirect.as_ref(),
        }
    }
}

/// What records the calls of a frame.
#[derive(Clone, Copy)]
struct Recorder<'a> {
    pool: &'a Pool,
    uniforms: &'a Uniforms,
    list: &'a DrawList,
    #[cfg(not(target_arch = "wasm32"))]
    indirect: Option<&'a Indirect>,
}

impl Recorder<'_> {
    fn record(&self, pass: &mut wgpu::RenderPass<'_>, scalars: bool) {
        let (mut bound, mut bound_draw) = (None, None);
        let mut first = 0;
        // What needs neither other buffers nor other uniforms.
        for calls in self.list.calls().chunk_by(|a, b| (a.slab, a.draw) == (b.slab, b.draw)) {
            let place = first;
            first += calls.len();
            let Some(call) = calls.first() else { continue };
            if bound != Some(call.slab) {
                if !self.pool.bind(pass, call.slab as usize, scalars) {
                    continue;
                }
                bound = Some(call.slab);
            }
            if bound_draw != Some(call.draw) {
                pass.set_bind_group(1, &self.uniforms.draw_group, &[call.draw * self.uniforms.stride]);
                bound_draw = Some(call.draw);
            }
            self.draw(pass, place, calls);
        }
    }

    #[cfg(not(target_arch = "wasm32"))]
    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, first: usize, calls: &[Call]) {
        match self.indirect {
            Some(indirect) => indirect.record(pass, first, calls.len()),
            None => draw_each(pass, calls),
        }
    }

    #[cfg(target_arch = "wasm32")]
    #[expect(clippy::unused_self, reason = "the interface of the native form")]
    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, _first: usize, calls: &[Call]) {
        draw_each(pass, calls);
    }
}

fn draw_each(pass: &mut wgpu::RenderPass<'_>, calls: &[Call]) {
    for call in calls {
        pass.draw_indexed(call.indices.clone(), 0, 0..1);
    }
}

fn target_size(view: &View, tile: Option<Tile>) -> [u32; 2] {
    tile.map_or(view.size, |t| t.size).map(|x| x.max(1))
}

/// Begin a pass over a cleared target and cleared (farthest) depth.
fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    color: &wgpu::TextureView,
    resolve: Option<&wgpu::TextureView>,
    depth: &wgpu::TextureView,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: color,
            depth_slice: None,
            resolve_target: resolve,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: if resolve.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store },
            },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
            stencil_ops: None,
        }),
        timestamp_writes,
        ..wgpu::RenderPassDescriptor::default()
    })
}

//! The browser: a `Viewer` object over the streamer and the renderer. JavaScript does what only it can do (requests,
//! workers, events) and is told what to do by [`Viewer::frame`]; everything decided is decided here.
//!
//! Lengths that JavaScript sees are world metres, pixels are those of the canvas's picture with y down, times are
//! milliseconds. Numbers of bytes and requests are `f64`, exact up to 2^53. Errors are sentences; those that begin with
//! `nogpu:` mean that nothing can be drawn here.

use crate::camera::{Bounds, Camera, StandardView};
use crate::gpu::context::Gpu;
use crate::gpu::frame::ERROR_SCALE;
use crate::gpu::readback::Readback;
use crate::gpu::target::{texture, view_of};
use crate::options::{Background, Mode, RenderOptions};
use crate::pick::{Hit, nearest};
use crate::renderer::Renderer;
use js_sys::{Array, Object, Promise, Reflect, Uint8Array};
use kilwa_pack::{GpuChunk, Metadata, PackError, PatchRange, parse_head};
use kilwa_stream::{Budgets, Command, DrawPatch, Event, FetchKind, Stats, Step, Streamer, View};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use wasm_bindgen::prelude::{JsError, JsValue, wasm_bindgen};
use web_sys::HtmlCanvasElement;

/// How many bytes from the start of the file are needed to open it: 0 when these are enough.
///
/// # Errors
/// When they are no pack, a newer one, or damaged.
#[wasm_bindgen(js_name = headNeeds)]
pub fn head_needs(bytes: &[u8]) -> Result<f64, JsError> {
    match parse_head(bytes) {
        Ok(_) => Ok(0.0),
        Err(PackError::Truncated { needed, .. }) if needed > bytes.len() as u64 => Ok(needed as f64),
        Err(e) => Err(JsError::new(&e.to_string())),
    }
}

/// What a pack says of itself, as JSON: the metadata, and under `pack` the header's figures.
///
/// # Errors
/// As [`head_needs`].
#[wasm_bindgen(js_name = packInfo)]
pub fn pack_info(bytes: &[u8]) -> Result<String, JsError> {
    let head = parse_head(bytes).map_err(|e| JsError::new(&e.to_string()))?;
    let metadata = serde_json::to_value(&head.metadata)?;
    let h = &head.header;
    let info = serde_json::json!({
        "metadata": metadata,
        "pack": {
            "bytes": h.file_bytes,
            "entries": h.entry_count,
            "triangles": h.triangles,
            "storedTriangles": h.stored_triangles,
            "colors": h.attributes.colors,
            "scalars": h.attributes.scalars,
        },
    });
    Ok(info.to_string())
}

/// One open pack on one canvas.
#[wasm_bindgen]
pub struct Viewer {
    gpu: Gpu,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    lost: Arc<AtomicBool>,
    renderer: Renderer,
    streamer: Streamer,
    decoded: BTreeMap<u32, GpuChunk>,
    events: Vec<Event>,
    bounds: Bounds,
    camera: Camera,
    options: RenderOptions,
    target_pixels: f64,
    draw: Vec<DrawPatch>,
}

#[wasm_bindgen]
impl Viewer {
    /// Open the pack whose first bytes are `head` (enough of them: [`head_needs`]) on a canvas.
    ///
    /// # Errors
    /// A sentence; it begins with `nogpu:` where the browser gives no device.
    pub async fn create(canvas: HtmlCanvasElement, head: Vec<u8>) -> Result<Viewer, JsError> {
        std::panic::set_hook(Box::new(|info| web_sys::console::error_1(&info.to_string().into())));
        let parsed = parse_head(&head).map_err(|e| JsError::new(&e.to_string()))?;
        let no_gpu = |e: &dyn std::fmt::Display| JsError::new(&format!("nogpu: {e}"));
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::BROWSER_WEBGPU;
        let instance = wgpu::Instance::new(descriptor);
        let size = [canvas.width().max(1), canvas.height().max(1)];
        let surface = instance.create_surface(wgpu::SurfaceTarget::Canvas(canvas)).map_err(|e| no_gpu(&e))?;
        let gpu = Gpu::for_surface(&instance, &surface).await.map_err(|e| no_gpu(&e))?;
        // The canvas's own format, whose values are encoded by the shader: a view of it with an sRGB format is not
        // honoured everywhere (Chromium on SwiftShader shows linear values).
        let config = surface
            .get_default_config(&gpu.adapter, size[0], size[1])
            .ok_or_else(|| no_gpu(&"the adapter cannot draw to a canvas"))?;
        let format = config.format;
        surface.configure(&gpu.device, &config);
        let lost = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&lost);
        gpu.device.set_device_lost_callback(move |_, _| flag.store(true, Ordering::Relaxed));
        let renderer = Renderer::new(gpu.device.clone(), gpu.queue.clone(), format, gpu.samples(format));
        // Chunks are small: sixteen are about a megabyte, which no frame feels, and a slow renderer needs fewer frames.
        let budgets = Budgets { uploads: 16, ..Budgets::default() };
        let streamer = Streamer::new(&parsed, head.len() as u64, budgets);
        let bounds = bounds(&parsed.metadata);
        Ok(Self {
            camera: Camera::standard(StandardView::Iso, &bounds, size),
            gpu,
            surface,
            config,
            lost,
            renderer,
            streamer,
            decoded: BTreeMap::new(),
            events: Vec::new(),
            bounds,
            options: RenderOptions::default(),
            target_pixels: 1.0,
            draw: Vec::new(),
        })
    }

    /// Name and kind of the graphics adapter.
    pub fn adapter(&self) -> String {
        self.gpu.describe()
    }

    /// The canvas has so many pixels now.
    pub fn resize(&mut self, width: u32, height: u32) {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        (self.config.width, self.config.height) = (width.clamp(1, limit), height.clamp(1, limit));
        self.surface.configure(&self.gpu.device, &self.config);
    }

    /// GPU memory and main memory for chunks, in bytes.
    #[wasm_bindgen(js_name = setMemory)]
    pub fn set_memory(&mut self, gpu_bytes: f64, cpu_bytes: f64) {
        let budgets = Budgets { gpu_bytes: gpu_bytes as u64, cpu_bytes: cpu_bytes as u64, ..*self.streamer.budgets() };
        self.streamer.set_budgets(budgets);
    }

    /// The pixel error to refine to.
    #[wasm_bindgen(js_name = setTargetPixels)]
    pub fn set_target_pixels(&mut self, pixels: f64) {
        self.target_pixels = if pixels.is_finite() { pixels.clamp(0.1, 100.0) } else { 1.0 };
    }

    /// Shading by name; false when there is none of that name.
    #[wasm_bindgen(js_name = setMode)]
    pub fn set_mode(&mut self, name: &str) -> bool {
        let mode = Mode::from_name(name);
        self.options.mode = mode.unwrap_or(self.options.mode);
        mode.is_some()
    }

    /// Names of all shadings.
    pub fn modes() -> Vec<String> {
        Mode::ALL.iter().map(|(_, name)| (*name).to_owned()).collect()
    }

    /// Where the colours of the error shading begin and end, metres.
    #[wasm_bindgen(js_name = errorScale)]
    pub fn error_scale() -> Vec<f64> {
        [ERROR_SCALE.0, ERROR_SCALE.1].map(|log2| f64::from(log2.exp2())).to_vec()
    }

    /// The shading in force.
    pub fn mode(&self) -> String {
        self.options.mode.name().to_owned()
    }

    /// The background of the dark or of the light theme.
    #[wasm_bindgen(js_name = setDark)]
    pub fn set_dark(&mut self, dark: bool) {
        self.options.background = if dark { Background::BASALT } else { Background::LIMESTONE };
    }

    /// Parallel instead of perspective projection.
    #[wasm_bindgen(js_name = setOrthographic)]
    pub fn set_orthographic(&mut self, orthographic: bool) {
        self.camera.orthographic = orthographic;
    }

    /// Turn round the pivot: a positive `azimuth` moves the eye clockwise seen from above, a positive `elevation` up. Radians.
    pub fn orbit(&mut self, azimuth: f64, elevation: f64) {
        if azimuth.is_finite() && elevation.is_finite() {
            self.camera.orbit(azimuth, elevation);
        }
    }

    /// Move with the picture, by pixels.
    pub fn pan(&mut self, dx: f64, dy: f64) {
        if dx.is_finite() && dy.is_finite() {
            self.camera.pan(dx, dy, self.size());
        }
    }

    /// Come nearer (`factor` < 1) or go away, towards what is under the pixel.
    pub fn zoom(&mut self, factor: f64, x: f64, y: f64) {
        let toward = match self.hit(x, y) {
            Some(hit) => self.streamer.header().lattice.world_from_steps(hit.point),
            None => self.camera.point_at_target_depth([x, y], self.size()),
        };
        self.camera.zoom(factor, toward, &self.bounds);
    }

    /// Turn round what is under the pixel from now on; false where there is nothing.
    #[wasm_bindgen(js_name = setPivot)]
    pub fn set_pivot(&mut self, x: f64, y: f64) -> bool {
        let hit = self.hit(x, y);
        if let Some(hit) = hit {
            self.camera.set_pivot(self.streamer.header().lattice.world_from_steps(hit.point));
        }
        hit.is_some()
    }

    /// Look from a standard direction at all of the model; false when there is none of that name.
    #[wasm_bindgen(js_name = standardView)]
    pub fn standard_view(&mut self, name: &str) -> bool {
        let view = StandardView::from_name(name);
        if let Some(view) = view {
            self.camera = Camera::standard(view, &self.bounds, self.size());
        }
        view.is_some()
    }

    /// Keep the direction and show all of the model.
    pub fn fit(&mut self) {
        self.camera.fit(&self.bounds, self.size());
    }

    /// The camera: azimuth, elevation (radians), distance, target x, y, z (metres), 1 where parallel.
    pub fn camera(&self) -> Vec<f64> {
        let c = &self.camera;
        vec![c.azimuth, c.elevation, c.distance, c.target[0], c.target[1], c.target[2], f64::from(c.orthographic)]
    }

    /// Take a camera that [`Viewer::camera`] gave; false when it is none.
    #[wasm_bindgen(js_name = setCamera)]
    pub fn set_camera(&mut self, camera: &[f64]) -> bool {
        let &[azimuth, elevation, distance, x, y, z, orthographic] = camera else { return false };
        let is_sane = camera.iter().all(|v| v.is_finite()) && distance > 0.0;
        if is_sane {
            self.camera.azimuth = 0.0;
            self.camera.elevation = 0.0;
            self.camera.orbit(azimuth, elevation);
            self.camera.target = [x, y, z];
            self.camera.orthographic = orthographic != 0.0;
            self.camera.distance = distance;
            // Brings the distance into its range.
            self.camera.zoom(1.0, self.camera.target, &self.bounds);
        }
        is_sane
    }

    /// Metres that one pixel shows at the pivot.
    #[wasm_bindgen(js_name = metresPerPixel)]
    pub fn metres_per_pixel(&self) -> f64 {
        2.0 * self.camera.half_height() / f64::from(self.config.height.max(1))
    }

    /// What is under a pixel: x, y, z and the certified error there, metres; empty where there is nothing.
    pub fn pick(&self, x: f64, y: f64) -> Vec<f64> {
        let Some(hit) = self.hit(x, y) else { return Vec::new() };
        let [x, y, z] = self.streamer.header().lattice.world_from_steps(hit.point);
        vec![x, y, z, f64::from(hit.error)]
    }

    /// The bytes of a chunk request came.
    #[wasm_bindgen(js_name = onBytes)]
    pub fn on_bytes(&mut self, request: f64, length: f64) {
        self.events.push(Event::Bytes { request: request as u64, length: length as u64 });
    }

    /// The bytes of a page request came.
    #[wasm_bindgen(js_name = onPageBytes)]
    pub fn on_page_bytes(&mut self, request: f64, bytes: Vec<u8>) {
        self.events.push(Event::PageBytes { request: request as u64, bytes });
    }

    /// A request failed.
    #[wasm_bindgen(js_name = onFailed)]
    pub fn on_failed(&mut self, request: f64) {
        self.events.push(Event::Failed { request: request as u64 });
    }

    /// A worker decoded a chunk. `patches`: first triangle, number of triangles, diamond; three numbers each.
    #[wasm_bindgen(js_name = onDecoded)]
    pub fn on_decoded(&mut self, chunk: u32, vertices: Vec<u8>, indices: Vec<u32>, patches: &[u32]) {
        let patches: Vec<PatchRange> =
            patches.chunks_exact(3).map(|p| PatchRange { first: p[0], count: p[1], diamond: p[2] }).collect();
        let decoded = GpuChunk {
            vertex_count: (vertices.len() / kilwa_pack::vertex_layout::VERTEX_BYTES) as u32,
            triangle_count: (indices.len() / 3) as u32,
            vertices,
            indices,
            patches: patches.clone(),
        };
        self.decoded.insert(chunk, decoded);
        self.events.push(Event::Decoded { chunk, patches });
    }

    /// A worker refused a chunk.
    #[wasm_bindgen(js_name = onDecodeFailed)]
    pub fn on_decode_failed(&mut self, chunk: u32) {
        self.events.push(Event::DecodeFailed { chunk });
    }

    /// Decide and draw. Returns `{ commands, stats }`; see `www/session.js`.
    ///
    /// # Errors
    /// When JavaScript refuses an object, which does not happen.
    pub fn frame(&mut self, now_ms: f64) -> Result<JsValue, JsValue> {
        let view = self.view();
        let step = self.streamer.step(&view, now_ms, std::mem::take(&mut self.events));
        let commands = Array::new();
        for command in &step.commands {
            match command {
                Command::Upload { chunk } => {
                    if let Some(decoded) = self.decoded.get(chunk) {
                        self.renderer.upload(*chunk, decoded);
                    }
                }
                Command::Evict { chunk } => {
                    self.decoded.remove(chunk);
                    self.renderer.evict(*chunk);
                    commands.push(&command_object(command)?);
                }
                _ => {
                    commands.push(&command_object(command)?);
                }
            }
        }
        let stats = self.stats_object(&step)?;
        self.draw = step.draw;
        self.present(&view);
        let answer = Object::new();
        set(&answer, "commands", &commands)?;
        set(&answer, "stats", &stats)?;
        Ok(answer.into())
    }

    /// A picture of the cut that is on screen, of the canvas's size, from an offscreen texture: resolves to
    /// `{ width, height, pixels }` with red, green, blue and alpha bytes, rows from the top.
    #[wasm_bindgen(js_name = readPixels)]
    pub fn read_pixels(&mut self) -> Promise {
        let view = self.view();
        let format = self.config.format;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let device = self.gpu.device.clone();
        let target = texture(&device, "pixels", view.size, 1, format, usage);
        self.renderer.draw(&view, &self.draw, &self.options, &view_of(&target));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let readback = Readback::record(&device, &mut encoder, &target, 4);
        self.gpu.queue.submit([encoder.finish()]);
        let is_bgra = matches!(format, wgpu::TextureFormat::Bgra8UnormSrgb | wgpu::TextureFormat::Bgra8Unorm);
        wasm_bindgen_futures::future_to_promise(async move {
            let mut pixels = readback.bytes(&device).await.map_err(|e| JsError::new(&e.to_string()))?;
            if is_bgra {
                pixels.chunks_exact_mut(4).for_each(|p| p.swap(0, 2));
            }
            let answer = Object::new();
            set(&answer, "width", &view.size[0].into())?;
            set(&answer, "height", &view.size[1].into())?;
            set(&answer, "pixels", &Uint8Array::from(pixels.as_slice()))?;
            Ok(answer.into())
        })
    }
}

impl Viewer {
    fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    fn view(&self) -> View {
        self.camera.view(&self.streamer.header().lattice, &self.bounds, self.size(), self.target_pixels)
    }

    fn hit(&self, x: f64, y: f64) -> Option<Hit> {
        let (origin, direction) = self.camera.ray([x, y], self.size());
        let lattice = &self.streamer.header().lattice;
        let origin = lattice.steps_from_world(origin);
        nearest(origin, direction, &self.draw, |chunk| {
            Some((self.decoded.get(&chunk)?, self.streamer.entry(chunk)?.bounds))
        })
    }

    /// Draw the cut on the canvas. A surface that is outdated is configured again and drawn with the next frame.
    fn present(&mut self, view: &View) {
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.surface.configure(&self.gpu.device, &self.config);
                return;
            }
            _ => return,
        };
        self.renderer.draw(view, &self.draw, &self.options, &view_of(&frame.texture));
        self.gpu.queue.present(frame);
    }

    fn stats_object(&self, step: &Step) -> Result<Object, JsValue> {
        let s: &Stats = &step.stats;
        let o = Object::new();
        for (name, value) in [
            ("entriesKnown", f64::from(s.entries_known)),
            ("chunksWanted", f64::from(s.chunks_wanted)),
            ("chunksMissing", f64::from(s.chunks_missing)),
            ("chunksResident", f64::from(s.chunks_resident)),
            ("bytesMissing", s.bytes_missing as f64),
            ("bytesWanted", s.bytes_wanted as f64),
            ("bytesReceived", s.bytes_received as f64),
            ("requestsInFlight", f64::from(s.requests_in_flight)),
            ("requestsMade", s.requests_made as f64),
            ("failures", s.failures as f64),
            ("retryInMs", s.retry_in_ms),
            ("gpuBytes", s.gpu_bytes as f64),
            ("gpuBytesHeld", self.renderer.chunk_bytes() as f64),
            ("cpuBytes", s.cpu_bytes as f64),
            ("gpuLimit", self.streamer.budgets().gpu_bytes as f64),
            ("patchesDrawn", f64::from(s.patches_drawn)),
            ("trianglesDrawn", s.triangles_drawn as f64),
            ("worstPixelError", s.worst_pixel_error),
            ("worstErrorMetres", s.worst_error_metres),
            ("targetPixels", self.target_pixels),
        ] {
            set(&o, name, &value.into())?;
        }
        for (name, value) in [
            ("targetReached", s.target_reached),
            ("budgetLimited", s.budget_limited),
            ("settled", s.settled),
            ("more", !step.commands.is_empty()),
            ("lost", self.lost.load(Ordering::Relaxed)),
        ] {
            set(&o, name, &value.into())?;
        }
        Ok(o)
    }
}

fn bounds(metadata: &Metadata) -> Bounds {
    Bounds { min: metadata.bounds_min, max: metadata.bounds_max }
}

fn command_object(command: &Command) -> Result<JsValue, JsValue> {
    let o = Object::new();
    let number = |name: &str, value: f64| set(&o, name, &value.into());
    match command {
        Command::Fetch { request, offset, length, kind } => {
            set(&o, "type", &"fetch".into())?;
            number("request", *request as f64)?;
            number("offset", *offset as f64)?;
            number("length", *length as f64)?;
            set(&o, "pages", &(*kind == FetchKind::Pages).into())?;
        }
        Command::Cancel { request } => {
            set(&o, "type", &"cancel".into())?;
            number("request", *request as f64)?;
        }
        Command::Decode { chunk, request, offset, length, vertices, triangles, checksum } => {
            set(&o, "type", &"decode".into())?;
            number("chunk", f64::from(*chunk))?;
            number("request", *request as f64)?;
            number("offset", *offset as f64)?;
            number("length", f64::from(*length))?;
            number("vertices", f64::from(*vertices))?;
            number("triangles", f64::from(*triangles))?;
            set(&o, "checksum", &Uint8Array::from(checksum.as_slice()))?;
        }
        Command::Upload { chunk } | Command::Evict { chunk } => {
            set(&o, "type", &"evict".into())?;
            number("chunk", f64::from(*chunk))?;
        }
    }
    Ok(o.into())
}

fn set(object: &Object, name: &str, value: &JsValue) -> Result<(), JsValue> {
    Reflect::set(object, &name.into(), value).map(drop)
}

//! The browser: a `Viewer` object over the streamer and the renderer. JavaScript does what only it can do (requests,
//! workers, events) and is instructed by [`Viewer::frame`]; every decision is made here.
//!
//! Lengths that JavaScript sees are world metres, pixels are those of the canvas's picture with y down, times are
//! milliseconds. Numbers of bytes and requests are `f64`, exact up to 2^53. Errors are sentences; one whose `kind`
//! is `noGpu` means that nothing can be drawn here.

mod camera;
mod display;
#[cfg(feature = "webgl")]
mod headset;
mod loss;
mod navigation;
mod picture;
mod stream;

use crate::camera::{Bounds, Camera, Edges, StandardView};
use crate::display::Display;
use crate::fade::Fader;
use crate::gpu::context::{BROWSER_BACKEND, Gpu};
use crate::gpu::target::view_of;
use crate::options::RenderOptions;
use crate::pick::{Hit, Scope, nearest};
use crate::renderer::{IMAGE_FORMAT, Renderer};
use js_sys::{Object, Promise, Reflect};
use kilwa_pack::footer::Footer;
use kilwa_pack::{GpuChunk, HEADER_BYTES, Metadata, PackError, ScalarChannel, parse_head};
use kilwa_stream::{Budgets, DrawPatch, Event, Pace, Streamer, View};
use loss::Loss;
use std::collections::BTreeMap;
use std::sync::Arc;
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
    // The header ends with its hash, which covers the metadata's: it identifies the pack before the end of the file has arrived.
    let hash =
        bytes.get(HEADER_BYTES - 32..HEADER_BYTES - 16).and_then(|b| b.try_into().ok()).map_or(0, u128::from_be_bytes);
    let info = serde_json::json!({
        "metadata": metadata,
        "pack": {
            "hash": format!("{hash:032x}"),
            "bytes": h.file_bytes,
            "entries": h.entry_count,
            "triangles": h.triangles,
            "storedTriangles": h.stored_triangles,
            "colors": h.attributes.colors,
            "scalars": h.attributes.scalars,
            "points": h.is_of_points(),
            "lattice": h.lattice,
        },
    });
    Ok(info.to_string())
}

/// What a pack is called (FORMAT section 7), from its last bytes and its first.
///
/// # Errors
/// When they are no footer, or one of another file.
#[wasm_bindgen(js_name = packIdentity)]
pub fn pack_identity(head: &[u8], footer: &[u8]) -> Result<String, JsError> {
    let footer = Footer::parse(footer).map_err(|e| JsError::new(&e.to_string()))?;
    if head.get(HEADER_BYTES - 32..HEADER_BYTES) != Some(&footer.header_hash[..]) {
        return Err(JsError::new("the end of the file belongs to another file than its beginning"));
    }
    Ok(footer.identity())
}

/// One open pack on one canvas.
#[wasm_bindgen]
pub struct Viewer {
    gpu: Gpu,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    lost: Arc<Loss>,
    renderer: Renderer,
    streamer: Streamer,
    decoded: BTreeMap<u32, GpuChunk>,
    events: Vec<Event>,
    bounds: Bounds,
    /// Of the picture, under the page's tools.
    covered: Edges,
    camera: Camera,
    display: Display,
    /// The theme that the background `auto` follows.
    dark: bool,
    pixel_ratio: f64,
    channels: Vec<ScalarChannel>,
    /// Number of the channel by which triangles are hidden.
    hidden_by: Option<usize>,
    options: RenderOptions,
    /// The system asks for little motion.
    reduced_motion: bool,
    fader: Fader,
    /// Size of the picture that is loaded for instead of the canvas.
    picture: Option<[u32; 2]>,
    target_pixels: f64,
    pace: Pace,
    /// The pixel error that the last frame refined to.
    paced: f64,
    /// Frames are slow to come.
    is_slow: bool,
    /// When the last frame was drawn, milliseconds.
    frame_at: f64,
    draw: Arc<Vec<DrawPatch>>,
}

#[wasm_bindgen]
impl Viewer {
    /// Open the pack whose first bytes are `head` (enough of them: [`head_needs`]) on a canvas.
    ///
    /// # Errors
    /// An `Error`; its `kind` is `noGpu` where the browser gives no device.
    pub async fn create(canvas: HtmlCanvasElement, head: Vec<u8>) -> Result<Viewer, JsValue> {
        std::panic::set_hook(Box::new(|info| web_sys::console::error_1(&info.to_string().into())));
        let parsed = parse_head(&head).map_err(|e| JsError::new(&e.to_string()))?;
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = BROWSER_BACKEND;
        let instance = wgpu::Instance::new(descriptor);
        let size = [canvas.width().max(1), canvas.height().max(1)];
        let surface =
            instance.create_surface(wgpu::SurfaceTarget::Canvas(canvas)).map_err(|e| no_gpu(&e.to_string()))?;
        let gpu = Gpu::for_surface(&instance, &surface).await.map_err(|e| no_gpu(&e.to_string()))?;
        // The canvas's own format, whose values are encoded by the shader: a view of it with an sRGB format is not
        // honoured everywhere (Chromium on SwiftShader shows linear values). WebGL 2 would prefer an sRGB one, with
        // other colours along edges, where samples are averaged.
        let mut config = surface
            .get_default_config(&gpu.adapter, size[0], size[1])
            .ok_or_else(|| no_gpu("the adapter cannot draw to a canvas"))?;
        let plain = config.format.remove_srgb_suffix();
        if surface.get_capabilities(&gpu.adapter).formats.contains(&plain) {
            config.format = plain;
        }
        // A transparent background lets the page show through.
        let blended = wgpu::CompositeAlphaMode::PreMultiplied;
        if surface.get_capabilities(&gpu.adapter).alpha_modes.contains(&blended) {
            config.alpha_mode = blended;
        }
        let format = config.format;
        surface.configure(&gpu.device, &config);
        let lost = Arc::new(Loss::default());
        let flag = Arc::clone(&lost);
        gpu.device.set_device_lost_callback(move |_, _| flag.happened());
        let renderer = Renderer::new(gpu.device.clone(), gpu.queue.clone(), format, gpu.samples(IMAGE_FORMAT));
        let budgets = Budgets { uploads: stream::UPLOADS, ..Budgets::default() };
        let streamer = Streamer::new(&parsed, head.len() as u64, budgets);
        let bounds = bounds(&parsed.metadata);
        let mut viewer = Self {
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
            covered: Edges::default(),
            display: Display::default(),
            dark: false,
            pixel_ratio: 1.0,
            channels: parsed.metadata.scalars.clone(),
            hidden_by: None,
            options: RenderOptions::default(),
            reduced_motion: false,
            fader: Fader::default(),
            picture: None,
            target_pixels: 1.0,
            pace: Pace::new(1.0),
            paced: 1.0,
            is_slow: false,
            frame_at: 0.0,
            draw: Arc::default(),
        };
        viewer.apply_display();
        Ok(viewer)
    }

    /// Name and kind of the graphics adapter.
    pub fn adapter(&self) -> String {
        self.gpu.describe()
    }

    /// Resolves when the graphics device is lost: at rest no frame would show it.
    #[wasm_bindgen(js_name = whenLost)]
    pub fn when_lost(&self) -> Promise {
        let lost = Arc::clone(&self.lost);
        wasm_bindgen_futures::future_to_promise(async move {
            lost.wait().await;
            Ok(JsValue::UNDEFINED)
        })
    }

    /// The canvas has so many pixels now.
    pub fn resize(&mut self, width: u32, height: u32) {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        let before = self.size();
        (self.config.width, self.config.height) = (width.clamp(1, limit), height.clamp(1, limit));
        if before.iter().all(|x| *x > 1) {
            self.camera.resized(before, self.size());
        }
        self.surface.configure(&self.gpu.device, &self.config);
    }
}

impl Viewer {
    fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    fn view(&self) -> View {
        self.view_of_size(self.size())
    }

    fn hit(&self, x: f64, y: f64) -> Option<Hit> {
        let (origin, direction) = self.camera.ray([x, y], self.size());
        let lattice = &self.streamer.header().lattice;
        let origin = lattice.steps_from_world(origin);
        nearest(origin, direction, &self.draw, Scope::Seen, &self.options.clip, |chunk| {
            Some((self.decoded.get(&chunk)?, self.streamer.entry(chunk)?.bounds))
        })
    }

    /// The view that is loaded for: the picture's while one is made, else the canvas's.
    fn wanted_view(&self) -> View {
        match self.picture {
            Some(size) => self.view_of_size(size),
            None => self.view(),
        }
    }

    fn view_of_size(&self, size: [u32; 2]) -> View {
        let view = self.camera.view(&self.streamer.header().lattice, &self.bounds, size, self.target_pixels);
        View { clip: self.options.clip, ..view }
    }

    /// Draw the cut on the canvas; returns whether levels are fading, which takes more frames. A surface that is outdated is configured
    /// again and drawn with the next frame.
    fn present(&mut self, now_ms: f64) -> bool {
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.surface.configure(&self.gpu.device, &self.config);
                return false;
            }
            _ => return false,
        };
        let view = self.view();
        let target = view_of(&frame.texture);
        let fades = self.display.fade.unwrap_or(!self.reduced_motion && !self.is_slow) && self.picture.is_none();
        let is_fading = if fades {
            let faded = self.fader.step(now_ms, &self.draw, |chunk| self.renderer.has_chunk(chunk));
            self.renderer.draw_fading(&view, &faded.patches, &faded.shares, &self.options, &target);
            faded.is_fading
        } else {
            self.fader.cut_short();
            match self.picture {
                // What the picture does not show may be seen here.
                Some(_) => {
                    let all: Vec<_> = self.draw.iter().map(|p| DrawPatch { visible: true, ..*p }).collect();
                    self.renderer.draw(&view, &all, &self.options, &target);
                }
                None => self.renderer.draw(&view, &self.draw, &self.options, &target),
            }
            false
        };
        self.gpu.queue.present(frame);
        is_fading
    }
}

fn bounds(metadata: &Metadata) -> Bounds {
    Bounds { min: metadata.bounds_min, max: metadata.bounds_max }
}

/// The error of a browser that gives no device to draw with.
fn no_gpu(reason: &str) -> JsValue {
    let error = js_sys::Error::new(reason);
    match set(&error, "kind", &"noGpu".into()) {
        Ok(()) => error.into(),
        Err(e) => e,
    }
}

fn set(object: &Object, name: &str, value: &JsValue) -> Result<(), JsValue> {
    Reflect::set(object, &name.into(), value).map(drop)
}

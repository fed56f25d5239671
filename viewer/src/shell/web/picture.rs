//! Pictures read back from the viewer: what is on screen, and parts of larger ones and of drawings to scale.

use super::{Viewer, set};
use crate::camera::{Camera, StandardView};
use crate::gpu::readback::Readback;
use crate::gpu::target::{texture, view_of};
use crate::options::{Background, RenderOptions, Tile};
use crate::renderer::Image;
use glam::DVec3;
use js_sys::{Object, Promise, Uint8Array};
use kilwa_measure::sheet::Part;
use kilwa_stream::View;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

#[wasm_bindgen]
impl Viewer {
    /// A picture of the cut that is on screen, of the canvas's size, from an offscreen texture: resolves to
    /// `{ width, height, pixels }` with red, green, blue and alpha bytes, rows from the top. Levels never fade in it.
    #[wasm_bindgen(js_name = readPixels)]
    pub fn read_pixels(&mut self) -> Promise {
        let view = self.view();
        let options = self.options;
        self.read(&view, &options)
    }

    /// Look at a part of a drawing to scale, given its middle and half of its height in world metres. The page restores the camera when it is
    /// done. False where no view is called so.
    #[wasm_bindgen(js_name = aimSheet)]
    pub fn aim_sheet(&mut self, view: &str, x: f64, y: f64, z: f64, half_height: f64) -> bool {
        let Some(view) = StandardView::from_name(view) else { return false };
        self.camera = Camera::of_part(view, &self.bounds, &Part { target: DVec3::new(x, y, z), half_height });
        true
    }

    /// Load for a picture of this size from now on, of the same camera: as high as the canvas shows, wider or narrower with its shape.
    /// When the streamer has settled, [`Viewer::render_tile`] draws it. Zeros: load for the canvas again.
    #[wasm_bindgen(js_name = setPicture)]
    pub fn set_picture(&mut self, width: u32, height: u32) {
        self.picture = (width > 0 && height > 0).then_some([width, height]);
    }

    /// A part of a picture of `full_width` times `full_height` pixels, which may be larger than any canvas: `width` times `height` pixels from `x`, `y`
    /// (left, top), at most what [`Viewer::max_tile`] says. Resolves as [`Viewer::read_pixels`] does; where the background is
    /// transparent, colours are not multiplied by alpha. Lines and radii grow with the picture.
    #[wasm_bindgen(js_name = renderTile)]
    pub fn render_tile(
        &mut self,
        full_width: u32,
        full_height: u32,
        x: u32,
        y: u32,
        width: u32,
        height: u32,
    ) -> Promise {
        let full = [full_width.max(1), full_height.max(1)];
        let limit = self.max_tile();
        let tile = Tile { offset: [x, y], size: [width.clamp(1, limit), height.clamp(1, limit)] };
        let larger = f64::from(full[1]) / f64::from(self.config.height.max(1));
        let options = RenderOptions { tile: Some(tile), ..self.display_options(self.pixel_ratio * larger) };
        self.read(&self.view_of_size(full), &options)
    }

    /// Pixels of the longest side that a tile can have.
    #[wasm_bindgen(js_name = maxTile)]
    pub fn max_tile(&self) -> u32 {
        // A tile has up to 32 pixels more round it where a mode looks at the neighbourhood.
        self.gpu.device.limits().max_texture_dimension_2d.saturating_sub(64).clamp(1, 2048)
    }
}

impl Viewer {
    fn read(&mut self, view: &View, options: &RenderOptions) -> Promise {
        let size = options.tile.map_or(view.size, |t| t.size);
        let format = self.config.format;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let device = self.gpu.device.clone();
        let target = texture(&device, "pixels", size, 1, format, usage);
        self.renderer.draw(view, &self.draw, options, &view_of(&target));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let readback = Readback::record(&device, &mut encoder, &target, 4);
        self.gpu.queue.submit([encoder.finish()]);
        let is_bgra = matches!(format, wgpu::TextureFormat::Bgra8UnormSrgb | wgpu::TextureFormat::Bgra8Unorm);
        let is_transparent = options.background == Background::Transparent;
        wasm_bindgen_futures::future_to_promise(async move {
            let mut pixels = readback.bytes(&device).await.map_err(|e| JsError::new(&e.to_string()))?;
            if is_bgra {
                pixels.chunks_exact_mut(4).for_each(|p| p.swap(0, 2));
            }
            if is_transparent {
                pixels = Image { size, pixels }.with_straight_alpha(format.is_srgb()).pixels;
            }
            let answer = Object::new();
            set(&answer, "width", &size[0].into())?;
            set(&answer, "height", &size[1].into())?;
            set(&answer, "pixels", &Uint8Array::from(pixels.as_slice()))?;
            Ok(answer.into())
        })
    }
}

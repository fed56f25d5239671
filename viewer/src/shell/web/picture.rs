//! Pictures read back from the viewer.

use super::{Viewer, set};
use crate::gpu::readback::Readback;
use crate::gpu::target::{texture, view_of};
use js_sys::{Object, Promise, Uint8Array};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

#[wasm_bindgen]
impl Viewer {
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

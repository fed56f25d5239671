//! A headset (WebXR): the page asks once per frame what its eyes need and then draws them one after the other. Only in the program for WebGL 2, because
//! browsers show nothing else in headsets (`www/headset/`).
//!
//! An eye is described by the numbers of [`Eye::from_numbers`]: `position` (x, y, z in world metres), `right` and `up` of its picture, the tangents
//! of its left, right, lower and upper edge, width and height in pixels.

use super::{Viewer, set};
use crate::eyes::{Eye, NUMBERS, view_of_all};
use crate::gpu::target::view_of;
use crate::options::{Background, RenderOptions};
use crate::pick::{Scope, nearest};
use crate::walk;
use glam::{DVec2, DVec3};
use js_sys::{Array, Object};
use kilwa_stream::View;
use wasm_bindgen::prelude::{JsError, JsValue, wasm_bindgen};

#[wasm_bindgen]
impl Viewer {
    /// Decide what the eyes show, without drawing. Returns `{ commands, stats }` as [`Viewer::frame`] does.
    ///
    /// # Errors
    /// When the numbers do not describe eyes, or one looks too far aside.
    #[wasm_bindgen(js_name = frameOfEyes)]
    pub fn frame_of_eyes(&mut self, now_ms: f64, eyes: &[f64]) -> Result<JsValue, JsValue> {
        let mut view = self.view_of_eyes(eyes)?;
        self.paced = self.pace.frame(now_ms, &view);
        view.target_pixels = self.paced;
        self.set_uploads(now_ms);
        let step = self.streamer.step(&view, now_ms, std::mem::take(&mut self.events));
        let commands = self.carry_out(&step)?;
        let stats = self.stats_object(&step)?;
        // A picture that is coarser because it moves becomes fine by itself.
        let is_hurried = self.pace.factor() > 1.0 && !self.pace.is_at_rest();
        set(&stats, "more", &(is_hurried || !step.commands.is_empty()).into())?;
        self.draw = step.draw;
        let answer = Object::new();
        set(&answer, "commands", &commands)?;
        set(&answer, "stats", &stats)?;
        Ok(answer.into())
    }

    /// As [`Viewer::attend`], for these eyes.
    ///
    /// # Errors
    /// As [`Viewer::frame_of_eyes`].
    #[wasm_bindgen(js_name = attendEyes)]
    pub fn attend_eyes(&mut self, now_ms: f64, eyes: &[f64]) -> Result<Array, JsValue> {
        let view = View { target_pixels: self.paced, ..self.view_of_eyes(eyes)? };
        let step = self.streamer.attend(&view, now_ms, std::mem::take(&mut self.events));
        let commands = self.carry_out(&step)?;
        self.draw = step.draw;
        Ok(commands)
    }

    /// Draw what one eye sees of the last frame into the upper left corner of the canvas. Levels do not fade. False where the canvas cannot be drawn to
    /// now.
    ///
    /// # Errors
    /// When the numbers do not describe an eye.
    #[wasm_bindgen(js_name = drawEye)]
    pub fn draw_eye(&mut self, eye: &[f64]) -> Result<bool, JsError> {
        let eye =
            Eye::from_numbers(eye).ok_or_else(|| JsError::new("the numbers do not describe an eye of a headset"))?;
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.surface.configure(&self.gpu.device, &self.config);
                return Ok(false);
            }
            _ => return Ok(false),
        };
        // Behind the model there is one colour: a gradient would turn with the head. The room shows through nothing.
        let background = match self.options.background {
            Background::Gradient(top, _) => Background::Flat(top),
            Background::Transparent => Background::Flat([0; 3]),
            flat @ Background::Flat(_) => flat,
        };
        let options = RenderOptions { background, frustum: Some(eye.frustum), ..self.options };
        let view = View { clip: options.clip, ..eye.view(&self.streamer.header().lattice, self.paced) };
        self.renderer.draw(&view, &self.draw, &options, &view_of(&frame.texture));
        self.gpu.queue.present(frame);
        Ok(true)
    }

    /// Where a ray (origin and direction, six numbers) first meets what is drawn: x, y, z, the certified error there and the distance, metres; empty
    /// where it meets nothing.
    #[wasm_bindgen(js_name = meet)]
    pub fn meet(&self, ray: &[f64]) -> Vec<f64> {
        let &[x, y, z, u, v, w] = ray else { return Vec::new() };
        let Some(way) = DVec3::new(u, v, w).try_normalize() else { return Vec::new() };
        let lattice = &self.streamer.header().lattice;
        let origin = lattice.steps_from_world(DVec3::new(x, y, z));
        let hit = nearest(origin, way, &self.draw, Scope::Whole, &self.options.clip, |chunk| {
            Some((self.decoded.get(&chunk)?, self.streamer.entry(chunk)?.bounds))
        });
        hit.map_or_else(Vec::new, |hit| {
            let DVec3 { x, y, z } = lattice.world_from_steps(hit.point);
            vec![x, y, z, f64::from(hit.error), hit.along * lattice.step()]
        })
    }

    /// Where an eye comes to be that walks from a place by `east` and `north` metres within `seconds`, `height` metres above the ground: x, y, z.
    #[wasm_bindgen(js_name = stepFrom)]
    #[expect(clippy::too_many_arguments, reason = "plain numbers cross to JavaScript cheaply")]
    pub fn step_from(&self, x: f64, y: f64, z: f64, east: f64, north: f64, seconds: f64, height: f64) -> Vec<f64> {
        let eye = DVec3::new(x, y, z);
        if ![x, y, z, east, north, seconds, height].iter().all(|v| v.is_finite()) || height <= 0.0 {
            return eye.to_array().to_vec();
        }
        let across = DVec2::new(east, north);
        walk::step(eye, across, seconds, height, |from, way| self.cast(from, way)).to_array().to_vec()
    }
}

impl Viewer {
    fn view_of_eyes(&self, eyes: &[f64]) -> Result<View, JsError> {
        let eyes: Option<Vec<Eye>> = eyes.chunks(NUMBERS).map(Eye::from_numbers).collect();
        let lattice = &self.streamer.header().lattice;
        let view = eyes.and_then(|eyes| view_of_all(&eyes, lattice, self.target_pixels));
        let view = view.ok_or_else(|| JsError::new("the numbers do not describe the eyes of a headset"))?;
        Ok(View { clip: self.options.clip, ..view })
    }
}

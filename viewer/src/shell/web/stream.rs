//! The viewer's streaming: budgets, what JavaScript reports, and the frame that decides and draws.

use super::{Viewer, set};
use crate::filled::hide;
use js_sys::{Array, Object, Uint8Array};
use kilwa_pack::{GpuChunk, PatchRange};
use kilwa_stream::{Budgets, Command, Event, FetchKind, Stats, Step};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

/// Chunks uploaded in a frame of a sixtieth of a second: sixteen are about a megabyte, which no frame feels.
pub(super) const UPLOADS: usize = 16;
/// Bytes of a request of several ranges: few enough that what the camera asks for next is not long behind it. Measured in docs/bench/2026-11-22-decisions.md, section 25.
const SEVERAL_BYTES: u64 = 128 << 10;

#[wasm_bindgen]
impl Viewer {
    /// GPU memory and main memory for chunks, in bytes.
    #[wasm_bindgen(js_name = setMemory)]
    pub fn set_memory(&mut self, gpu_bytes: f64, cpu_bytes: f64) {
        let budgets = Budgets { gpu_bytes: gpu_bytes as u64, cpu_bytes: cpu_bytes as u64, ..*self.streamer.budgets() };
        self.streamer.set_budgets(budgets);
    }

    /// The file has only so many bytes, fewer than its header states.
    #[wasm_bindgen(js_name = setCutOff)]
    pub fn set_cut_off(&mut self, file_bytes: f64) {
        self.streamer.set_cut_off(file_bytes as u64);
    }

    /// How many ranges one request may ask for.
    #[wasm_bindgen(js_name = setRanges)]
    pub fn set_ranges(&mut self, ranges: usize) {
        let request_bytes = if ranges > 1 { SEVERAL_BYTES } else { Budgets::default().request_bytes };
        self.streamer.set_budgets(Budgets { ranges: ranges.max(1), request_bytes, ..*self.streamer.budgets() });
    }

    /// The pixel error to refine to.
    #[wasm_bindgen(js_name = setTargetPixels)]
    pub fn set_target_pixels(&mut self, pixels: f64) {
        self.target_pixels = if pixels.is_finite() { pixels.clamp(0.1, 100.0) } else { 1.0 };
        self.pace.set_target(self.target_pixels);
    }

    /// So many bytes of the answer of a chunk request are there, from its beginning.
    #[wasm_bindgen(js_name = onProgress)]
    pub fn on_progress(&mut self, request: f64, length: f64) {
        let (request, length) = (request as u64, length as u64);
        // Several parts of one answer between two frames are one.
        match self.events.last_mut() {
            Some(Event::Progress { request: last, length: so_far }) if *last == request => *so_far = length,
            _ => self.events.push(Event::Progress { request, length }),
        }
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

    /// A worker decoded a chunk. `patches`: first triangle, number of triangles, diamond; three numbers each. `scalars`: one
    /// channel behind the other.
    #[wasm_bindgen(js_name = onDecoded)]
    pub fn on_decoded(&mut self, chunk: u32, vertices: Vec<u8>, indices: Vec<u32>, patches: &[u32], scalars: Vec<f32>) {
        let patches: Vec<PatchRange> =
            patches.chunks_exact(3).map(|p| PatchRange { first: p[0], count: p[1], diamond: p[2] }).collect();
        let decoded = GpuChunk {
            vertex_count: (vertices.len() / kilwa_pack::vertex_layout::VERTEX_BYTES) as u32,
            triangle_count: (indices.len() / 3) as u32,
            vertices,
            indices,
            patches: patches.clone(),
            scalars,
        };
        self.decoded.insert(chunk, decoded);
        self.events.push(Event::Decoded { chunk, patches });
    }

    /// A worker refused a chunk.
    #[wasm_bindgen(js_name = onDecodeFailed)]
    pub fn on_decode_failed(&mut self, chunk: u32) {
        self.events.push(Event::DecodeFailed { chunk });
    }

    /// Decide without drawing, for the time in which the browser asks for no frame: what came is decoded, and what that leads to is asked
    /// for. Returns commands as [`Viewer::frame`] does.
    ///
    /// # Errors
    /// As [`Viewer::frame`].
    pub fn attend(&mut self, now_ms: f64) -> Result<Array, JsValue> {
        let mut view = self.wanted_view();
        if self.picture.is_none() {
            view.target_pixels = self.paced;
        }
        let step = self.streamer.attend(&view, now_ms, std::mem::take(&mut self.events));
        let commands = self.carry_out(&step)?;
        self.draw = step.draw;
        Ok(commands)
    }

    /// Decide and draw. `is_slow` where the browser takes long to give a frame: then levels do not fade into each other, for a fade of
    /// two pictures is none. Returns `{ commands, stats }`; see `www/session.js`.
    ///
    /// # Errors
    /// When JavaScript refuses an object, which does not happen.
    pub fn frame(&mut self, now_ms: f64, is_slow: bool) -> Result<JsValue, JsValue> {
        self.is_slow = is_slow;
        let mut view = self.wanted_view();
        // A picture is loaded for at its own error; that the camera rests meanwhile is noticed all the same.
        let paced = self.pace.frame(now_ms, &self.view());
        if self.picture.is_none() {
            view.target_pixels = paced;
        }
        self.paced = paced;
        self.set_uploads(now_ms);
        let step = self.streamer.step(&view, now_ms, std::mem::take(&mut self.events));
        let commands = self.carry_out(&step)?;
        let stats = self.stats_object(&step)?;
        self.draw = step.draw;
        let is_fading = self.present(now_ms);
        // A picture that is coarser because it moves becomes fine by itself.
        let is_hurried = self.pace.factor() > 1.0 && !self.pace.is_at_rest();
        set(&stats, "more", &(is_fading || is_hurried || !step.commands.is_empty()).into())?;
        let answer = Object::new();
        set(&answer, "commands", &commands)?;
        set(&answer, "stats", &stats)?;
        Ok(answer.into())
    }
}

impl Viewer {
    /// Where a frame takes long for other reasons, more uploads in it are not felt, and the model is there sooner.
    #[inline]
    pub(super) fn set_uploads(&mut self, now_ms: f64) {
        let since = (now_ms - self.frame_at).clamp(1000.0 / 60.0, 8000.0 / 60.0);
        self.frame_at = now_ms;
        self.streamer.set_uploads((UPLOADS as f64 * since * 60.0 / 1000.0) as usize);
    }

    /// Uploads and evictions of a step are carried out, the rest is returned for JavaScript.
    pub(super) fn carry_out(&mut self, step: &Step) -> Result<Array, JsValue> {
        let commands = Array::new();
        for command in &step.commands {
            match command {
                Command::Upload { chunk } => {
                    if let Some(decoded) = self.decoded.get_mut(chunk) {
                        hide(decoded, self.hidden_by);
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
        Ok(commands)
    }

    pub(super) fn stats_object(&self, step: &Step) -> Result<Object, JsValue> {
        let s: &Stats = &step.stats;
        let o = Object::new();
        for (name, value) in [
            ("entriesKnown", f64::from(s.entries_known)),
            ("chunksWanted", f64::from(s.chunks_wanted)),
            ("chunksMissing", f64::from(s.chunks_missing)),
            ("chunksResident", f64::from(s.chunks_resident)),
            ("chunksInFlight", f64::from(s.chunks_in_flight)),
            ("chunksShown", f64::from(s.chunks_shown)),
            ("pagesMissing", f64::from(s.pages_missing)),
            ("bytesInFlight", s.bytes_in_flight as f64),
            ("bytesShown", s.bytes_shown as f64),
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
            ("pixelsWhileMoving", self.target_pixels * self.pace.factor()),
            ("frameMs", self.pace.frame_ms()),
        ] {
            set(&o, name, &value.into())?;
        }
        for (name, value) in [
            ("targetReached", s.worst_pixel_error <= self.target_pixels),
            ("budgetLimited", s.budget_limited),
            ("cutOff", s.cut_off),
            ("settled", s.settled),
            ("lost", self.lost.has_happened()),
        ] {
            set(&o, name, &value.into())?;
        }
        Ok(o)
    }
}

fn command_object(command: &Command) -> Result<JsValue, JsValue> {
    let o = Object::new();
    let number = |name: &str, value: f64| set(&o, name, &value.into());
    match command {
        Command::Fetch { request, ranges, kind } => {
            let parts = Array::new();
            for range in ranges {
                parts.push(&(range.start as f64).into());
                parts.push(&((range.end - range.start) as f64).into());
            }
            set(&o, "type", &"fetch".into())?;
            number("request", *request as f64)?;
            set(&o, "parts", &parts)?;
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

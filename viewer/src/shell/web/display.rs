//! How the viewer shows the model: one state in JSON ([`Display`]), its legend, and shortcuts for single settings.

use super::Viewer;
use crate::colormap::{NO_VALUE, VIRIDIS};
use crate::display::{Display, Plane};
use crate::filled::hide;
use crate::gpu::frame::ERROR_SCALE;
use crate::gpu::pool::ShownScalar;
use crate::options::{Mode, RenderOptions};
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

#[wasm_bindgen]
impl Viewer {
    /// How the model is shown: mode, light, scale, background, cut. JSON that leaves out what is as usual (`{}`), for links.
    #[wasm_bindgen(js_name = displayState)]
    pub fn display_state(&self) -> String {
        self.display.to_json()
    }

    /// Take a state that [`Viewer::display_state`] gave, or a part of one: what is left out is as usual.
    ///
    /// # Errors
    /// A sentence that names the field; nothing changes then.
    #[wasm_bindgen(js_name = setDisplayState)]
    pub fn set_display_state(&mut self, json: &str) -> Result<(), JsError> {
        self.display = Display::from_json(json).map_err(|e| JsError::new(&e.to_string()))?;
        self.apply_display();
        Ok(())
    }

    /// Shading by name; false when there is none of that name.
    #[wasm_bindgen(js_name = setMode)]
    pub fn set_mode(&mut self, name: &str) -> bool {
        let mode = Mode::from_name(name);
        if let Some(mode) = mode {
            mode.name().clone_into(&mut self.display.mode);
            self.apply_display();
        }
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
        self.display.mode().name().to_owned()
    }

    /// The dark or the light theme: what the background `auto` follows.
    #[wasm_bindgen(js_name = setDark)]
    pub fn set_dark(&mut self, dark: bool) {
        self.dark = dark;
        self.apply_display();
    }

    /// Pixels of the picture per CSS pixel: widths of lines and radii are in CSS pixels.
    #[wasm_bindgen(js_name = setPixelRatio)]
    pub fn set_pixel_ratio(&mut self, ratio: f64) {
        self.pixel_ratio = if ratio.is_finite() { ratio.clamp(0.25, 8.0) } else { 1.0 };
        self.apply_display();
    }

    /// The system asks for little motion: levels do not fade unless the state says so.
    #[wasm_bindgen(js_name = setReducedMotion)]
    pub fn set_reduced_motion(&mut self, reduced: bool) {
        self.reduced_motion = reduced;
    }

    /// What the colours mean and what the settings in force are, as JSON: `stops` (sRGB), `low`, `high`, `unit` (`m` or empty), `channel`
    /// (name, where a scalar is shown), `noValue`; `plane` that distances count from; `feature` in metres; `channels` (name, min, max).
    pub fn legend(&self) -> String {
        let mode = self.display.mode();
        let channel = self.channel();
        let [low, high] = match (mode, &channel) {
            (Mode::Scalar, Some((_, c))) => self.display.channel_range.unwrap_or([f64::from(c.min), f64::from(c.max)]),
            _ => self.display.scale_range(&self.bounds),
        };
        let Plane { normal, point } = self.display.scale_plane(&self.bounds);
        serde_json::json!({
            "scale": mode.has_scale() && (mode != Mode::Scalar || channel.is_some()),
            "stops": VIRIDIS,
            "noValue": NO_VALUE,
            "low": low,
            "high": high,
            "unit": if mode == Mode::Scalar { "" } else { "m" },
            "channel": channel.filter(|_| mode == Mode::Scalar).map(|(_, c)| c.name.clone()),
            "channels": self.channels,
            "plane": { "normal": normal, "point": point },
            "feature": self.display.feature_size(&self.bounds),
        })
        .to_string()
    }

    /// The model's box: smallest corner, largest corner, metres.
    pub fn bounds(&self) -> Vec<f64> {
        [self.bounds.min, self.bounds.max].map(|p| p.to_array()).concat()
    }
}

impl Viewer {
    fn channel(&self) -> Option<(usize, &kilwa_pack::ScalarChannel)> {
        let names: Vec<&str> = self.channels.iter().map(|c| c.name.as_str()).collect();
        let index = self.display.channel_index(&names)?;
        Some((index, self.channels.get(index)?))
    }

    /// What the display says, for a picture with so many pixels per CSS pixel.
    pub(super) fn display_options(&self, pixel_ratio: f64) -> RenderOptions {
        let range = self.channel().map(|(_, c)| [f64::from(c.min), f64::from(c.max)]);
        let lattice = self.streamer.header().lattice;
        self.display.options(&lattice, &self.bounds, self.dark, pixel_ratio, range)
    }

    /// Tell the renderer what the display says now.
    pub(super) fn apply_display(&mut self) {
        let scalar = self.channel().map(|(channel, c)| ShownScalar { channel, min: c.min, max: c.max });
        let hidden_by = self.display.hidden_by(&self.channels);
        if self.hidden_by != hidden_by {
            self.hidden_by = hidden_by;
            for (index, chunk) in &mut self.decoded {
                hide(chunk, hidden_by);
                self.renderer.renew(*index, chunk);
            }
        }
        self.options = self.display_options(self.pixel_ratio);
        if self.renderer.set_scalar(scalar.filter(|_| self.options.mode == Mode::Scalar)) {
            for (index, chunk) in &self.decoded {
                self.renderer.upload_scalars(*index, chunk);
            }
        }
    }
}

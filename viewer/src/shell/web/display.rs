//! How the viewer shows the model: shading, background.

use super::Viewer;
use crate::gpu::frame::ERROR_SCALE;
use crate::options::{Background, Mode};
use wasm_bindgen::prelude::wasm_bindgen;

#[wasm_bindgen]
impl Viewer {
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
}

//! Drawings to scale from the page: the camera of each part. What stands on the sheet is computed by the module that measures; JavaScript draws part by
//! part (`www/sheet.js`).

use super::Viewer;
use crate::camera::StandardView;
use glam::DVec3;
use kilwa_measure::sheet::Part;
use wasm_bindgen::prelude::wasm_bindgen;

#[wasm_bindgen]
impl Viewer {
    /// Look at a part of a drawing: its middle, world metres, and half of what it shows upwards. The page gives the camera back when it is
    /// done. False where no view is called so.
    #[wasm_bindgen(js_name = aimSheet)]
    pub fn aim_sheet(&mut self, view: &str, x: f64, y: f64, z: f64, half_height: f64) -> bool {
        let Some(view) = StandardView::from_name(view) else { return false };
        self.camera = crate::sheet::camera(view, &self.bounds, &Part { target: DVec3::new(x, y, z), half_height });
        true
    }
}

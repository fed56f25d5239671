//! The camera as JavaScript has it: an object with the fields that `www/kilwa-viewer.d.ts` declares.

use super::{Viewer, set};
use crate::camera::Camera;
use glam::DVec3;
use js_sys::{Array, Object, Reflect};
use wasm_bindgen::prelude::{JsValue, wasm_bindgen};

#[wasm_bindgen(typescript_custom_section)]
const DECLARATION: &str = r"
/** Where the viewer looks from. Angles are radians, lengths metres. */
export interface Camera {
  azimuth: number;
  elevation: number;
  distance: number;
  target: [x: number, y: number, z: number];
  orthographic: boolean;
  roll: number;
  fieldOfView: number;
}
";

#[wasm_bindgen]
impl Viewer {
    /// The camera.
    ///
    /// # Errors
    /// Never, as long as JavaScript lets new objects have fields.
    #[wasm_bindgen(unchecked_return_type = "Camera")]
    pub fn camera(&self) -> Result<JsValue, JsValue> {
        let Camera { azimuth, elevation, distance, target, orthographic, roll, field_of_view } = self.camera;
        let object = Object::new();
        let numbers = [("azimuth", azimuth), ("elevation", elevation), ("distance", distance), ("roll", roll)];
        for (name, value) in numbers {
            set(&object, name, &value.into())?;
        }
        set(&object, "fieldOfView", &field_of_view.into())?;
        set(&object, "orthographic", &orthographic.into())?;
        set(&object, "target", &target.to_array().map(JsValue::from).into_iter().collect::<Array>())?;
        Ok(object.into())
    }

    /// Take a camera that [`Viewer::camera`] could have returned; false, and nothing changes, where a field is missing, no number or out of range.
    #[wasm_bindgen(js_name = setCamera)]
    pub fn set_camera(&mut self, #[wasm_bindgen(unchecked_param_type = "Camera")] camera: &JsValue) -> bool {
        let Some(given) = read(camera) else { return false };
        self.camera.azimuth = 0.0;
        self.camera.elevation = 0.0;
        self.camera.orbit(given.azimuth, given.elevation);
        self.camera.target = given.target;
        self.camera.orthographic = given.orthographic;
        self.camera.distance = given.distance;
        self.camera.roll = given.roll;
        self.camera.field_of_view = given.field_of_view;
        // Brings the distance into its range.
        self.camera.zoom(1.0, self.camera.target, &self.bounds);
        true
    }
}

/// The fields of a camera, before they are brought into their ranges.
struct Given {
    azimuth: f64,
    elevation: f64,
    distance: f64,
    target: DVec3,
    orthographic: bool,
    roll: f64,
    field_of_view: f64,
}

fn read(camera: &JsValue) -> Option<Given> {
    let number = |object: &JsValue, name: &JsValue| Reflect::get(object, name).ok()?.as_f64().filter(|v| v.is_finite());
    let field = |name: &str| number(camera, &name.into());
    let target = Reflect::get(camera, &"target".into()).ok()?;
    let given = Given {
        azimuth: field("azimuth")?,
        elevation: field("elevation")?,
        distance: field("distance")?,
        target: DVec3::new(number(&target, &0.into())?, number(&target, &1.into())?, number(&target, &2.into())?),
        orthographic: Reflect::get(camera, &"orthographic".into()).ok()?.is_truthy(),
        roll: field("roll")?,
        field_of_view: field("fieldOfView")?,
    };
    let is_sane = given.distance > 0.0 && (0.01..=2.8).contains(&given.field_of_view);
    is_sane.then_some(given)
}

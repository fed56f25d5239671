//! Where the viewer looks from: camera, standard views, what is under a pixel.

use super::Viewer;
use crate::camera::{Camera, StandardView};
use wasm_bindgen::prelude::wasm_bindgen;

#[wasm_bindgen]
impl Viewer {
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
}

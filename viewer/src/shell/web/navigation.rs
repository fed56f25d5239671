//! Where the viewer looks from: camera, standard views, what is under a pixel.

use super::Viewer;
use crate::camera::{Camera, Edges, StandardView};
use crate::pick::{Scope, interval, nearest};
use crate::section::Clip;
use crate::walk;
use glam::{DVec2, DVec3};
use kilwa_measure::Ray;
use kilwa_measure::interval::Provisional;
use kilwa_pack::{GpuChunk, NO_DIAMOND};
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

    /// Turn about the picture's own axes, without poles: `across` moves the eye to the left, `upward` up, `twist` leans the
    /// picture. Radians.
    #[wasm_bindgen(js_name = turnFree)]
    pub fn turn_free(&mut self, across: f64, upward: f64, twist: f64) {
        if across.is_finite() && upward.is_finite() && twist.is_finite() {
            self.camera.turn_free(across, upward, twist);
        }
    }

    /// Look around from the place of the eye; radians as for `orbit`.
    pub fn look(&mut self, azimuth: f64, elevation: f64) {
        if azimuth.is_finite() && elevation.is_finite() {
            self.camera.look(azimuth, elevation);
        }
    }

    /// Walk some metres forward and to the right over the surface within `seconds`, the eye `height` metres above it;
    /// false where nothing moved.
    pub fn walk(&mut self, forward: f64, right: f64, seconds: f64, height: f64) -> bool {
        if ![forward, right, seconds, height].iter().all(|v| v.is_finite()) || height <= 0.0 {
            return false;
        }
        let (sin, cos) = libm::sincos(self.camera.azimuth);
        let across = DVec2::new(-sin * forward - cos * right, -cos * forward + sin * right);
        let eye = self.camera.eye();
        let there = walk::step(eye, across, seconds, height, |from, way| self.cast(from, way));
        // Movements too small to be seen are skipped, so that the picture is still while the person stands still.
        let moved = (there - eye).abs().max_element() > height * 1e-4;
        if moved {
            self.camera.place_eye(there);
        }
        moved
    }

    /// Height of the surface below a place, metres; not a number if there is none.
    #[wasm_bindgen(js_name = groundBelow)]
    pub fn ground_below(&self, x: f64, y: f64, z: f64) -> f64 {
        walk::ground(DVec3::new(x, y, z), |from, way| self.cast(from, way)).unwrap_or(f64::NAN)
    }

    /// The eye, x, y, z in metres.
    pub fn eye(&self) -> Vec<f64> {
        self.camera.eye().to_array().to_vec()
    }

    /// Pixels of places: for each x, y, z its pixel x, y and its depth in metres, not numbers where it is not before the eye.
    pub fn project(&self, places: &[f64]) -> Vec<f64> {
        let pixel = |p: &[f64]| self.camera.pixel(DVec3::from_slice(p), self.size());
        let nowhere = ([f64::NAN; 2], f64::NAN);
        places.chunks_exact(3).map(|p| pixel(p).unwrap_or(nowhere)).flat_map(|([x, y], depth)| [x, y, depth]).collect()
    }

    /// The ray through a pixel: its origin in world metres and a unit direction, six numbers. What is measured is what it meets on the
    /// finest surface, whatever is on screen.
    pub fn ray(&self, x: f64, y: f64) -> Vec<f64> {
        let (origin, direction) = self.camera.ray([x, y], self.size());
        [origin, direction].map(|v| v.to_array()).concat()
    }

    /// Whether the surface on screen is in front of a place. A place up to `slack` metres behind it counts as on it.
    #[wasm_bindgen(js_name = isHidden)]
    pub fn is_hidden(&self, x: f64, y: f64, z: f64, slack: f64) -> bool {
        let Some((pixel, _)) = self.camera.pixel(DVec3::new(x, y, z), self.size()) else { return true };
        let (origin, direction) = self.camera.ray(pixel, self.size());
        let Some(hit) = self.hit(pixel[0], pixel[1]) else { return false };
        let seen = self.streamer.header().lattice.world_from_steps(hit.point);
        (seen - origin).dot(direction) + slack < (DVec3::new(x, y, z) - origin).dot(direction)
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
            self.fit();
        }
        view.is_some()
    }

    /// Keep the direction and show all of the model.
    pub fn fit(&mut self) {
        self.camera.fit_beside(&self.bounds, self.size(), self.covered);
    }

    /// So many pixels at the edges of the picture lie under tools of the page: all of the model is shown beside them from now on.
    #[wasm_bindgen(js_name = setCovered)]
    pub fn set_covered(&mut self, left: f64, top: f64, right: f64, bottom: f64) {
        self.covered = Edges { left, top, right, bottom };
    }

    /// Metres that one pixel shows at the pivot.
    #[wasm_bindgen(js_name = metresPerPixel)]
    pub fn metres_per_pixel(&self) -> f64 {
        2.0 * self.camera.half_height() / f64::from(self.config.height.max(1))
    }

    /// Where a ray (origin and direction, world coordinates) can meet the finest surface, as far as drawn chunks show. JSON:
    /// `low` and `high` (metres along the ray from its origin, null where there are several stretches or none), `stretches` (their number),
    /// `local` and `world` (where the ray meets what is drawn; else the middle of the first stretch), `error` (certified, metres; half the
    /// stretch where nothing drawn is met). Empty where the ray passes everything that may be there.
    pub fn provisional(&self, ray: &[f64]) -> String {
        let &[x, y, z, u, v, w] = ray else { return String::new() };
        let lattice = &self.streamer.header().lattice;
        let ray = Ray { origin: lattice.steps_from_world(DVec3::new(x, y, z)), direction: DVec3::new(u, v, w) };
        let chunk = |chunk| Some((self.decoded.get(&chunk)?, self.streamer.entry(chunk)?.bounds));
        let clip = &self.options.clip;
        let (between, count) = match interval(&ray, &self.draw, clip, lattice.step(), chunk) {
            Provisional::Nothing => return String::new(),
            Provisional::Between { from, to } => (Some((from, to)), 1),
            Provisional::Several(all) => (None, all.len()),
        };
        let metres = ray.direction.length() * lattice.step();
        let hit = nearest(ray.origin, ray.direction, &self.draw, Scope::Whole, clip, chunk);
        let at = hit.map(|h| h.along).or(between.map(|(from, to)| f64::midpoint(from, to)));
        let error = hit.map(|h| f64::from(h.error)).or(between.map(|(from, to)| (to - from) * 0.5 * metres));
        let local = at.map(|at| ray.at(at) * lattice.step());
        let world = local.map(|p| p + lattice.origin);
        serde_json::json!({
            "low": between.map(|b| b.0 * metres),
            "high": between.map(|b| b.1 * metres),
            "stretches": count,
            "local": local,
            "world": world,
            "error": error,
        })
        .to_string()
    }

    /// Chunks that are here and hold nothing of the finest surface: what measures need not fetch them.
    pub fn leafless(&self) -> Vec<u32> {
        let is_leafless = |c: &GpuChunk| c.patches.iter().all(|p| p.diamond != NO_DIAMOND);
        self.decoded.iter().filter(|(_, c)| is_leafless(c)).map(|(i, _)| *i).collect()
    }

    /// What is under a pixel: x, y, z and the certified error there, metres; empty where there is nothing.
    pub fn pick(&self, x: f64, y: f64) -> Vec<f64> {
        let Some(hit) = self.hit(x, y) else { return Vec::new() };
        let DVec3 { x, y, z } = self.streamer.header().lattice.world_from_steps(hit.point);
        vec![x, y, z, f64::from(hit.error)]
    }
}

impl Viewer {
    /// Metres from a place along a unit vector to the nearest surface of the cut, also outside the picture.
    pub(super) fn cast(&self, from: DVec3, way: DVec3) -> Option<f64> {
        let lattice = &self.streamer.header().lattice;
        let origin = lattice.steps_from_world(from);
        let hit = nearest(origin, way, &self.draw, Scope::Whole, &Clip::default(), |chunk| {
            Some((self.decoded.get(&chunk)?, self.streamer.entry(chunk)?.bounds))
        })?;
        Some(hit.along * lattice.step())
    }
}

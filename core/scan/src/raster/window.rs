//! Perspective views that cover what a camera sees.

use crate::camera::{Camera, CubeFace};
use glam::{DMat3, DVec2, DVec3};

/// Cameras that see farther than this from their axis, radians, are covered by the faces of a cube.
const WIDE: f64 = 0.96;
/// Sample positions along each side of a picture, from which its field of view is found.
const SAMPLES: u32 = 33;
/// Windows extend beyond the samples by this share of their size.
const MARGIN: f64 = 0.02;

/// A perspective view without distortion. Pixels as in [`crate::camera`]: (0, 0) is the corner of the first pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The rotation from the axes of the camera to those of the window: x right, y down, z forward.
    pub window_from_camera: DMat3,
    /// Focal length, in pixels.
    pub focal: f64,
    /// Principal point, in pixels.
    pub center: DVec2,
    /// Width and height, pixels.
    pub size: [u32; 2],
}

impl Window {
    /// The pixel position of a point given in the axes of the window; None if it is not in front of the camera or not inside the picture.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        if point.z <= 0.0 {
            return None;
        }
        let pixel = self.center + point.truncate() * (self.focal / point.z);
        let [width, height] = self.size.map(f64::from);
        (pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < width && pixel.y < height).then_some(pixel)
    }

    /// The viewing direction at a pixel position, in the axes of the camera; its component along the axis of the window is 1.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        self.window_from_camera.transpose() * ((pixel - self.center) / self.focal).extend(1.0)
    }

    /// The tangents of the left, upper, right and lower edges.
    fn tangents(&self) -> [f64; 4] {
        let size = DVec2::new(self.size[0].into(), self.size[1].into());
        let (low, high) = (-self.center / self.focal, (size - self.center) / self.focal);
        [low.x, low.y, high.x, high.y]
    }

    /// Whether a sphere, with its centre in the axes of the camera, may reach into the view; always true if the sphere contains the camera.
    pub fn may_show(&self, center: DVec3, radius: f64) -> bool {
        let at = self.window_from_camera * center;
        let [left, top, right, bottom] = self.tangents();
        let planes = [
            DVec3::new(1.0, 0.0, -left),
            DVec3::new(-1.0, 0.0, right),
            DVec3::new(0.0, 1.0, -top),
            DVec3::new(0.0, -1.0, bottom),
        ];
        at.z > -radius && planes.iter().all(|plane| plane.dot(at) >= -radius * plane.length())
    }
}

/// The windows that cover what a camera sees, at `scale` times the resolution of the picture in each direction (0.5: a quarter as many pixels), but together not many more pixels
/// than `max_pixels`.
pub fn windows(camera: &Camera, scale: f64, max_pixels: u32) -> Vec<Window> {
    let rays = rays(camera);
    let widest = rays.iter().map(|ray| ray.z.clamp(-1.0, 1.0)).fold(1.0, f64::min);
    let frames: Vec<DMat3> = if widest > libm::cos(WIDE) {
        vec![DMat3::IDENTITY]
    } else {
        CubeFace::ALL.iter().map(|face| DMat3::from_quat(face.face_from_cube())).collect()
    };
    let is_wide = frames.len() > 1;
    let extents: Vec<(DMat3, [DVec2; 2])> =
        frames.into_iter().filter_map(|frame| Some((frame, extent(&rays, frame, is_wide)?))).collect();
    let area: f64 = extents.iter().map(|(_, [low, high])| (*high - *low).element_product()).sum();
    let wanted = camera.pixels_per_radian() * scale;
    let most = (f64::from(max_pixels.max(1)) / area.max(1e-12)).sqrt();
    let focal = wanted.min(most).max(1e-3);
    let window = |(window_from_camera, [low, high]): (DMat3, [DVec2; 2])| {
        let size = ((high - low) * focal).ceil().max(DVec2::ONE);
        let size = [size.x, size.y].map(|side| side.min(65_536.0) as u32);
        Window { window_from_camera, focal, center: -low * focal, size }
    };
    extents.into_iter().map(window).collect()
}

/// Unit directions seen at places all over the picture, edges included.
fn rays(camera: &Camera) -> Vec<DVec3> {
    let [width, height] = camera.size().map(f64::from);
    let share = |k: u32| f64::from(k) / f64::from(SAMPLES - 1);
    let places = (0..SAMPLES * SAMPLES).map(|k| (share(k % SAMPLES), share(k / SAMPLES)));
    places.filter_map(|(x, y)| camera.ray(DVec2::new(x * width, y * height))).collect()
}

/// The smallest and largest tangents that a view of these axes needs; None if it sees none of the directions. The view through a face of a cube does not extend beyond that face.
fn extent(rays: &[DVec3], frame: DMat3, is_face: bool) -> Option<[DVec2; 2]> {
    let start = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    let inside = rays.iter().map(|ray| frame * *ray).filter(|at| at.z > 0.3).map(|at| at.truncate() / at.z);
    // Directions just outside a face count, so that none is lost between samples.
    let near = inside.filter(|tangent| !is_face || tangent.abs().max_element() < 1.2);
    let [low, high] = near.fold(start, |[low, high], at| [low.min(at), high.max(at)]);
    if low.x > high.x {
        return None;
    }
    let margin = ((high - low) * MARGIN).max(DVec2::splat(1e-4));
    let [low, high] = [low - margin, high + margin];
    let limit = if is_face { 1.0 } else { f64::INFINITY };
    let [low, high] = [low, high].map(|corner| corner.clamp(DVec2::splat(-limit), DVec2::splat(limit)));
    (high.cmpgt(low).all()).then_some([low, high])
}

//! What a picture should show of a model: the values that were drawn into windows, resampled into the pixels of the picture.

use super::Grey;
use crate::camera::Camera;
use crate::raster::{Raster, Window};
use glam::{DVec2, DVec3};

/// What a model shows at a pixel: its brightness (linear light from its colours; NaN where it has none), its intensity (NaN where it has none), and its normal.
/// The normal need not have unit length.
pub type Shown = [f32; 5];

/// Added to brightness before its logarithm, as a share of the mean: noise in dark pixels has no meaning.
const DARK: f32 = 0.05;
/// Depths of neighbouring pixels of a window that differ by a larger share are not interpolated.
const JUMP: f32 = 0.02;

/// The expected picture at one resolution.
#[derive(Debug, Clone)]
pub(super) struct Prediction {
    /// Distance along the ray, metres; infinite where nothing is shown.
    pub(super) range: Vec<f32>,
    /// 1 where a surface is shown, 0 elsewhere.
    pub(super) surface: Grey,
    /// Details of what is shown, each with the root mean square below which it counts as constant.
    pub(super) channels: Vec<(Grey, f32)>,
}

/// Logarithms of a brightness.
pub(super) fn logarithm(picture: &Grey, known: Option<&Grey>) -> Grey {
    let (mut sum, mut count) = (0.0_f64, 0_u32);
    for (k, value) in picture.values().iter().enumerate() {
        if value.is_finite() && known.is_none_or(|known| known.values()[k] > 0.0) {
            sum += f64::from(value.max(0.0));
            count += 1;
        }
    }
    let floor = (DARK * (sum / f64::from(count.max(1))) as f32).max(1e-9);
    picture.map(|value| if value.is_finite() { libm::logf(value.max(0.0) + floor) } else { 0.0 })
}

impl Prediction {
    /// The picture of a camera, divided by `factor` in both directions, from what was drawn. `size`: that of the result, pixels.
    pub(super) fn new(camera: &Camera, factor: f64, size: [u32; 2], rasters: &[Raster<Shown>]) -> Self {
        let count = size[0] as usize * size[1] as usize;
        let mut range = vec![f32::INFINITY; count];
        let mut shown = vec![[f32::NAN; 5]; count];
        for (k, (range, shown)) in range.iter_mut().zip(&mut shown).enumerate() {
            let (x, y) = (k % size[0] as usize, k / size[0] as usize);
            let pixel = (DVec2::new(x as f64, y as f64) + 0.5) * factor;
            let Some(ray) = camera.ray(pixel) else { continue };
            if let Some((distance, value)) = rasters.iter().find_map(|raster| look(raster, ray)) {
                (*range, *shown) = (distance, value);
            }
        }
        let picture = |value: &dyn Fn(&Shown) -> f32| {
            Grey::from_fn(size, |x, y| value(&shown[y as usize * size[0] as usize + x as usize]))
        };
        let surface = Grey::from_fn(size, |x, y| f32::from(u8::from(range[(y * size[0] + x) as usize].is_finite())));
        let mut channels = Vec::new();
        for brightness in [0, 1] {
            let known = picture(&|shown| f32::from(u8::from(shown[brightness].is_finite())));
            let values = picture(&|shown| shown[brightness]);
            if known.values().iter().any(|known| *known > 0.0) {
                channels.push((logarithm(&values, Some(&known)).details(Some(&known)), 0.01));
            }
        }
        for axis in 0..3 {
            let values = picture(&|shown| unit(shown)[axis]);
            channels.push((values.details(Some(&surface)), 0.02));
        }
        // Borders of the surface before the sky, and of near surface before far surface.
        channels.push((surface.details(None), 0.05));
        let known = surface.values();
        let depth = Grey::from_fn(size, |x, y| {
            let at = (y * size[0] + x) as usize;
            if known[at] > 0.0 { libm::logf(range[at].max(1e-6)) } else { 0.0 }
        });
        channels.push((depth.details(Some(&surface)), 0.02));
        Self { range, surface, channels }
    }
}

fn unit(shown: &Shown) -> [f32; 3] {
    let [_, _, x, y, z] = *shown;
    let length = (x * x + y * y + z * z).sqrt();
    if length > 1e-6 { [x / length, y / length, z / length] } else { [0.0; 3] }
}

/// What a raster shows in a direction (camera's axes, unit), and how far away it is.
pub(super) fn look(raster: &Raster<Shown>, ray: DVec3) -> Option<(f32, Shown)> {
    let window: &Window = raster.window();
    let direction = window.window_from_camera * ray;
    let place = window.project(direction)?;
    let [width, height] = window.size;
    // Depth along the axis to distance along the ray.
    let stretch = (1.0 / direction.z) as f32;
    let corner = (place - 0.5).floor();
    let share = place - 0.5 - corner;
    let at = |dx: f64, dy: f64| {
        let x = (corner.x + dx).clamp(0.0, f64::from(width - 1)) as u32;
        let y = (corner.y + dy).clamp(0.0, f64::from(height - 1)) as u32;
        raster.value(x, y).map(|value| (raster.depth(x, y), value))
    };
    let nearest = at(share.x.round(), share.y.round());
    let four = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    let [Some(a), Some(b), Some(c), Some(d)] = four else {
        return nearest.map(|(depth, value)| (depth * stretch, value));
    };
    let four = [a, b, c, d];
    let (low, high) = four.iter().fold((f32::INFINITY, 0.0_f32), |(low, high), (z, _)| (low.min(*z), high.max(*z)));
    if high > low * (1.0 + JUMP) {
        return nearest.map(|(depth, value)| (depth * stretch, value));
    }
    let (x, y) = (share.x as f32, share.y as f32);
    let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
    let (mut depth, mut value) = (0.0, [0.0; 5]);
    for ((z, values), weight) in four.iter().zip(weights) {
        depth += weight * z;
        value.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight * v);
    }
    Some((depth * stretch, value))
}

//! A photograph refined against a pack.

use super::super::{Model, Part};
use crate::ScanError;
use kilwa_geometry::color::light_from_srgb_f32;
use kilwa_pack::Source;
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::photo_pose::{Grey, NotRefined, Options, Refined, Shown, refine};
use kilwa_scan_core::raster::{Raster, windows};

/// Pixels that are drawn for a photograph, at most.
const MAX_PIXELS: u32 = 4_000_000;
/// Error of the surface that is drawn, pixels.
const ERROR_PIXELS: f64 = 0.5;

/// What a camera sees of a model, with pixels of `scale` of its pixels in each direction: brightness and normals.
///
/// # Errors
/// [`ScanError::Model`] if a chunk is damaged.
pub fn draw<S: Source + Sync>(
    model: &Model<'_, S>,
    camera: &PosedCamera,
    scale: f64,
) -> Result<Vec<Raster<Shown>>, ScanError> {
    let shown = |part: &Part, vertex: usize| -> Shown {
        let brightness = part.colors.get(vertex).map_or(f32::NAN, |color| {
            let [r, g, b] = color.map(light_from_srgb_f32);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        });
        let normal = part.normals.get(vertex).copied().unwrap_or_default();
        [brightness, f32::NAN, normal.x, normal.y, normal.z]
    };
    let windows = windows(&camera.camera, scale, MAX_PIXELS);
    windows.into_iter().map(|window| model.draw(camera, window, ERROR_PIXELS, shown)).collect()
}

/// Refine the pose of a photograph against a model; see [`refine`]. `picture`: the luminance of the photograph, at full size or divided by `factor`.
///
/// # Errors
/// [`ScanError::Model`] if a chunk is damaged. The inner error: the photograph cannot be refined, and must not be used.
pub fn refine_photograph<S: Source + Sync>(
    model: &Model<'_, S>,
    camera: &PosedCamera,
    picture: &Grey,
    factor: f64,
    options: &Options,
) -> Result<Result<Refined, Box<NotRefined>>, ScanError> {
    refine(camera, picture, factor, &mut |camera, scale| draw(model, camera, scale), options)
}

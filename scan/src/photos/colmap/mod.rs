//! COLMAP: a folder with `cameras`, `images` and `points3D`, all as text or all binary.
//!
//! An image has a rotation (quaternion w x y z) and a translation that transform world coordinates to camera
//! coordinates. Axes and pixels are as in [`kilwa_scan_core::camera`] (the
//! centre of the upper left pixel is (0.5, 0.5)). Rigs and frames of COLMAP 3.12 and later are not needed: `images` holds the pose of every image.
//!
//! Sources: COLMAP's documentation, "Output Format" (<https://colmap.github.io/format.html>) and "Camera Models"
//! (<https://colmap.github.io/cameras.html>); `src/colmap/sensor/models.h` for the parameters of each model.

mod binary;
mod models;
mod text;

use super::{Contents, PhotoRecord};
use crate::ScanError;
use glam::{DQuat, DVec3};
use kilwa_scan_core::{Camera, Pose};
use std::collections::HashMap;
use std::path::Path;

/// The cameras by their numbers.
type Cameras = HashMap<u32, Result<Camera, String>>;

/// Read the binary model in a folder.
pub(super) fn read_binary(folder: &Path) -> Result<Contents, ScanError> {
    let cameras = binary::cameras(&folder.join("cameras.bin"))?;
    let photos = binary::images(&folder.join("images.bin"), &cameras)?;
    let points = folder.join("points3D.bin");
    let points = if points.is_file() { binary::points(&points)? } else { Vec::new() };
    Ok(Contents { photos, points, crs: None })
}

/// Read the model in a folder that is text.
pub(super) fn read_text(folder: &Path) -> Result<Contents, ScanError> {
    let cameras = text::cameras(&folder.join("cameras.txt"))?;
    let photos = text::images(&folder.join("images.txt"), &cameras)?;
    let points = folder.join("points3D.txt");
    let points = if points.is_file() { text::points(&points)? } else { Vec::new() };
    Ok(Contents { photos, points, crs: None })
}

/// The pose of an image. None if the quaternion is 0 or a number is not finite.
fn pose([w, x, y, z, tx, ty, tz]: [f64; 7]) -> Option<Pose> {
    let (rotation, translation) = (DQuat::from_xyzw(x, y, z, w), DVec3::new(tx, ty, tz));
    let length = rotation.length();
    let is_sound = length.is_finite() && length > 1e-6 && translation.is_finite();
    is_sound.then(|| Pose { rotation: rotation.normalize(), translation })
}

/// The record of an image. None if it names a camera that is not there.
fn record(name: String, pose: Pose, camera: u32, cameras: &Cameras) -> Option<PhotoRecord> {
    let camera = cameras.get(&camera)?;
    let mut photo = PhotoRecord::named(name);
    photo.set_camera(camera.clone());
    photo.set_pose(Ok(pose));
    Some(photo)
}

//! The binary files.

use super::super::binary::Bytes;
use super::super::{PhotoRecord, SparsePoint};
use super::{Cameras, models, pose, record};
use crate::ScanError;
use glam::DVec3;
use std::path::Path;

/// `cameras.bin`: number, model, width, height and parameters of each.
pub(super) fn cameras(path: &Path) -> Result<Cameras, ScanError> {
    let mut file = Bytes::open(path)?;
    let count = file.count("cameras", 24 + 16)?;
    let mut cameras = Cameras::default();
    for _ in 0..count {
        let id = file.u32()?;
        let model = file.u32()?.cast_signed();
        let (name, parameters) = models::by_number(model)
            .ok_or_else(|| file.wrong(format!("camera model {model}"), "a model of COLMAP, from 0 to 17"))?;
        let size = [file.u64()?, file.u64()?];
        let mut values = [0.0; models::PARAMETERS_MAX];
        for value in &mut values[..parameters] {
            *value = file.f64()?;
        }
        cameras.insert(id, models::camera(name, size, &values[..parameters]));
    }
    file.end()?;
    Ok(cameras)
}

/// `images.bin`: number, pose, camera, name and observations of each.
pub(super) fn images(path: &Path, cameras: &Cameras) -> Result<Vec<PhotoRecord>, ScanError> {
    let mut file = Bytes::open(path)?;
    let count = file.count("images", 4 + 56 + 4 + 1 + 8)?;
    let mut photos = Vec::new();
    for _ in 0..count {
        let id = file.u32()?;
        let pose = pose(file.f64s()?).ok_or_else(|| {
            file.wrong(format!("an invalid pose of image {id}"), "finite numbers and a quaternion other than 0")
        })?;
        let camera = file.u32()?;
        let name = file.name()?;
        let photo = record(name, pose, camera, cameras)
            .ok_or_else(|| file.wrong(format!("camera {camera} of image {id}"), "a camera that is in cameras.bin"))?;
        photos.push(photo);
        let observations = file.count("observations", 24)?;
        file.skip(observations * 24)?;
    }
    file.end()?;
    Ok(photos)
}

/// `points3D.bin`: number, place, colour, error and track of each.
pub(super) fn points(path: &Path) -> Result<Vec<SparsePoint>, ScanError> {
    let mut file = Bytes::open(path)?;
    let count = file.count("points", 8 + 24 + 3 + 8 + 8)?;
    let mut points = Vec::new();
    for _ in 0..count {
        let id = file.u64()?;
        let at = DVec3::from_array(file.f64s()?);
        let color = [file.byte()?, file.byte()?, file.byte()?];
        if !at.is_finite() {
            return Err(file.wrong(format!("a position of point {id} that is not finite"), "three finite numbers"));
        }
        file.f64()?;
        let seen = file.count("observations", 8)?;
        file.skip(seen * 8)?;
        points.push(SparsePoint { at, color, seen: u32::try_from(seen).unwrap_or(u32::MAX) });
    }
    file.end()?;
    Ok(points)
}

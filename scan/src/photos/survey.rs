//! Photographs of `survey.toml` and of E57 files.
//!
//! The pose of a pinhole picture has the axes x right, y up, z backwards. That of a spherical or cylindrical picture has the axes of E57's
//! spherical coordinates: z up, and the centre of the picture at azimuth 0, along x; azimuths grow counterclockwise, so columns grow against them.

use super::folder::mask_beside;
use super::{Frame, Missing, PhotoRecord, Source, note_missing, picture};
use crate::survey::{Camera as Stated, Photograph, Survey};
use glam::{DMat3, DQuat, DVec2, DVec3};
use kilwa_scan_core::{Camera, CameraModel, Distortion, Pose};
use std::path::Path;

/// The record of a photograph in `survey.toml`.
pub(super) fn record(folder: &Path, survey: &Survey, photograph: &Photograph) -> PhotoRecord {
    let path = folder.join(&photograph.file);
    let mut photo = PhotoRecord::named(&photograph.file);
    photo.frame = Frame::Survey;
    photo.station.clone_from(&photograph.station);
    take(&mut photo, photograph.camera.as_ref(), photograph.pose);
    if path.is_file() {
        match picture::read(&path) {
            Ok(picture) => photo.picture = Some(picture),
            Err(why) => photo.missing.push(Missing::Picture(why)),
        }
        photo.mask = mask_beside(&path);
        photo.source = Source::File(path);
    } else {
        photo.missing.push(Missing::File);
    }
    if let Some(station) = photo.station.as_deref()
        && survey.stations.iter().all(|known| known.name != station)
    {
        photo.station = None;
    }
    note_missing(&mut photo);
    photo
}

/// Take a camera and a pose as `survey.toml` and E57 state them.
pub(super) fn take(photo: &mut PhotoRecord, stated: Option<&Stated>, pose: Option<Pose>) {
    if let Some(stated) = stated {
        photo.set_camera(camera(stated));
    }
    let is_round = stated.is_some_and(|stated| !matches!(stated, Stated::Pinhole { .. }));
    let turn = if is_round { camera_from_spherical() } else { DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0) };
    photo.camera_from_world = pose.map(|pose| pose.inverse().then(Pose { rotation: turn, translation: DVec3::ZERO }));
}

/// From axes x forward, y left, z up to those of a camera.
pub(super) fn camera_from_spherical() -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(DVec3::Z, -DVec3::X, -DVec3::Y))
}

fn camera(stated: &Stated) -> Result<Camera, String> {
    let (size, model) = match stated {
        Stated::Pinhole { size, focal, center } => {
            let (focal, center) = (DVec2::from_array(*focal), DVec2::from_array(*center));
            (*size, CameraModel::Pinhole { focal, center, skew: 0.0, distortion: Distortion::None })
        }
        Stated::Spherical { size, pixel } => {
            let center = DVec2::from_array(size.map(f64::from)) * 0.5;
            (*size, CameraModel::Equirectangular { scale: DVec2::from_array(*pixel).recip(), center })
        }
        Stated::Cylindrical { size, radius, center, pixel } => {
            let scale = DVec2::new(1.0 / pixel[0], radius / pixel[1]);
            (*size, CameraModel::Cylindrical { scale, center: DVec2::new(f64::from(size[0]) * 0.5, *center) })
        }
    };
    Camera::new(size, model).map_err(|e| e.to_string())
}

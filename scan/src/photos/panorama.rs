//! Panoramas of stations: pictures that no file with poses names, and that are named after a station.
//!
//! `STATION.jpg`, twice as wide as high, is equirectangular: its centre looks along the x axis of the station, and z is up. `STATION_front.jpg`, `_right`, `_back`,
//! `_left`, `_up` and `_down` (or their first letters) are the faces of a cube; the front looks along x. Programs of scanners write panoramas of
//! these orientations when they place them at the scanner; a picture that is turned must be given a pose.

use super::survey::camera_from_spherical;
use super::{Frame, PhotoRecord, Source};
use crate::survey::Station;
use glam::DVec3;
use kilwa_scan_core::camera::CubeFace;
use kilwa_scan_core::{Camera, Pose};
use std::path::Path;

/// Tolerance of the 2:1 aspect ratio, for rounding: 8191 × 4096 is a panorama, too.
const ROUNDING: u32 = 1;

/// Give a photograph the camera of a panorama, and the pose of its station.
pub(super) fn place(photo: &mut PhotoRecord, stations: &[Station]) {
    let Some(size) = photo.picture.as_ref().map(|picture| picture.size) else { return };
    let Source::File(path) = &photo.source else { return };
    let Some(stem) = path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned) else { return };
    let is_panorama = size[0].abs_diff(size[1].saturating_mul(2)) <= ROUNDING && size[1] > 1;
    let face = face(&stem).filter(|_| size[0] == size[1]);
    let (name, camera, turn) = match face {
        _ if is_panorama => (stem.as_str(), Camera::equirectangular(size), None),
        Some((name, face)) => (name, Camera::cube_face(size[0]), Some(face)),
        None => return,
    };
    let named = stations.iter().find(|station| station.name == name || stem_of(&station.scan) == Some(name));
    // A file with several scans has no panorama of its own.
    let mut of_file = stations.iter().filter(|station| stem_of(&station.source.file) == Some(name));
    let Some(station) = named.or(of_file.next().filter(|_| of_file.next().is_none())) else { return };
    photo.set_camera(camera.map_err(|e| e.to_string()));
    photo.station = Some(station.name.clone());
    photo.frame = Frame::Survey;
    let rotation = turn.map_or(camera_from_spherical(), |face| face.face_from_cube() * camera_from_spherical());
    photo.camera_from_world = station.pose.map(|pose| pose.inverse().then(Pose { rotation, translation: DVec3::ZERO }));
}

/// The name of a file without its ending.
fn stem_of(file: &str) -> Option<&str> {
    Path::new(file).file_stem().and_then(|stem| stem.to_str())
}

/// The station and the face in the name of a picture.
fn face(stem: &str) -> Option<(&str, CubeFace)> {
    let (name, face) = stem.rsplit_once('_')?;
    let face = match face.to_ascii_lowercase().as_str() {
        "front" | "f" => CubeFace::Front,
        "right" | "r" => CubeFace::Right,
        "back" | "b" => CubeFace::Back,
        "left" | "l" => CubeFace::Left,
        "up" | "u" => CubeFace::Up,
        "down" | "d" => CubeFace::Down,
        _ => return None,
    };
    Some((name, face))
}

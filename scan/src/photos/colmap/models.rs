//! The camera models of COLMAP.

use glam::DVec2;
use kilwa_scan_core::{Camera, Distortion};

/// Number, name and count of parameters of each model (`src/colmap/sensor/models.h`; those from 12 on are of COLMAP 4).
const MODELS: [(i32, &str, usize); 18] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (5, "OPENCV_FISHEYE", 8),
    (6, "FULL_OPENCV", 12),
    (7, "FOV", 5),
    (8, "SIMPLE_RADIAL_FISHEYE", 4),
    (9, "RADIAL_FISHEYE", 5),
    (10, "THIN_PRISM_FISHEYE", 12),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", 16),
    (12, "SIMPLE_DIVISION", 4),
    (13, "DIVISION", 5),
    (14, "SIMPLE_FISHEYE", 3),
    (15, "FISHEYE", 4),
    (16, "EUCM", 6),
    (17, "EQUIRECTANGULAR", 2),
];

/// The most parameters of a model.
pub(super) const PARAMETERS_MAX: usize = 16;

/// Name and count of parameters of the model of this number.
pub(super) fn by_number(number: i32) -> Option<(&'static str, usize)> {
    MODELS.iter().find(|model| model.0 == number).map(|model| (model.1, model.2))
}

/// Count of parameters of the model of this name.
pub(super) fn by_name(name: &str) -> Option<usize> {
    MODELS.iter().find(|model| model.1 == name).map(|model| model.2)
}

/// The camera of a model; or why there is none.
pub(super) fn camera(name: &str, size: [u64; 2], parameters: &[f64]) -> Result<Camera, String> {
    let size = size.map(|n| u32::try_from(n).unwrap_or(0));
    let fisheye = |k: [f64; 4], p| Distortion::Fisheye { k, p };
    let brown = |k1, k2| Distortion::Brown { k: [k1, k2, 0.0, 0.0], p: [0.0; 2] };
    let (focal, center, distortion) = match (name, parameters) {
        ("SIMPLE_PINHOLE", [f, cx, cy]) => ([f, f], [cx, cy], Distortion::None),
        ("PINHOLE", [fx, fy, cx, cy]) => ([fx, fy], [cx, cy], Distortion::None),
        ("SIMPLE_RADIAL", [f, cx, cy, k]) => ([f, f], [cx, cy], brown(*k, 0.0)),
        ("RADIAL", [f, cx, cy, k1, k2]) => ([f, f], [cx, cy], brown(*k1, *k2)),
        ("OPENCV", [fx, fy, cx, cy, k1, k2, p1, p2]) => {
            ([fx, fy], [cx, cy], Distortion::Brown { k: [*k1, *k2, 0.0, 0.0], p: [*p1, *p2] })
        }
        ("FULL_OPENCV", [fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            let k = [*k1, *k2, *k3, *k4, *k5, *k6];
            ([fx, fy], [cx, cy], Distortion::OpenCv { k, p: [*p1, *p2] })
        }
        ("OPENCV_FISHEYE", [fx, fy, cx, cy, k1, k2, k3, k4]) => {
            ([fx, fy], [cx, cy], fisheye([*k1, *k2, *k3, *k4], [0.0; 2]))
        }
        ("SIMPLE_RADIAL_FISHEYE", [f, cx, cy, k]) => ([f, f], [cx, cy], fisheye([*k, 0.0, 0.0, 0.0], [0.0; 2])),
        ("RADIAL_FISHEYE", [f, cx, cy, k1, k2]) => ([f, f], [cx, cy], fisheye([*k1, *k2, 0.0, 0.0], [0.0; 2])),
        ("SIMPLE_FISHEYE", [f, cx, cy]) => ([f, f], [cx, cy], fisheye([0.0; 4], [0.0; 2])),
        ("FISHEYE", [fx, fy, cx, cy]) => ([fx, fy], [cx, cy], fisheye([0.0; 4], [0.0; 2])),
        ("THIN_PRISM_FISHEYE", [fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx, sy]) if *sx == 0.0 && *sy == 0.0 => {
            ([fx, fy], [cx, cy], fisheye([*k1, *k2, *k3, *k4], [*p1, *p2]))
        }
        ("EQUIRECTANGULAR", _) => return Camera::equirectangular(size).map_err(|e| format!("{name} with {e}")),
        _ => return Err(format!("the camera model {name} is not supported")),
    };
    let (focal, center) = (DVec2::new(*focal[0], *focal[1]), DVec2::new(*center[0], *center[1]));
    Camera::pinhole(size, focal, center, distortion).map_err(|e| format!("{name} with {e}"))
}

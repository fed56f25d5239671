//! Small changes of a camera: of its pose, and if asked of its focal length and principal point; and by how much they shift what is seen.

use crate::camera::{Camera, CameraError, CameraModel, PosedCamera};
use crate::pose::Pose;
use glam::{DQuat, DVec2, DVec3};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Parameters: a rotation about the camera's axes (radians), a translation along them (in units of a length), the logarithm of the focal length, the principal point (in units of the focal length).
pub(super) const PARAMETERS: usize = 9;
/// Those of the pose.
const OF_POSE: usize = 6;
/// Directions in which the shifts are smaller than this share of the largest are left as they are.
const WEAK: f64 = 1e-4;

/// A change of a camera.
pub(super) type Change = [f64; PARAMETERS];

/// The camera after a change. `length`: the unit of translations.
///
/// # Errors
/// [`CameraError`] if the changed camera is none.
pub(super) fn changed(camera: &PosedCamera, change: &Change, length: f64) -> Result<PosedCamera, CameraError> {
    let turn = DQuat::from_scaled_axis(DVec3::new(change[0], change[1], change[2]));
    let shift = DVec3::new(change[3], change[4], change[5]) * length;
    let pose = camera.camera_from_world;
    let camera_from_world =
        Pose { rotation: (turn * pose.rotation).normalize(), translation: turn * pose.translation + shift };
    let mut model = *camera.camera.model();
    if change[OF_POSE..].iter().any(|value| *value != 0.0)
        && let CameraModel::Pinhole { focal, center, skew, .. } = &mut model
    {
        *center += DVec2::new(change[7], change[8]) * focal.max_element();
        *focal *= libm::exp(change[6]);
        *skew *= libm::exp(change[6]);
        return Ok(PosedCamera { camera: Camera::new(camera.camera.size(), model)?, camera_from_world });
    }
    Ok(PosedCamera { camera: camera.camera, camera_from_world })
}

/// Derivatives of the place (pixels, x and y) of a point in the camera's axes with respect to a change. None where the point is not seen.
pub(super) fn derivatives(camera: &Camera, point: DVec3, length: f64, calibrate: bool) -> Option<[Change; 2]> {
    let projection = camera.project_with_derivative(point)?;
    let mut out = [[0.0; PARAMETERS]; 2];
    for (out, row) in out.iter_mut().zip(projection.rows) {
        // row · (ω × p) = ω · (p × row)
        out[..3].copy_from_slice(&point.cross(row).to_array());
        out[3..6].copy_from_slice(&(row * length).to_array());
    }
    if calibrate && let CameraModel::Pinhole { focal, center, .. } = camera.model() {
        let offset = projection.pixel - *center;
        (out[0][6], out[1][6]) = (offset.x, offset.y);
        (out[0][7], out[1][8]) = (focal.max_element(), focal.max_element());
    }
    Some(out)
}

/// Directions of change, each of which shifts the points by one pixel (root mean square), independent of each other.
#[derive(Debug, Clone)]
pub(super) struct Directions {
    /// Changes.
    pub(super) changes: Vec<Change>,
}

impl Directions {
    /// The directions for points with these derivatives; those that hardly shift any point are left out.
    pub(super) fn new(rows: &[[Change; 2]]) -> Self {
        let mut product = DMatrix::<f64>::zeros(PARAMETERS, PARAMETERS);
        for row in rows.iter().flatten() {
            let row = DVector::from_column_slice(row);
            product += &row * row.transpose();
        }
        product /= rows.len().max(1) as f64;
        let eigen = SymmetricEigen::new(product);
        let mut order: Vec<usize> = (0..PARAMETERS).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let largest = eigen.eigenvalues[order[0]];
        let strong = order.into_iter().filter(|k| eigen.eigenvalues[*k] > WEAK * WEAK * largest && largest > 0.0);
        let changes = strong.map(|k| {
            let column = eigen.eigenvectors.column(k);
            let largest = column.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(1.0);
            // The sign of an eigenvector is arbitrary.
            let scale = largest.signum() / eigen.eigenvalues[k].sqrt();
            std::array::from_fn(|i| column[i] * scale)
        });
        Self { changes: changes.collect() }
    }

    /// The change that is a sum of directions.
    pub(super) fn change(&self, amounts: &[f64]) -> Change {
        let mut out = [0.0; PARAMETERS];
        for (direction, amount) in self.changes.iter().zip(amounts) {
            out.iter_mut().zip(direction).for_each(|(sum, value)| *sum += amount * value);
        }
        out
    }

    /// The amounts of these directions by which a change shifts the points.
    pub(super) fn amounts(&self, change: &Change, rows: &[[Change; 2]]) -> Vec<f64> {
        let count = rows.len().max(1) as f64;
        let along = |direction: &Change| {
            let product = |row: &Change| dot(row, direction) * dot(row, change);
            rows.iter().flatten().map(product).sum::<f64>() / count
        };
        self.changes.iter().map(along).collect()
    }
}

/// The shift along a row.
pub(super) fn dot(row: &Change, change: &Change) -> f64 {
    row.iter().zip(change).map(|(a, b)| a * b).sum()
}

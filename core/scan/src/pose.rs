//! Where a station stands in its survey: a rotation and a translation, without scale.

use glam::{DMat3, DMat4, DQuat, DVec3};
use std::fmt;

/// `survey_from_station`: takes coordinates of a station to those of the survey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// A unit quaternion.
    pub rotation: DQuat,
    /// Where the station's origin is in the survey, metres.
    pub translation: DVec3,
}

/// Why a matrix is no pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseError {
    /// A number is not finite.
    NotFinite,
    /// The last row is not 0 0 0 1.
    NotAffine,
    /// It flattens space.
    Singular,
    /// It mirrors: its determinant is this.
    Mirrored(f64),
    /// It scales or shears: the largest difference from the nearest rotation is this.
    NotRigid(f64),
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("a number that is not finite"),
            Self::NotAffine => f.write_str("a matrix whose last row is not 0 0 0 1"),
            Self::Singular => f.write_str("a matrix that flattens space"),
            Self::Mirrored(d) => write!(f, "a matrix that mirrors (its determinant is {d:.6})"),
            Self::NotRigid(d) => {
                write!(f, "a matrix that scales or shears (an entry is {d:.6} from that of a rotation)")
            }
        }
    }
}

impl std::error::Error for PoseError {}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The station's coordinates are those of the survey.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// How far an entry of a matrix may be from the nearest rotation: files with four decimals are accepted, a scale is not.
    pub const TOLERANCE: f64 = 1e-3;

    /// A translation alone.
    pub fn at(translation: DVec3) -> Self {
        Self { translation, ..Self::IDENTITY }
    }

    /// The pose nearest to a matrix (column vectors: the translation is the last column), and the largest difference between an entry
    /// of its rotation and the matrix: 0 to the last digit of the matrix where that is a rotation.
    ///
    /// # Errors
    /// [`PoseError`] if the matrix is no rotation and translation within [`Self::TOLERANCE`].
    pub fn from_matrix(matrix: DMat4) -> Result<(Self, f64), PoseError> {
        if !matrix.is_finite() {
            return Err(PoseError::NotFinite);
        }
        let last = matrix.row(3);
        if (last - glam::DVec4::W).abs().max_element() > 1e-9 {
            return Err(PoseError::NotAffine);
        }
        let given = DMat3::from_mat4(matrix);
        let determinant = given.determinant();
        if determinant.abs() < 1e-9 {
            return Err(PoseError::Singular);
        }
        if determinant < 0.0 {
            return Err(PoseError::Mirrored(determinant));
        }
        let rotation = nearest_rotation(given);
        let difference = (0..3).map(|k| (rotation.col(k) - given.col(k)).abs().max_element()).fold(0.0, f64::max);
        if difference.is_nan() || difference > Self::TOLERANCE {
            return Err(PoseError::NotRigid(difference));
        }
        let rotation = DQuat::from_mat3(&rotation).normalize();
        Ok((Self { rotation, translation: matrix.w_axis.truncate() }, difference))
    }

    /// As a matrix for column vectors.
    pub fn to_matrix(self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// A point of the station in the survey.
    pub fn apply(self, station: DVec3) -> DVec3 {
        self.rotation * station + self.translation
    }

    /// `station_from_survey`.
    #[must_use]
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.inverse();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// First `self`, then `next`.
    #[must_use]
    pub fn then(self, next: Self) -> Self {
        Self {
            rotation: (next.rotation * self.rotation).normalize(),
            translation: next.rotation * self.translation + next.translation,
        }
    }

    /// The angle between two rotations (radians) and the distance between two places (metres).
    pub fn difference(self, other: Self) -> (f64, f64) {
        (self.rotation.angle_between(other.rotation), self.translation.distance(other.translation))
    }
}

/// The rotation nearest to a matrix of positive determinant: the orthogonal factor of its polar decomposition, by Newton's iteration
/// (Higham, "Computing the Polar Decomposition", 1986), which converges quadratically.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    let mut r = matrix;
    for _ in 0..50 {
        let next = (r + r.inverse().transpose()) * 0.5;
        let change = (0..3).map(|k| (next.col(k) - r.col(k)).abs().max_element()).fold(0.0, f64::max);
        r = next;
        if change < 1e-15 {
            break;
        }
    }
    r
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-size..size).prop_map(DVec3::from_array)
    }

    fn pose() -> impl Strategy<Value = Pose> {
        (vector(1.0), vector(1e3))
            .prop_map(|(axis, translation)| Pose { rotation: DQuat::from_scaled_axis(axis * 3.0), translation })
    }

    proptest! {
        #[test]
        fn a_pose_survives_its_matrix_and_its_inverse_undoes_it(pose in pose(), p in vector(100.0)) {
            let (back, difference) = Pose::from_matrix(pose.to_matrix()).unwrap();
            prop_assert!(difference < 1e-14);
            prop_assert!(back.apply(p).distance(pose.apply(p)) < 1e-11);
            prop_assert!(pose.inverse().apply(pose.apply(p)).distance(p) < 1e-11);
            prop_assert!(pose.then(pose.inverse()).difference(Pose::IDENTITY).0 < 1e-7);
        }

        #[test]
        fn poses_are_joined_as_their_matrices(a in pose(), b in pose(), p in vector(100.0)) {
            prop_assert!(a.then(b).apply(p).distance(b.to_matrix().transform_point3(a.to_matrix().transform_point3(p))) < 1e-9);
        }

        #[test]
        fn a_matrix_of_four_decimals_is_a_pose_and_the_difference_is_reported(pose in pose()) {
            let rounded = pose.to_matrix().to_cols_array().map(|v| (v * 1e4).round() / 1e4);
            let (back, difference) = Pose::from_matrix(DMat4::from_cols_array(&rounded)).unwrap();
            prop_assert!(difference <= 2e-4, "{difference}");
            prop_assert!(back.difference(pose).0 < 5e-4);
        }
    }

    #[test]
    fn a_matrix_that_is_not_a_pose_is_refused_with_the_reason() {
        let scaled = DMat4::from_scale(DVec3::splat(1.01));
        assert!(matches!(Pose::from_matrix(scaled), Err(PoseError::NotRigid(d)) if (d - 0.01).abs() < 1e-9));
        assert!(matches!(
            Pose::from_matrix(DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0))),
            Err(PoseError::Mirrored(_))
        ));
        assert_eq!(Pose::from_matrix(DMat4::ZERO), Err(PoseError::NotAffine));
        assert_eq!(Pose::from_matrix(DMat4::from_scale(DVec3::new(1.0, 1.0, 0.0))), Err(PoseError::Singular));
        assert_eq!(Pose::from_matrix(DMat4::from_translation(DVec3::NAN)), Err(PoseError::NotFinite));
        let transposed = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0)).transpose();
        assert_eq!(Pose::from_matrix(transposed), Err(PoseError::NotAffine));
    }
}

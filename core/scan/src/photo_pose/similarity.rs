//! The frame of a reconstruction from photographs and that of the survey: a similarity from pairs of points.

use crate::camera::PosedCamera;
use crate::kabsch::{BestRotation, best_rotation, is_line};
use crate::pose::Pose;
use glam::{DQuat, DVec3};
use nalgebra::Matrix3;
use std::fmt;

/// Fewest pairs that define a similarity.
pub const MIN_PAIRS: usize = 3;
/// Maximum number of pairs, those with the largest residuals, that are left out one at a time to find the wrong one.
const MAX_SUSPECTS: usize = 100;

/// Takes coordinates of a reconstruction to those of the survey: `scale · rotation · p + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Metres per unit of the reconstruction.
    pub scale: f64,
    /// A unit quaternion.
    pub rotation: DQuat,
    /// Where the origin of the reconstruction is in the survey, metres.
    pub translation: DVec3,
}

/// A point that is known in both frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// In the survey, metres.
    pub survey: DVec3,
    /// In the reconstruction.
    pub reconstruction: DVec3,
    /// The standard deviation of their difference, metres of the survey.
    pub sigma: f64,
}

/// A similarity from pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// The similarity.
    pub similarity: Similarity,
    /// The distance that remains between the points of each pair, metres.
    pub residuals: Vec<f64>,
    /// Their root mean square, metres.
    pub rms: f64,
}

/// Why pairs define no similarity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameError {
    /// Fewer than three pairs.
    Few {
        /// This many.
        pairs: usize,
    },
    /// A coordinate or standard deviation is not finite, or a standard deviation is not positive.
    Unusable {
        /// The pair, from 0.
        pair: usize,
    },
    /// The points are on a line, or at one place.
    Line,
    /// A pair contradicts the others.
    Contradiction {
        /// The pair, from 0.
        pair: usize,
        /// The distance between its points if the other pairs are right, metres.
        distance: f64,
        /// The largest distance that is expected, metres.
        expected: f64,
    },
    /// The pairs contradict each other, and it is unknown which of them is wrong.
    Contradictions {
        /// The pair with the largest distance, from 0.
        pair: usize,
        /// This distance, metres.
        distance: f64,
        /// The largest distance that is expected, metres.
        expected: f64,
    },
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Few { pairs: 0 } => f.write_str("no points are known in both frames; at least three are needed"),
            Self::Few { pairs: 1 } => f.write_str("only one point is known in both frames; at least three are needed"),
            Self::Few { pairs } => {
                write!(f, "only {pairs} points are known in both frames; at least three are needed")
            }
            Self::Unusable { pair } => {
                write!(
                    f,
                    "pair {} has a number that is not finite or a standard deviation that is not positive",
                    pair + 1
                )
            }
            Self::Line => {
                f.write_str("the points that are known in both frames all lie on one line or at one place; add a point away from the line")
            }
            Self::Contradiction { pair, distance, expected } => write!(
                f,
                "pair {} contradicts the others: its points are {distance:.3} m apart if the others are right; at most {expected:.3} m are expected",
                pair + 1
            ),
            Self::Contradictions { pair, distance, expected } => write!(
                f,
                "the pairs contradict each other: the points of pair {} are {distance:.3} m apart, at most {expected:.3} m are expected. Leaving out a single pair does not help",
                pair + 1
            ),
        }
    }
}

impl std::error::Error for FrameError {}

impl Similarity {
    /// Both frames are the same.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A point of the reconstruction in the survey.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }

    /// Takes coordinates of the survey to those of the reconstruction.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (scale, rotation) = (1.0 / self.scale, self.rotation.inverse());
        Self { scale, rotation, translation: -(rotation * self.translation) * scale }
    }

    /// First `self`, then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            scale: self.scale * next.scale,
            rotation: (next.rotation * self.rotation).normalize(),
            translation: next.apply(self.translation),
        }
    }

    /// A camera of the reconstruction in the survey: it sees each moved point at the same pixel.
    pub fn camera(&self, camera: &PosedCamera) -> PosedCamera {
        PosedCamera { camera: camera.camera, camera_from_world: self.pose(camera.camera_from_world) }
    }

    /// The same for the pose of a camera (`camera_from_world`).
    #[must_use]
    pub fn pose(&self, camera_from_world: Pose) -> Pose {
        let rotation = (camera_from_world.rotation * self.rotation.inverse()).normalize();
        Pose { rotation, translation: camera_from_world.translation * self.scale - rotation * self.translation }
    }

    /// The similarity that best takes the points of the reconstruction to those of the survey, each pair weighted with 1 / sigma² (Umeyama,
    /// "Least-squares estimation of transformation parameters between two point patterns", 1991); None if they are on a line.
    fn umeyama(pairs: &[Pair]) -> Option<Self> {
        let weights: Vec<f64> = pairs.iter().map(|pair| 1.0 / (pair.sigma * pair.sigma)).collect();
        let total: f64 = weights.iter().sum();
        let (mut to, mut from) = (DVec3::ZERO, DVec3::ZERO);
        for (pair, weight) in pairs.iter().zip(&weights) {
            to += pair.survey * (weight / total);
            from += pair.reconstruction * (weight / total);
        }
        let (mut product, mut spread) = (Matrix3::zeros(), Matrix3::zeros());
        let mut in_survey = Matrix3::zeros();
        for (pair, weight) in pairs.iter().zip(&weights) {
            let a = nalgebra::Vector3::from((pair.survey - to).to_array());
            let b = nalgebra::Vector3::from((pair.reconstruction - from).to_array());
            product += a * b.transpose() * (weight / total);
            spread += b * b.transpose() * (weight / total);
            in_survey += a * a.transpose() * (weight / total);
        }
        if is_line(&spread) || is_line(&in_survey) {
            return None;
        }
        let BestRotation { rotation, trace } = best_rotation(&product)?;
        let scale = trace / spread.trace();
        let is_scale = scale.is_finite() && scale > 0.0;
        is_scale.then_some(Self { scale, rotation, translation: to - rotation * from * scale })
    }

    /// The similarity from pairs, if they agree within five standard deviations (and a centimetre). With four or more pairs, the one that contradicts the others is named.
    ///
    /// # Errors
    /// [`FrameError`].
    pub fn from_pairs(pairs: &[Pair]) -> Result<Fit, FrameError> {
        if pairs.len() < MIN_PAIRS {
            return Err(FrameError::Few { pairs: pairs.len() });
        }
        let is_usable = |pair: &Pair| {
            pair.survey.is_finite() && pair.reconstruction.is_finite() && pair.sigma.is_finite() && pair.sigma > 0.0
        };
        if let Some(pair) = pairs.iter().position(|pair| !is_usable(pair)) {
            return Err(FrameError::Unusable { pair });
        }
        let similarity = Self::umeyama(pairs).ok_or(FrameError::Line)?;
        let residuals: Vec<f64> = pairs.iter().map(|pair| similarity.distance(pair)).collect();
        let excess = |pair: &Pair, residual: f64| residual / tolerance(pair);
        let worst = |similarity: &Self, pairs: &[Pair]| {
            pairs.iter().map(|pair| excess(pair, similarity.distance(pair))).fold(0.0, f64::max)
        };
        if worst(&similarity, pairs) <= 1.0 {
            let square: f64 = residuals.iter().map(|r| r * r).sum();
            let rms = (square / pairs.len() as f64).sqrt();
            return Ok(Fit { similarity, residuals, rms });
        }
        // Which pair is wrong? The one without which the others agree; with three pairs, the others always do to a point.
        let mut suspects = Vec::new();
        if pairs.len() > MIN_PAIRS + 1 {
            let mut order: Vec<usize> = (0..pairs.len()).collect();
            order.sort_by(|a, b| excess(&pairs[*b], residuals[*b]).total_cmp(&excess(&pairs[*a], residuals[*a])));
            for left_out in order.into_iter().take(MAX_SUSPECTS) {
                let others: Vec<Pair> =
                    pairs.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, pair)| *pair).collect();
                if let Some(fit) = Self::umeyama(&others)
                    && worst(&fit, &others) <= 1.0
                {
                    suspects.push((left_out, fit.distance(&pairs[left_out])));
                }
            }
        }
        if let [(pair, distance)] = suspects[..] {
            return Err(FrameError::Contradiction { pair, distance, expected: tolerance(&pairs[pair]) });
        }
        let largest =
            |a: &usize, b: &usize| excess(&pairs[*a], residuals[*a]).total_cmp(&excess(&pairs[*b], residuals[*b]));
        let pair = (0..pairs.len()).max_by(largest).unwrap_or(0);
        Err(FrameError::Contradictions { pair, distance: residuals[pair], expected: tolerance(&pairs[pair]) })
    }

    fn distance(&self, pair: &Pair) -> f64 {
        self.apply(pair.reconstruction).distance(pair.survey)
    }
}

/// How far the points of a pair may be apart, metres.
fn tolerance(pair: &Pair) -> f64 {
    (5.0 * pair.sigma).max(0.01)
}

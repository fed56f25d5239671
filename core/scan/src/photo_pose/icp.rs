//! A reconstruction's sparse points brought onto the surface of the model: point to plane, with scale, robust.

use super::similarity::Similarity;
use super::surface::{Foot, Surface};
use glam::{DQuat, DVec3};
use nalgebra::{SMatrix, SVector, SymmetricEigen};
use std::fmt;

/// Fewest points that must lie on the surface.
pub const MIN_POINTS: usize = 30;
/// Rounds for one reach.
const ROUNDS: usize = 20;
/// The share of points that must be on the surface in the end.
const MIN_SHARE: f64 = 0.3;
/// Each reach is this share of the one before.
const SHRINK: f64 = 0.5;
/// The last reach: this many times the median distance of points from the surface.
const TIGHT: f64 = 4.0;
/// The last reach is not much smaller than this share of the spacing of the surface's points.
const FINEST: f64 = 0.05;
/// A change is determined if shifting the points by it moves them, across the surface, by at least this share (root mean square).
const DETERMINED: f64 = 0.02;

/// A reconstruction on a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceFit {
    /// The frame.
    pub similarity: Similarity,
    /// The share of points that are within the last reach of the surface.
    pub share: f64,
    /// Points within it.
    pub points: usize,
    /// The median of their distances from the surface, metres.
    pub median: f64,
    /// The last reach, metres.
    pub reach: f64,
}

/// Why points could not be brought onto a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SurfaceFitError {
    /// Too few points, or too few of them are near the surface.
    Few {
        /// Points near the surface.
        near: usize,
        /// All points.
        points: usize,
        /// How far from it they may be, metres.
        reach: f64,
    },
    /// The surface does not hold them in place: it is flat, or round, or a corridor.
    Slides,
    /// It moved farther than the start can be wrong.
    Ran {
        /// By how much, metres (root mean square).
        moved: f64,
        /// How much was allowed, metres.
        allowed: f64,
    },
}

impl fmt::Display for SurfaceFitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Few { near, points, reach } => write!(
                f,
                "only {near} of {points} points of the reconstruction are within {reach:.2} m of the surface; at least {MIN_POINTS} and {:.0} % are needed. The reconstruction shows something else, or its frame is too far off",
                100.0 * MIN_SHARE
            ),
            Self::Slides => f.write_str(
                "the points of the reconstruction can slide along the surface, so their frame is not determined; give control points",
            ),
            Self::Ran { moved, allowed } => write!(
                f,
                "the points of the reconstruction moved by {moved:.2} m, more than the allowed error of the initial frame ({allowed:.2} m); give control points"
            ),
        }
    }
}

impl std::error::Error for SurfaceFitError {}

/// Bring points onto a surface. `start`: in error by at most `reach`, metres. `spacing`: the distance between the points that describe the surface, metres.
///
/// Distances along the normal are minimised by Gauss–Newton over rotation, translation and scale (Chen and Medioni, "Object modelling by registration of multiple range images", 1992), with weights of Geman and McClure whose scale shrinks.
///
/// # Errors
/// [`SurfaceFitError`].
pub fn fit_to_surface(
    points: &[DVec3],
    start: &Similarity,
    reach: f64,
    surface: &Surface,
    spacing: f64,
) -> Result<SurfaceFit, SurfaceFitError> {
    let foot = &|place: DVec3, radius: f64| {
        let (foot, normal) = surface.nearest(place, radius.hypot(spacing))?;
        ((place - foot).dot(normal).abs() <= radius).then_some((foot, normal))
    };
    let mut similarity = *start;
    let mut radius = reach;
    loop {
        for _ in 0..ROUNDS {
            let step = step(points, &similarity, radius, foot)?;
            similarity = similarity.then(&step.change);
            if step.moved < 1e-3 * radius {
                break;
            }
        }
        let distances = distances(points, &similarity, radius, foot);
        let Some(median) = distances.get(distances.len() / 2).copied() else {
            return Err(SurfaceFitError::Few { near: 0, points: points.len(), reach: radius });
        };
        // Normals at the points of the surface are not better than this.
        if radius * SHRINK < (TIGHT * median).max(FINEST * spacing) {
            return judged(points, start, similarity, reach, radius, foot);
        }
        radius *= SHRINK;
    }
}

fn judged(
    points: &[DVec3],
    start: &Similarity,
    similarity: Similarity,
    allowed: f64,
    radius: f64,
    foot: &dyn Fn(DVec3, f64) -> Option<Foot>,
) -> Result<SurfaceFit, SurfaceFitError> {
    let distances = distances(points, &similarity, radius, foot);
    let (near, count) = (distances.len(), points.len());
    let share = near as f64 / count.max(1) as f64;
    if near < MIN_POINTS || share < MIN_SHARE {
        return Err(SurfaceFitError::Few { near, points: count, reach: radius });
    }
    let square: f64 = points.iter().map(|p| similarity.apply(*p).distance_squared(start.apply(*p))).sum();
    let moved = (square / count as f64).sqrt();
    if moved > 2.0 * allowed {
        return Err(SurfaceFitError::Ran { moved, allowed });
    }
    Ok(SurfaceFit { similarity, share, points: near, median: distances[near / 2], reach: radius })
}

/// The distances from the surface of the points that are within a radius of it, in order.
fn distances(
    points: &[DVec3],
    similarity: &Similarity,
    radius: f64,
    foot: &dyn Fn(DVec3, f64) -> Option<Foot>,
) -> Vec<f64> {
    let distance = |point: &DVec3| {
        let at = similarity.apply(*point);
        let (place, normal) = foot(at, radius)?;
        Some((at - place).dot(normal).abs())
    };
    let mut all: Vec<f64> = points.iter().filter_map(distance).collect();
    all.sort_unstable_by(f64::total_cmp);
    all
}

struct Step {
    change: Similarity,
    /// Root mean square, metres.
    moved: f64,
}

/// One step of Gauss–Newton.
fn step(
    points: &[DVec3],
    similarity: &Similarity,
    radius: f64,
    foot: &dyn Fn(DVec3, f64) -> Option<Foot>,
) -> Result<Step, SurfaceFitError> {
    let pair = |point: &DVec3| {
        let at = similarity.apply(*point);
        foot(at, radius).map(|(place, normal)| (at, place, normal))
    };
    let pairs: Vec<(DVec3, DVec3, DVec3)> = points.iter().filter_map(pair).collect();
    if pairs.len() < MIN_POINTS {
        return Err(SurfaceFitError::Few { near: pairs.len(), points: points.len(), reach: radius });
    }
    let center = pairs.iter().map(|(at, ..)| *at).sum::<DVec3>() / pairs.len() as f64;
    let square: f64 = pairs.iter().map(|(at, ..)| at.distance_squared(center)).sum();
    // Turning or scaling by 1 moves points about this far.
    let size = (square / pairs.len() as f64).sqrt().max(1e-9);
    let scale = radius / 3.0;
    let (mut information, mut gradient) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
    let mut weights = 0.0;
    for (at, place, normal) in &pairs {
        let distance = (*at - *place).dot(*normal);
        let t = distance / scale;
        let weight = 1.0 / ((1.0 + t * t) * (1.0 + t * t));
        let arm = (*at - center) / size;
        let turn = arm.cross(*normal);
        let row = SVector::<f64, 7>::from([turn.x, turn.y, turn.z, normal.x, normal.y, normal.z, arm.dot(*normal)]);
        information += row * row.transpose() * weight;
        gradient += row * (weight * distance);
        weights += weight;
    }
    if weights < 1e-9 {
        return Err(SurfaceFitError::Few { near: 0, points: points.len(), reach: radius });
    }
    let eigen = SymmetricEigen::new(information / weights);
    if eigen.eigenvalues.iter().any(|value| *value < DETERMINED * DETERMINED) {
        return Err(SurfaceFitError::Slides);
    }
    let inverse = eigen.eigenvectors
        * SMatrix::from_diagonal(&eigen.eigenvalues.map(f64::recip))
        * eigen.eigenvectors.transpose();
    let step = -(inverse * gradient / weights);
    let turn = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]) / size);
    let factor = libm::exp(step[6] / size);
    let shift = DVec3::new(step[3], step[4], step[5]);
    let change = Similarity { scale: factor, rotation: turn, translation: center + shift - turn * center * factor };
    Ok(Step { change, moved: step.norm() })
}

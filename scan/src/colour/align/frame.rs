//! The frame of a reconstruction brought to the survey's.

use super::pairs::{KnownCamera, NamedPair};
use crate::ScanError;
use crate::photos::{Frame, PhotoRecord, PhotoSet};
use glam::DVec3;
use kilwa_scan_core::Pose;
use kilwa_scan_core::photo_pose::icp::{SurfaceFit, SurfaceFitError, fit_to_surface};
use kilwa_scan_core::photo_pose::similarity::{Fit, FrameError, MIN_PAIRS, Pair};
use kilwa_scan_core::photo_pose::{Similarity, Surface};
use std::collections::HashMap;

/// Sparse points are used if at least this many photographs saw them.
const MIN_SEEN: u32 = 2;
/// Sparse points that are used, at most.
const MAX_POINTS: usize = 50_000;
/// How far sparse points may be from the surface at first: this many times the root mean square of the pairs, and at least this share of their extent.
const REACH_PER_RMS: f64 = 5.0;
const REACH_SHARE: f64 = 0.01;

/// Maximum number of cameras without a pose that an error lists.
const NAMED: usize = 5;

/// Where the frame comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Start {
    /// Points that are known in both frames.
    Points(Vec<NamedPair>),
    /// Known positions of cameras.
    Cameras(Vec<KnownCamera>),
    /// The frame itself, in error by at most some metres.
    Given(Similarity, f64),
}

/// The distance that remains at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// The point or photograph.
    pub name: String,
    /// With the frame that was found from these points, metres.
    pub before: f64,
    /// With the final frame, metres.
    pub after: f64,
}

/// A frame, and how good it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Aligned {
    /// Takes coordinates of the reconstruction to those of the survey.
    pub similarity: Similarity,
    /// What remains at control points or known cameras.
    pub residuals: Vec<Residual>,
    /// Their root mean square with the final frame, metres; None without any.
    pub rms: Option<f64>,
    /// How the sparse points lie on the surface, if they were used.
    pub landed: Option<SurfaceFit>,
    /// Why they were not used, although there is a surface.
    pub not_landed: Option<SurfaceFitError>,
    /// Cameras with a known position but without a pose in the reconstruction.
    pub without_pose: Vec<String>,
}

impl Aligned {
    /// Put the photographs of a reconstruction into the survey.
    pub fn apply(&self, set: &mut PhotoSet) {
        for photo in set.photos.iter_mut().filter(|photo| photo.frame == Frame::Reconstruction) {
            if let Some(pose) = photo.camera_from_world {
                photo.camera_from_world = Some(self.similarity.pose(pose));
            }
            photo.frame = Frame::Survey;
        }
        for point in &mut set.sparse_points {
            point.at = self.similarity.apply(point.at);
        }
    }
}

/// Find the frame of a reconstruction. `surface`: the surface of the model, and the distance between its points, metres; without it, the start is the result.
///
/// Sparse points improve the start. If they do not determine the frame (they slide along the surface, too few lie on it), the start is kept and the reason stated.
///
/// # Errors
/// [`ScanError::Request`] if there are too few points, they are on a line, or one contradicts the others; it names the points.
pub fn frame(set: &PhotoSet, start: &Start, surface: Option<(&Surface, f64)>) -> Result<Aligned, ScanError> {
    let (pairs, without_pose) = pairs(set, start)?;
    let sparse: Vec<DVec3> = sparse_points(set);
    let (first, before, reach) = if let Start::Given(similarity, reach) = start {
        (*similarity, Vec::new(), *reach)
    } else {
        let plain: Vec<Pair> = pairs.iter().map(|pair| pair.pair).collect();
        let fit = Similarity::from_pairs(&plain).map_err(|error| refusal(&error, &pairs))?;
        let Fit { similarity, residuals, rms } = fit;
        let extent = extent(&sparse) * similarity.scale;
        (similarity, residuals, (REACH_PER_RMS * rms).max(REACH_SHARE * extent))
    };
    let (mut similarity, mut landed, mut not_landed) = (first, None, None);
    if let Some((surface, spacing)) = surface.filter(|_| !sparse.is_empty()) {
        match fit_to_surface(&sparse, &first, reach, surface, spacing) {
            Ok(found) => {
                similarity = found.similarity;
                landed = Some(found);
            }
            Err(error) => not_landed = Some(error),
        }
    }
    let residual = |(k, pair): (usize, &NamedPair)| Residual {
        name: pair.name.clone(),
        before: before[k],
        after: similarity.apply(pair.pair.reconstruction).distance(pair.pair.survey),
    };
    let residuals: Vec<Residual> = pairs.iter().enumerate().map(residual).collect();
    let square: f64 = residuals.iter().map(|r| r.after * r.after).sum();
    let rms = (!residuals.is_empty()).then(|| (square / residuals.len() as f64).sqrt());
    Ok(Aligned { similarity, residuals, rms, landed, not_landed, without_pose })
}

/// How many points of a reconstruction are near a surface if its poses are used unchanged, and how many points there are. `surface`: as for [`frame()`].
pub fn near_surface(set: &PhotoSet, (surface, spacing): (&Surface, f64)) -> (usize, usize) {
    let sparse = sparse_points(set);
    let reach = REACH_SHARE * extent(&sparse);
    let is_near = |point: &&DVec3| {
        let nearest = surface.nearest(**point, reach.hypot(spacing));
        nearest.is_some_and(|(foot, normal)| (**point - foot).dot(normal).abs() <= reach)
    };
    (sparse.iter().filter(is_near).count(), sparse.len())
}

/// The points that are known in both frames, and the cameras that are known only in the survey.
fn pairs(set: &PhotoSet, start: &Start) -> Result<(Vec<NamedPair>, Vec<String>), ScanError> {
    let cameras = match start {
        Start::Points(pairs) => return Ok((pairs.clone(), Vec::new())),
        Start::Given(..) => return Ok((Vec::new(), Vec::new())),
        Start::Cameras(cameras) => cameras,
    };
    let of_photo = |photo: &PhotoRecord| (photo.frame == Frame::Reconstruction).then_some(photo.camera_from_world)?;
    let poses: HashMap<&str, Pose> =
        set.photos.iter().filter_map(|photo| Some((photo.name.as_str(), of_photo(photo)?))).collect();
    let (mut pairs, mut without_pose) = (Vec::new(), Vec::new());
    for (name, survey, sigma) in cameras {
        let Some(pose) = poses.get(name.as_str()) else {
            without_pose.push(name.clone());
            continue;
        };
        let reconstruction = pose.inverse().translation;
        pairs.push(NamedPair { name: name.clone(), pair: Pair { survey: *survey, reconstruction, sigma: *sigma } });
    }
    if pairs.len() < MIN_PAIRS && !without_pose.is_empty() {
        let some: Vec<&str> = without_pose.iter().take(NAMED).map(String::as_str).collect();
        let more = if without_pose.len() > NAMED { ", …" } else { "" };
        return Err(ScanError::Request(format!(
            "the reconstruction has poses for only {} of the {} cameras whose positions are known; {MIN_PAIRS} are needed. Check the names of the photographs without a pose: {}{more}",
            pairs.len(),
            cameras.len(),
            some.join(", ")
        )));
    }
    Ok((pairs, without_pose))
}

/// Sparse points that enough photographs saw, evenly chosen if there are very many.
fn sparse_points(set: &PhotoSet) -> Vec<DVec3> {
    let good = || set.sparse_points.iter().filter(|point| point.seen >= MIN_SEEN && point.at.is_finite());
    let step = good().count().div_ceil(MAX_POINTS).max(1);
    good().step_by(step).map(|point| point.at).collect()
}

/// How far apart most points are: between the 5th and the 95th percentile along the longest axis.
fn extent(points: &[DVec3]) -> f64 {
    let along = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        let at =
            |share: f64| values.get((share * values.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0);
        at(0.95) - at(0.05)
    };
    (0..3).map(along).fold(0.0, f64::max)
}

/// The error in words, with the names of the points.
fn refusal(error: &FrameError, pairs: &[NamedPair]) -> ScanError {
    let name = |pair: usize| pairs.get(pair).map_or("?", |pair| pair.name.as_str());
    let text = match *error {
        FrameError::Unusable { pair } => {
            format!("{} has a coordinate that is not finite or a standard deviation that is not positive", name(pair))
        }
        FrameError::Contradiction { pair, distance, expected } => format!(
            "{} contradicts the other points: it is {distance:.3} m from where they place it (expected: at most {expected:.3} m); correct it or leave it out",
            name(pair)
        ),
        FrameError::Contradictions { pair, distance, expected } => format!(
            "the points that are known in the reconstruction and in the survey contradict each other: {} is {distance:.3} m off (at most {expected:.3} m), and leaving out a single point does not help. Check all points, and check that the axes are in the same order",
            name(pair)
        ),
        FrameError::Few { .. } | FrameError::Line => error.to_string(),
    };
    ScanError::Request(format!("the frame of the reconstruction cannot be found: {text}"))
}

//! Joint adjustment of all poses: the distances between the surfaces of all stations are minimised together, and the residuals determine the uncertainty of the poses.
//!
//! Point-to-plane distances of every pair of stations that see the same surface go into one system of normal equations (Bergevin et al., "Towards a
//! general multi-view registration technique", 1996), which is solved by the Gauss–Newton method. Errors of neighbouring planes are not independent:
//! they share the same relief, edges and samples. The covariance is therefore the sandwich estimate for clusters (Liang and Zeger, "Longitudinal data
//! analysis using generalized linear models", 1986), where a cluster is a cube of space: any correlation of the distances within a cube is accounted for.

use super::cloud::Cloud;
use super::fit::{Match, moved};
use super::image::{Image, Point, Surface};
use crate::Pose;
use glam::{DVec3, IVec3};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix6, SMatrix, SVector, Vector6};
use std::collections::BTreeMap;

/// Sample spacing beyond which the surface between samples is considered uncertain, metres.
const FINE: f64 = 0.01;

/// Normal equations of a pair: the six unknowns of the first station, then those of the second.
type Matrix12 = SMatrix<f64, 12, 12>;
type Vector12 = SVector<f64, 12>;

/// The surface that a station saw.
#[derive(Debug, Clone)]
pub enum Shape {
    /// As a function of direction.
    Image(Image),
    /// For a point cloud without a grid.
    Cloud(Cloud),
}

impl Shape {
    fn surface(&self, place: DVec3) -> Option<Surface> {
        match self {
            Self::Image(image) => image.surface(place),
            Self::Cloud(cloud) => cloud.surface(place),
        }
    }
}

/// A station of an adjustment.
#[derive(Debug, Clone, Copy)]
pub struct Party<'a> {
    /// The surface that it saw.
    pub shape: &'a Shape,
    /// Some of its samples, spread evenly over the surface.
    pub samples: &'a [Point],
    /// `survey_from_station`.
    pub pose: Pose,
}

/// How distances are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// The maximum distance between matching surfaces, metres.
    pub reach: f64,
    /// The scale of the robust weights, metres.
    pub sigma: f64,
    /// The edge of the cubes within which errors may be correlated, metres; 0: no clusters are collected.
    pub cluster: f64,
}

/// The normal equations of a pair of stations.
#[derive(Debug, Clone)]
pub struct Link {
    information: Matrix12,
    gradient: Vector12,
    /// The gradient of each cube of space.
    clusters: Vec<(IVec3, Vector12)>,
    /// Number of samples that were matched.
    pub matched: usize,
    /// The weighted sum of squared distances (square metres), and the sum of the weights.
    pub squares: [f64; 2],
    /// Absolute distances, metres.
    pub distances: Vec<f32>,
}

impl Link {
    /// Compare two stations: the samples of each with the surface of the other.
    pub fn compare(a: Party<'_>, b: Party<'_>, reach: Reach) -> Self {
        let mut link = Self {
            information: Matrix12::zeros(),
            gradient: Vector12::zeros(),
            clusters: Vec::new(),
            matched: 0,
            squares: [0.0; 2],
            distances: Vec::new(),
        };
        let mut clusters: BTreeMap<[i32; 3], Vector12> = BTreeMap::new();
        for (target, source, sign) in [(a, b, 1.0), (b, a, -1.0)] {
            let target_from_source = source.pose.then(target.pose.inverse());
            for sample in source.samples {
                let Some(found) = find(target.shape, sample, target_from_source, reach.reach) else { continue };
                let found = found.seen_from(target.pose);
                let w = found.weight(reach.sigma);
                // The distance is the signed height of the source above the target: moving the second station forwards has the opposite effect to moving the first.
                let (ja, jb) = (found.jacobian(a.pose.translation) * -sign, found.jacobian(b.pose.translation) * sign);
                let mut j = Vector12::zeros();
                j.fixed_rows_mut::<6>(0).copy_from(&ja);
                j.fixed_rows_mut::<6>(6).copy_from(&jb);
                link.information += j * j.transpose() * w;
                let part = j * (w * found.distance);
                link.gradient += part;
                if reach.cluster > 0.0 {
                    let cube = (found.position / reach.cluster).floor().as_ivec3().to_array();
                    *clusters.entry(cube).or_default() += part;
                }
                link.matched += 1;
                link.squares[0] += w * found.distance * found.distance;
                link.squares[1] += w;
                link.distances.push(found.distance.abs() as f32);
            }
        }
        link.clusters = clusters.into_iter().map(|(cube, part)| (IVec3::from_array(cube), part)).collect();
        link
    }

    /// The root mean square distance, metres.
    pub fn residual(&self) -> f64 {
        (self.squares[0] / self.squares[1].max(1e-12)).sqrt()
    }

    /// The information matrix of the pose of the second station relative to the first, from this pair alone.
    pub fn information(&self) -> Matrix6<f64> {
        self.information.fixed_view::<6, 6>(6, 6).into_owned()
    }

    /// The covariance of the pose of the second station relative to the first, from this pair alone, as a sandwich estimate; `None` if the pose is not fully determined.
    pub fn covariance(&self) -> Option<Matrix6<f64>> {
        let inverse = Cholesky::new(self.information())?.inverse();
        let mut meat = Matrix6::zeros();
        for (_, part) in &self.clusters {
            let g = part.fixed_rows::<6>(6);
            meat += g * g.transpose();
        }
        Some(inverse * meat * inverse)
    }
}

/// The signed distance of a sample of one station from the surface of another, metres (positive: nearer to the scanner of the other), and its weight;
/// `None` if the other did not see the same surface within `reach` metres.
pub fn distance(target: &Shape, sample: &Point, target_from_source: Pose, reach: f64) -> Option<(f64, f64)> {
    find(target, sample, target_from_source, reach).map(|found| (found.distance, found.share))
}

/// Matches a sample of the source with the surface of the target.
fn find(target: &Shape, sample: &Point, target_from_source: Pose, reach: f64) -> Option<Match> {
    let own = &sample.surface;
    let position = target_from_source.apply(sample.position);
    let surface = target.surface(position)?;
    let normal = target_from_source.rotation * own.normal;
    if surface.normal.dot(normal) < 0.7 {
        return None;
    }
    let distance = position.dot(surface.normal) - surface.offset;
    // Where samples are far apart, the surface between them is uncertain; at grazing incidence, part of it is hidden.
    let share = surface.facing * own.facing / (1.0 + (surface.spacing / FINE).powi(2));
    (distance.abs() <= reach).then_some(Match {
        position,
        normal: surface.normal,
        distance,
        share,
        normal_variance: 0.0,
    })
}

/// A prior: a known pose with its information matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// The number of the station.
    pub station: usize,
    /// The deviation of the pose from the known one: rotation, translation.
    pub error: Vector6<f64>,
    /// The inverse of its covariance.
    pub information: Matrix6<f64>,
}

/// The system of normal equations of all stations that can move.
#[derive(Debug)]
pub struct System {
    /// The index of the unknowns of each station; `None` for those that cannot move.
    places: Vec<Option<usize>>,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    clusters: BTreeMap<[i32; 3], BTreeMap<usize, Vector6<f64>>>,
    /// The part of the information that comes from priors and control points, whose standard deviations are taken as stated.
    known: DMatrix<f64>,
}

impl System {
    /// A system without equations; `is_fixed`: the stations that cannot move.
    pub fn new(is_fixed: &[bool]) -> Self {
        let mut next = 0;
        let place = |fixed: &bool| {
            let place = (!fixed).then_some(next);
            next += usize::from(!fixed);
            place
        };
        let places: Vec<Option<usize>> = is_fixed.iter().map(place).collect();
        Self {
            information: DMatrix::zeros(6 * next, 6 * next),
            gradient: DVector::zeros(6 * next),
            clusters: BTreeMap::new(),
            known: DMatrix::zeros(6 * next, 6 * next),
            places,
        }
    }

    /// Add the equations of the stations `a` and `b`.
    pub fn add(&mut self, a: usize, b: usize, link: &Link) {
        let own = [self.places[a], self.places[b]];
        for (i, row) in own.iter().enumerate() {
            let Some(row) = row else { continue };
            let part = link.gradient.fixed_rows::<6>(6 * i);
            let mut sum = self.gradient.fixed_rows_mut::<6>(6 * row);
            sum += part;
            for (k, column) in own.iter().enumerate() {
                let Some(column) = column else { continue };
                let block = link.information.fixed_view::<6, 6>(6 * i, 6 * k).into_owned();
                let mut view = self.information.fixed_view_mut::<6, 6>(6 * row, 6 * column);
                view += block;
            }
        }
        for (cube, part) in &link.clusters {
            let entry = self.clusters.entry(cube.to_array()).or_default();
            for (i, row) in own.iter().enumerate() {
                if let Some(row) = row {
                    *entry.entry(*row).or_default() += part.fixed_rows::<6>(6 * i);
                }
            }
        }
    }

    /// Add a control point that two stations observed, each in its own coordinates (`a` is `None` if the survey coordinates are `known`). `sigma`:
    /// the standard deviation of each coordinate of their difference, metres. `variance`: that of a
    /// surface distance, square metres.
    pub fn add_point(
        &mut self,
        a: Option<(usize, Pose, DVec3)>,
        b: (usize, Pose, DVec3),
        known: DVec3,
        sigma: f64,
        variance: f64,
    ) {
        let weight = variance / (sigma * sigma);
        let at = |(_, pose, p): (usize, Pose, DVec3)| pose.apply(p);
        let difference = at(b) - a.map_or(known, at);
        for axis in DVec3::AXES {
            let row = |(station, pose, p): (usize, Pose, DVec3), sign: f64| {
                let c = (pose.apply(p) - pose.translation).cross(axis) * sign;
                let n = axis * sign;
                (self.places[station], Vector6::new(c.x, c.y, c.z, n.x, n.y, n.z))
            };
            let rows: Vec<(Option<usize>, Vector6<f64>)> =
                a.map(|a| row(a, -1.0)).into_iter().chain([row(b, 1.0)]).collect();
            for (place, j) in &rows {
                let Some(place) = place else { continue };
                let mut sum = self.gradient.fixed_rows_mut::<6>(6 * place);
                sum += j * (weight * difference.dot(axis));
                for (other, k) in &rows {
                    let Some(other) = other else { continue };
                    let block = j * k.transpose() * weight;
                    let mut view = self.information.fixed_view_mut::<6, 6>(6 * place, 6 * other);
                    view += block;
                    // Its error is independent of all others and has the stated standard deviation.
                    let mut view = self.known.fixed_view_mut::<6, 6>(6 * place, 6 * other);
                    view += block;
                }
            }
        }
    }

    /// Add a prior; `variance` is that of a distance, square metres.
    pub fn add_prior(&mut self, prior: &Prior, variance: f64) {
        let Some(row) = self.places[prior.station] else { return };
        let information = prior.information * variance;
        let mut view = self.information.fixed_view_mut::<6, 6>(6 * row, 6 * row);
        view += information;
        let mut view = self.known.fixed_view_mut::<6, 6>(6 * row, 6 * row);
        view += information;
        let mut own = self.gradient.fixed_rows_mut::<6>(6 * row);
        own += information * prior.error;
    }

    fn factor(&self, damping: f64) -> Option<Cholesky<f64, Dyn>> {
        let mut information = self.information.clone();
        // Undetermined directions stay as they are.
        let n = information.nrows();
        let damping = damping * information.trace() / n.max(1) as f64;
        for k in 0..n {
            information[(k, k)] += damping;
        }
        Cholesky::new(information)
    }

    /// Move the poses to the solution. Returns the largest rotation and translation (radians, metres), or `None` if there is no solution.
    pub fn solve(&self, poses: &mut [Pose]) -> Option<[f64; 2]> {
        let step = -self.factor(1e-9)?.solve(&self.gradient);
        let mut most = [0.0_f64; 2];
        for (pose, place) in poses.iter_mut().zip(&self.places) {
            let Some(place) = place else { continue };
            let own: Vector6<f64> = step.fixed_rows::<6>(6 * place).into_owned();
            *pose = moved(*pose, &own);
            most[0] = most[0].max(own.fixed_rows::<3>(0).norm());
            most[1] = most[1].max(own.fixed_rows::<3>(3).norm());
        }
        Some(most)
    }

    /// The covariance of every station's pose, zero for those that cannot move; `variance` is that of a distance. `None` if there is no solution.
    pub fn covariances(&self, variance: f64, caution: f64) -> Option<Vec<Matrix6<f64>>> {
        // Approximate known poses may locate the survey with a weight many orders of magnitude smaller than that of the surfaces; damping must not add to it.
        let inverse = self.factor(1e-14)?.inverse();
        let n = inverse.nrows();
        let mut meat = DMatrix::<f64>::zeros(n, n);
        for parts in self.clusters.values() {
            for (row, a) in parts {
                for (column, b) in parts {
                    let mut view = meat.fixed_view_mut::<6, 6>(6 * row, 6 * column);
                    view += a * b.transpose();
                }
            }
        }
        // Residuals underestimate errors, because the poses are fitted to them; with few clusters, the difference is noticeable.
        let clusters = self.clusters.len() as f64;
        meat *= caution * clusters / (clusters - n as f64).max(0.1 * clusters).max(1.0);
        meat += &self.known * variance;
        let covariance = &inverse * meat * &inverse;
        let own = |place: &Option<usize>| {
            place.map_or_else(Matrix6::zeros, |k| covariance.fixed_view::<6, 6>(6 * k, 6 * k).into_owned())
        };
        Some(self.places.iter().map(own).collect())
    }
}

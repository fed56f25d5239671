//! The surface that a station saw, as small planes: the plane through the points of each voxel of a grid, for several voxel sizes.
//!
//! A plane through a dozen points is more precise than each of them, and every square metre has the same number of planes, near or far, so that
//! densely scanned parts do not outweigh the rest (the covariance of points in a voxel as in Biber and Straßer, "The normal distributions
//! transform", 2003; voxels of surfaces as in Koide et al., "Voxelized GICP for fast and accurate 3D point cloud registration", 2021).

use glam::{DVec3, IVec3};
use nalgebra::{Matrix3, SymmetricEigen};
use rustc_hash::{FxHashMap, FxHashSet};

/// Number of voxel sizes; each is twice the previous one.
pub const LEVELS: usize = 4;
/// Fewest points that define a plane.
const MIN_POINTS: u32 = 6;
/// A voxel holds a plane if the smallest of its three variances is at most this share of the second, and the second at least that share of the largest.
const FLAT: f64 = 0.1;
const WIDE: f64 = 0.08;

/// A small plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// The mean of its points, metres, in the coordinates of the station.
    pub position: DVec3,
    /// Unit normal, towards the scanner.
    pub normal: DVec3,
    /// Root mean square distance of its points from the plane, metres.
    pub roughness: f64,
    /// Edge of its voxel, metres.
    pub edge: f64,
    /// Number of its points.
    pub points: u32,
    /// Cosine of the angle at which the scanner saw it.
    pub facing: f64,
    /// Standard deviation of its points along the second principal axis, metres.
    pub spread: f64,
}

impl Surfel {
    /// The variance of the direction of the normal, square radians, assuming independent distances of the points from the plane.
    pub fn normal_variance(&self) -> f64 {
        (self.roughness / self.spread).powi(2) / f64::from(self.points)
    }
}

/// Sums of the points of a voxel.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    points: u32,
    sum: DVec3,
    /// xx, yy, zz.
    squares: DVec3,
    /// yz, zx, xy.
    products: DVec3,
    towards: DVec3,
}

impl Sums {
    fn add(&mut self, p: DVec3, towards: DVec3) {
        self.points += 1;
        self.sum += p;
        self.squares += p * p;
        self.products += DVec3::new(p.y * p.z, p.z * p.x, p.x * p.y);
        self.towards += towards;
    }

    fn join(&mut self, other: &Self) {
        self.points += other.points;
        self.sum += other.sum;
        self.squares += other.squares;
        self.products += other.products;
        self.towards += other.towards;
    }

    fn surfel(&self, edge: f64) -> Option<Surfel> {
        if self.points < MIN_POINTS {
            return None;
        }
        let n = f64::from(self.points);
        let mean = self.sum / n;
        let d = self.squares / n - mean * mean;
        let o = self.products / n - DVec3::new(mean.y * mean.z, mean.z * mean.x, mean.x * mean.y);
        let eigen = SymmetricEigen::new(Matrix3::new(d.x, o.z, o.y, o.z, d.y, o.x, o.y, o.x, d.z));
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        let [least, middle, most] = order.map(|k| eigen.eigenvalues[k].max(0.0));
        if least > FLAT * middle || middle < WIDE * most || middle <= 0.0 {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]);
        let normal = DVec3::new(normal[0], normal[1], normal[2]).normalize_or_zero();
        let normal = if normal.dot(self.towards) < 0.0 { -normal } else { normal };
        let facing = normal.dot(self.towards.normalize_or_zero());
        Some(Surfel {
            position: mean,
            normal,
            roughness: least.sqrt(),
            edge,
            points: self.points,
            facing,
            spread: middle.sqrt(),
        })
    }
}

/// Collects the points of a station.
#[derive(Debug, Clone)]
pub struct Collector {
    edge: f64,
    voxels: FxHashMap<IVec3, Sums>,
}

impl Collector {
    /// `edge`: the edge of the voxels at the finest level, metres.
    pub fn new(edge: f64) -> Self {
        Self { edge, voxels: FxHashMap::default() }
    }

    /// Add a point, and the unit vector from it to the scanner.
    pub fn add(&mut self, point: DVec3, towards: DVec3) {
        self.voxels.entry(voxel_of(point, self.edge)).or_default().add(point, towards);
    }

    /// The planes at every level.
    pub fn finish(self) -> Surfels {
        let mut levels = Vec::with_capacity(LEVELS);
        let (mut edge, mut voxels) = (self.edge, self.voxels);
        let mut near = FxHashSet::default();
        for number in 0..LEVELS {
            // Sorted, so that the order does not depend on the hash table.
            let mut sorted: Vec<(IVec3, Sums)> = voxels.into_iter().collect();
            sorted.sort_unstable_by_key(|(voxel, _)| voxel.to_array());
            let mut level = Level { edge, surfels: Vec::new(), voxels: Vec::new(), at: FxHashMap::default() };
            let mut parents: FxHashMap<IVec3, Sums> = FxHashMap::default();
            for (voxel, sums) in &sorted {
                if let Some(surfel) = sums.surfel(edge) {
                    level.at.insert(*voxel, level.surfels.len() as u32);
                    level.surfels.push(surfel);
                    level.voxels.push(*voxel);
                }
                parents.entry(voxel.map(|v| v.div_euclid(2))).or_default().join(sums);
                if number + 1 == LEVELS {
                    near.extend(around(*voxel));
                }
            }
            levels.push(level);
            voxels = parents;
            edge *= 2.0;
        }
        Surfels { levels, near }
    }
}

/// The voxel of a position. Faster than the software implementation of `floor`, with the same results.
fn voxel_of(position: DVec3, edge: f64) -> IVec3 {
    let floor = |v: f64| {
        let whole = v as i32;
        whole.saturating_sub(i32::from(v < f64::from(whole)))
    };
    let place = position / edge;
    IVec3::new(floor(place.x), floor(place.y), floor(place.z))
}

/// A voxel and its 26 neighbours.
fn around(voxel: IVec3) -> impl Iterator<Item = IVec3> {
    (0..27).map(move |k| voxel.saturating_add(IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1)))
}

#[derive(Debug, Clone)]
struct Level {
    edge: f64,
    surfels: Vec<Surfel>,
    voxels: Vec<IVec3>,
    at: FxHashMap<IVec3, u32>,
}

/// The surface of a station as planes.
#[derive(Debug, Clone)]
pub struct Surfels {
    levels: Vec<Level>,
    /// The voxels at the coarsest level that contain points, and their neighbours: elsewhere, there is no plane at any level.
    near: FxHashSet<IVec3>,
}

impl Surfels {
    /// The edge of the voxels of a level, metres.
    pub fn edge(&self, level: usize) -> f64 {
        self.levels[level].edge
    }

    /// The planes of a level.
    pub fn level(&self, level: usize) -> &[Surfel] {
        &self.levels[level].surfels
    }

    /// The whole surface without duplication: the planes of `level`, and larger ones where there are none at that level.
    pub fn cover(&self, level: usize) -> Vec<Surfel> {
        let mut out = self.levels[level].surfels.clone();
        let mut covered: FxHashSet<IVec3> = self.levels[level].voxels.iter().copied().collect();
        for next in level + 1..LEVELS {
            covered = covered.into_iter().map(|v| v.map(|v| v.div_euclid(2))).collect();
            for (surfel, voxel) in self.levels[next].surfels.iter().zip(&self.levels[next].voxels) {
                if covered.insert(*voxel) {
                    out.push(*surfel);
                }
            }
        }
        out
    }

    /// The plane that matches `surfel` (in the coordinates of this station): of the planes at `level` or coarser in the voxels in front of it, at it and behind it, the nearest with a similar normal.
    /// `reach` is the maximum distance between the planes, metres. `None` if there is none.
    pub fn find(&self, level: usize, position: DVec3, normal: DVec3, reach: f64) -> Option<&Surfel> {
        /// Cosine of the maximum angle between normals.
        const SIMILAR: f64 = 0.8;
        // Planes are looked for up to half an edge away, so at most one voxel away at the coarsest level. Most positions are not near any.
        if !self.near.contains(&voxel_of(position, self.levels[LEVELS - 1].edge)) {
            return None;
        }
        let mut best: Option<(f64, &Surfel)> = None;
        for level in &self.levels[level..] {
            let mut last = IVec3::MAX;
            for step in [0.0, -0.5, 0.5] {
                let voxel = voxel_of(position + normal * (step * level.edge), level.edge);
                if voxel == last {
                    continue;
                }
                last = voxel;
                let Some(found) = level.at.get(&voxel).map(|k| &level.surfels[*k as usize]) else { continue };
                if found.normal.dot(normal) < SIMILAR {
                    continue;
                }
                let distance = (position - found.position).dot(found.normal).abs();
                if distance <= reach && best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, found));
                }
            }
            if best.is_some() {
                break;
            }
        }
        best.map(|(_, surfel)| surfel)
    }
}

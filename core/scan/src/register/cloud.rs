//! The surface of a point cloud without a grid: the plane through the neighbours of the nearest point.

use super::image::{Point, Surface};
use glam::{DVec3, IVec3, Vec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rustc_hash::{FxHashMap, FxHashSet};

/// Edge of the cells in which neighbours are searched, as a multiple of the point spacing.
const CELL: f64 = 3.0;
/// Points closer to each other than this many spacings count as one.
const SAME: f64 = 0.3;
/// Minimum number of neighbours that define a plane.
const MIN_NEIGHBOURS: usize = 6;
/// Maximum root mean square distance of neighbours from their plane, as a share of their spread along it.
const FLAT: f64 = 0.5;

/// Points with their normals.
#[derive(Debug, Clone)]
pub struct Cloud {
    spacing: f64,
    points: Vec<Vec3>,
    /// Unit normals towards the scanner; zero where the neighbours do not define one.
    normals: Vec<Vec3>,
    /// Indices of the points in each cell.
    cells: FxHashMap<IVec3, Vec<u32>>,
}

/// Collects points.
#[derive(Debug, Clone)]
pub struct Collector {
    spacing: f64,
    taken: FxHashSet<IVec3>,
    points: Vec<Vec3>,
}

impl Collector {
    /// `spacing`: the approximate distance between points, metres.
    pub fn new(spacing: f64) -> Self {
        Self { spacing, taken: FxHashSet::default(), points: Vec::new() }
    }

    /// Add a point, in coordinates of the station.
    pub fn add(&mut self, point: Vec3) {
        if self.taken.insert(cell(point.as_dvec3(), SAME * self.spacing)) {
            self.points.push(point);
        }
    }

    /// The cloud, and a subset of its points with their surfaces: one per cube of `edge` metres.
    pub fn finish(self, edge: f64) -> (Cloud, Vec<Point>) {
        let Self { spacing, points, .. } = self;
        let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
        for (number, point) in points.iter().enumerate() {
            cells.entry(cell(point.as_dvec3(), CELL * spacing)).or_default().push(number as u32);
        }
        let mut cloud = Cloud { spacing, points, normals: Vec::new(), cells };
        cloud.normals = cloud.points.iter().map(|p| cloud.normal(p.as_dvec3()).unwrap_or_default().as_vec3()).collect();
        let (mut taken, mut out) = (FxHashSet::default(), Vec::new());
        for number in 0..cloud.points.len() {
            let position = cloud.points[number].as_dvec3();
            let Some(surface) = cloud.plane(number) else { continue };
            if taken.insert(cell(position, edge)) {
                out.push(Point { position, surface });
            }
        }
        (cloud, out)
    }
}

fn cell(p: DVec3, edge: f64) -> IVec3 {
    (p / edge).floor().as_ivec3()
}

impl Cloud {
    fn around(&self, place: DVec3) -> impl Iterator<Item = u32> + '_ {
        let middle = cell(place, CELL * self.spacing);
        let near = (0..27).map(move |k| middle.saturating_add(IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1)));
        near.filter_map(|cell| self.cells.get(&cell)).flatten().copied()
    }

    /// The normal of the plane through the points around a position.
    fn normal(&self, place: DVec3) -> Option<DVec3> {
        let near = CELL * self.spacing;
        let all: Vec<DVec3> = self.around(place).map(|k| self.points[k as usize].as_dvec3()).collect();
        let all: Vec<DVec3> = all.into_iter().filter(|p| p.distance_squared(place) <= near * near).collect();
        if all.len() < MIN_NEIGHBOURS {
            return None;
        }
        let mean = all.iter().sum::<DVec3>() / all.len() as f64;
        let mut spread = Matrix3::zeros();
        for p in &all {
            let d = Vector3::from((*p - mean).to_array());
            spread += d * d.transpose();
        }
        let eigen = SymmetricEigen::new(spread / all.len() as f64);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        if eigen.eigenvalues[order[0]] > FLAT * FLAT * eigen.eigenvalues[order[1]] {
            return None;
        }
        let normal = eigen.eigenvectors.column(order[0]);
        let normal = DVec3::new(normal[0], normal[1], normal[2]).try_normalize()?;
        Some(if normal.dot(place) > 0.0 { -normal } else { normal })
    }

    fn plane(&self, number: usize) -> Option<Surface> {
        let (position, normal) = (self.points[number].as_dvec3(), self.normals[number].as_dvec3());
        let normal = normal.try_normalize()?;
        // The scanner position of a cloud is often unknown, so the angle of incidence does not affect the weight.
        Some(Surface { normal, offset: normal.dot(position), facing: 1.0, spacing: self.spacing })
    }

    /// The surface at the point nearest to a position, in coordinates of the station; `None` if there is none in the cells around it.
    pub fn surface(&self, place: DVec3) -> Option<Surface> {
        let distance = |k: &u32| self.points[*k as usize].as_dvec3().distance_squared(place);
        let nearest = self.around(place).min_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)))?;
        self.plane(nearest as usize)
    }
}

//! The data of a station that registration needs: planes, walls and floors seen from above, and the nearest range in every direction.

use crate::ScanError;
use crate::import::Progress;
use crate::mask;
use crate::points::points;
use crate::spool::Reader;
use crate::survey::Station;
use glam::{DVec3, Vec3};
use kilwa_scan_core::mask::through::{RangeImage, Seen};
use kilwa_scan_core::register::adjust::Shape;
use kilwa_scan_core::register::cloud;
use kilwa_scan_core::register::correlate::Plan;
use kilwa_scan_core::register::image::{self, Point};
use kilwa_scan_core::register::surfels::{Collector, LEVELS, Surfel, Surfels};
use kilwa_scan_core::{Pose, Rays, tessellate};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points with a smaller cosine of the incidence angle are left out: they are far apart along the surface, and many are mixed pixels between two surfaces.
const MIN_COS: f64 = 0.15;
/// The same for planes that are compared with the range image of another station.
const MIN_LOOK: f64 = 0.2;
/// The width of a pixel, as a multiple of the ray spacing, so that nearly every pixel has a sample.
const PIXEL: f64 = 1.3;
/// Width of a range image, pixels.
const WIDTH: f64 = 1440.0;
/// The edge of the smallest voxels, as a multiple of the point spacing.
const EDGE: f64 = 4.0;
/// The smallest angle between rays that counts for this edge, radians: in denser scans, each plane is fitted to more points, and the number of planes does not grow.
const FINEST: f64 = std::f64::consts::TAU / WIDTH;
/// Number of azimuth steps of the horizontal range of view, and the maximum elevation at which a ray counts as horizontal, radians.
const HORIZON: usize = 360;
const BAND: f64 = 0.04;
/// Spacing of the points of a cloud without a grid that are used in the adjustment: one per cube, whose edge is this share of a voxel edge.
const CLOUD_SHARE: f64 = 0.5;
/// Maximum number of points that are kept of a cloud without a grid. Each takes about 80 bytes.
const MAX_CLOUD: u64 = 400_000;
/// Minimum number of points needed to estimate a spacing, and the minimum spacing, metres.
const MIN_MEASURED: u64 = 100;
const MIN_SPACING: f64 = 1e-5;
/// Number of cells that are read at a time.
const BATCH: u64 = 65_536;
/// Number of planes of a station that are compared to check a candidate pose.
const SAMPLES: usize = 1500;

/// A station in a registration.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub(super) surfels: Surfels,
    /// Every part of the surface once, at the smallest size.
    pub(super) fine: Vec<Surfel>,
    /// The same at the second size, thinned out evenly.
    pub(super) samples: Vec<Surfel>,
    pub(super) plan: Plan,
    rays: Rays,
    /// `None` where rays are parallel.
    pub(super) image: Option<RangeImage>,
    /// The surface at the resolution of its samples, and evenly spaced samples on it.
    pub(super) shape: Shape,
    pub(super) points: Vec<Point>,
}

/// The spacing of the points of a station, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Spacing {
    /// The median.
    median: f64,
    /// The median if no rays of a grid were less than [`FINEST`] apart.
    limited: f64,
}

/// The spacing of the points of a station; `None` if there are too few.
fn spacing(folder: &Path, station: &Station) -> Result<Option<Spacing>, ScanError> {
    const LINES: u32 = 64;
    let mut reader = mask::open(folder, station, false)?;
    let header = *reader.header();
    let measured = header.statistics.measured;
    if measured < MIN_MEASURED {
        return Ok(None);
    }
    if !header.is_grid {
        return cloud_spacing(&mut reader);
    }
    let finest = |p: Vec3| if header.rays == Rays::Central { FINEST * p.as_dvec3().length() } else { 0.0 };
    let lines = header.grid.lines();
    let (mut line, mut next, mut all) = (Vec::new(), Vec::new(), Vec::new());
    let every = lines.div_ceil(LINES).max(1) as usize;
    for number in (0..lines.saturating_sub(1)).step_by(every) {
        reader.line(number, &mut line)?;
        reader.line(number + 1, &mut next)?;
        for (k, sample) in line.iter().enumerate().filter(|(_, s)| s.is_measured()) {
            let beside = [line.get(k + 1), next.get(k)].map(|other| {
                other.filter(|o| o.is_measured()).map(|o| header.rays.spacing(sample.position, o.position))
            });
            if let [Some(a), Some(b)] = beside {
                all.push((a.max(b), finest(sample.position)));
            }
        }
    }
    all.retain(|(spacing, _)| *spacing > 0.0);
    let median = |of: &dyn Fn(&(f64, f64)) -> f64| {
        let mut values: Vec<f64> = all.iter().map(of).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let limited = median(&|(spacing, finest)| spacing.max(*finest));
    Ok(median(&|(spacing, _)| *spacing).zip(limited).map(|(median, limited)| Spacing { median, limited }))
}

/// The point spacing of a cloud without a grid, estimated as if the points were evenly spread over the occupied cells of a coarse grid.
fn cloud_spacing(reader: &mut Reader) -> Result<Option<Spacing>, ScanError> {
    let [low, high] = reader.header().statistics.bounds;
    let edge = f64::from((high - low).max_element()) / 64.0;
    // All points in one place have no spacing.
    if edge < MIN_SPACING {
        return Ok(None);
    }
    let (mut occupied, mut count) = (std::collections::HashSet::new(), 0_u64);
    each_sample(reader, &mut |sample| {
        occupied.insert((sample.as_dvec3() / edge).floor().as_ivec3());
        count += 1;
    })?;
    let median = (edge * (occupied.len().max(1) as f64 / count.max(1) as f64).sqrt()).max(MIN_SPACING);
    // The origin of a cloud need not be the scanner, so ranges are unknown.
    Ok(Some(Spacing { median, limited: median }))
}

/// The edge of the smallest voxels for stations whose points have these (limited) median spacings, metres.
pub(super) fn edge(mut spacings: Vec<f64>) -> f64 {
    spacings.sort_unstable_by(f64::total_cmp);
    EDGE * spacings.get(spacings.len() / 2).copied().unwrap_or(0.02)
}

/// What every station saw, and the edge of the smallest voxels, metres.
pub(super) fn load_all(
    folder: &Path,
    stations: &[&Station],
    progress: &(dyn Progress + Sync),
) -> Result<(Vec<View>, f64), ScanError> {
    let (done, total) = (AtomicU64::new(0), 2 * stations.len() as u64);
    let step = || {
        progress.update("reading stations", done.fetch_add(1, Ordering::Relaxed) + 1, total);
        if progress.is_stopped() { Err(ScanError::Stopped) } else { Ok(()) }
    };
    let spacings = stations.par_iter().map(|station| {
        step()?;
        spacing(folder, station)
    });
    let spacings: Vec<Option<Spacing>> = spacings.collect::<Result<_, _>>()?;
    let edge = edge(spacings.iter().flatten().map(|spacing| spacing.limited).collect());
    let views = stations.par_iter().zip(&spacings).map(|(station, spacing)| {
        step()?;
        View::load(folder, station, edge, spacing.map_or(edge, |spacing| spacing.median))
    });
    Ok((views.collect::<Result<_, _>>()?, edge))
}

impl View {
    pub(super) fn load(folder: &Path, station: &Station, edge: f64, own_spacing: f64) -> Result<Self, ScanError> {
        let mut reader = mask::open(folder, station, false)?;
        let rays = reader.header().rays;
        let mut collector = Collector::new(edge);
        let options = tessellate::Options::default();
        points(&mut reader, Pose::IDENTITY, &options, &mut |points, _, _| {
            for point in points {
                let towards = -rays.direction(point.position.as_vec3());
                if point.normal.dot(towards) >= MIN_COS {
                    collector.add(point.position, towards);
                }
            }
            Ok(())
        })?;
        let image = if rays == Rays::Central { Some(image(folder, station)?) } else { None };
        let surfels = collector.finish();
        let fine = surfels.cover(0);
        let coarse = surfels.cover(1);
        let every = coarse.len().div_ceil(SAMPLES).max(1);
        let samples = coarse.iter().step_by(every).copied().collect();
        let horizon = image.as_ref().map_or_else(Vec::new, |image| image.horizon(HORIZON, BAND));
        let (shape, points) = shape(&mut reader, own_spacing, edge)?;
        Ok(Self { plan: Plan::new(&coarse, horizon), fine, samples, surfels, rays, image, shape, points })
    }

    /// A station with these data, for tests of comparisons.
    #[cfg(test)]
    pub(super) fn for_test(
        surfels: Surfels,
        samples: Vec<Surfel>,
        image: RangeImage,
        shape: Shape,
        points: Vec<Point>,
    ) -> Self {
        let (fine, image) = (samples.clone(), Some(image));
        Self { surfels, fine, samples, plan: Plan::default(), rays: Rays::Central, image, shape, points }
    }

    /// The indices of the planes of another station that rays of this one pass through.
    pub(super) fn through(&self, source: &[Surfel], own_from_source: Pose, margin: f64) -> Vec<usize> {
        let is_through = |surfel: &Surfel| {
            let position = own_from_source.apply(surfel.position);
            let facing = (own_from_source.rotation * surfel.normal).dot(self.rays.direction(position.as_vec3()));
            facing.abs() >= MIN_LOOK && self.look(position, margin) == Some(Seen::Through)
        };
        source.iter().enumerate().filter(|(_, surfel)| is_through(surfel)).map(|(k, _)| k).collect()
    }

    /// What it saw along the ray through a position; `None` for a cloud without a known scanner.
    fn look(&self, position: DVec3, margin: f64) -> Option<Seen> {
        match (&self.image, &self.shape) {
            (Some(image), _) => Some(image.look(position, margin + 0.01 * position.length())),
            (None, Shape::Image(image)) => Some(image.look(position, margin)),
            (None, Shape::Cloud(_)) => None,
        }
    }
}

/// The surface of a station whose points are `spacing` metres apart, and samples on it: one per cube of `edge` metres.
fn shape(reader: &mut Reader, spacing: f64, edge: f64) -> Result<(Shape, Vec<Point>), ScanError> {
    let header = *reader.header();
    if !header.is_grid {
        let every = header.statistics.measured.div_ceil(MAX_CLOUD).max(1);
        let mut collector = cloud::Collector::new(spacing * (every as f64).sqrt());
        let mut number = 0_u64;
        each_sample(reader, &mut |sample| {
            if number.is_multiple_of(every) {
                collector.add(sample);
            }
            number += 1;
        })?;
        let (cloud, points) = collector.finish(CLOUD_SHARE * edge);
        return Ok((Shape::Cloud(cloud), points));
    }
    let mut collector = match header.rays {
        Rays::Parallel(direction) if header.statistics.measured > 0 => {
            let bounds = header.statistics.bounds.map(Vec3::as_dvec3);
            image::Collector::across(PIXEL * spacing, direction, bounds)
        }
        Rays::Parallel(_) | Rays::Central => {
            image::Collector::around((std::f64::consts::TAU / WIDTH).max(PIXEL * mask::ray_spacing(reader)?))
        }
    };
    each_sample(reader, &mut |sample| collector.add(sample))?;
    let (image, points) = collector.finish(edge);
    Ok((Shape::Image(image), points))
}

/// The nearest range in every direction, of all samples: masked ones stopped the rays, too.
fn image(folder: &Path, station: &Station) -> Result<RangeImage, ScanError> {
    let mut reader = mask::open(folder, station, true)?;
    let mut image = RangeImage::new((std::f64::consts::TAU / WIDTH).max(mask::ray_spacing(&mut reader)?));
    each_sample(&mut reader, &mut |sample| image.add(sample))?;
    Ok(image)
}

/// Calls `each` with the positions of all measured points.
fn each_sample(reader: &mut Reader, each: &mut dyn FnMut(Vec3)) -> Result<(), ScanError> {
    let (cells, mut at, mut batch) = (reader.header().grid.cells(), 0, Vec::new());
    while at < cells {
        let size = BATCH.min(cells - at);
        reader.read(at, size as usize, &mut batch)?;
        batch.iter().filter(|sample| sample.is_measured()).for_each(|sample| each(sample.position));
        at += size;
    }
    Ok(())
}

/// How well two stations agree in a candidate pose.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Verdict {
    /// Planes that were compared.
    pub(super) planes: u32,
    /// Those where the other station saw a surface at about the same position, with the same normal.
    pub(super) agree: u32,
    /// Those where it saw a different surface.
    pub(super) differ: u32,
    /// Those that its rays pass through.
    pub(super) through: u32,
    /// The sum of the squared distances of those that agree, square metres.
    pub(super) squares: f64,
}

impl Verdict {
    /// Compares planes of `source` with what `target` saw there, using at most `most` evenly spaced planes.
    pub(super) fn one_way(
        target: &View,
        source: &[Surfel],
        most: usize,
        target_from_source: Pose,
        margin: f64,
    ) -> Self {
        let every = source.len().div_ceil(most).max(1);
        let mut out = Self::default();
        for surfel in source.iter().step_by(every) {
            out.planes += 1;
            let position = target_from_source.apply(surfel.position);
            let normal = target_from_source.rotation * surfel.normal;
            let facing = normal.dot(target.rays.direction(position.as_vec3()));
            // At grazing incidence, the range is not informative.
            if facing.abs() < MIN_LOOK {
                continue;
            }
            let seen = target.look(position, margin);
            match seen {
                Some(Seen::Through) => out.through += 1,
                Some(Seen::At) | None => {
                    // A surface that faces away cannot be seen.
                    if facing > 0.0 && seen.is_some() {
                        out.differ += 1;
                        continue;
                    }
                    match find(target, position, normal, margin) {
                        Some(distance) => {
                            out.agree += 1;
                            out.squares += distance * distance;
                        }
                        None => out.differ += u32::from(seen.is_some()),
                    }
                }
                Some(Seen::Hidden | Seen::Outside | Seen::NoReturn) => {}
            }
        }
        out
    }

    pub(super) fn join(self, other: Self) -> Self {
        Self {
            planes: self.planes + other.planes,
            agree: self.agree + other.agree,
            differ: self.differ + other.differ,
            through: self.through + other.through,
            squares: self.squares + other.squares,
        }
    }

    /// Planes that both should see.
    pub(super) fn common(self) -> u32 {
        self.agree + self.differ + self.through
    }

    /// Share of them that agree.
    pub(super) fn agreement(self) -> f64 {
        f64::from(self.agree) / f64::from(self.common().max(1))
    }

    /// Share of them that the other's rays pass through.
    pub(super) fn contradicted(self) -> f64 {
        f64::from(self.through) / f64::from(self.common().max(1))
    }

    pub(super) fn residual(self) -> f64 {
        (self.squares / f64::from(self.agree.max(1))).sqrt()
    }
}

/// The distance to the matching plane of the target, if there is one.
fn find(target: &View, position: DVec3, normal: DVec3, margin: f64) -> Option<f64> {
    // The plane size corresponds to the maximum matching distance.
    let level = ((margin / target.surfels.edge(0)).log2().round() as usize + 1).min(LEVELS - 1);
    let found = target.surfels.find(level, position, normal, margin)?;
    Some((position - found.position).dot((found.normal + normal).normalize_or_zero()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Options, Silent, import};
    use crate::survey::Survey;
    use std::fmt::Write as _;

    /// The spacing of a wall 5 m away, in steps of this angle.
    fn of_wall(step: f64) -> Spacing {
        let dir = tempfile::tempdir().unwrap();
        let count = 40;
        let mut text = format!("{count}\n{count}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
        text.push_str("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
        for cell in 0..count * count {
            let [y, z] = [cell / count, cell % count].map(|k| 5.0 * step * f64::from(k - count / 2));
            writeln!(text, "5 {y} {z} 0.5").unwrap();
        }
        let (file, folder) = (dir.path().join("wall.ptx"), dir.path().join("survey"));
        std::fs::write(&file, text).unwrap();
        import(&folder, &[file], &Options::default(), &Silent).unwrap();
        let survey = Survey::open(&folder).unwrap();
        spacing(&folder, &survey.stations[0]).unwrap().unwrap()
    }

    #[test]
    fn denser_scans_than_1440_points_per_turn_do_not_get_more_planes() {
        let sparse = of_wall(0.01);
        assert!((sparse.median - 0.05).abs() < 0.001 && sparse.limited == sparse.median, "{sparse:?}");
        let dense = of_wall(0.001);
        assert!((dense.median - 0.005).abs() < 0.0001, "{dense:?}");
        assert!((dense.limited - 5.0 * std::f64::consts::TAU / 1440.0).abs() < 0.0001, "{dense:?}");
    }
}

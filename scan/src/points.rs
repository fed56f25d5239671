//! The points of a station with the normal of the surface there and the spacing of its points, in coordinates of the survey. Memory holds three lines of
//! the grid, or a block of a cloud.

use crate::ScanError;
use crate::spool::Reader;
use glam::DVec3;
use kilwa_scan_core::tessellate::{self, Vertex};
use kilwa_scan_core::{Pose, Rays, Sample};

/// Samples of a cloud that are read at a time.
const BLOCK: usize = 1 << 16;
/// At an incidence of more than this a splat does not grow any further.
const MIN_COS: f64 = 0.1;

/// A point of a station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationPoint {
    /// Where, metres.
    pub position: DVec3,
    /// Unit normal towards the scanner: that of the surface, or of the ray where the neighbours do not determine it.
    pub normal: DVec3,
    /// How far the points of the surface are apart there, metres; 0 for a point of a cloud without a grid, or a grid of one point.
    pub spacing: f64,
    /// sRGB, where the sample has one.
    pub color: Option<[u8; 3]>,
    /// As the file has it; NaN where it has none.
    pub intensity: f32,
}

/// Receives points, and how many of how many parts of the scan are done.
pub type PointSink<'a> = dyn FnMut(&[StationPoint], u64, u64) -> Result<(), ScanError> + 'a;

/// Hand on all measured points of a station in blocks, with how many of how many samples are done.
///
/// # Errors
/// [`ScanError::Spool`] where it is damaged; what `sink` returns.
pub fn points(
    reader: &mut Reader,
    pose: Pose,
    options: &tessellate::Options,
    sink: &mut PointSink<'_>,
) -> Result<(), ScanError> {
    let header = *reader.header();
    if !header.is_grid {
        return cloud(reader, pose, sink);
    }
    let lines = header.grid.lines();
    let mut out = Out { pose, rays: header.rays, step: 0.0, points: Vec::new() };
    let mut read = |number: u32| -> Result<Option<Vec<Sample>>, ScanError> {
        let mut samples = Vec::new();
        if number < lines {
            reader.line(number, &mut samples)?;
        }
        Ok((number < lines).then_some(samples))
    };
    let (mut before, mut here) = (None::<Vec<Sample>>, read(0)?);
    let mut vertices = Vec::new();
    for number in 1..=lines {
        let after = read(number)?;
        let Some(line) = here else { break };
        tessellate::vertices(before.as_deref(), &line, after.as_deref(), header.rays, options, &mut vertices);
        out.line(before.as_deref(), &line, after.as_deref(), &vertices);
        sink(&out.points, u64::from(number), u64::from(lines))?;
        out.points.clear();
        before = Some(line);
        here = after;
    }
    Ok(())
}

/// The points of a station without a grid.
fn cloud(reader: &mut Reader, pose: Pose, sink: &mut PointSink<'_>) -> Result<(), ScanError> {
    let header = *reader.header();
    let cells = header.grid.cells();
    let mut out = Out { pose, rays: header.rays, step: 0.0, points: Vec::new() };
    let mut samples = Vec::new();
    let mut first = 0;
    while first < cells {
        let count = usize::try_from(cells - first).map_or(BLOCK, |left| left.min(BLOCK));
        samples.clear();
        reader.read(first, count, &mut samples)?;
        for sample in samples.iter().filter(|s| s.is_measured()) {
            out.push(sample, -header.rays.direction(sample.position), 0.0);
        }
        first += count as u64;
        sink(&out.points, first, cells)?;
        out.points.clear();
    }
    Ok(())
}

struct Out {
    pose: Pose,
    rays: Rays,
    /// The spacing of rays that was seen last: as an angle where they are central, metres where they are parallel.
    step: f64,
    points: Vec<StationPoint>,
}

impl Out {
    fn push(&mut self, sample: &Sample, normal: DVec3, spacing: f64) {
        self.points.push(StationPoint {
            position: self.pose.apply(sample.position.as_dvec3()),
            normal: self.pose.rotation * normal,
            spacing,
            color: sample.state.has_color().then_some(sample.color),
            intensity: sample.intensity,
        });
    }

    fn line(
        &mut self,
        left: Option<&[Sample]>,
        here: &[Sample],
        right: Option<&[Sample]>,
        vertices: &[Option<Vertex>],
    ) {
        for (row, (sample, vertex)) in here.iter().zip(vertices).enumerate() {
            let Some(vertex) = vertex else { continue };
            let range = if self.rays == Rays::Central { f64::from(sample.position.length()) } else { 1.0 };
            let at = |line: Option<&[Sample]>, row: Option<usize>| {
                let other = line?.get(row?)?;
                other.is_measured().then(|| self.rays.spacing(sample.position, other.position))
            };
            let pair = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::min);
            let along = pair(at(Some(here), row.checked_sub(1)), at(Some(here), Some(row + 1)));
            let across = pair(at(left, Some(row)), at(right, Some(row)));
            let between = along.into_iter().chain(across).reduce(f64::max);
            // A point without neighbours is as large as the last one that had some would be at its range.
            let between = match between {
                Some(between) if range > 0.0 => {
                    self.step = between / range;
                    between
                }
                _ => self.step * range,
            };
            // The surface between two rays is longer where it is seen at an angle; the square has the same area.
            let cos = vertex.cos_incidence.unwrap_or(1.0).max(MIN_COS);
            self.push(sample, vertex.normal, between / cos.sqrt());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, Vec3};
    use kilwa_scan_core::Grid;

    /// A wall at `y = 10` seen from the origin, a column every `step` radians.
    fn wall(step: f32, size: u32) -> Vec<Sample> {
        let tangent = |k: u32| ((k as f32 - size as f32 / 2.0) * step).tan();
        let at = |column, row| Vec3::new(tangent(column), 1.0, tangent(row)) * 10.0;
        (0..size).flat_map(|column| (0..size).map(move |row| Sample::measured(at(column, row)))).collect()
    }

    fn of(samples: &[Sample], size: u32, pose: Pose) -> Vec<StationPoint> {
        let grid = Grid::by_columns(size, size);
        let lines: Vec<&[Sample]> = samples.chunks(grid.line_length() as usize).collect();
        let mut out = Out { pose, rays: Rays::Central, step: 0.0, points: Vec::new() };
        let mut vertices = Vec::new();
        for k in 0..lines.len() {
            let (left, right) = (k.checked_sub(1).map(|k| lines[k]), lines.get(k + 1).copied());
            tessellate::vertices(left, lines[k], right, Rays::Central, &tessellate::Options::default(), &mut vertices);
            out.line(left, lines[k], right, &vertices);
        }
        out.points
    }

    #[test]
    fn points_of_a_wall_face_the_scanner_and_are_as_far_apart_as_its_rays() {
        let pose = Pose {
            rotation: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
            translation: DVec3::new(100.0, 0.0, 2.0),
        };
        let points = of(&wall(0.002, 21), 21, pose);
        assert_eq!(points.len(), 441);
        for p in &points {
            assert!((p.position.x - 90.0).abs() < 1e-4 && p.normal.dot(DVec3::X) > 0.999);
            assert!((p.spacing / 0.02 - 1.0).abs() < 0.05, "{}", p.spacing);
        }
    }

    #[test]
    fn a_point_without_neighbours_is_as_large_as_others_at_its_range() {
        let mut samples = wall(0.002, 21);
        for (k, s) in samples.iter_mut().enumerate() {
            if k / 21 >= 10 && k != 15 * 21 + 10 {
                *s = Sample::EMPTY;
            }
        }
        let points = of(&samples, 21, Pose::IDENTITY);
        assert_eq!(points.len(), 211);
        assert!((points[210].spacing / 0.02 - 1.0).abs() < 0.1, "{}", points[210].spacing);
    }
}

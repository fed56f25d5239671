//! The mesh of a station: its grid tessellated line by line, in coordinates of the survey.
//!
//! What is held is four lines of the grid: three neighbours, and the first one until it is known whether the scan goes round. Vertices are delivered
//! when a triangle needs them, each before its first triangle.

use crate::ScanError;
use crate::spool::Reader;
use crate::turn::Turn;
use glam::DVec3;
use kilwa_scan_core::tessellate::{self, Corner, Dropped, Side, Vertex};
use kilwa_scan_core::{Pose, Rays, Sample};

/// How a station is meshed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Which edges and triangles are kept, and the instrument.
    pub tessellate: tessellate::Options,
    /// Every so many rows and columns; 1 for all.
    pub subsample: u32,
    /// Only triangles whose centroid lies in this box of the survey, metres.
    pub bounds: Option<[DVec3; 2]>,
}

impl Default for Options {
    fn default() -> Self {
        Self { tessellate: tessellate::Options::default(), subsample: 1, bounds: None }
    }
}

/// A vertex of the mesh, in coordinates of the survey.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshVertex {
    /// Where, metres.
    pub position: DVec3,
    /// Unit normal, towards the scanner.
    pub normal: DVec3,
    /// sRGB, where the sample has one.
    pub color: Option<[u8; 3]>,
    /// As the file has it; NaN where it has none.
    pub intensity: f32,
    /// `cos θ / (σ² + d²)`, 1/m²: see [`tessellate`].
    pub confidence: f32,
}

/// Receives a mesh.
pub trait Surface {
    /// The number of the part that the next triangle belongs to, asked before its vertices are passed. Parts have vertices of their own: one that a triangle of
    /// another part used is passed again, identical in every bit.
    ///
    /// # Errors
    /// If the part before cannot be kept.
    fn part(&mut self) -> Result<u32, ScanError> {
        Ok(0)
    }

    /// A vertex; its number.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError>;

    /// A triangle of vertices that came before, counterclockwise seen from the scanner.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError>;

    /// So many of so many lines are done.
    ///
    /// # Errors
    /// [`ScanError::Stopped`].
    fn progress(&mut self, _done: u64, _total: u64) -> Result<(), ScanError> {
        Ok(())
    }
}

/// What became of a station.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Report {
    /// Vertices; those that several parts use are counted in each.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
    /// Triangles that were not made.
    pub dropped: Dropped,
    /// Triangles outside of the box.
    pub outside: u64,
    /// Whether the last line was joined to the first.
    pub is_closed: bool,
}

/// Mesh the station in a spool.
///
/// # Errors
/// [`ScanError::Request`] for a cloud without a grid; [`ScanError::Spool`] where it is damaged; what `surface` returns.
pub fn mesh(
    reader: &mut Reader,
    pose: Pose,
    options: &Options,
    surface: &mut dyn Surface,
) -> Result<Report, ScanError> {
    let header = *reader.header();
    if !header.is_grid {
        let message = "this station is an unstructured point cloud, so it is unknown which points are neighbours; stations from PTX, E57 with rows and columns, and PLY range grids can be meshed";
        return Err(ScanError::Request(message.to_owned()));
    }
    // Positions in the spool are relative to the origin, and so is the pose in the survey.
    let step = options.subsample.max(1);
    let mut strips = Strips { rays: header.rays, pose, options, surface, report: Report::default() };
    let numbers: Vec<u32> = (0..header.grid.lines()).step_by(step as usize).collect();
    let mut window = Window { reader, step, next: 0, numbers: &numbers };
    let Some(mut here) = window.next()? else { return Ok(Report::default()) };
    let mut before: Option<Line> = None;
    let mut first: Option<Line> = None;
    let total = numbers.len() as u64;
    let (mut done, mut turn) = (0, Turn::new(total));
    loop {
        let after = window.next()?;
        let left = before.as_ref().map(|line| line.samples.as_slice());
        let right = after.as_ref().map(|line| line.samples.as_slice());
        tessellate::vertices(left, &here.samples, right, header.rays, &options.tessellate, &mut here.vertices);
        if let Some(before) = &mut before {
            turn.add(&before.samples, &here.samples);
            strips.between(before, &mut here)?;
        }
        done += 1;
        if done % 64 == 0 {
            strips.surface.progress(done, total)?;
        }
        let last = before.replace(here);
        if first.is_none() {
            first = last;
        }
        match after {
            Some(after) => here = after,
            None => break,
        }
    }
    if let Some((mut last, mut first)) = before.zip(first)
        && turn.closes(&last.samples, &first.samples, header.rays)
    {
        strips.between(&mut last, &mut first)?;
        strips.report.is_closed = true;
    }
    Ok(strips.report)
}

/// Mesh at most `count` strips between two lines of the grid, spread evenly over it; returns which share of all strips that is.
///
/// # Errors
/// As [`mesh`].
pub(crate) fn sample_strips(
    reader: &mut Reader,
    pose: Pose,
    options: &Options,
    count: usize,
    surface: &mut dyn Surface,
) -> Result<f64, ScanError> {
    let (header, step) = (*reader.header(), options.subsample.max(1));
    let numbers: Vec<u32> = (0..header.grid.lines()).step_by(step as usize).collect();
    let all = numbers.len().saturating_sub(1);
    let count = count.min(all);
    let mut strips = Strips { rays: header.rays, pose, options, surface, report: Report::default() };
    let mut window = Window { reader, step, next: 0, numbers: &numbers };
    for strip in 0..count {
        window.next = strip * all / count;
        let (Some(mut left), Some(mut right)) = (window.next()?, window.next()?) else { break };
        let (a, b) = (&left.samples, &right.samples);
        tessellate::vertices(None, a, Some(b), header.rays, &options.tessellate, &mut left.vertices);
        tessellate::vertices(Some(a), b, None, header.rays, &options.tessellate, &mut right.vertices);
        strips.between(&mut left, &mut right)?;
    }
    Ok(if all == 0 { 1.0 } else { count as f64 / all as f64 })
}

/// A line of the grid, thinned, with its surface and the numbers of its vertices.
struct Line {
    samples: Vec<Sample>,
    vertices: Vec<Option<Vertex>>,
    /// The numbers of its vertices in this part.
    numbers: Vec<Option<u32>>,
    part: u32,
}

impl Line {
    /// Vertices have no numbers yet in another part.
    fn enter(&mut self, part: u32) {
        if self.part != part {
            self.part = part;
            self.numbers.fill(None);
        }
    }
}

struct Window<'a> {
    reader: &'a mut Reader,
    step: u32,
    next: usize,
    numbers: &'a [u32],
}

impl Window<'_> {
    fn next(&mut self) -> Result<Option<Line>, ScanError> {
        let Some(number) = self.numbers.get(self.next) else { return Ok(None) };
        self.next += 1;
        let mut samples = Vec::new();
        self.reader.line(*number, &mut samples)?;
        if self.step > 1 {
            samples = samples.into_iter().step_by(self.step as usize).collect();
        }
        let numbers = vec![None; samples.len()];
        Ok(Some(Line { samples, vertices: Vec::new(), numbers, part: 0 }))
    }
}

struct Strips<'a> {
    rays: Rays,
    pose: Pose,
    options: &'a Options,
    surface: &'a mut dyn Surface,
    report: Report,
}

impl Strips<'_> {
    /// The triangles between two lines.
    fn between(&mut self, left: &mut Line, right: &mut Line) -> Result<(), ScanError> {
        let mut made = Vec::new();
        tessellate::triangles(
            Side { samples: &left.samples, vertices: &left.vertices },
            Side { samples: &right.samples, vertices: &right.vertices },
            self.rays,
            &self.options.tessellate,
            &mut self.report.dropped,
            &mut |corners| made.push(corners),
        );
        for corners in made {
            if let Some([min, max]) = self.options.bounds {
                let points = corners.map(|c| self.place(if c.is_right { right } else { left }, c));
                let middle = (points[0] + points[1] + points[2]) / 3.0;
                if middle.cmplt(min).any() || middle.cmpgt(max).any() {
                    self.report.outside += 1;
                    continue;
                }
            }
            let part = self.surface.part()?;
            left.enter(part);
            right.enter(part);
            let mut numbers = [0; 3];
            for (number, corner) in numbers.iter_mut().zip(corners) {
                *number = self.number(if corner.is_right { right } else { left }, corner.row)?;
            }
            self.surface.triangle(numbers)?;
            self.report.triangles += 1;
        }
        Ok(())
    }

    fn place(&self, line: &Line, corner: Corner) -> DVec3 {
        self.pose.apply(line.samples[corner.row].position.as_dvec3())
    }

    /// The number of a vertex, which is delivered where it is new.
    fn number(&mut self, line: &mut Line, row: usize) -> Result<u32, ScanError> {
        if let Some(number) = line.numbers[row] {
            return Ok(number);
        }
        let sample = &line.samples[row];
        let (normal, confidence) = line.vertices[row].map_or((DVec3::Z, 0.0), |v| (v.normal, v.confidence));
        let number = self.surface.vertex(&MeshVertex {
            position: self.pose.apply(sample.position.as_dvec3()),
            normal: self.pose.rotation * normal,
            color: sample.state.has_color().then_some(sample.color),
            intensity: sample.intensity,
            confidence,
        })?;
        line.numbers[row] = Some(number);
        self.report.vertices += 1;
        Ok(number)
    }
}

//! PLY, by the reader of mesh files: range grids, and clouds of points.
//!
//! A range grid is that of a triangulation scanner: its rays are parallel and run along -z, unless a position is given, which makes them central.
//! Its vertices go to a scratch file first, because the cells that refer to them come later. Channels `intensity`, `scalar_intensity`, and then
//! `confidence` are kept as intensity.

use super::{Frame, Head, Input, MAX_RANGE, Sink};
use crate::ScanError;
use crate::spool::Layout;
use glam::DVec3;
use kilwa_formats::Diagnostics;
use kilwa_formats::read::ply::points::{PointSink, has_grid, read_points};
use kilwa_formats::read::{ReadError, VertexBlock, VertexSink};
use kilwa_scan_core::{Grid, Kind, Pose, Rays, Sample, State};
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Channels that may be the intensity, the first that is there.
const INTENSITIES: [&str; 5] = ["intensity", "scalar_intensity", "scalar_scalar_intensity", "confidence", "quality"];

pub(super) fn read(input: &mut Input<'_>) -> Result<(), ScanError> {
    let at = Cell::new(0);
    let frame = Frame::unplaced(input.options, input.options.units.metres());
    let mut points = Points {
        path: input.path,
        frame,
        sink: &mut *input.sink,
        has_station: input.options.station.is_some(),
        intensity: None,
        scratch: None,
        count: 0,
        grid: None,
        is_wanted: None,
        used: 0,
        failure: None,
        at: &at,
    };
    let done = read_points(input.path, &mut points, &mut |done, _| at.set(done));
    if let Some(failure) = points.failure.take() {
        return Err(failure);
    }
    done?;
    points.end()?;
    points.sink.progress(input.total)
}

/// Find out from the header whether it is a mesh, or a cloud without a position.
pub(super) fn check(path: &Path, has_station: bool) -> Result<(), ScanError> {
    if has_grid(path)? || has_station { Ok(()) } else { Err(ScanError::NoStation { file: path.to_owned() }) }
}

struct Points<'a> {
    path: &'a Path,
    frame: Frame,
    sink: &'a mut dyn Sink,
    has_station: bool,
    /// The channel that is kept as intensity.
    intensity: Option<usize>,
    scratch: Option<Scratch>,
    count: u64,
    grid: Option<Grid>,
    is_wanted: Option<bool>,
    /// Cells with a vertex.
    used: u64,
    /// Bytes that are read.
    at: &'a Cell<u64>,
    /// An error of the survey, which the reader of meshes cannot carry.
    failure: Option<ScanError>,
}

/// Vertices in a file without a name, until their cells come.
struct Scratch {
    file: BufWriter<File>,
    block: Option<u64>,
    bytes: Vec<u8>,
}

/// Bytes of a vertex in the scratch file: x y z, intensity, colour, state.
const VERTEX: usize = crate::spool::SAMPLE_BYTES;
const BLOCK: u64 = 1024;

impl Points<'_> {
    /// Carry an error of the survey through the reader of meshes.
    fn fail(&mut self, e: ScanError) -> ReadError {
        self.failure = Some(e);
        ReadError::NotAFile { file: self.path.to_owned(), what: "not read to its end" }
    }

    fn scratch_error(&self, source: io::Error) -> ReadError {
        ReadError::Scratch { file: self.path.to_owned(), folder: std::env::temp_dir(), what: "used", source }
    }

    fn sample(&self, block: &VertexBlock<'_>, k: usize) -> Result<Sample, ScanError> {
        let Some(&position) = block.positions.get(k) else { return Ok(Sample::EMPTY) };
        if !position.is_finite() {
            return Ok(Sample { state: State::new(Kind::NoReturn, false, 0), ..Sample::EMPTY });
        }
        let position = self.frame.place(position).map_err(|metres| ScanError::Nothing {
            file: self.path.to_owned(),
            what: format!(
                "vertex {} is {:.0} km from the scanner, and at most {:.0} km are accepted; if its coordinates are those of the map, give the position of the scanner with --station X,Y,Z",
                self.count + k as u64,
                metres / 1000.0,
                MAX_RANGE / 1000.0
            ),
        })?;
        let color = block.colors.get(k);
        let intensity =
            self.intensity.and_then(|channel| block.scalars.get(channel)?.get(k)).copied().unwrap_or(f32::NAN);
        let state = State::new(Kind::Measured, color.is_some(), 0);
        Ok(Sample { position, intensity, color: color.copied().unwrap_or_default(), state })
    }

    fn begin(&mut self) -> Result<bool, ScanError> {
        if let Some(is_wanted) = self.is_wanted {
            return Ok(is_wanted);
        }
        let pose = self.has_station.then(|| self.frame.pose(Pose::default()));
        let is_wanted = self.sink.begin(&Head { pose, is_position_given: self.has_station, ..Head::default() })?;
        self.is_wanted = Some(is_wanted);
        Ok(is_wanted)
    }

    fn end(&mut self) -> Result<(), ScanError> {
        let (grid, is_grid) = (self.grid.unwrap_or(Grid::by_columns(1, self.count as u32)), self.grid.is_some());
        if is_grid {
            let unused = self.count.saturating_sub(self.used);
            self.sink.diagnostics().add_many("vertices that no cell of the grid refers to dropped", unused);
        }
        if self.is_wanted != Some(true) {
            return Ok(());
        }
        let rays = if is_grid && !self.has_station { Rays::Parallel(DVec3::NEG_Z) } else { Rays::Central };
        self.sink.end(Layout { grid, is_grid, rays, origin: self.frame.origin })
    }
}

impl VertexSink for Points<'_> {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        let find = |wanted: &str| names.iter().position(|name| name.eq_ignore_ascii_case(wanted));
        self.intensity = INTENSITIES.iter().find_map(|wanted| find(wanted));
        Ok(())
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        let is_direct = self.scratch.is_none();
        if is_direct && !self.begin().map_err(|e| self.fail(e))? {
            self.count += block.positions.len() as u64;
            return Ok(());
        }
        for k in 0..block.positions.len() {
            let sample = self.sample(block, k).map_err(|e| self.fail(e))?;
            if let Some(scratch) = &mut self.scratch {
                let written = scratch.write(&sample);
                written.map_err(|e| self.scratch_error(e))?;
            } else {
                let pushed = self.sink.push(&sample);
                pushed.map_err(|e| self.fail(e))?;
            }
        }
        self.count += block.positions.len() as u64;
        let done = self.at.get();
        self.sink.progress(done).map_err(|e| self.fail(e))
    }

    fn vertex_count(&self) -> u64 {
        self.count
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        self.sink.diagnostics()
    }
}

impl PointSink for Points<'_> {
    fn expect(&mut self, has_grid: bool) -> Result<(), ReadError> {
        if has_grid {
            let file = tempfile::tempfile().map_err(|e| self.scratch_error(e))?;
            self.scratch = Some(Scratch { file: BufWriter::new(file), block: None, bytes: Vec::new() });
        } else if !self.has_station {
            return Err(self.fail(ScanError::NoStation { file: self.path.to_owned() }));
        }
        Ok(())
    }

    fn grid(&mut self, columns: u32, rows: u32) -> Result<(), ReadError> {
        self.grid = Some(Grid { columns, rows, by_rows: true });
        self.begin().map_err(|e| self.fail(e))?;
        let flushed = self.scratch.as_mut().map_or(Ok(()), |scratch| scratch.file.flush());
        flushed.map_err(|e| self.scratch_error(e))
    }

    fn cell(&mut self, vertex: Option<u64>) -> Result<(), ReadError> {
        self.used += u64::from(vertex.is_some());
        if self.is_wanted != Some(true) {
            return Ok(());
        }
        let sample = match (vertex, &mut self.scratch) {
            (Some(vertex), Some(scratch)) => {
                let read = scratch.read(vertex);
                read.map_err(|e| self.scratch_error(e))?
            }
            _ => Sample::EMPTY,
        };
        let pushed = self.sink.push(&sample);
        pushed.map_err(|e| self.fail(e))
    }
}

impl Scratch {
    fn write(&mut self, sample: &Sample) -> io::Result<()> {
        let mut bytes = [0; VERTEX];
        crate::spool::encode(sample, &mut bytes);
        self.file.write_all(&bytes)
    }

    fn read(&mut self, vertex: u64) -> io::Result<Sample> {
        let block = vertex / BLOCK;
        if self.block != Some(block) {
            let file = self.file.get_mut();
            file.seek(SeekFrom::Start(block * BLOCK * VERTEX as u64))?;
            self.bytes.clear();
            file.take(BLOCK * VERTEX as u64).read_to_end(&mut self.bytes)?;
            self.block = Some(block);
        }
        let at = (vertex % BLOCK) as usize * VERTEX;
        let sample = self.bytes.get(at..at + VERTEX).and_then(crate::spool::decode);
        sample.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof))
    }
}

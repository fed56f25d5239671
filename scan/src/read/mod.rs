//! Readers of scans: a file is handed on station by station and sample by sample to a [`Sink`].
//!
//! Formats are recognised by their first bytes; text files of numbers by their first lines and, where several formats fit, by the ending of the
//! name. Headers are compared with what follows them: a file that holds less or more than it announces is refused with its line or byte.
//!
//! Invariants: samples are metres from the origin of their station; what a reader holds does not grow with the file; every sample of the file is
//! delivered, or counted in the [`Diagnostics`] as dropped.

mod columns;
mod e57;
pub(crate) mod e57_images;
mod las;
mod lines;
mod order;
mod ply;
mod ptx;
mod sniff;

pub use sniff::{EXTENSIONS, Format, is_named_as_scan, recognise};

use crate::ScanError;
use crate::spool::Layout;
use crate::survey::Camera;
use glam::DVec3;
use kilwa_files::plain_file;
use kilwa_formats::Diagnostics;
use kilwa_formats::read::{Place, ReadError};
use kilwa_geometry::LengthUnit;
use kilwa_scan_core::{Pose, Sample};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How files are to be understood where they do not tell.
#[derive(Debug, Clone, Copy)]
pub struct ReadOptions {
    /// The scanner's position, in the file's coordinates and units, of clouds that have none.
    pub station: Option<DVec3>,
    /// That position is also the one of scans that state their own: their points are not relative to the scanner.
    pub override_position: bool,
    /// The unit of files that are not in metres by definition (all but E57).
    pub units: LengthUnit,
    /// Import a scan that ends before all announced points have come, with what is there.
    pub keep_incomplete: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { station: None, override_position: false, units: LengthUnit::Metre, keep_incomplete: false }
    }
}

/// What is known of a station before its samples.
#[derive(Debug, Clone, Default)]
pub struct Head {
    /// Its name in the file.
    pub name: Option<String>,
    /// Where it stands in the survey, if the file or the user tells.
    pub pose: Option<Pose>,
    /// The scanner, if the file tells.
    pub instrument: Option<String>,
    /// The coordinate reference system of the survey, an EPSG code or WKT, if the file tells.
    pub crs: Option<String>,
    /// Whether the position of the scanner is [`ReadOptions::station`].
    pub is_position_given: bool,
    /// How many samples come, of files that may take much less room than these.
    pub samples: Option<u64>,
}

/// A photograph inside a scan file.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Its name in the file.
    pub name: Option<String>,
    /// Where the camera stands in the survey.
    pub pose: Option<Pose>,
    /// How it projects; `None` if the file only holds the picture for reference.
    pub camera: Option<Camera>,
    /// The ending that fits its content: `jpg` or `png`.
    pub extension: &'static str,
    /// The number of the scan in this file that it belongs to; the first is 1.
    pub station: Option<u64>,
}

/// Receives what a file holds.
pub trait Sink {
    /// A station begins. `false` if it is not wanted; then nothing more of it must come.
    ///
    /// # Errors
    /// Where it cannot be kept, or the user stopped.
    fn begin(&mut self, head: &Head) -> Result<bool, ScanError>;

    /// The next scan of the file holds no points; it has a number like the others.
    fn skip(&mut self);

    /// The sample of the next cell.
    ///
    /// # Errors
    /// As [`Self::begin`].
    fn push(&mut self, sample: &Sample) -> Result<(), ScanError>;

    /// The sample of a cell; `false` if this cell had one before.
    ///
    /// # Errors
    /// As [`Self::begin`].
    fn put(&mut self, cell: u64, sample: &Sample) -> Result<bool, ScanError>;

    /// The station is complete.
    ///
    /// # Errors
    /// As [`Self::begin`].
    fn end(&mut self, layout: Layout) -> Result<(), ScanError>;

    /// A photograph; `write` writes its bytes.
    ///
    /// # Errors
    /// As [`Self::begin`].
    fn picture(
        &mut self,
        picture: &Picture,
        write: &mut dyn FnMut(&mut dyn std::io::Write) -> Result<(), ScanError>,
    ) -> Result<(), ScanError>;

    /// Called about once a mebibyte with the bytes of the file that are done.
    ///
    /// # Errors
    /// [`ScanError::Stopped`].
    fn progress(&mut self, done: u64) -> Result<(), ScanError>;

    /// Where repairs are counted.
    fn diagnostics(&mut self) -> &mut Diagnostics;
}

/// One file in the hands of a reader.
struct Input<'a> {
    path: &'a Path,
    file: File,
    total: u64,
    options: &'a ReadOptions,
    sink: &'a mut dyn Sink,
}

impl Input<'_> {
    /// The lines of the file.
    fn lines(&self) -> Result<lines::Lines, ScanError> {
        let cannot = |source| ReadError::Open { file: self.path.to_owned(), source };
        Ok(lines::Lines::new(self.path, self.file.try_clone().map_err(cannot)?))
    }
}

/// Hand on all that the file at `path` holds.
///
/// # Errors
/// [`ScanError`], whose text names the file, the place, what was found and what was expected.
pub fn read(path: &Path, options: &ReadOptions, sink: &mut dyn Sink) -> Result<(), ScanError> {
    let format = recognise(path)?;
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let file = plain_file::open(path).map_err(cannot)?;
    let total = file.metadata().map_err(cannot)?.len();
    let mut input = Input { path, file, total, options, sink };
    match format {
        Format::Ptx => ptx::read(input),
        Format::Pts => columns::read(input, columns::Kind::Pts),
        Format::Xyz => columns::read(input, columns::Kind::Xyz),
        Format::E57 => e57::read(input),
        Format::Las => las::read(&mut input),
        Format::Ply => ply::read(&mut input),
    }
}

/// Check what can be known of a file before it is imported: its format, whether a position is missing, whether a PLY file is a mesh.
///
/// # Errors
/// As [`read`].
pub fn check(path: &Path, options: &ReadOptions) -> Result<(), ScanError> {
    match recognise(path)? {
        Format::Pts | Format::Xyz | Format::Las if options.station.is_none() => {
            Err(ScanError::NoStation { file: path.to_owned() })
        }
        Format::Ply => ply::check(path, options.station.is_some()),
        _ => Ok(()),
    }
}

/// The first bytes of a file.
fn beginning(path: &Path, bytes: u64) -> Result<Vec<u8>, ScanError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let mut start = Vec::new();
    plain_file::open(path).map_err(cannot)?.take(bytes).read_to_end(&mut start).map_err(cannot)?;
    Ok(start)
}

/// Farther from its scanner than this, a point loses more than half a millimetre in 32 bits, and no scanner reaches as far.
const MAX_RANGE: f64 = 10_000.0;

/// From the coordinates of a file to metres from the station.
#[derive(Debug, Clone, Copy)]
struct Frame {
    origin: DVec3,
    metres: f64,
}

impl Frame {
    /// Of points whose file does not tell where the scanner was.
    fn unplaced(options: &ReadOptions, metres: f64) -> Self {
        Self { origin: options.station.unwrap_or_default() * metres, metres }
    }

    /// Of points that are relative to the scanner, unless the user knows better.
    fn placed(options: &ReadOptions, metres: f64) -> Self {
        if options.override_position { Self::unplaced(options, metres) } else { Self { origin: DVec3::ZERO, metres } }
    }

    /// Where the station stands in the survey, if this is the pose that the file states for its coordinates.
    fn pose(&self, of_file: Pose) -> Pose {
        Pose::at(self.origin).then(of_file)
    }

    /// A point of the file; `Err` with its distance in metres if it is too far from the station to belong to it.
    #[inline]
    fn place(&self, point: DVec3) -> Result<glam::Vec3, f64> {
        let p = point * self.metres - self.origin;
        // The largest element passes over what is no number.
        if p.is_finite() && p.abs().max_element() <= MAX_RANGE { Ok(p.as_vec3()) } else { Err(p.length()) }
    }
}

/// The error for a point that [`Frame::place`] refuses.
fn too_far(file: &Path, place: Place, metres: f64) -> ScanError {
    if !metres.is_finite() {
        return ScanError::malformed(
            file,
            place,
            "a coordinate that is not a finite number",
            "points within 10 km of the scanner",
        );
    }
    ScanError::malformed(
        file,
        place,
        format!("a point {:.0} km from the scanner", metres / 1000.0),
        "points within 10 km of it; if these are coordinates of the map, give the position of the scanner with --station X,Y,Z (and --override-position for scans that state one)",
    )
}

//! A survey: a folder with `survey.toml`, which people edit, and the binary files that it names.
//!
//! ```text
//! survey.toml              stations, poses, control points, masks, photographs, options
//! stations/NAME.scan       the samples of a station: see [`crate::spool`]
//! stations/NAME.MASK.ID.mask  what a mask masks of a station: see [`crate::mask`]
//! photographs/NAME.jpg     photographs that were inside scan files
//! ```
//!
//! The program reads the file whole and reports every mistake with its line ([`Survey::open`]). It changes single entries and keeps all else, also
//! comments and order ([`edit::Edit`]).

pub mod edit;
pub(crate) mod parse;

#[cfg(test)]
mod tests;

use crate::ScanError;
use glam::DVec3;
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::Pose;
use kilwa_scan_core::tessellate::Instrument;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The name of the file.
pub const FILE: &str = "survey.toml";
/// The folder of the spools.
pub const STATIONS: &str = "stations";
/// The folder of photographs that were inside scan files.
pub const PHOTOGRAPHS: &str = "photographs";
/// Largest `survey.toml`, bytes.
const FILE_MAX: u64 = 16 << 20;
/// Most stations, control points or photographs.
const LIST_MAX: usize = 100_000;

/// What `survey.toml` holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Survey {
    /// A title.
    pub title: Option<String>,
    /// Coordinate reference system, for example EPSG:32737.
    pub crs: Option<String>,
    /// The stations, in the order of the file.
    pub stations: Vec<Station>,
    /// Control points.
    pub controls: Vec<Control>,
    /// Photographs.
    pub photographs: Vec<Photograph>,
    /// How stations are meshed.
    pub mesh: MeshDefaults,
}

/// One station.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Its name, unique in the survey.
    pub name: String,
    /// Its spool, relative to the folder of the survey.
    pub scan: String,
    /// Where it stands; `None` where that is unknown.
    pub pose: Option<Pose>,
    /// Standard deviations of the pose: metres, radians.
    pub sigma: Option<[f64; 2]>,
    /// Whether registration must leave the pose as it is.
    pub is_fixed: bool,
    /// Maker, model and serial number of the scanner.
    pub instrument: Option<String>,
    /// Noise and beam, where they differ from the defaults.
    pub range_noise: Option<[f64; 2]>,
    /// See [`Instrument::beam`].
    pub beam: Option<[f64; 2]>,
    /// Its masks, in the order of the file.
    pub masks: Vec<Mask>,
    /// The file it came from.
    pub source: Source,
}

/// A mask of a station: which of its samples are not of the site.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Its name, unique in the station; stations may have masks of the same name.
    pub name: String,
    /// Its file, relative to the folder of the survey: see [`crate::mask`].
    pub file: String,
    /// Whether what reads the station leaves out what it masks.
    pub is_on: bool,
    /// The options that it was made with, as on the command line.
    pub made: String,
    /// What tells the poses that it was made with from others, where it depends on poses.
    pub poses: Option<String>,
}

impl Station {
    /// Noise and beam of its instrument.
    pub fn measures_with(&self) -> Instrument {
        let common = Instrument::default();
        Instrument {
            range_noise: self.range_noise.unwrap_or(common.range_noise),
            beam: self.beam.unwrap_or(common.beam),
        }
    }
}

/// The file from which a station came.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Its name, without folders.
    pub file: String,
    /// Its length.
    pub bytes: u64,
    /// Its BLAKE3 hash, hexadecimal.
    pub blake3: String,
    /// The number of the scan in it, from 1.
    pub number: u64,
}

/// A point that is known in a station, or in the survey. Entries of the same name are the same point.
#[derive(Debug, Clone, PartialEq)]
pub struct Control {
    /// Its name.
    pub name: String,
    /// The station in whose coordinates it is given; `None`: in those of the survey.
    pub station: Option<String>,
    /// Where, metres.
    pub at: DVec3,
    /// Standard deviation, metres.
    pub sigma: Option<f64>,
}

/// How a camera projects; pixels from the upper left corner.
#[derive(Debug, Clone, PartialEq)]
pub enum Camera {
    /// A perspective picture.
    Pinhole {
        /// Width and height, pixels.
        size: [u32; 2],
        /// Focal lengths along both axes, pixels.
        focal: [f64; 2],
        /// Principal point, pixels.
        center: [f64; 2],
    },
    /// Equirectangular: columns are azimuths, rows elevations.
    Spherical {
        /// Width and height, pixels.
        size: [u32; 2],
        /// Angles of a pixel, radians.
        pixel: [f64; 2],
    },
    /// On a cylinder.
    Cylindrical {
        /// Width and height, pixels.
        size: [u32; 2],
        /// Radius, metres.
        radius: f64,
        /// Row of the horizon.
        center: f64,
        /// Angle of a column (radians) and height of a row (metres).
        pixel: [f64; 2],
    },
}

impl Camera {
    /// Whether its numbers can be those of a camera.
    pub fn is_sound(&self) -> bool {
        let positive = |values: &[f64]| values.iter().all(|v| v.is_finite() && *v > 0.0);
        match self {
            Self::Pinhole { size, focal, center } => {
                size.iter().all(|n| *n > 0) && positive(focal) && center.iter().all(|v| v.is_finite())
            }
            Self::Spherical { size, pixel } => size.iter().all(|n| *n > 0) && positive(pixel),
            Self::Cylindrical { size, radius, center, pixel } => {
                size.iter().all(|n| *n > 0) && positive(&[*radius]) && positive(pixel) && center.is_finite()
            }
        }
    }
}

/// A photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// The picture, relative to the folder of the survey, or absolute.
    pub file: String,
    /// The station it belongs to.
    pub station: Option<String>,
    /// Where the camera stands in the survey: its axes are x right, y up, z backwards, as in E57.
    pub pose: Option<Pose>,
    /// How it projects.
    pub camera: Option<Camera>,
}

/// Defaults of `kilwa scans export --mesh` for this survey.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MeshDefaults {
    /// Every so many rows and columns.
    pub subsample: Option<u32>,
    /// How many times the expected spacing an edge may be long.
    pub edge_factor: Option<f64>,
    /// Longest edge, metres.
    pub max_edge: Option<f64>,
    /// Largest incidence, degrees.
    pub grazing: Option<f64>,
}

impl Survey {
    /// Read the survey in `folder`.
    ///
    /// # Errors
    /// [`ScanError::Survey`] with every mistake; [`ReadError::Open`] where the file cannot be opened.
    pub fn open(folder: &Path) -> Result<Self, ScanError> {
        let (path, text) = text(folder)?;
        Self::parse(&text).map_err(|problems| ScanError::Survey { file: path, problems })
    }

    /// The station of this name.
    ///
    /// # Errors
    /// [`ScanError::Request`] with the nearest name where there is none.
    pub fn station(&self, name: &str) -> Result<&Station, ScanError> {
        let found = self.stations.iter().find(|station| station.name == name);
        found.ok_or_else(|| {
            let near = kilwa_toml::nearest(name, self.stations.iter().map(|s| s.name.as_str()));
            let hint = match near {
                Some(near) => format!("did you mean {near}?"),
                None if self.stations.is_empty() => "it has no stations yet; use `kilwa scans import`".to_owned(),
                None => "`kilwa scans list` shows them".to_owned(),
            };
            ScanError::Request(format!("the survey has no station {name}; {hint}"))
        })
    }
}

/// The spool of a station of this name, as `survey.toml` has it.
pub(crate) fn spool_of(name: &str) -> String {
    format!("{STATIONS}/{name}.scan")
}

/// Whether two paths in the folder of the survey may be the same file: `.` in them means nothing, and some disks do not distinguish case.
pub(crate) fn is_same_file(a: &str, b: &str) -> bool {
    let parts = |path: &str| -> Vec<String> {
        let parts = path.split(['/', '\\']).filter(|part| !part.is_empty() && *part != ".");
        parts.map(str::to_lowercase).collect()
    };
    parts(a) == parts(b)
}

/// Whether a folder is a survey.
pub fn is_survey(folder: &Path) -> bool {
    folder.join(FILE).is_file()
}

/// The path and the text of the file.
fn text(folder: &Path) -> Result<(PathBuf, String), ScanError> {
    let path = folder.join(FILE);
    let cannot = |source| ReadError::Open { file: path.clone(), source };
    let file = plain_file::open(&path).map_err(cannot)?;
    let mut text = String::new();
    file.take(FILE_MAX + 1).read_to_string(&mut text).map_err(cannot)?;
    if text.len() as u64 > FILE_MAX {
        return Err(ScanError::Request(format!("{} has more than {FILE_MAX} bytes", path.display())));
    }
    Ok((path, text))
}

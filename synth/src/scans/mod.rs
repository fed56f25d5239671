//! Simulated laser scans of the synthetic fort: what `kilwa synth scans` writes, with its truth.
//!
//! Stations ([`stations`]) look at the fort's distance field, not at its mesh, through beams of several rays ([`beam`]), so mixed pixels appear where
//! real ones do. A sample is a pure function of the seed, the station and its place in the grid: bytes do not depend on threads or on the
//! machine. Samples are streamed to disk ([`format`]); memory does not grow with the survey. Everything is written into a folder that gets its
//! name when it is complete.

mod beam;
mod columns;
pub(crate) mod figures;
mod format;
mod instrument;
pub(crate) mod props;
mod sight;
pub(crate) mod stations;
mod surface;
#[cfg(test)]
mod tests;
pub(crate) mod truth;

pub use beam::Sample;
pub use figures::Extras;
pub use format::ScanFormat;
pub use instrument::{INSTRUMENTS, Instrument, LOWEST_ELEVATION, MIN_RANGE, Returns};
pub use sight::{Sight, SurfacePlace};
pub use stations::{Station, TILT_DEGREES};

use crate::folder::{self, FolderError};
use crate::fort::scene::Scene;
use crate::noise::{derive, hash3, normal};
use crate::piece::weld;
use crate::{UTM_CRS, UTM_ORIGIN, ply};
use columns::Columns;
use figures::Occasion;
use format::Header;
use glam::{DMat3, DVec3};
use kilwa_pack::plural::counted;
use props::Props;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Most stations.
pub const MAX_STATIONS: u32 = 1_000;
/// Fewest and most columns of the densest instrument.
pub const COLUMNS: (u32, u32) = (16, 40_000);
/// Maximum spacing of traced columns and rows.
pub const MAX_TRACE_EVERY: u32 = 64;
/// Fewest and most triangles of the true surface.
pub const TRUTH_TRIANGLES: (u64, u64) = (20_000, 1_000_000_000);

/// What a sample truly is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Class {
    /// Nothing in range.
    Empty = 0,
    /// The fort or its ground.
    Surface = 1,
    /// Returns of surfaces one behind the other, averaged: a point that is on neither.
    Mixed = 2,
    /// Somebody who walks about.
    Walker = 3,
    /// A blade of grass.
    Grass = 4,
    /// Scaffolding.
    Scaffolding = 5,
    /// A surface in range, but too little light came back: no point.
    Dropout = 6,
}

const CLASSES: usize = 7;

impl Class {
    /// All classes, in the order of their numbers.
    pub const ALL: [Self; CLASSES] =
        [Self::Empty, Self::Surface, Self::Mixed, Self::Walker, Self::Grass, Self::Scaffolding, Self::Dropout];

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::Surface => "surface",
            Self::Mixed => "mixed",
            Self::Walker => "walker",
            Self::Grass => "grass",
            Self::Scaffolding => "scaffolding",
            Self::Dropout => "dropout",
        }
    }
}

/// Which poses the scans get.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Poses {
    /// The true ones.
    True,
    /// None: each scan is in its own frame.
    None,
    /// The true ones, disturbed and without the tilt: standard deviations of each coordinate in metres, and of the heading in degrees.
    Rough {
        /// Of each coordinate, in metres.
        position: f64,
        /// Of the heading, in degrees.
        heading: f64,
    },
}

/// How to scan.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanOptions {
    /// Seed of the fort and of everything random.
    pub seed: u64,
    /// Number of stations.
    pub stations: u32,
    /// Columns of a scan of the densest instrument; rows follow.
    pub columns: u32,
    /// The format of the files.
    pub format: ScanFormat,
    /// The poses that the files have.
    pub poses: Poses,
    /// With [`Poses::Rough`]: how many stations, from the first, keep their true poses.
    pub surveyed: u32,
    /// Coordinates in [`UTM_CRS`] instead of the site's frame.
    pub utm: bool,
    /// What stands before the fort.
    pub extras: Extras,
    /// What the noise of ranges, intensities and colours is multiplied by: 0 is none.
    pub noise: f64,
    /// Instead of each instrument's own.
    pub returns: Option<Returns>,
    /// Trace only every so many columns and rows, and interpolate the samples between where the surface is smooth; 1 traces all.
    pub trace_every: u32,
    /// Also write the true surface, in about so many triangles.
    pub truth_mesh: Option<u64>,
}

impl ScanOptions {
    /// Defaults: seed 1, PTX, true poses.
    pub fn new(stations: u32, columns: u32) -> Self {
        Self {
            seed: 1,
            stations,
            columns,
            format: ScanFormat::Ptx,
            poses: Poses::True,
            surveyed: 0,
            utm: false,
            extras: Extras::default(),
            noise: 1.0,
            returns: None,
            trace_every: 1,
            truth_mesh: None,
        }
    }

    fn crs(&self) -> Option<&'static str> {
        (self.utm && self.poses != Poses::None).then_some(UTM_CRS)
    }
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScanReport {
    /// The scans, in the order of the stations.
    pub files: Vec<PathBuf>,
    /// The folder of the truth.
    pub truth: PathBuf,
    /// Samples of each class, in the order of [`Class::ALL`].
    pub samples: [u64; CLASSES],
    /// Stations indoors.
    pub indoors: u32,
    /// Bytes of the scans.
    pub bytes: u64,
    /// Triangles of the true surface, if it was asked for.
    pub truth_triangles: Option<u64>,
}

impl ScanReport {
    /// Samples that have a point.
    pub fn points(&self) -> u64 {
        let none = self.samples[Class::Empty as usize] + self.samples[Class::Dropout as usize];
        self.samples.iter().sum::<u64>() - none
    }
}

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum ScanError {
    /// No station, or too many.
    #[error("cannot simulate {}: ask for 1 to {MAX_STATIONS}", counted(*asked, "station", "stations"))]
    Stations {
        /// Asked for.
        asked: u32,
    },
    /// Too few or too many columns.
    #[error("cannot simulate {}: ask for {} to {}", counted(*asked, "column", "columns"), COLUMNS.0, COLUMNS.1)]
    Columns {
        /// Asked for.
        asked: u32,
    },
    /// The spacing of traced rays is zero or too large.
    #[error("the spacing of traced columns and rows cannot be {asked}: give a number from 1 to {MAX_TRACE_EVERY}")]
    TraceEvery {
        /// Asked for.
        asked: u32,
    },
    /// A factor or standard deviation that is negative, too large or no number.
    #[error("{what} cannot be {value}: give a number from 0 to {max}")]
    Value {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
        /// The largest that is possible.
        max: f64,
    },
    /// There are no places for so many stations.
    #[error("the fort has places for only {found} of {asked} stations: ask for fewer")]
    Places {
        /// Found.
        found: u32,
        /// Asked for.
        asked: u32,
    },
    /// Too few or too many triangles.
    #[error("cannot make a true surface of {}: ask for {} to {}", counted(*asked, "triangle", "triangles"), TRUTH_TRIANGLES.0, TRUTH_TRIANGLES.1)]
    Triangles {
        /// Asked for.
        asked: u64,
    },
    /// The mesh of the true surface could not be written.
    #[error(transparent)]
    Mesh(crate::SynthError),
    /// The name of the folder cannot be used.
    #[error("{}: {why}", .path.display())]
    Name {
        /// The name.
        path: PathBuf,
        /// What is wrong with it and what to do.
        why: &'static str,
    },
    /// A file could not be written.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: io::Error,
    },
}

impl From<FolderError> for ScanError {
    fn from(error: FolderError) -> Self {
        match error {
            FolderError::Name(path, why) => Self::Name { path, why },
            FolderError::Io(path, source) => Self::Io { path, source },
        }
    }
}

fn failed(path: &Path) -> impl Fn(io::Error) -> ScanError + '_ {
    |source| ScanError::Io { path: path.to_owned(), source }
}

/// Scan the fort and write the scans and their truth into the new folder `out`. `progress` is called with the samples written so far and the
/// number of all samples.
///
/// # Errors
/// [`ScanError`]; there is no folder `out` then.
pub fn write(options: &ScanOptions, out: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<ScanReport, ScanError> {
    check(options)?;
    folder::check(out)?;
    let scene = Scene::new(options.seed);
    let survey = Survey::new(&scene, options)?;
    let mut report = folder::create(out, |folder| survey.write(folder, progress))?;
    report.files.iter_mut().for_each(|file| *file = out.join(&*file));
    report.truth = out.join(TRUTH);
    Ok(report)
}

/// The folder of the truth.
const TRUTH: &str = "truth";

fn check(options: &ScanOptions) -> Result<(), ScanError> {
    if options.stations == 0 || options.stations > MAX_STATIONS {
        return Err(ScanError::Stations { asked: options.stations });
    }
    if !(COLUMNS.0..=COLUMNS.1).contains(&options.columns) {
        return Err(ScanError::Columns { asked: options.columns });
    }
    if !(1..=MAX_TRACE_EVERY).contains(&options.trace_every) {
        return Err(ScanError::TraceEvery { asked: options.trace_every });
    }
    if let Some(asked) = options.truth_mesh
        && !(TRUTH_TRIANGLES.0..=TRUTH_TRIANGLES.1).contains(&asked)
    {
        return Err(ScanError::Triangles { asked });
    }
    let within = |what, value: f64, max: f64| {
        if (0.0..=max).contains(&value) { Ok(()) } else { Err(ScanError::Value { what, value, max }) }
    };
    within("the noise", options.noise, 100.0)?;
    if let Poses::Rough { position, heading } = options.poses {
        within("the deviation of positions", position, 100.0)?;
        within("the deviation of headings", heading, 180.0)?;
    }
    Ok(())
}

/// A survey that is ready to be scanned.
struct Survey<'a> {
    scene: &'a Scene,
    options: &'a ScanOptions,
    stations: Vec<Station>,
}

impl<'a> Survey<'a> {
    fn new(scene: &'a Scene, options: &'a ScanOptions) -> Result<Self, ScanError> {
        let stations = stations::stations(scene, options.seed, options.stations);
        if stations.len() < options.stations as usize {
            return Err(ScanError::Places { found: stations.len() as u32, asked: options.stations });
        }
        Ok(Self { scene, options, stations })
    }

    /// Write everything into a folder.
    fn write(&self, folder: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<ScanReport, ScanError> {
        let grids = self.stations.iter().map(|s| s.instrument.grid(self.options.columns));
        let samples: u64 = grids.map(|(columns, rows)| u64::from(columns) * u64::from(rows)).sum();
        let total = samples + self.options.truth_mesh.unwrap_or(0);
        let truth = folder.join(TRUTH);
        fs::create_dir(&truth).map_err(failed(&truth))?;
        let mut report = ScanReport::default();
        let mut entries = Vec::new();
        let mut done = 0;
        progress(0, total);
        for station in &self.stations {
            let name = format!("scan_{:03}", station.number);
            let file = format!("{name}.{}", self.options.format.extension());
            let (path, labels) = (folder.join(&file), truth.join(format!("{name}.labels")));
            let header = self.header(station, &name);
            let mut columns = self.columns(station, File::create(&labels).map_err(failed(&labels))?);
            let mut stream = std::iter::from_fn(|| {
                let column = columns.next()?;
                done += column.as_ref().map_or(0, |column| column.len() as u64);
                if columns.is_batch_taken() {
                    progress(done, total);
                }
                Some(column)
            });
            let new = File::options().read(true).write(true).create_new(true).open(&path).map_err(failed(&path))?;
            let written = self.options.format.write(new, &header, &mut stream).map_err(failed(&path))?;
            written.sync_all().map_err(failed(&path))?;
            report.bytes += written.metadata().map_err(failed(&path))?.len();
            let counts = columns.finish().map_err(failed(&labels))?;
            for (sum, count) in report.samples.iter_mut().zip(counts) {
                *sum += count;
            }
            report.indoors += u32::from(station.indoors);
            report.files.push(PathBuf::from(&file));
            entries.push(truth::Entry {
                station,
                name,
                file,
                grid: (header.columns, header.rows),
                position: station.position + self.origin(),
                written: (header.rotation, header.position),
                counts,
            });
        }
        let poses = truth.join("poses.toml");
        let text = truth::poses(self.options, self.options.utm.then_some(UTM_CRS), &entries);
        let write = || -> io::Result<()> {
            let mut file = File::create(&poses)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        write().map_err(failed(&poses))?;
        if let Some(triangles) = self.options.truth_mesh {
            let path = truth.join("surface.ply");
            let made = self.surface(&path, triangles, &mut |n| progress(done + n.min(triangles), total));
            report.truth_triangles = Some(made.map_err(ScanError::Mesh)?);
        }
        Ok(report)
    }

    /// Write the true surface; gives its number of triangles.
    fn surface(&self, path: &Path, triangles: u64, progress: &mut dyn FnMut(u64)) -> Result<u64, crate::SynthError> {
        let surface = surface::Surface::new(self.scene, figures::grilles(self.scene), triangles);
        let mut comments = vec![
            format!(
                "kilwa synth scans, seed {}: the true surface, made by a program, no real place",
                self.options.seed
            ),
            "units metre, z up".to_owned(),
        ];
        comments.extend(self.options.utm.then(|| format!("crs {UTM_CRS}")));
        let mut file = ply::Writer::create(path, self.options.utm.then_some(UTM_ORIGIN), &comments)?;
        weld(&surface, 0, !self.options.utm, &mut file, progress)?;
        let finished = file.finish()?;
        let triangles = finished.triangles;
        finished.keep(false)?;
        Ok(triangles)
    }

    fn origin(&self) -> DVec3 {
        if self.options.utm { UTM_ORIGIN } else { DVec3::ZERO }
    }

    fn header(&self, station: &Station, name: &str) -> Header {
        let (columns, rows) = station.instrument.grid(self.options.columns);
        let seed = derive(derive(self.options.seed, 0xe2), u64::from(station.number));
        let poses = match self.options.poses {
            Poses::Rough { .. } if station.number <= self.options.surveyed => Poses::True,
            poses => poses,
        };
        let (rotation, position) = match poses {
            Poses::True => (station.rotation, station.position + self.origin()),
            Poses::None => (DMat3::IDENTITY, DVec3::ZERO),
            Poses::Rough { position, heading } => {
                let random = |k| normal(hash3(seed, k, 0, 0));
                let off = DVec3::new(random(1), random(2), random(3)) * position;
                let turned = station.heading + heading.to_radians() * random(4);
                (stations::about_z(turned), station.position + off + self.origin())
            }
        };
        Header {
            name: name.to_owned(),
            guid: seed,
            columns,
            rows,
            rotation,
            position,
            instrument: station.instrument.name,
            crs: self.options.crs(),
        }
    }

    fn columns(&self, station: &'a Station, labels: File) -> Columns<'a> {
        let seed = self.options.seed;
        let eye = Scene::from_site(station.position);
        let at = Occasion { station: station.number, later: station.later, eye, floor: station.floor };
        let props = Props::new(figures::props(self.scene, derive(seed, 0xe3), self.options.extras, &at));
        Columns::new(self.scene, self.options, station, props, labels)
    }
}

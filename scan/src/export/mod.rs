//! Stations for other programs: PTX and E57, with masks and poses applied.
//!
//! A file holds one station or several, in the order in which they are asked for. Memory holds one line of a grid (for PTX of a grid that is stored
//! by rows, some columns) or one packet, never a whole scan.

mod e57;
mod photograph;
mod ptx;

pub use self::e57::e57;
pub use self::ptx::{ptx, ptx_file};

use crate::ScanError;
use crate::mask;
use crate::spool::Reader;
use crate::survey::{Station, Survey};
use kilwa_scan_core::Grid;
use std::io;
use std::path::Path;

/// The stations of a survey that are to be written into one file.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// The folder of the survey.
    pub folder: &'a Path,
    /// The survey.
    pub survey: &'a Survey,
    /// The stations, in the order of the file.
    pub stations: Vec<&'a Station>,
    /// Also write samples that masks hide.
    pub unmasked: bool,
}

impl Request<'_> {
    fn open(&self, station: &Station) -> Result<Reader, ScanError> {
        mask::open(self.folder, station, self.unmasked)
    }

    /// Every station with its number of cells; finds what is damaged or missing before anything is written.
    fn cells(&self) -> Result<u64, ScanError> {
        let mut cells = 0;
        for station in &self.stations {
            cells += self.open(station)?.header().grid.cells();
        }
        Ok(cells)
    }

    /// Smallest and largest intensity of all of them; `None` where there is none.
    fn intensity(&self) -> Result<Option<[f32; 2]>, ScanError> {
        let mut range: Option<[f32; 2]> = None;
        for station in &self.stations {
            let statistics = self.open(station)?.header().statistics;
            if statistics.with_intensity > 0 {
                let [min, max] = statistics.intensity;
                range = Some(range.map_or([min, max], |r| [r[0].min(min), r[1].max(max)]));
            }
        }
        Ok(range)
    }
}

/// A station that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Its name.
    pub station: String,
    /// Its grid; `None` for an unstructured point cloud.
    pub grid: Option<Grid>,
    /// Points that were written.
    pub points: u64,
    /// Samples that masks hide, which were left out.
    pub masked: u64,
}

/// What was written into a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// The stations.
    pub stations: Vec<Exported>,
    /// How many photographs were written.
    pub photographs: u64,
    /// The range of intensities that was scaled to 0 to 1, where it had to be.
    pub scaled: Option<[f32; 2]>,
}

/// How errors and progress are reported while a file is written.
pub struct Output<'a> {
    /// Turns an error of the system into a [`ScanError`].
    pub cannot: &'a dyn Fn(io::Error) -> ScanError,
    /// Called with how much is done, of how much; an error stops the export.
    pub progress: &'a mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
}

impl std::fmt::Debug for Output<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Output").finish_non_exhaustive()
    }
}

//! The position of the frame of a reconstruction in the coordinates of the model.

use kilwa_scan::ScanError;
use kilwa_scan::colour::align::{Start, pairs};
use kilwa_scan_core::photo_pose::Similarity;
use std::path::{Path, PathBuf};

/// What is known about the frame. Without any of these, the poses are used as they are.
#[derive(clap::Args)]
pub(super) struct KnownFrame {
    /// A text file with three or more points that are known in both frames: name, x y z in the reconstruction, x y z in the model (metres), and optionally the standard deviation of the point (metres).
    #[arg(long, value_name = "FILE", group = "frame")]
    control_points: Option<PathBuf>,
    /// A text file with the measured positions of three or more cameras: name of the photograph, x y z in the coordinates of the model (metres), and optionally the standard deviation (metres).
    #[arg(long, value_name = "FILE", group = "frame")]
    camera_positions: Option<PathBuf>,
    /// The poses are in the coordinates of the model, except for a common shift, rotation and scale that displaces the points they see by at most this many metres. The correction is computed from the points of the reconstruction.
    #[arg(long, value_name = "METRES", group = "frame", value_parser = metres)]
    approximate_poses: Option<f64>,
}

impl KnownFrame {
    /// Where to start; None if the poses are used as they are.
    pub(super) fn start(&self) -> Result<Option<Start>, ScanError> {
        if let Some(file) = &self.control_points {
            return Ok(Some(Start::Points(pairs::read(file)?)));
        }
        if let Some(file) = &self.camera_positions {
            return Ok(Some(Start::Cameras(pairs::read_cameras(file)?)));
        }
        Ok(self.approximate_poses.map(|reach| Start::Given(Similarity::IDENTITY, reach)))
    }

    /// The files that are read.
    pub(super) fn files(&self) -> impl Iterator<Item = &Path> {
        self.control_points.iter().chain(&self.camera_positions).map(PathBuf::as_path)
    }
}

/// A length between a millimetre and a hundred metres.
fn metres(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number of metres".to_owned())?;
    if (0.001..=100.0).contains(&value) { Ok(value) } else { Err("give 0.001 to 100 metres".to_owned()) }
}

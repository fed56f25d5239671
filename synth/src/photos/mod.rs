//! Simulated photographs of the synthetic fort: what `kilwa synth photos` writes, with its ground truth.
//!
//! Cameras ([`place`]) look at the fort's distance field, with its colours, under a sun that moves ([`light`]), with people in front of it ([`people`]).
//! A photograph is rendered by rays ([`view`]) and exposed ([`develop`]); poses are written as other programs give them ([`colmap`]). A pixel is a pure
//! function of the seed, the photograph and its place: bytes do not depend on threads or on the machine. One picture at a time is in memory.
//! [`Session`] gives the ground truth: the reflectance of a point, its light, and which photographs see it.

mod colmap;
mod develop;
mod light;
mod people;
mod place;
mod session;
#[cfg(test)]
mod tests;
mod truth;
mod view;
mod write;

pub use develop::Exposure;
pub use place::Carrier;
pub use session::{Photo, Place, Session};
pub use write::{PhotoReport, write};

use kilwa_pack::plural::counted;
use std::io;
use std::path::PathBuf;

/// Most photographs, and most panoramas.
pub const MAX_PHOTOS: u32 = 2_000;
/// See [`MAX_PHOTOS`].
pub const MAX_PANORAMAS: u32 = 200;
/// Smallest and largest side of a photograph, in pixels.
pub const SIDES: (u32, u32) = (32, 8_192);
/// A photograph's longer side is at most this many times the shorter one.
pub const MAX_ASPECT: u32 = 4;
/// Largest exposure, in stops; largest share of people, in per cent; longest session, in hours; largest error of poses, in pixels.
pub const MAX_EV: f64 = 3.0;
/// See [`MAX_EV`].
pub const MAX_PASSERS_BY: f64 = 30.0;
/// See [`MAX_EV`].
pub const MAX_HOURS: f64 = 6.0;
/// See [`MAX_EV`].
pub const MAX_POSE_ERROR: f64 = 200.0;

/// How to photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoOptions {
    /// Seed of the fort and of everything random; the fort is that of `kilwa synth scans` with this seed.
    pub seed: u64,
    /// Number of photographs by hand and by drone.
    pub photos: u32,
    /// Number of panoramas: from the first stations of `kilwa synth scans`.
    pub panoramas: u32,
    /// Width and height of a photograph, in pixels. Panoramas are twice as wide, and as high as photographs are wide.
    pub size: (u32, u32),
    /// Exposures vary by up to this many stops in either direction.
    pub exposure: f64,
    /// Share of pixels that people hide, in per cent.
    pub passers_by: f64,
    /// Hours from the first to the last photograph.
    pub hours: f64,
    /// What the noise of the sensor is multiplied by: 0 is none.
    pub noise: f64,
    /// Write the reconstruction in a frame of its own instead of the survey's.
    pub sfm_frame: bool,
    /// By how many pixels (root mean square) the poses of photographs are wrong.
    pub pose_error: f64,
    /// Also write the range of each pixel.
    pub truth_depth: bool,
}

impl PhotoOptions {
    /// Defaults: seed 1, no panoramas, one stop, 2 % of people, two hours, true poses in the survey's frame.
    pub fn new(photos: u32, size: (u32, u32)) -> Self {
        Self {
            seed: 1,
            photos,
            panoramas: 0,
            size,
            exposure: 1.0,
            passers_by: 2.0,
            hours: 2.0,
            noise: 1.0,
            sfm_frame: false,
            pose_error: 0.0,
            truth_depth: false,
        }
    }

    fn check(&self) -> Result<(), PhotoError> {
        if self.photos > MAX_PHOTOS || self.panoramas > MAX_PANORAMAS || self.photos + self.panoramas == 0 {
            return Err(PhotoError::Count { photos: self.photos, panoramas: self.panoramas });
        }
        let (width, height) = self.size;
        let sides = SIDES.0..=SIDES.1;
        let (long, short) = (width.max(height), width.min(height));
        if !sides.contains(&width) || !sides.contains(&height) || long > MAX_ASPECT * short {
            return Err(PhotoError::Size { width, height });
        }
        for (what, value, max) in [
            ("the exposure", self.exposure, MAX_EV),
            ("the share of people", self.passers_by, MAX_PASSERS_BY),
            ("the number of hours", self.hours, MAX_HOURS),
            ("the noise", self.noise, 100.0),
            ("the error of poses", self.pose_error, MAX_POSE_ERROR),
        ] {
            if !(0.0..=max).contains(&value) {
                return Err(PhotoError::Value { what, value, max });
            }
        }
        Ok(())
    }
}

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    /// No picture, or too many.
    #[error(
        "cannot simulate {} and {}: ask for at most {MAX_PHOTOS} photographs and {MAX_PANORAMAS} panoramas, and for at least one of them",
        counted(*photos, "photograph", "photographs"), counted(*panoramas, "panorama", "panoramas")
    )]
    Count {
        /// Asked for.
        photos: u32,
        /// Asked for.
        panoramas: u32,
    },
    /// Pictures that are too small, too large, or too narrow.
    #[error(
        "cannot simulate photographs of {width} × {height} pixels: each side must have {} to {} pixels, and the longer one at most {MAX_ASPECT} times the shorter one",
        SIDES.0, SIDES.1
    )]
    Size {
        /// Asked for.
        width: u32,
        /// Asked for.
        height: u32,
    },
    /// A number that is negative, too large or NaN.
    #[error("{what} cannot be {value}: give a number from 0 to {max}")]
    Value {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f64,
        /// The largest that is possible.
        max: f64,
    },
    /// There are not enough positions for this many photographs.
    #[error("there are camera positions for only {found} of {asked} {what}: ask for fewer")]
    Places {
        /// Photographs or panoramas.
        what: &'static str,
        /// Found.
        found: u32,
        /// Asked for.
        asked: u32,
    },
    /// The name of the folder cannot be used.
    #[error("{}: {why}", .path.display())]
    Name {
        /// The name.
        path: PathBuf,
        /// What is wrong with it and what to do.
        why: &'static str,
    },
    /// A picture could not be encoded.
    #[error("{}: {source}", .path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What the encoder reports.
        source: image::ImageError,
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

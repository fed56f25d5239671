//! Photographs: what is known about each picture in a folder, from the pictures and from other programs' files with
//! cameras and poses.
//!
//! A format has a file here: COLMAP (text and binary), Bundler, Metashape, XMP sidecars of RealityCapture, MeshLab, E57. [`read`] finds out which of them a
//! folder holds, reads it, and finds the pictures that it names among the pictures of the folder; names never lead outside the folder.
//! Panoramas named after a station take its pose. Nothing is refused because a picture lacks something: what is missing is listed with the
//! picture ([`Missing`]). Files that are damaged are refused with their line or byte.
//!
//! Invariants: all cameras have the axes and pixels of [`kilwa_scan_core::camera`]; no more memory is used than the files justify.

mod binary;
mod bundler;
mod colmap;
mod e57;
mod folder;
mod meshlab;
mod metashape;
mod panorama;
mod picture;
mod reality_capture;
mod sniff;
mod survey;
pub(crate) mod text;
mod xml;

pub use e57::extract;
pub(crate) use picture::size as picture_size;
pub use picture::{Exposure, Picture, PictureFormat, states_position};
pub use sniff::Format;

use crate::ScanError;
use crate::survey::{Station, Survey};
use folder::Folder;
use glam::DVec3;
use kilwa_scan_core::{Camera, Pose, PosedCamera};
use std::path::{Path, PathBuf};

/// What is known of the photographs of a folder.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoSet {
    /// The format of the file with the poses, and the file (of COLMAP and of sidecars: the folder). None if there is none.
    pub poses: Option<(Format, PathBuf)>,
    /// The photographs, in the order of the file with the poses; then those that it does not name, by path.
    pub photos: Vec<PhotoRecord>,
    /// Points that the reconstruction found, in [`Frame::Reconstruction`].
    pub sparse_points: Vec<SparsePoint>,
    /// The coordinate system of the reconstruction, as the file states it: WKT, or a name.
    pub crs: Option<String>,
}

/// In which coordinates a pose is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// Those of the survey, metres.
    Survey,
    /// Those of a reconstruction from photographs: place, rotation and scale are arbitrary unless its program was given control points.
    Reconstruction,
}

/// A photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoRecord {
    /// Its name in the file with the poses, or its path in the folder.
    pub name: String,
    /// Where its pixels are.
    pub source: Source,
    /// The camera.
    pub camera: Option<Camera>,
    /// Takes coordinates of `frame` to those of the camera.
    pub camera_from_world: Option<Pose>,
    /// The frame of the pose.
    pub frame: Frame,
    /// The station that it belongs to.
    pub station: Option<String>,
    /// What the picture file states: its size, time and exposure.
    pub picture: Option<Picture>,
    /// A PNG picture that masks parts of it: `NAME.mask.png`, `NAME_mask.png` or `masks/NAME.png`.
    pub mask: Option<PathBuf>,
    /// Reasons why it cannot be used, or only with changes.
    pub missing: Vec<Missing>,
}

/// Where the pixels of a photograph are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// In a file.
    File(PathBuf),
    /// In an E57 file; [`extract`] writes them.
    Inside {
        /// The E57 file.
        file: PathBuf,
        /// The number of the picture in it, from 0.
        number: usize,
    },
    /// Not found.
    Missing,
}

/// What a photograph lacks.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Missing {
    /// The picture was not found in the folder.
    File,
    /// Several pictures of the folder have its name; this many.
    Ambiguous(usize),
    /// The picture cannot be read; why.
    Picture(String),
    /// It has no camera, or none that can be used; why.
    Calibration(String),
    /// It has no pose, or none that can be used; why, if that is known.
    Pose(Option<String>),
    /// The picture's size differs from the calibrated size.
    Size {
        /// Width and height of the picture, pixels.
        picture: [u32; 2],
        /// Those of the calibration.
        calibrated: [u32; 2],
    },
    /// It was disabled in the program that made the poses.
    Disabled,
}

impl std::fmt::Display for Missing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File => f.write_str("no file"),
            Self::Ambiguous(count) => write!(f, "{count} files with this name"),
            Self::Picture(why) => write!(f, "unreadable: {why}"),
            Self::Calibration(why) => write!(f, "no calibration: {why}"),
            Self::Pose(None) => f.write_str("no pose"),
            Self::Pose(Some(why)) => write!(f, "no pose: {why}"),
            Self::Size { picture: [w, h], calibrated: [a, b] } => {
                write!(f, "{w} × {h} pixels, but calibrated for {a} × {b}")
            }
            Self::Disabled => f.write_str("disabled"),
        }
    }
}

/// A point that a reconstruction found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparsePoint {
    /// Where, in the reconstruction's frame.
    pub at: DVec3,
    /// Its colour (sRGB).
    pub color: [u8; 3],
    /// In how many photographs it was seen.
    pub seen: u32,
}

/// How a folder is read.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// The file with the poses, or the folder of a COLMAP model; None: the only one of the folder.
    pub poses: Option<&'a Path>,
    /// Stations whose panoramas may be in the folder.
    pub stations: &'a [Station],
}

impl PhotoRecord {
    /// A photograph of which only the name is known.
    fn named(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            source: Source::Missing,
            camera: None,
            camera_from_world: None,
            frame: Frame::Reconstruction,
            station: None,
            picture: None,
            mask: None,
            missing: Vec::new(),
        }
    }

    /// Take a camera, or the reason why there is none.
    fn set_camera(&mut self, camera: Result<Camera, String>) {
        match camera {
            Ok(camera) => self.camera = Some(camera),
            Err(why) => self.missing.push(Missing::Calibration(why)),
        }
    }

    /// Take a pose, or the reason why there is none.
    fn set_pose(&mut self, pose: Result<Pose, Option<String>>) {
        match pose {
            Ok(pose) => self.camera_from_world = Some(pose),
            Err(why) => self.missing.push(Missing::Pose(why)),
        }
    }

    /// The camera with its pose, if both are known and the picture has the calibrated size.
    pub fn posed(&self) -> Option<PosedCamera> {
        let is_other_size = self.missing.iter().any(|missing| matches!(missing, Missing::Size { .. }));
        let (camera, camera_from_world) = (self.camera?, self.camera_from_world?);
        (!is_other_size).then_some(PosedCamera { camera, camera_from_world })
    }
}

/// Read what is known of the photographs in `folder`.
///
/// # Errors
/// [`ScanError::Read`]: a file is damaged (with its line or byte) or cannot be read. [`ScanError::Request`]: the folder has several files with poses, which are
/// named, or [`Options::poses`] is none.
pub fn read(folder: &Path, options: &Options<'_>) -> Result<PhotoSet, ScanError> {
    let folder = Folder::walk(folder)?;
    let found = match options.poses {
        Some(path) => Some(sniff::given(path)?),
        None => sniff::only(&folder)?,
    };
    let mut set = match &found {
        Some((format, path)) => sniff::read(*format, path, &folder)?,
        None => Contents::default(),
    };
    let mut used = vec![false; folder.pictures.len()];
    for photo in &mut set.photos {
        resolve(photo, &folder, &mut used);
    }
    for (picture, _) in folder.pictures.iter().zip(used).filter(|(_, is_used)| !is_used) {
        let mut photo = PhotoRecord::named(folder.relative(picture));
        photo.source = Source::File(picture.clone());
        set.photos.push(photo);
    }
    for photo in &mut set.photos {
        complete(photo, &folder, options.stations);
    }
    Ok(PhotoSet { poses: found, photos: set.photos, sparse_points: set.points, crs: set.crs })
}

/// Read what is known of the photographs that `survey.toml` in `folder` lists.
pub fn of_survey(folder: &Path, survey: &Survey) -> PhotoSet {
    let photos = survey.photographs.iter().map(|photograph| survey::record(folder, survey, photograph)).collect();
    PhotoSet { poses: None, photos, sparse_points: Vec::new(), crs: survey.crs.clone() }
}

/// What a file with poses holds.
#[derive(Debug, Default)]
struct Contents {
    photos: Vec<PhotoRecord>,
    points: Vec<SparsePoint>,
    crs: Option<String>,
}

/// Find the picture of a photograph in the folder.
fn resolve(photo: &mut PhotoRecord, folder: &Folder, used: &mut [bool]) {
    if photo.source == Source::Missing {
        match folder.find(&photo.name) {
            Ok(at) => photo.source = Source::File(folder.pictures[at].clone()),
            Err(missing) => photo.missing.push(missing),
        }
    }
    if let Source::File(path) = &photo.source
        && let Some(at) = folder.position(path)
    {
        used[at] = true;
    }
}

/// Add what the picture says, its mask, and what is missing.
fn complete(photo: &mut PhotoRecord, folder: &Folder, stations: &[Station]) {
    if let Source::File(path) = &photo.source {
        photo.mask = folder.mask(path);
        if photo.picture.is_none() {
            match picture::read(path) {
                Ok(picture) => photo.picture = Some(picture),
                Err(why) => photo.missing.push(Missing::Picture(why)),
            }
        }
    }
    if photo.camera_from_world.is_none() && photo.camera.is_none() && photo.missing.is_empty() {
        panorama::place(photo, stations);
    }
    note_missing(photo);
}

/// List what is missing and not yet listed.
fn note_missing(photo: &mut PhotoRecord) {
    let has = |photo: &PhotoRecord, kind: fn(&Missing) -> bool| photo.missing.iter().any(kind);
    if photo.camera.is_none() && !has(photo, |m| matches!(m, Missing::Calibration(_))) {
        photo.missing.push(Missing::Calibration("no file describes its camera".to_owned()));
    }
    if photo.camera_from_world.is_none() && !has(photo, |m| matches!(m, Missing::Pose(_))) {
        photo.missing.push(Missing::Pose(None));
    }
    if let Some((camera, picture)) = photo.camera.as_ref().zip(photo.picture.as_ref())
        && camera.size() != picture.size
    {
        photo.missing.push(Missing::Size { picture: picture.size, calibrated: camera.size() });
    }
    photo.missing.sort();
    photo.missing.dedup();
}

//! The pictures in an E57 file, without its points.

use super::e57::{Errors, Reader, blob_and_camera, open as open_file, pose_of};
use crate::ScanError;
use crate::survey::Camera;
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::Pose;
use std::io::Write;
use std::path::Path;

/// The pictures of a file.
pub(crate) struct Images {
    reader: Reader,
    errors: Errors,
    images: Vec<e57::Image>,
}

/// What the file states about a picture.
pub(crate) struct Stated {
    pub(crate) name: Option<String>,
    /// Where it was taken; its axes depend on the camera (see [`crate::photos`]).
    pub(crate) pose: Option<Pose>,
    pub(crate) camera: Option<Camera>,
    /// Whether the picture itself is in the file.
    pub(crate) has_data: bool,
}

/// Open a file.
pub(crate) fn open(path: &Path) -> Result<Images, ScanError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let file = plain_file::open(path).map_err(cannot)?;
    let total = file.metadata().map_err(cannot)?.len();
    let (reader, errors) = open_file(path, file, total)?;
    let images = reader.images();
    Ok(Images { reader, errors, images })
}

impl Images {
    pub(crate) fn is_empty(&self) -> bool {
        self.images.is_empty()
    }

    pub(crate) fn len(&self) -> usize {
        self.images.len()
    }

    /// What the file states about the picture of this number, from 0.
    pub(crate) fn get(&self, number: usize) -> Stated {
        let image = &self.images[number];
        let found = blob_and_camera(image);
        Stated {
            name: image.name.clone().filter(|name| !name.is_empty()),
            pose: pose_of(image.transform.as_ref()).and_then(Result::ok),
            has_data: found.is_some(),
            camera: found.and_then(|(_, camera)| camera),
        }
    }

    /// Write the file of the picture of this number, from 0.
    pub(crate) fn write(&mut self, number: usize, mut out: &mut dyn Write) -> Result<(), ScanError> {
        let Some((blob, _)) = blob_and_camera(&self.images[number]) else {
            let what = format!("picture {} without data", number + 1);
            return Err(self.errors.malformed(what, "a picture in the file"));
        };
        self.reader.blob(&blob.data, &mut out).map(drop).map_err(|e| self.errors.wrap(&e))
    }
}

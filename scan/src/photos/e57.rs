//! Pictures inside an E57 file: their cameras and poses; the pictures themselves are taken out on demand.

use super::{Contents, Frame, Missing, PhotoRecord, Source, survey};
use crate::ScanError;
use crate::read::e57_images::{Images, open};
use std::io::Write;
use std::path::Path;

/// Whether the file holds pictures. A damaged file counts as one, so that reading it reports the damage.
pub(super) fn has_pictures(path: &Path) -> bool {
    open(path).map_or(true, |images| !images.is_empty())
}

/// Read the pictures of a file.
pub(super) fn read(path: &Path) -> Result<Contents, ScanError> {
    let images: Images = open(path)?;
    let mut contents = Contents::default();
    for number in 0..images.len() {
        let image = images.get(number);
        let name = image.name.clone().unwrap_or_else(|| format!("picture {}", number + 1));
        let mut photo = PhotoRecord::named(name);
        photo.frame = Frame::Survey;
        photo.source = Source::Inside { file: path.to_owned(), number };
        survey::take(&mut photo, image.camera.as_ref(), image.pose);
        if !image.has_data {
            photo.missing.push(Missing::File);
        }
        if image.camera.is_none() {
            photo.missing.push(Missing::Calibration("the file holds the picture for reference only".to_owned()));
        }
        contents.photos.push(photo);
    }
    Ok(contents)
}

/// Write the picture of this number in an E57 file to `out`: a JPEG or PNG file, as it was put in.
///
/// # Errors
/// [`ScanError::Read`]: the file is damaged or cannot be read. [`ScanError::Request`]: it has no such picture.
pub fn extract(path: &Path, number: usize, out: &mut dyn Write) -> Result<(), ScanError> {
    let mut images = open(path)?;
    if number >= images.len() {
        let what = format!("{} has no picture {} (number of pictures: {})", path.display(), number + 1, images.len());
        return Err(ScanError::Request(what));
    }
    images.write(number, out)
}

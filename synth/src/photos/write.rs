//! The files of a session.

use super::colmap::Model;
use super::develop::develop;
use super::session::{Photo, Session};
use super::truth::{self, Counts};
use super::view::Rendered;
use super::{Carrier, PhotoError, PhotoOptions};
use crate::folder::{self, FolderError};
use crate::noise::{derive, hash2};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Quality of the JPEG files.
const QUALITY: u8 = 92;
/// Unit of the ranges of `truth/range`, in metres.
const RANGE_UNIT: f64 = 0.002;
const TRUTH: &str = "truth";

/// What was written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PhotoReport {
    /// The pictures: first the photographs, then the panoramas.
    pub files: Vec<PathBuf>,
    /// The folder of the ground truth.
    pub truth: PathBuf,
    /// Number of photographs taken by hand and by drone, and of panoramas.
    pub by_carrier: [u32; 3],
    /// Pixels of all pictures.
    pub pixels: u64,
    /// Pixels that show the fort, its ground or people.
    pub surface_pixels: u64,
    /// Pixels that show people, if only in part.
    pub people_pixels: u64,
    /// Sparse points of the reconstruction.
    pub points: u64,
    /// Bytes of the pictures.
    pub bytes: u64,
}

impl From<FolderError> for PhotoError {
    fn from(error: FolderError) -> Self {
        match error {
            FolderError::Name(path, why) => Self::Name { path, why },
            FolderError::Io(path, source) => Self::Io { path, source },
        }
    }
}

fn failed(path: &Path) -> impl Fn(io::Error) -> PhotoError + '_ {
    |source| PhotoError::Io { path: path.to_owned(), source }
}

/// The folder of the pictures of a carrier. Programs that look for photographs are given the folder above it, which does not hold the ground truth.
pub(super) fn folder(carrier: Carrier) -> &'static str {
    if carrier == Carrier::Tripod { "photos/panoramas" } else { "photos/images" }
}

/// Photograph the fort and write the pictures, the poses and the ground truth into the new folder `out`. `progress` is called with the pixels rendered
/// so far and the number of all pixels.
///
/// # Errors
/// [`PhotoError`]; there is no folder `out` then.
pub fn write(
    options: &PhotoOptions,
    out: &Path,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<PhotoReport, PhotoError> {
    options.check()?;
    folder::check(out)?;
    let session = Session::new(options)?;
    let mut report = folder::create(out, |folder| Writer { session: &session, options, folder }.write(progress))?;
    report.files.iter_mut().for_each(|file| *file = out.join(&*file));
    report.truth = out.join(TRUTH);
    Ok(report)
}

struct Writer<'a> {
    session: &'a Session,
    options: &'a PhotoOptions,
    folder: &'a Path,
}

impl Writer<'_> {
    fn write(&self, progress: &mut dyn FnMut(u64, u64)) -> Result<PhotoReport, PhotoError> {
        let photos = self.session.photos();
        let pixels = |photo: &Photo| u64::from(photo.size().0) * u64::from(photo.size().1);
        let total = photos.iter().map(pixels).sum();
        let mut report = PhotoReport { pixels: total, ..PhotoReport::default() };
        progress(0, total);
        let mut counts = Vec::new();
        let mut done = 0;
        for (number, photo) in photos.iter().enumerate() {
            let rendered = self.session.view(number).render(&mut |pixels| progress(done + pixels, total));
            let people = rendered.is_person.iter().filter(|is| **is).count() as u64;
            let count = Counts { pixels: pixels(photo), surface: rendered.surface, people };
            done += count.pixels;
            report.surface_pixels += count.surface;
            report.people_pixels += count.people;
            report.by_carrier[photo.carrier as usize] += 1;
            let file = PathBuf::from(folder(photo.carrier)).join(format!("{}.jpg", photo.name));
            report.bytes += self.picture(&file, number, photo, &rendered)?;
            report.files.push(file);
            self.mask(photo, &rendered)?;
            if self.options.truth_depth {
                self.range(photo, &rendered)?;
            }
            counts.push(count);
        }
        let model = Model::new(self.session, self.options);
        report.points = model.point_count();
        if !model.given.is_empty() {
            for (name, text) in model.texts(self.session) {
                self.text(&format!("photos/sparse/{name}"), &text)?;
            }
        }
        self.text("truth/photos.toml", &truth::photos(self.options, self.session, &model, &counts))?;
        Ok(report)
    }

    /// Write a file, and its folder if it is the first one in it; gives its number of bytes.
    fn file(&self, name: &Path, bytes: &[u8]) -> Result<u64, PhotoError> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(failed(parent))?;
        }
        let write = || -> io::Result<()> {
            let mut file = File::create_new(&path)?;
            file.write_all(bytes)?;
            file.sync_all()
        };
        write().map_err(failed(&path))?;
        Ok(bytes.len() as u64)
    }

    fn text(&self, name: &str, text: &str) -> Result<(), PhotoError> {
        self.file(Path::new(name), text.as_bytes()).map(|_| ())
    }

    fn encoded(
        &self,
        name: &Path,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<(), ImageError>,
    ) -> Result<u64, PhotoError> {
        let mut bytes = Vec::new();
        encode(&mut bytes).map_err(|source| PhotoError::Picture { path: self.folder.join(name), source })?;
        self.file(name, &bytes)
    }

    fn picture(&self, name: &Path, number: usize, photo: &Photo, rendered: &Rendered) -> Result<u64, PhotoError> {
        let (width, height) = photo.size();
        let seed = hash2(derive(self.options.seed, 0xf8), number as i64, 0);
        let pixels = develop(&rendered.light, (width, height), &photo.exposure, self.options.noise, seed);
        self.encoded(name, |bytes| {
            JpegEncoder::new_with_quality(bytes, QUALITY).write_image(&pixels, width, height, ExtendedColorType::Rgb8)
        })
    }

    /// 255 where people are.
    fn mask(&self, photo: &Photo, rendered: &Rendered) -> Result<(), PhotoError> {
        let (width, height) = photo.size();
        let pixels: Vec<u8> = rendered.is_person.iter().map(|is| if *is { 255 } else { 0 }).collect();
        let name = PathBuf::from(TRUTH).join("people").join(format!("{}.png", photo.name));
        let encode =
            |bytes: &mut Vec<u8>| PngEncoder::new(bytes).write_image(&pixels, width, height, ExtendedColorType::L8);
        self.encoded(&name, encode).map(|_| ())
    }

    /// Distance from the camera in units of 2 mm, 0 where nothing is.
    fn range(&self, photo: &Photo, rendered: &Rendered) -> Result<(), PhotoError> {
        let (width, height) = photo.size();
        let unit = |range: &f32| -> u16 {
            let units = (f64::from(*range) / RANGE_UNIT).round();
            if units <= f64::from(u16::MAX) { units as u16 } else { 0 }
        };
        let pixels: Vec<u8> = rendered.range.iter().flat_map(|range| unit(range).to_ne_bytes()).collect();
        let name = PathBuf::from(TRUTH).join("range").join(format!("{}.png", photo.name));
        let encode =
            |bytes: &mut Vec<u8>| PngEncoder::new(bytes).write_image(&pixels, width, height, ExtendedColorType::L16);
        self.encoded(&name, encode).map(|_| ())
    }
}

//! Smaller copies of published photographs, for the page of the model: previews, which it lays over the model, and thumbnails, which it lists.
//!
//! A photograph has 5 MB or more; without copies, the page would take minutes to load on a slow connection. They are made in a temporary folder before
//! anything is published, because the colour report states their SHA-256. Small photographs get none. Copies are RGB and have the colour profile of their photograph if
//! it is one of RGB, but no EXIF data.

use super::photographs::{Colours, Found};
use super::progress::{Progress, Stage};
use crate::new_file::private_folder;
use anyhow::Context;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageDecoder, ImageEncoder, ImageReader, RgbImage};
use kilwa_archive::checksums::sha256;
use kilwa_archive::colour_report::{PHOTOGRAPH_THUMBNAILS, PREVIEWS, Photograph, SmallerCopy};
use kilwa_files::plain_file;
use kilwa_pack::plural::{counted, plural};
use kilwa_pack::visible::visible;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

/// Longest side of a preview, pixels: that of a panorama surrounds the viewer, who sees a part of it.
const PREVIEW_SIDE: u32 = 1600;
const PANORAMA_SIDE: u32 = 4096;
/// Longest side of a thumbnail, pixels.
const THUMBNAIL_SIDE: u32 = 240;
/// Quality of the JPEG files, of 100.
const QUALITY: u8 = 80;
/// How many photographs are in memory at most, and their pixels together: each takes 3 bytes per pixel, some of them more. A larger one is alone.
const AT_ONCE: usize = 4;
const PIXELS_AT_ONCE: u64 = 200_000_000;
/// For the check of the disk: bytes of the copies of a photograph.
const EXPECTED: u64 = 400_000;

/// Bytes that the smaller copies of so many photographs take, about.
pub(super) fn expected_bytes(photographs: u64) -> u64 {
    photographs * EXPECTED
}

/// The copies of a photograph, not yet written.
struct Made {
    preview: Option<(Vec<u8>, [u32; 2])>,
    thumbnail: Option<(Vec<u8>, [u32; 2])>,
}

/// Make the copies of the photographs that the version includes, add them to the report and to the files of the version. A photograph that cannot be
/// decoded has none, with a warning.
///
/// # Errors
/// If a copy cannot be written.
pub(super) fn make(colours: &mut Colours, progress: &Progress) -> anyhow::Result<()> {
    let photographs = &colours.report.photographs;
    let by_path: BTreeMap<&str, &Photograph> =
        photographs.iter().filter_map(|photo| Some((photo.path.as_deref()?, photo))).collect();
    let wanted: Vec<(&Found, &Photograph)> =
        colours.files.iter().filter_map(|file| Some((file, *by_path.get(file.path.as_str())?))).collect();
    if wanted.is_empty() {
        return Ok(());
    }
    progress.begin(Stage::SmallerCopies);
    let folder = private_folder("kilwa-photographs-").context("cannot make a temporary folder")?;
    let all = colours.length();
    let mut added = Vec::new();
    let mut of_photograph: BTreeMap<String, [Option<SmallerCopy>; 2]> = BTreeMap::new();
    let mut failed = Vec::new();
    let mut left = wanted.as_slice();
    while !left.is_empty() {
        let (several, rest) = left.split_at(at_once(left));
        left = rest;
        let made: Vec<_> = several.par_iter().map(|(file, photo)| of_file(&file.from, photo)).collect();
        for ((file, photo), made) in several.iter().zip(made) {
            progress.more(file.bytes, all);
            let Made { preview, thumbnail } = match made {
                Ok(made) => made,
                Err(why) => {
                    failed.push(format!("{} ({why})", visible(&photo.name)));
                    continue;
                }
            };
            let mut write = |folder_of: &str, copy: Option<(Vec<u8>, [u32; 2])>| -> anyhow::Result<_> {
                let Some((bytes, size)) = copy else { return Ok(None) };
                let sum = sha256(&bytes);
                let path = colours.paths.copy(folder_of, &file.path, &sum);
                let from = folder.path().join(&sum);
                std::fs::write(&from, &bytes).with_context(|| format!("cannot write {}", from.display()))?;
                let bytes = bytes.len() as u64;
                added.push(Found { from, path: path.clone(), bytes, sha256: sum.clone() });
                Ok(Some(SmallerCopy { path, bytes, sha256: sum, size }))
            };
            let copies = [write(PREVIEWS, preview)?, write(PHOTOGRAPH_THUMBNAILS, thumbnail)?];
            of_photograph.insert(file.path.clone(), copies);
        }
    }
    for photo in &mut colours.report.photographs {
        if let Some([preview, thumbnail]) = photo.path.as_ref().and_then(|path| of_photograph.get(path)) {
            (photo.preview, photo.thumbnail) = (preview.clone(), thumbnail.clone());
        }
    }
    colours.warnings.extend(warning(&failed));
    colours.add(added, folder)
}

/// How many of these photographs are decoded at the same time: at least one.
fn at_once(photographs: &[(&Found, &Photograph)]) -> usize {
    let most = AT_ONCE.min(rayon::current_num_threads());
    let mut pixels = 0;
    let fits = |(_, photo): &&(&Found, &Photograph)| {
        pixels += photo.camera.size.iter().map(|side| u64::from(*side)).product::<u64>();
        pixels <= PIXELS_AT_ONCE
    };
    photographs.iter().take(most).take_while(fits).count().max(1)
}

fn warning(failed: &[String]) -> Option<String> {
    let first = failed.first()?;
    Some(format!(
        "{} no smaller copy for the page, because {} could not be decoded: {first}",
        counted(failed.len(), "photograph has", "photographs have"),
        plural(failed.len(), "it", "they")
    ))
}

/// Read a photograph and make its copies.
fn of_file(path: &Path, photo: &Photograph) -> Result<Made, String> {
    let file = plain_file::open(path).map_err(|e| e.to_string())?;
    let reader = ImageReader::new(BufReader::with_capacity(1 << 20, file));
    let mut decoder =
        reader.with_guessed_format().map_err(|e| e.to_string())?.into_decoder().map_err(|e| e.to_string())?;
    // The memory that decoding takes was bounded by this size.
    let (width, height) = decoder.dimensions();
    if [width, height] != photo.camera.size {
        let [wide, high] = photo.camera.size;
        return Err(format!("it has {width} × {height} pixels; its camera in the report has {wide} × {high}"));
    }
    let orientation = decoder.orientation().map_err(|e| e.to_string())?;
    let profile = decoder.icc_profile().map_err(|e| e.to_string())?.filter(|profile| is_of_rgb(profile));
    let picture = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb8();
    let side = if photo.camera.kind == "pinhole" { PREVIEW_SIDE } else { PANORAMA_SIDE };
    let preview = smaller(&picture, side);
    let thumbnail = smaller(preview.as_ref().unwrap_or(&picture), THUMBNAIL_SIDE).map(|picture| {
        let mut upright = DynamicImage::ImageRgb8(picture);
        upright.apply_orientation(orientation);
        upright.into_rgb8()
    });
    let encoded = |picture: Option<RgbImage>| picture.map(|picture| jpeg(&picture, profile.clone())).transpose();
    Ok(Made { preview: encoded(preview)?, thumbnail: encoded(thumbnail)? })
}

/// Whether a colour profile describes RGB values, as those of a copy are, and not grey values or inks (data colour space field, ICC.1:2022, 7.2.6).
fn is_of_rgb(profile: &[u8]) -> bool {
    profile.get(16..20) == Some(b"RGB ")
}

/// A picture whose longer side has so many pixels; None if it is not longer.
fn smaller(picture: &RgbImage, side: u32) -> Option<RgbImage> {
    let (width, height) = picture.dimensions();
    let longest = width.max(height);
    if longest <= side {
        return None;
    }
    let scaled =
        |length: u32| u32::try_from(u64::from(length) * u64::from(side) / u64::from(longest)).unwrap_or(side).max(1);
    // The mean of all pixels that a smaller one covers.
    Some(image::imageops::thumbnail(picture, scaled(width), scaled(height)))
}

fn jpeg(picture: &RgbImage, profile: Option<Vec<u8>>) -> Result<(Vec<u8>, [u32; 2]), String> {
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    if let Some(profile) = profile {
        encoder.set_icc_profile(profile).map_err(|e| e.to_string())?;
    }
    encoder.encode_image(picture).map_err(|e| e.to_string())?;
    Ok((bytes, [picture.width(), picture.height()]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;
    use kilwa_archive::ColourReport;

    /// Stands for a colour profile: the data colour space follows 16 bytes of other fields.
    const PROFILE: &[u8] = b"0123456789abcdefRGB XYZ ";

    /// A photograph of a report, and its file: red above, blue below, with this EXIF orientation.
    fn photograph(folder: &Path, kind: &str, [width, height]: [u32; 2], orientation: u8) -> (Found, Photograph) {
        let half = |y| if y < height / 2 { Rgb([200, 0, 0]) } else { Rgb([0, 0, 200]) };
        let picture = RgbImage::from_fn(width, height, |_, y| half(y));
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        // TIFF, little endian: one field, 0x0112 (orientation), one number of 16 bits.
        let exif =
            [b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".as_slice(), &[orientation, 0, 0, 0], &[0; 4]].concat();
        encoder.set_exif_metadata(exif).unwrap();
        encoder.set_icc_profile(PROFILE.to_vec()).unwrap();
        encoder.encode_image(&picture).unwrap();
        let from = folder.join(format!("{kind}-{orientation}.jpg"));
        std::fs::write(&from, &bytes).unwrap();
        let (length, sum) = (bytes.len(), sha256(&bytes));
        let report = serde_json::json!({
            "kilwa_colour_report": 1, "vertices": 1, "coloured_share": 1.0, "points_compared": 0, "brightness": 1.0, "frame": null, "left_out": [],
            "photographs": [{
                "name": "a.jpg", "file": "a.jpg", "path": "photographs/a.jpg", "bytes": length, "sha256": sum,
                "camera": { "kind": kind, "size": [width, height], "max_angle_degrees": 60.0 },
                "camera_from_world": { "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0] }, "position": [0.0, 0.0, 0.0],
                "refined": null, "seen": 1, "share": 1.0, "dropped": 0, "gain": [1.0, 1.0, 1.0], "offset": [0.0, 0.0, 0.0], "corner": 1.0,
            }],
        });
        let mut report = ColourReport::parse(report.to_string().as_bytes()).unwrap();
        let photo = report.photographs.remove(0);
        (Found { from, path: "photographs/a.jpg".to_owned(), bytes: photo.bytes, sha256: sum }, photo)
    }

    fn decoded(copy: Option<&(Vec<u8>, [u32; 2])>) -> RgbImage {
        let (bytes, size) = copy.unwrap();
        let picture = image::load_from_memory(bytes).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (size[0], size[1]));
        picture
    }

    #[test]
    fn a_preview_keeps_the_borders_of_its_photograph_and_a_thumbnail_is_upright() {
        let folder = private_folder("kilwa-test-").unwrap();
        // 6: turned to the left; to see it upright, turn it to the right.
        let (file, photo) = photograph(folder.path(), "pinhole", [2400, 1800], 6);
        let made = of_file(&file.from, &photo).unwrap();
        let preview = decoded(made.preview.as_ref());
        assert_eq!(preview.dimensions(), (1600, 1200));
        let is_red = |pixel: &Rgb<u8>| pixel[0] > 150 && pixel[2] < 50;
        assert!(is_red(preview.get_pixel(800, 10)) && !is_red(preview.get_pixel(800, 1190)));
        let thumbnail = decoded(made.thumbnail.as_ref());
        assert_eq!(thumbnail.dimensions(), (180, 240));
        // What was above is at the right.
        assert!(is_red(thumbnail.get_pixel(170, 120)) && !is_red(thumbnail.get_pixel(10, 120)));
        let bytes = made.preview.unwrap().0;
        assert!(bytes.len() < 200_000);
        // The colours keep their meaning; where and when it was taken is not repeated.
        let mut decoder =
            ImageReader::with_format(std::io::Cursor::new(&bytes), image::ImageFormat::Jpeg).into_decoder().unwrap();
        assert_eq!(decoder.icc_profile().unwrap().as_deref(), Some(PROFILE));
        assert_eq!(decoder.exif_metadata().unwrap(), None);
    }

    #[test]
    fn the_copies_of_a_grey_photograph_have_no_profile_of_grey_values() {
        let folder = private_folder("kilwa-test-").unwrap();
        let (file, photo) = photograph(folder.path(), "pinhole", [2400, 1800], 1);
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        encoder.set_icc_profile(b"0123456789abcdefGRAYXYZ ".to_vec()).unwrap();
        encoder.encode_image(&image::GrayImage::from_pixel(2400, 1800, image::Luma([120]))).unwrap();
        std::fs::write(&file.from, &bytes).unwrap();
        let made = of_file(&file.from, &photo).unwrap();
        for (bytes, _) in [made.preview, made.thumbnail].map(Option::unwrap) {
            let mut decoder = ImageReader::with_format(std::io::Cursor::new(&bytes), image::ImageFormat::Jpeg)
                .into_decoder()
                .unwrap();
            assert_eq!(decoder.icc_profile().unwrap(), None);
            assert_eq!(DynamicImage::from_decoder(decoder).unwrap().into_rgb8().get_pixel(0, 0), &Rgb([120; 3]));
        }
    }

    #[test]
    fn panoramas_keep_more_pixels_and_small_photographs_need_no_copies() {
        let folder = private_folder("kilwa-test-").unwrap();
        let (file, photo) = photograph(folder.path(), "equirectangular", [5000, 2500], 1);
        assert_eq!(decoded(of_file(&file.from, &photo).unwrap().preview.as_ref()).dimensions(), (4096, 2048));
        let (file, photo) = photograph(folder.path(), "pinhole", [240, 100], 1);
        let made = of_file(&file.from, &photo).unwrap();
        assert!(made.preview.is_none() && made.thumbnail.is_none());
        let (file, photo) = photograph(folder.path(), "pinhole", [1600, 3], 1);
        let made = of_file(&file.from, &photo).unwrap();
        assert!(made.preview.is_none() && decoded(made.thumbnail.as_ref()).dimensions() == (240, 1));
    }

    #[test]
    fn a_file_that_is_no_picture_is_named_with_the_reason() {
        let folder = private_folder("kilwa-test-").unwrap();
        let (file, photo) = photograph(folder.path(), "pinhole", [300, 200], 1);
        let larger = Photograph {
            camera: kilwa_archive::colour_report::Camera { size: [30_000, 20_000], ..photo.camera.clone() },
            ..photo.clone()
        };
        let why = of_file(&file.from, &larger).err().unwrap();
        assert_eq!(why, "it has 300 × 200 pixels; its camera in the report has 30000 × 20000");
        assert_eq!(at_once(&[(&file, &larger), (&file, &photo)]), 1);
        std::fs::write(&file.from, b"\xff\xd8\xff nothing").unwrap();
        assert!(of_file(&file.from, &photo).is_err());
        let words = warning(&["a.jpg (why)".to_owned(), "b.jpg (why)".to_owned()]).unwrap();
        assert_eq!(
            words,
            "2 photographs have no smaller copy for the page, because they could not be decoded: a.jpg (why)"
        );
        assert_eq!(warning(&[]), None);
    }
}

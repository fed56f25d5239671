//! The text files: a line for each camera and point, two for each image.

use super::super::text::{Lines, number, quoted};
use super::super::{PhotoRecord, SparsePoint};
use super::{Cameras, models, pose, record};
use crate::ScanError;
use glam::DVec3;
use std::path::Path;

/// `cameras.txt`: CAMERA_ID MODEL WIDTH HEIGHT PARAMS.
pub(super) fn cameras(path: &Path) -> Result<Cameras, ScanError> {
    let mut lines = Lines::open(path)?;
    let mut cameras = Cameras::default();
    while let Some(line) = lines.next_content()? {
        let Some((id, camera)) = one_camera(line) else {
            let found = quoted(line);
            return Err(lines.wrong(found, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS of a model of COLMAP"));
        };
        cameras.insert(id, camera);
    }
    Ok(cameras)
}

fn one_camera(line: &str) -> Option<(u32, Result<kilwa_scan_core::Camera, String>)> {
    let mut words = line.split_ascii_whitespace();
    let id = words.next()?.parse().ok()?;
    let name = words.next()?;
    let size = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
    let mut values = [0.0; models::PARAMETERS_MAX];
    let count = models::by_name(name)?;
    for value in &mut values[..count] {
        *value = number(words.next()?)?;
    }
    words.next().is_none().then(|| (id, models::camera(name, size, &values[..count])))
}

/// `images.txt`: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of observations, which may be empty.
pub(super) fn images(path: &Path, cameras: &Cameras) -> Result<Vec<PhotoRecord>, ScanError> {
    let mut lines = Lines::open(path)?;
    let (mut photos, mut announced) = (Vec::new(), None);
    while let Some(line) = lines.next()? {
        if line.is_empty() || line.starts_with('#') {
            announced = announced.or(count_of(line));
            continue;
        }
        let photo = one_image(line, cameras).map_err(|expected| (quoted(line), expected));
        photos.push(photo.map_err(|(found, expected)| lines.wrong(found, expected))?);
        let observations = lines.skip()?;
        if one_image(observations, cameras).is_ok() {
            let found = quoted(observations);
            let expected = "the observations of the image above it, X Y POINT3D_ID for each, or an empty line";
            return Err(lines.wrong(found, expected));
        }
    }
    check(&lines, announced, photos.len(), "images")?;
    Ok(photos)
}

fn one_image(line: &str, cameras: &Cameras) -> Result<PhotoRecord, &'static str> {
    const FORM: &str = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME";
    let mut rest = line;
    let mut word = || {
        let (word, after) = rest.trim_start().split_once([' ', '\t'])?;
        rest = after;
        Some(word)
    };
    let mut values = [0.0; 7];
    word().and_then(|id| id.parse::<u32>().ok()).ok_or(FORM)?;
    for value in &mut values {
        *value = word().and_then(number).ok_or(FORM)?;
    }
    let camera = word().and_then(|camera| camera.parse().ok()).ok_or(FORM)?;
    let name = rest.trim();
    if name.is_empty() {
        return Err(FORM);
    }
    let pose = pose(values).ok_or("a quaternion other than 0")?;
    record(name.to_owned(), pose, camera, cameras).ok_or("a camera that is in cameras.txt")
}

/// `points3D.txt`: POINT3D_ID X Y Z R G B ERROR TRACK.
pub(super) fn points(path: &Path) -> Result<Vec<SparsePoint>, ScanError> {
    let mut lines = Lines::open(path)?;
    let (mut points, mut announced) = (Vec::new(), None);
    while let Some(line) = lines.next()? {
        if line.is_empty() || line.starts_with('#') {
            announced = announced.or(count_of(line));
            continue;
        }
        let Some(point) = one_point(line) else {
            let found = quoted(line);
            return Err(lines.wrong(found, "POINT3D_ID X Y Z R G B ERROR and pairs of IMAGE_ID POINT2D_IDX"));
        };
        points.push(point);
    }
    check(&lines, announced, points.len(), "points")?;
    Ok(points)
}

fn one_point(line: &str) -> Option<SparsePoint> {
    let mut words = line.split_ascii_whitespace();
    words.next()?.parse::<u64>().ok()?;
    let at = DVec3::new(number(words.next()?)?, number(words.next()?)?, number(words.next()?)?);
    let mut color = [0; 3];
    for value in &mut color {
        *value = words.next()?.parse().ok()?;
    }
    // The error is NaN or -1 where it was not computed.
    words.next()?.parse::<f64>().ok()?;
    let track = words.count();
    track.is_multiple_of(2).then_some(SparsePoint { at, color, seen: u32::try_from(track / 2).unwrap_or(u32::MAX) })
}

/// The number in a comment such as `# Number of images: 8, mean observations per image: 20`.
fn count_of(line: &str) -> Option<u64> {
    let (before, after) = line.strip_prefix("# Number of ")?.split_once(':')?;
    let is_count = ["images", "points"].contains(&before);
    let digits = after.trim().split(',').next()?;
    if is_count { digits.parse().ok() } else { None }
}

fn check(lines: &Lines, announced: Option<u64>, found: usize, what: &str) -> Result<(), ScanError> {
    match announced {
        Some(count) if count != found as u64 => Err(lines.ended(format!(
            "{count} {what}, as stated at the start of the file, not {found}; copy or export the file again"
        ))),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_may_hold_spaces() {
        let cameras = [one_camera("3 PINHOLE 10 10 5 5 5 5").unwrap()].into_iter().collect();
        let photo = one_image("1 1 0 0 0 0 0 0 3 my photo (1).jpg", &cameras).unwrap();
        assert_eq!(photo.name, "my photo (1).jpg");
        assert!(one_image("1 1 0 0 0 0 0 0 4 a.jpg", &cameras).is_err());
        assert!(one_image("1 1 0 0 0 0 0 0 3", &cameras).is_err());
    }
}

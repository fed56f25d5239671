//! Bundler: `bundle.out` (version 0.3), and a list of its pictures beside it.
//!
//! P = R·X + t, p = -P / P.z, pixel = f · (1 + k1·|p|² + k2·|p|⁴) · p, measured from the centre of the picture, x right, y up: the camera
//! looks along -z. A focal length of 0 stands for a picture that was not registered. The size of a picture is not in the file.
//!
//! Source: "Bundler v0.4 User's Manual", part VI (<https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html>).

use super::folder::Folder;
use super::text::{Lines, number, numbers, quoted};
use super::{Contents, Missing, PhotoRecord, SparsePoint, picture};
use crate::ScanError;
use glam::{DMat3, DMat4, DVec2, DVec3};
use kilwa_scan_core::{Camera, Distortion, Pose};
use std::path::{Path, PathBuf};

/// The first words of the file.
pub(super) const MAGIC: &str = "# Bundle file v0.3";

/// Read a bundle file.
pub(super) fn read(path: &Path, folder: &Folder) -> Result<Contents, ScanError> {
    let names = list(path)?;
    let mut lines = Lines::open(path)?;
    let first = lines.next()?.map(str::to_owned).unwrap_or_default();
    if first != MAGIC {
        return Err(lines.wrong(quoted(&first), format!("\"{MAGIC}\"")));
    }
    let [cameras, points] = counts(&mut lines)?;
    if cameras != names.1.len() as u64 {
        let what = format!("a camera count of {cameras}");
        return Err(lines.wrong(what, format!("{}, the number of names in {}", names.1.len(), names.0.display())));
    }
    let mut contents = Contents::default();
    for name in names.1 {
        contents.photos.push(one_camera(&mut lines, &name, folder)?);
    }
    for _ in 0..points {
        contents.points.push(one_point(&mut lines)?);
    }
    let more = lines.next_content()?.map(quoted);
    // MeshLab ends a file without points with such a line.
    let is_of_meshlab = points == 0 && more.as_deref() == Some("\"0 0 0\"");
    if let Some(more) = more.filter(|_| !is_of_meshlab) {
        return Err(lines.wrong(more, format!("the end of the file (number of points: {points})")));
    }
    Ok(contents)
}

fn counts(lines: &mut Lines) -> Result<[u64; 2], ScanError> {
    let line = lines.next_content()?.map(str::to_owned);
    let line = line.ok_or_else(|| lines.ended("the number of cameras and of points"))?;
    let counts: Option<Vec<u64>> = line.split_ascii_whitespace().map(|word| word.parse().ok()).collect();
    match counts.as_deref() {
        Some([cameras, points]) => Ok([*cameras, *points]),
        _ => Err(lines.wrong(quoted(&line), "the number of cameras and of points")),
    }
}

/// A line of `N` numbers.
fn line_of<const N: usize>(lines: &mut Lines, what: &str) -> Result<[f64; N], ScanError> {
    let line = lines.next_content()?.map(|line| (numbers(line), quoted(line)));
    match line {
        Some((Some(numbers), _)) => Ok(numbers),
        Some((None, found)) => Err(lines.wrong(found, format!("{what}: {N} numbers"))),
        None => Err(lines.ended(format!("{what}: {N} numbers"))),
    }
}

fn one_camera(lines: &mut Lines, name: &str, folder: &Folder) -> Result<PhotoRecord, ScanError> {
    let [focal, k1, k2] = line_of(lines, "focal length, k1 and k2")?;
    let mut rows = [DVec3::ZERO; 3];
    for row in &mut rows {
        *row = DVec3::from_array(line_of(lines, "a row of a rotation")?);
    }
    let translation = DVec3::from_array(line_of(lines, "a translation")?);
    let mut photo = PhotoRecord::named(name);
    if focal == 0.0 {
        photo.missing.push(Missing::Pose(Some("not registered by Bundler".to_owned())));
        return Ok(photo);
    }
    // Turned about x, so that y points down and z forward.
    let flip = DVec3::new(1.0, -1.0, -1.0);
    let rotation = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    let rotation = DMat3::from_diagonal(flip) * rotation;
    let matrix = DMat4::from_mat3_translation(rotation, flip * translation);
    let (pose, _) =
        Pose::from_matrix(matrix).map_err(|e| lines.wrong(e.to_string(), "a rotation and a translation"))?;
    photo.set_pose(Ok(pose));
    photo.set_camera(camera(focal, [k1, k2], size(name, folder)));
    Ok(photo)
}

fn size(name: &str, folder: &Folder) -> Option<[u32; 2]> {
    let at = folder.find(name).ok()?;
    Some(picture::read(&folder.pictures[at]).ok()?.size)
}

fn camera(focal: f64, [k1, k2]: [f64; 2], size: Option<[u32; 2]>) -> Result<Camera, String> {
    let size = size.ok_or("the size of the picture is unknown")?;
    let distortion = Distortion::Brown { k: [k1, k2, 0.0, 0.0], p: [0.0; 2] };
    let center = DVec2::from_array(size.map(f64::from)) * 0.5;
    Camera::pinhole(size, DVec2::splat(focal), center, distortion).map_err(|e| e.to_string())
}

fn one_point(lines: &mut Lines) -> Result<SparsePoint, ScanError> {
    let at = DVec3::from_array(line_of(lines, "the position of a point")?);
    let color = line_of::<3>(lines, "the colour of a point")?.map(|value| value.clamp(0.0, 255.0) as u8);
    let line = lines.next_content()?.map(|line| (seen(line), quoted(line)));
    match line {
        Some((Some(seen), _)) => Ok(SparsePoint { at, color, seen }),
        Some((None, found)) => Err(lines.wrong(found, "the number of views of a point, and four numbers for each")),
        None => Err(lines.ended("the views of a point")),
    }
}

fn seen(line: &str) -> Option<u32> {
    let mut words = line.split_ascii_whitespace();
    let count: u32 = words.next()?.parse().ok()?;
    (words.count() as u64 == 4 * u64::from(count)).then_some(count)
}

/// The names of the pictures, in the order of the cameras: `NAME.list.txt`, `list.txt` or `image_list.txt` beside the file.
fn list(path: &Path) -> Result<(PathBuf, Vec<String>), ScanError> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let beside = path.parent().unwrap_or(Path::new(""));
    let around = [beside.to_owned(), beside.join("..")];
    let own = [format!("{stem}.list.txt"), format!("{stem}.out.list.txt"), format!("{stem}.txt")];
    let usual = ["list.txt", "list_focal.txt", "image_list.txt", "pictures.txt"].map(str::to_owned);
    let candidates = around.iter().flat_map(|folder| own.iter().chain(&usual).map(|name| folder.join(name)));
    let Some(list) = candidates.into_iter().find(|path| path.is_file()) else {
        return Err(ScanError::Request(format!(
            "there is no list of pictures beside {}; put {stem}.list.txt or list.txt there, with one file name per line in the order of the cameras",
            path.display()
        )));
    };
    let mut lines = Lines::open(&list)?;
    let mut names = Vec::new();
    while let Some(line) = lines.next_content()? {
        names.push(without_focal(line).to_owned());
    }
    Ok((list, names))
}

/// A line of the list without the 0 and the focal length that Bundler's scripts add.
fn without_focal(line: &str) -> &str {
    let mut parts = line.rsplitn(3, [' ', '\t']);
    match (parts.next(), parts.next(), parts.next()) {
        (Some(focal), Some("0"), Some(name)) if number(focal).is_some() => name.trim_end(),
        _ => line,
    }
}

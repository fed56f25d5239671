//! Published reports of colours: what `kilwa colour --report` writes, kept in a version as `colour-report.json`, and the photographs that a version includes.
//!
//! [`ColourReport::parse`] reads the file of `kilwa colour` or of a version. Whatever is not part of the report is left out, folders of the computer on which
//! the model was coloured among it, and a photograph that cannot be is refused with its number. [`ColourReport::to_bytes`] writes a canonical form: a server
//! that receives such a file can check that it contains nothing else.
//!
//! Positions are metres in the coordinates of the model, z up; `camera_from_world` takes them to the axes of the camera (x right, y down, z forward).
//! Allocation is bounded by the length of the file.

use crate::checksums::{Checksum, is_sha256, sha256};
use crate::layout::{PHOTOGRAPHS, is_photograph};
use glam::DVec3;
use kilwa_pack::metadata::{SourceFile, sum_lines};
use kilwa_pack::plural::counted;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use thiserror::Error;

/// The version of this form that is written, and the only one that is read.
pub const COLOUR_REPORT_FORM: u32 = 1;
/// Maximum size of a published report, bytes.
pub const COLOUR_REPORT_MAX: u64 = 16_000_000;
/// Maximum size of a file that is read, bytes; larger, because `kilwa colour` writes it with line breaks and folders.
pub const COLOUR_REPORT_READ_MAX: u64 = 4 * COLOUR_REPORT_MAX;
/// Maximum number of photographs, used and left out.
pub const PHOTOGRAPHS_MAX: usize = 10_000;
/// Largest photograph or mask that is published, bytes.
pub const PHOTOGRAPH_MAX: u64 = 1 << 30;
/// Larger numbers are refused: no survey is that large.
const FAR: f64 = 1e12;
/// By how much the length of a quaternion may differ from 1.
const UNIT: f64 = 1e-6;
/// Longest text, bytes.
const TEXT_MAX: usize = 1000;
/// Most differences that a message lists.
const LISTED: usize = 5;
/// Largest smaller copy of a photograph, bytes.
pub const SMALLER_COPY_MAX: u64 = 16 << 20;
/// Longest side of a smaller copy, pixels.
const SMALLER_COPY_SIDE_MAX: u32 = 1 << 14;
/// Folders of the smaller copies, with which the page of the model shows photographs: as pictures, and in lists.
pub const PREVIEWS: &str = "photographs/previews";
/// See [`PREVIEWS`].
pub const PHOTOGRAPH_THUMBNAILS: &str = "photographs/thumbnails";
/// Folder of the masks, and how many folders of a photograph's name are kept.
const MASKS: &str = "photographs/masks";
const FOLDERS_KEPT: usize = 3;
/// Longest part of a path, characters.
const PART_MAX: usize = 80;

/// Why a report is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ColourReportError {
    /// It is not JSON, or not a report of this form.
    #[error("not a report as written by kilwa colour --report: {0}")]
    Form(String),
    /// It was written before reports had hashes.
    #[error(
        "it has no \"kilwa_colour_report\": either it is not a report of kilwa colour, or an earlier version of kilwa wrote it, without the hashes of the photographs. Run kilwa colour again with --report"
    )]
    Unversioned,
    /// Written by a later program.
    #[error("the report has format version {0}; this program reads version {COLOUR_REPORT_FORM}. Use a newer kilwa")]
    Newer(u64),
    /// An invalid photograph.
    #[error("photograph {number} (\"{name}\"): {what}")]
    Photograph {
        /// Its number in the file, from 1.
        number: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        what: String,
    },
    /// It is about another pack.
    #[error(
        "the report and the pack do not list the same photographs: {0}. Give the report that kilwa colour wrote together with this pack"
    )]
    Sources(String),
    /// It is too long.
    #[error("the report would take {0} bytes, more than the maximum of {COLOUR_REPORT_MAX}")]
    Long(usize),
}

/// A camera, as `kilwa scans photos list --json` describes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// `pinhole`, `equirectangular` or `cylindrical`.
    pub kind: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Focal lengths, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focal: Option<[f64; 2]>,
    /// Principal point, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 2]>,
    /// Skew, pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skew: Option<f64>,
    /// Pixels per radian of a panorama.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f64; 2]>,
    /// Distortion of the lens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Lens>,
    /// Largest angle from the optical axis at which the distortion is valid.
    pub max_angle_degrees: f64,
}

/// Distortion of a lens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// `none`, `brown`, `rational` or `fisheye`.
    pub kind: String,
    /// Radial coefficients.
    pub k: Vec<f64>,
    /// Tangential coefficients.
    pub p: Vec<f64>,
}

/// Where a camera was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// A unit quaternion.
    pub rotation_wxyz: [f64; 4],
    /// Metres.
    pub translation: DVec3,
}

/// How a pose was refined.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Refined {
    /// By how much what the photograph shows was shifted, pixels.
    pub moved_px: f64,
    /// Distances between photograph and model that remain, pixels (root mean square).
    pub residual_px: f64,
    /// The share of the patches that agree with the pose.
    pub agreement: f64,
}

/// A smaller copy of a photograph, for the page of the model: JPEG without EXIF data.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SmallerCopy {
    /// Its path in the version.
    pub path: String,
    /// Length of its file.
    pub bytes: u64,
    /// SHA-256 of its file.
    pub sha256: Checksum,
    /// Width and height, pixels.
    pub size: [u32; 2],
}

impl SmallerCopy {
    fn is_valid(&self) -> bool {
        is_photograph(&self.path)
            && self.path.rsplit_once('.').is_some_and(|(_, ending)| ending == "jpg")
            && is_sha256(&self.sha256)
            && (1..=SMALLER_COPY_MAX).contains(&self.bytes)
            && self.size.iter().all(|side| (1..=SMALLER_COPY_SIDE_MAX).contains(side))
    }
}

/// A photograph that was used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Photograph {
    /// Its name in the file with the poses, or its path in the folder.
    pub name: String,
    /// Its file name.
    #[serde(deserialize_with = "file_name")]
    pub file: String,
    /// Its path in the version, if the version includes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
    /// A copy with the same borders and fewer pixels, if the version includes it: that of a photograph that is large.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preview: Option<SmallerCopy>,
    /// A copy for lists, upright according to the EXIF data, if the version includes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thumbnail: Option<SmallerCopy>,
    /// Length of its file.
    pub bytes: u64,
    /// SHA-256 of its file.
    pub sha256: Checksum,
    /// File name of its mask, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "some_file_name")]
    pub mask: Option<String>,
    /// Path of the mask in the version, if the version includes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_path: Option<String>,
    /// Length of the mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_bytes: Option<u64>,
    /// SHA-256 of the mask.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask_sha256: Option<Checksum>,
    /// The camera.
    pub camera: Camera,
    /// Its pose, refined if that was asked for.
    pub camera_from_world: Pose,
    /// Its position, metres.
    pub position: DVec3,
    /// How the pose was refined, if it was.
    pub refined: Option<Refined>,
    /// Vertices that it sees.
    pub seen: u64,
    /// The sum of its shares in the colours of vertices.
    pub share: f64,
    /// Vertices for which it was dropped.
    pub dropped: u64,
    /// Gain of each colour channel.
    pub gain: [f64; 3],
    /// Offset of each colour channel, in linear light.
    pub offset: [f64; 3],
    /// Brightness of the lens in the corners, relative to the centre.
    pub corner: f64,
}

/// A photograph that was not used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// Why.
    pub why: String,
    /// Length of its file, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// SHA-256 of its file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<Checksum>,
}

/// A known point or camera of the reconstruction, and its residuals, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Its name.
    pub name: String,
    /// After the first estimate.
    pub before: f64,
    /// After the fit to the surface.
    pub after: f64,
}

/// How well the points of the reconstruction lie on the surface.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct OnSurface {
    /// Points on it.
    pub points: u64,
    /// Their share of all points.
    pub share: f64,
    /// Their median distance, metres.
    pub median: f64,
}

/// How the frame of the reconstruction was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Scale of the similarity from the reconstruction to the model.
    pub scale: f64,
    /// Its rotation.
    pub rotation_wxyz: [f64; 4],
    /// Its translation, metres.
    pub translation: DVec3,
    /// Root mean square of the residuals, metres.
    pub rms: Option<f64>,
    /// Residuals of known points or cameras.
    pub residuals: Vec<Residual>,
    /// Known cameras without a pose.
    pub cameras_without_pose: Vec<String>,
    /// The fit to the surface.
    pub surface: Option<OnSurface>,
    /// Why it was not fitted.
    pub surface_not_used: Option<String>,
}

/// The report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ColourReport {
    /// [`COLOUR_REPORT_FORM`].
    pub kilwa_colour_report: u32,
    /// Vertices of the finest surface.
    pub vertices: u64,
    /// The share of them that photographs coloured.
    pub coloured_share: f64,
    /// Places at which exposures were compared.
    pub points_compared: u64,
    /// By which factor the colours were darkened.
    pub brightness: f64,
    /// The frame of the reconstruction, if it was not that of the model.
    pub frame: Option<Frame>,
    /// Photographs that were used.
    pub photographs: Vec<Photograph>,
    /// Photographs that were not.
    pub left_out: Vec<LeftOut>,
}

/// The last part of a path of any system.
fn last_part(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or_default().to_owned()
}

fn file_name<'de, D: serde::Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    String::deserialize(from).map(|path| last_part(&path))
}

fn some_file_name<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Option::<String>::deserialize(from).map(|path| path.map(|path| last_part(&path)))
}

/// A file of the version that a report names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IncludedFile<'a> {
    /// Path in the version.
    pub path: &'a str,
    /// Length.
    pub bytes: u64,
    /// SHA-256.
    pub sha256: &'a str,
}

impl Photograph {
    /// Whether colours of the model come from it.
    pub fn is_used(&self) -> bool {
        self.seen > 0
    }

    /// Its smaller copies that the version includes.
    pub fn copies(&self) -> impl Iterator<Item = &SmallerCopy> {
        self.preview.iter().chain(&self.thumbnail)
    }

    fn check(&self) -> Result<(), String> {
        let is_text = |text: &str| !text.is_empty() && text.len() <= TEXT_MAX && !text.chars().any(char::is_control);
        if ![&self.name, &self.file].into_iter().chain(&self.mask).all(|text| is_text(text)) {
            return Err(format!("its names must have 1 to {TEXT_MAX} bytes and no control characters"));
        }
        if !is_sha256(&self.sha256) || self.mask_sha256.as_ref().is_some_and(|sum| !is_sha256(sum)) {
            return Err("its SHA-256 must have 64 lower-case hexadecimal digits".to_owned());
        }
        let of_mask = [self.mask.is_some(), self.mask_bytes.is_some(), self.mask_sha256.is_some()];
        if of_mask != [of_mask[0]; 3] || (self.mask_path.is_some() && self.path.is_none()) {
            return Err("its mask needs a name, a length and a SHA-256".to_owned());
        }
        if self.path.is_some() && !self.is_used() {
            return Err(
                "it has a path, although no colour comes from it; such photographs are not published".to_owned()
            );
        }
        if ![&self.path, &self.mask_path].into_iter().flatten().all(|path| is_photograph(path)) {
            return Err(format!("its path must be in {PHOTOGRAPHS}, with the ending jpg or png"));
        }
        if self.copies().any(|copy| self.path.is_none() || !copy.is_valid()) {
            return Err(format!(
                "its smaller copies must be JPEG files in {PHOTOGRAPHS} with a SHA-256, at most {SMALLER_COPY_SIDE_MAX} pixels wide and high, and the photograph must have a path"
            ));
        }
        let numbers = self.numbers();
        if !numbers.iter().all(|v| v.abs() < FAR) || self.share < 0.0 {
            return Err("its numbers must be finite and less than 1e12, and its share not negative".to_owned());
        }
        let length: f64 = self.camera_from_world.rotation_wxyz.iter().map(|v| v * v).sum();
        if (length.sqrt() - 1.0).abs() > UNIT {
            return Err("its rotation must be a unit quaternion".to_owned());
        }
        Ok(())
    }

    fn numbers(&self) -> Vec<f64> {
        let camera = &self.camera;
        let lens = camera.distortion.iter().flat_map(|lens| lens.k.iter().chain(&lens.p)).copied();
        let pairs = [camera.focal, camera.center, camera.scale].into_iter().flatten().flatten();
        let refined = self.refined.iter().flat_map(|r| [r.moved_px, r.residual_px, r.agreement]);
        let pose = self.camera_from_world;
        let places = [pose.translation, self.position].into_iter().flat_map(|place| place.to_array());
        let singles = [camera.max_angle_degrees, camera.skew.unwrap_or_default(), self.share, self.corner];
        let own = pose.rotation_wxyz.into_iter().chain(self.gain).chain(self.offset).chain(singles);
        own.chain(places).chain(lens).chain(pairs).chain(refined).collect()
    }
}

impl ColourReport {
    /// Read a report.
    ///
    /// # Errors
    /// [`ColourReportError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, ColourReportError> {
        #[derive(Deserialize)]
        struct Form {
            kilwa_colour_report: Option<u64>,
        }
        let form: Form = kilwa_pack::json::from_slice(bytes).map_err(|e| ColourReportError::Form(e.to_string()))?;
        match form.kilwa_colour_report {
            Some(form) if form == u64::from(COLOUR_REPORT_FORM) => {}
            Some(form) => return Err(ColourReportError::Newer(form)),
            None => return Err(ColourReportError::Unversioned),
        }
        // Its keys were compared above.
        let report: Self = serde_json::from_slice(bytes).map_err(|e| ColourReportError::Form(e.to_string()))?;
        let all = report.photographs.len() + report.left_out.len();
        if all > PHOTOGRAPHS_MAX {
            let what = format!("it lists {all} photographs, more than the maximum of {PHOTOGRAPHS_MAX}");
            return Err(ColourReportError::Form(what));
        }
        for (photo, number) in report.photographs.iter().zip(1..) {
            let name: String = photo.name.chars().take(100).collect();
            photo.check().map_err(|what| ColourReportError::Photograph { number, name, what })?;
        }
        Ok(report)
    }

    /// The published form: JSON in one line.
    ///
    /// # Errors
    /// [`ColourReportError::Long`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, ColourReportError> {
        let mut bytes = serde_json::to_vec(self).map_err(|e| ColourReportError::Form(e.to_string()))?;
        bytes.push(b'\n');
        if bytes.len() as u64 > COLOUR_REPORT_MAX {
            return Err(ColourReportError::Long(bytes.len()));
        }
        Ok(bytes)
    }

    /// The photographs, masks and smaller copies that the version includes, each once, in the order of the report.
    pub fn files(&self) -> Vec<IncludedFile<'_>> {
        let mut seen = BTreeSet::new();
        let mut files = Vec::new();
        for photo in &self.photographs {
            if let Some(path) = photo.path.as_deref().filter(|path| seen.insert(path.to_owned())) {
                files.push(IncludedFile { path, bytes: photo.bytes, sha256: &photo.sha256 });
            }
            let mask = photo.mask_path.as_deref().zip(photo.mask_bytes.zip(photo.mask_sha256.as_deref()));
            if let Some((path, (bytes, sha256))) = mask.filter(|(path, _)| seen.insert(path.to_owned())) {
                files.push(IncludedFile { path, bytes, sha256 });
            }
            for copy in photo.copies().filter(|copy| seen.insert(copy.path.as_str())) {
                files.push(IncludedFile { path: &copy.path, bytes: copy.bytes, sha256: &copy.sha256 });
            }
        }
        files
    }

    /// Check that the photographs that colours come from are those that a pack names as its sources. Returns what could not be compared, in words.
    ///
    /// # Errors
    /// [`ColourReportError::Sources`] with what differs.
    pub fn same_photographs(&self, sources: &[SourceFile]) -> Result<Vec<String>, ColourReportError> {
        let listed: BTreeSet<&str> = sources.iter().map(|source| source.sha256.as_str()).collect();
        let mut unlisted: Vec<&Photograph> = Vec::new();
        for photo in self.photographs.iter().filter(|photo| photo.is_used() && !listed.contains(&*photo.sha256)) {
            if !unlisted.iter().any(|other| (&other.file, &other.sha256) == (&photo.file, &photo.sha256)) {
                unlisted.push(photo);
            }
        }
        let mut differences = Vec::new();
        for photo in &unlisted {
            if let Some(other) = sources.iter().find(|source| source.name == photo.file) {
                differences.push(format!(
                    "{} has the SHA-256 {}… in the report and {}… in the pack",
                    photo.file,
                    short(&photo.sha256),
                    short(&other.sha256)
                ));
            }
        }
        // A pack with many sources has one entry for the last ones.
        let rest = sources.iter().find_map(|source| Some((source.stands_for()?, source)));
        let mut left = Vec::new();
        match rest {
            Some((count, rest)) if differences.is_empty() && count >= unlisted.len() => {
                let lines = unlisted.iter().map(|photo| (photo.sha256.as_str(), photo.file.as_str()));
                if count > unlisted.len() && !unlisted.is_empty() {
                    let photographs = counted(unlisted.len(), "photograph", "photographs");
                    left.push(format!("{photographs} of the report could not be compared with the pack, which lists its last {count} source files as one entry"));
                } else if !unlisted.is_empty() && sha256(sum_lines(lines).as_bytes()) != rest.sha256 {
                    differences.push(format!("the last {count} source files of the pack are others"));
                }
            }
            _ => {
                let missing = unlisted.iter().filter(|photo| sources.iter().all(|source| source.name != photo.file));
                differences
                    .extend(missing.map(|photo| format!("{} is not among the source files of the pack", photo.file)));
            }
        }
        if differences.is_empty() {
            left.extend(self.others(sources));
            return Ok(left);
        }
        let more = differences.len().saturating_sub(LISTED);
        differences.truncate(LISTED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        Err(ColourReportError::Sources(differences.join("; ") + &more))
    }

    /// Pictures among the sources of the pack that the report does not name: the model may have been coloured twice.
    fn others(&self, sources: &[SourceFile]) -> Option<String> {
        let is_picture = |name: &str| {
            let end = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
            ["jpg", "jpeg", "png"].contains(&end.as_str())
        };
        let known: BTreeSet<&str> = self.photographs.iter().map(|photo| photo.sha256.as_str()).collect();
        let others = sources.iter().filter(|source| is_picture(&source.name) && !known.contains(&*source.sha256));
        let names: Vec<&str> = others.map(|source| source.name.as_str()).collect();
        let count = counted(names.len(), "picture", "pictures");
        let first = names.first()?;
        Some(format!(
            "the pack names {count} as source files that the colour report does not list, {first} for example"
        ))
    }
}

fn short(sum: &str) -> &str {
    sum.get(..12).unwrap_or(sum)
}

/// Gives photographs and masks their paths in a version: the same names give the same paths, equal files share one, and no two paths differ in case only.
#[derive(Debug, Clone, Default)]
pub struct Paths {
    taken: BTreeSet<String>,
    of_sum: BTreeMap<Checksum, String>,
}

impl Paths {
    /// The path of a photograph; `ending` is that of its format.
    pub fn photograph(&mut self, name: &str, ending: &str, sum: &str) -> String {
        self.of(PHOTOGRAPHS, name, ending, sum)
    }

    /// The path of a mask, which is a PNG file.
    pub fn mask(&mut self, name: &str, sum: &str) -> String {
        self.of(MASKS, name, "png", sum)
    }

    /// The path in `folder` of a smaller copy of the photograph at `path`.
    pub fn copy(&mut self, folder: &str, path: &str, sum: &str) -> String {
        let name = path.strip_prefix(PHOTOGRAPHS).unwrap_or(path);
        self.of(folder, name, "jpg", sum)
    }

    fn of(&mut self, folder: &str, name: &str, ending: &str, sum: &str) -> String {
        if let Some(path) = self.of_sum.get(sum) {
            return path.clone();
        }
        let parts: Vec<String> = name.split(['/', '\\']).map(plain).filter(|part| !part.is_empty()).collect();
        let kept = parts.get(parts.len().saturating_sub(FOLDERS_KEPT)..).unwrap_or_default().join("/");
        let stem = ["jpg", "jpeg", "png"].iter().find_map(|end| {
            let (stem, known) = kept.rsplit_once('.')?;
            (known.eq_ignore_ascii_case(end) && !stem.is_empty() && !stem.ends_with('/')).then(|| stem.to_owned())
        });
        let stem = stem.unwrap_or(kept);
        let stem = if stem.is_empty() { "photograph".to_owned() } else { stem };
        let numbered = (1..).map(|number| match number {
            1 => format!("{folder}/{stem}.{ending}"),
            number => format!("{folder}/{stem}-{number}.{ending}"),
        });
        let mut free = numbered.filter(|path| !self.taken.contains(&path.to_lowercase()));
        let path = free.next().unwrap_or_default();
        self.taken.insert(path.to_lowercase());
        self.of_sum.insert(sum.to_owned(), path.clone());
        path
    }
}

/// A part of a path that every system and every address can have as it is; the report has the true name.
fn plain(part: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || ".-_".contains(c) { c } else { '_' };
    let text: String = part.chars().map(plain).take(PART_MAX).collect();
    text.trim_matches('.').to_owned()
}

#[cfg(test)]
#[path = "colour_report_tests.rs"]
pub(crate) mod tests;

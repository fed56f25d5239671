//! Which files of a folder hold poses, and in which format.

use super::folder::{Folder, has_extension};
use super::{Contents, bundler, colmap, e57, meshlab, metashape, reality_capture};
use crate::ScanError;
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use std::fmt;
use std::io::Read;
use std::path::{Path, PathBuf};

/// How much of the beginning of a file is looked at, bytes.
const SNIFFED: u64 = 64 << 10;

/// A format of files with poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A folder with `cameras.bin` and `images.bin`.
    ColmapBinary,
    /// A folder with `cameras.txt` and `images.txt`.
    ColmapText,
    /// `bundle.out`.
    Bundler,
    /// XML of Metashape or PhotoScan.
    Metashape,
    /// The XMP sidecars in a folder.
    RealityCapture,
    /// A project or a camera of MeshLab.
    MeshLab,
    /// Pictures in an E57 file.
    E57,
}

impl Format {
    /// A short name for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::ColmapBinary => "colmap-binary",
            Self::ColmapText => "colmap-text",
            Self::Bundler => "bundler",
            Self::Metashape => "metashape",
            Self::RealityCapture => "realitycapture",
            Self::MeshLab => "meshlab",
            Self::E57 => "e57",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ColmapBinary => "COLMAP, binary",
            Self::ColmapText => "COLMAP, text",
            Self::Bundler => "Bundler",
            Self::Metashape => "Metashape",
            Self::RealityCapture => "XMP sidecars of RealityCapture",
            Self::MeshLab => "MeshLab",
            Self::E57 => "pictures in an E57 file",
        })
    }
}

type Found = (Format, PathBuf);

/// Read a file or folder of this format.
pub(super) fn read(format: Format, path: &Path, folder: &Folder) -> Result<Contents, ScanError> {
    match format {
        Format::ColmapBinary => colmap::read_binary(path),
        Format::ColmapText => colmap::read_text(path),
        Format::Bundler => bundler::read(path, folder),
        Format::Metashape => metashape::read(path),
        Format::RealityCapture => reality_capture::read(path, folder),
        Format::MeshLab => meshlab::read(path),
        Format::E57 => e57::read(path),
    }
}

/// The only file with poses in a folder; None if there is none.
pub(super) fn only(folder: &Folder) -> Result<Option<Found>, ScanError> {
    let mut found: Vec<Found> = Vec::new();
    for path in &folder.others {
        for candidate in of(path)? {
            // Sidecars are one set, wherever in the folder they are.
            let is_known = |known: &Found| {
                known.0 == candidate.0 && (known.1 == candidate.1 || candidate.0 == Format::RealityCapture)
            };
            match found.iter_mut().find(|known| is_known(known)) {
                Some(known) if candidate.0 == Format::RealityCapture => known.1 = common(&known.1, &candidate.1),
                Some(_) => {}
                None => found.push(candidate),
            }
        }
    }
    match found.len() {
        0 | 1 => Ok(found.pop()),
        _ => {
            let list: Vec<String> =
                found.iter().map(|(format, path)| format!("{} ({format})", path.display())).collect();
            let what = format!("several files contain poses: {}; choose one with --poses FILE", list.join(", "));
            Err(ScanError::Request(what))
        }
    }
}

fn common(a: &Path, b: &Path) -> PathBuf {
    a.components().zip(b.components()).take_while(|(a, b)| a == b).map(|(a, _)| a).collect()
}

/// The format of a file or folder that a person named.
pub(super) fn given(path: &Path) -> Result<Found, ScanError> {
    let is_model = |ending: &str| ["cameras", "images"].iter().all(|n| path.join(format!("{n}.{ending}")).is_file());
    let mut found = Vec::new();
    if path.is_dir() {
        found.extend(is_model("bin").then(|| (Format::ColmapBinary, path.to_owned())));
        found.extend(is_model("txt").then(|| (Format::ColmapText, path.to_owned())));
        if let [one] = &found[..] {
            return Ok(one.clone());
        }
        if found.is_empty() {
            let sidecars = Folder::walk(path)?;
            let mut sidecars = sidecars.others.iter().filter(|path| reality_capture::is_sidecar(path));
            if sidecars.any(|path| of(path).is_ok_and(|found| !found.is_empty())) {
                return Ok((Format::RealityCapture, path.to_owned()));
            }
        }
    } else {
        plain_file::open(path).map_err(|source| ReadError::Open { file: path.to_owned(), source })?;
        found = of(path)?;
        if let Some(one) = found.pop() {
            return Ok(one);
        }
    }
    let holds =
        if found.is_empty() { "contains no poses" } else { "contains a COLMAP model both as text and in binary form" };
    Err(ScanError::Request(format!(
        "{} {holds}; --poses takes bundle.out, cameras.bin or cameras.txt of COLMAP, the XML of Metashape, an XMP sidecar of RealityCapture, .mlp or camera XML of MeshLab, or an E57 file with pictures",
        path.display()
    )))
}

/// What a file is a part of; empty if it holds no poses.
fn of(path: &Path) -> Result<Vec<Found>, ScanError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let folder = path.parent().unwrap_or(Path::new(""));
    let has = |name: &str| folder.join(name).is_file();
    match name.as_str() {
        "cameras.bin" | "images.bin" | "points3d.bin" if has("cameras.bin") && has("images.bin") => {
            return Ok(vec![(Format::ColmapBinary, folder.to_owned())]);
        }
        "cameras.txt" | "images.txt" | "points3d.txt" if has("cameras.txt") && has("images.txt") => {
            return Ok(vec![(Format::ColmapText, folder.to_owned())]);
        }
        _ => {}
    }
    if has_extension(path, &["e57"]) {
        return Ok(if e57::has_pictures(path) { vec![(Format::E57, path.to_owned())] } else { Vec::new() });
    }
    if !has_extension(path, &["out", "xml", "mlp", "xmp"]) {
        return Ok(Vec::new());
    }
    let text = beginning(path)?;
    let format = if text.starts_with(bundler::MAGIC) {
        Some((Format::Bundler, path.to_owned()))
    } else if text.contains("<MeshLabProject") || text.contains("<VCGCamera") {
        Some((Format::MeshLab, path.to_owned()))
    } else if text.contains("<document") && (text.contains("<chunk") || text.contains("<sensors")) {
        Some((Format::Metashape, path.to_owned()))
    } else if text.contains(reality_capture::NAMESPACE) {
        Some((Format::RealityCapture, folder.to_owned()))
    } else {
        None
    };
    Ok(format.into_iter().collect())
}

/// The beginning of a file as text.
fn beginning(path: &Path) -> Result<String, ScanError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let mut start = Vec::new();
    plain_file::open(path).map_err(cannot)?.take(SNIFFED).read_to_end(&mut start).map_err(cannot)?;
    Ok(String::from_utf8_lossy(&start).into_owned())
}

/// Whether the beginning of a file has this text.
pub(super) fn contains(path: &Path, text: &str) -> Result<bool, ScanError> {
    Ok(beginning(path)?.contains(text))
}

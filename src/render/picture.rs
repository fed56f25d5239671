//! A picture as a file: the extension of its name chooses the format.

use crate::new_file::NewFile;
use anyhow::{Context, bail, ensure};
use image::ImageEncoder as _;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageError};
use kilwa_viewer::Image;
use std::io::{BufWriter, Write as _};
use std::path::Path;

/// Of 100. Fine lines of stone stay sharp, at about a sixth of a PNG.
const JPEG_QUALITY: u8 = 92;
/// Longest side of a JPEG, pixels: its header has 16 bits.
const JPEG_MAX: u32 = 65_535;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Jpeg,
}

fn format_of(path: &Path) -> anyhow::Result<Format> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("png") => Ok(Format::Png),
        Some("jpg" | "jpeg") => Ok(Format::Jpeg),
        Some("pdf" | "tif" | "tiff") => {
            bail!(
                "{}: PDF and TIFF are only for drawings to scale; give --scale, or choose a .png or .jpg file name",
                path.display()
            )
        }
        _ => bail!("{}: the file extension of a picture must be .png or .jpg", path.display()),
    }
}

/// Check that a picture of this size can be written under this name, before it is drawn.
pub(super) fn check(path: &Path, size: [u32; 2], is_transparent: bool) -> anyhow::Result<()> {
    if format_of(path)? == Format::Png {
        return Ok(());
    }
    let shown = path.display();
    ensure!(!is_transparent, "{shown}: JPEG cannot be transparent; choose a .png file name or another --background");
    ensure!(
        size.iter().all(|side| *side <= JPEG_MAX),
        "{shown}: a JPEG has at most {JPEG_MAX} pixels on a side; name a .png, or choose a smaller --size"
    );
    Ok(())
}

/// Write under a temporary name in the same folder, then rename: no half picture under the final name.
pub(super) fn write(path: &Path, image: &Image, alpha: bool, replace: bool) -> anyhow::Result<()> {
    let format = format_of(path)?;
    let failed = || format!("cannot write {}", path.display());
    let mut file = NewFile::create(path)?;
    let [width, height] = image.size;
    let (pixels, color) = if alpha {
        (image.clone().with_straight_alpha(true).pixels, ExtendedColorType::Rgba8)
    } else {
        let opaque = image.pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        (opaque, ExtendedColorType::Rgb8)
    };
    let mut out = BufWriter::new(file.file());
    match format {
        Format::Png => PngEncoder::new(&mut out).write_image(&pixels, width, height, color),
        Format::Jpeg => {
            JpegEncoder::new_with_quality(&mut out, JPEG_QUALITY).write_image(&pixels, width, height, color)
        }
    }
    .and_then(|()| out.flush().map_err(ImageError::IoError))
    .with_context(failed)?;
    drop(out);
    file.commit(replace)
}

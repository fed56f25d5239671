//! The memory that decoding a picture takes: estimated beforehand, and reduced.
//!
//! What decoders allocate beside their result is known by format: a JPEG in several scans keeps all coefficients, a WebP one
//! or two canvases, a TIFF its samples and a strip. Nothing here depends on what a file says of its own parts, but for its
//! width, height and kind.

use image::{ColorType, ImageFormat};
use std::borrow::Cow;

/// Bytes of the signature of a PNG.
const SIGNATURE: usize = 8;

/// A PNG without its ancillary chunks but transparency: colour profiles and texts, which may inflate without measure, are
/// not looked at. Other formats as they are, and so is what follows a chunk that is cut.
pub(super) fn without_extras(bytes: &[u8]) -> Cow<'_, [u8]> {
    if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return Cow::Borrowed(bytes);
    }
    let mut essential = Vec::with_capacity(bytes.len());
    let (start, mut rest) = bytes.split_at(SIGNATURE);
    essential.extend_from_slice(start);
    while let Some((chunk, after)) = chunk(rest) {
        if chunk[4].is_ascii_uppercase() || &chunk[4..8] == b"tRNS" {
            essential.extend_from_slice(chunk);
        }
        rest = after;
    }
    essential.extend_from_slice(rest);
    Cow::Owned(essential)
}

/// The first chunk, with its length, name and sum, and what follows it.
fn chunk(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u32::from_be_bytes(*bytes.first_chunk()?) as usize;
    bytes.split_at_checked(length.checked_add(12)?)
}

/// Bytes that the result and its conversion take, and the file with a copy of it.
pub(super) fn apart(bytes: &[u8], texels: u64, color: ColorType) -> u64 {
    let converted = if matches!(color, ColorType::Rgb8 | ColorType::Rgba8) { 0 } else { 3 };
    texels * (u64::from(color.bytes_per_pixel()) + converted) + 2 * bytes.len() as u64
}

/// Bytes that decoding takes at the most, but for the strips of a TIFF.
pub(super) fn needed(format: Option<ImageFormat>, bytes: &[u8], texels: u64, color: ColorType) -> u64 {
    let pixel = u64::from(color.bytes_per_pixel());
    let beside = match format {
        // Coefficients of 16 bits.
        Some(ImageFormat::Jpeg) if has_scans(bytes) => 2 * pixel,
        Some(ImageFormat::Jpeg | ImageFormat::Png) => 0,
        // Canvas and frame, four bytes a texel each.
        Some(ImageFormat::WebP) => 8,
        // CMYK has four samples for three.
        _ => 2 * pixel,
    };
    apart(bytes, texels, color) + beside * texels
}

/// Whether a JPEG comes in several scans, or may do so.
fn has_scans(bytes: &[u8]) -> bool {
    let mut at = 2;
    let mut components = None;
    loop {
        let Some(&[0xff, marker, high, low]) = bytes.get(at..at + 4) else { return true };
        let first = bytes.get(at + 4).copied();
        match marker {
            0xc0 | 0xc1 => components = bytes.get(at + 9).copied(),
            0xc2..=0xcf if !matches!(marker, 0xc4 | 0xc8 | 0xcc) => return true,
            0xda => return components.is_none() || first != components,
            _ => {}
        }
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
    }
}

/// Red, green and blue of texels that have opacity too, in the same place.
pub(super) fn without_alpha(mut texels: Vec<u8>) -> Vec<u8> {
    let n = texels.len() / 4;
    for i in 0..n {
        texels.copy_within(4 * i..4 * i + 3, 3 * i);
    }
    texels.truncate(3 * n);
    texels.shrink_to_fit();
    texels
}

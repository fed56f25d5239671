//! The encoder of drawings to scale: PNG with three bytes per pixel and a resolution. `kilwa publish` writes drawings with it, and servers check with it that a
//! drawing contains nothing but its pixels: the same pixels always give the same bytes.

use super::compare::CompareWriter;
use kilwa_pack::SliceSource;
use std::io::{Cursor, Write};

/// Begin a picture of `size` pixels, with `per_metre` pixels per metre of paper. Write the pixels to its `stream_writer`.
///
/// # Errors
/// If it cannot be written, or has no pixels.
pub fn begin<W: Write>(out: W, size: [u32; 2], per_metre: u32) -> Result<png::Writer<W>, png::EncodingError> {
    let mut encoder = png::Encoder::new(out, size[0], size[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels = png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit: png::Unit::Meter };
    encoder.set_pixel_dims(Some(pixels));
    encoder.write_header()
}

/// Whether encoding a picture's pixels again gives exactly its bytes, so that nothing is hidden in filters, compression or chunks. It must have three
/// bytes per pixel, and the caller must be prepared to decode a picture of this size.
pub fn is_as_written(bytes: &[u8], size: [u32; 2], per_metre: u32) -> bool {
    let source = SliceSource(bytes);
    let mut compared = CompareWriter::new(&source);
    write_again(bytes, &mut compared, size, per_metre).is_some() && compared.written() == bytes.len() as u64
}

/// Decode it and encode it again, row by row. `None` at the first byte that differs.
fn write_again(bytes: &[u8], compared: impl Write, size: [u32; 2], per_metre: u32) -> Option<()> {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().ok()?;
    let mut writer = begin(compared, size, per_metre).ok()?;
    let mut stream = writer.stream_writer().ok()?;
    while let Some(row) = reader.next_row().ok()? {
        stream.write_all(row.data()).ok()?;
    }
    stream.finish().ok()
    // The end of the file is written when the writer is dropped.
}

#[cfg(test)]
mod tests {
    use super::*;
    use png::{Compression, Filter};

    const SIZE: [u32; 2] = [150, 90];
    const PER_METRE: u32 = 5906;

    /// The bytes of all pixels: lines on a gradient, so that filters and compression make a difference.
    fn pixels() -> Vec<u8> {
        let at = |x: u32, y: u32| {
            if (x + 2 * y).is_multiple_of(17) { [0; 3] } else { [x as u8, y as u8, (x * y / 9) as u8] }
        };
        (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).flat_map(move |x| at(x, y))).collect()
    }

    fn written() -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = begin(&mut bytes, SIZE, PER_METRE).unwrap();
        let mut stream = writer.stream_writer().unwrap();
        // In parts that do not end with rows.
        for part in pixels().chunks(1001) {
            stream.write_all(part).unwrap();
        }
        stream.finish().unwrap();
        drop(writer);
        bytes
    }

    /// The same pixels, encoded differently.
    fn otherwise(compression: Compression, filter: Filter, chunk: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, SIZE[0], SIZE[1]);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: PER_METRE, yppu: PER_METRE, unit: png::Unit::Meter }));
        encoder.set_compression(compression);
        encoder.set_filter(filter);
        let mut writer = encoder.write_header().unwrap();
        let mut stream = writer.stream_writer_with_size(chunk).unwrap();
        stream.write_all(&pixels()).unwrap();
        stream.finish().unwrap();
        drop(writer);
        bytes
    }

    fn decoded(bytes: &[u8]) -> Vec<u8> {
        let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
        let mut all = Vec::new();
        while let Some(row) = reader.next_row().unwrap() {
            all.extend_from_slice(row.data());
        }
        all
    }

    #[test]
    fn the_same_pixels_encoded_differently_are_rejected() {
        let bytes = written();
        assert!(is_as_written(&bytes, SIZE, PER_METRE));
        let mut others = vec![otherwise(Compression::Balanced, Filter::Adaptive, 1000)];
        for filter in [Filter::NoFilter, Filter::Sub, Filter::Up, Filter::Avg, Filter::Paeth] {
            others.push(otherwise(Compression::Balanced, filter, 1 << 15));
        }
        for compression in [Compression::NoCompression, Compression::Fast, Compression::High] {
            others.push(otherwise(compression, Filter::Adaptive, 1 << 15));
        }
        others.retain(|other| *other != bytes);
        assert!(others.len() > 5, "only {} other encodings", others.len());
        for other in &others {
            assert!(decoded(other) == pixels(), "another picture");
            assert!(!is_as_written(other, SIZE, PER_METRE));
        }
        // Truncated, extended and changed.
        assert!(!is_as_written(&bytes[..bytes.len() - 12], SIZE, PER_METRE));
        assert!(!is_as_written(&[&bytes[..], b"more"].concat(), SIZE, PER_METRE));
        assert!(!is_as_written(&bytes, SIZE, PER_METRE + 1));
        for at in (0..bytes.len()).step_by(101) {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(!is_as_written(&changed, SIZE, PER_METRE), "byte {at}");
        }
    }
}

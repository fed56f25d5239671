//! Pictures as PNG.

use std::io::{self, Write};

/// Write a picture with 8 bits per channel, rows from the top.
///
/// # Errors
/// Those of `out`.
pub(crate) fn write_png(
    out: &mut dyn Write,
    [width, height]: [u32; 2],
    channels: png::ColorType,
    pixels: &[u8],
) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(channels);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(())
}

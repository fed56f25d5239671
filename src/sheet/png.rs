//! PNG, row by row, with its resolution (chunk pHYs).

use super::Next;
use anyhow::Context;
use std::fs::File;
use std::io::{BufWriter, Write};

pub(super) fn write(file: &mut File, size: [u32; 2], dpi: u32, next: Next<'_>) -> anyhow::Result<()> {
    let mut encoder = png::Encoder::new(BufWriter::new(file), size[0], size[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let per_metre = (f64::from(dpi) / 0.0254).round() as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit: png::Unit::Meter }));
    let mut writer = encoder.write_header().context("cannot write the PNG")?;
    let mut stream = writer.stream_writer().context("cannot write the PNG")?;
    while let Some(rows) = next()? {
        stream.write_all(&rows).context("cannot write the PNG")?;
    }
    stream.finish().context("cannot write the PNG")?;
    Ok(())
}

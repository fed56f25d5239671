//! PNG, row by row, with its resolution (chunk pHYs).

use super::Next;
use anyhow::Context;
use kilwa_archive::drawing;
use std::fs::File;
use std::io::{BufWriter, Write};

pub(super) fn write(file: &mut File, size: [u32; 2], dpi: u32, next: Next<'_>) -> anyhow::Result<()> {
    let per_metre = (f64::from(dpi) / 0.0254).round() as u32;
    // Servers check drawings with the same encoder.
    let mut writer = drawing::begin(BufWriter::new(file), size, per_metre).context("cannot write the PNG")?;
    let mut stream = writer.stream_writer().context("cannot write the PNG")?;
    while let Some(rows) = next()? {
        stream.write_all(&rows).context("cannot write the PNG")?;
    }
    stream.finish().context("cannot write the PNG")?;
    Ok(())
}

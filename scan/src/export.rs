//! Stations for other programs: PTX with its grid and pose.

use crate::ScanError;
use crate::spool::Reader;
use glam::{DMat4, DVec3};
use kilwa_scan_core::{Kind, Pose, Sample};
use std::io::{self, Write};

/// Memory for columns of a grid that is stored row by row.
const COLUMNS_BYTES: usize = 64 << 20;

/// Write a station as one scan of a PTX file, column by column. Coordinates are written with as many digits as their `f32` needs, so that they come back
/// exactly. A cell without a point is `0 0 0 0.5`; a sample without intensity has 0.5.
///
/// # Errors
/// [`ScanError::Request`] for a cloud without a grid, [`ScanError::Spool`] where the spool is damaged, `written` of what the system says.
pub fn ptx(
    reader: &mut Reader,
    pose: Pose,
    out: &mut dyn Write,
    written: &dyn Fn(io::Error) -> ScanError,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let header = *reader.header();
    if !header.is_grid {
        let message = "this station is an unstructured point cloud, and PTX needs a grid".to_owned();
        return Err(ScanError::Request(message));
    }
    let grid = header.grid;
    ptx_header(grid.columns, grid.rows, pose, out).map_err(written)?;
    let has_color = header.statistics.colored > 0;
    let (mut columns, mut line, mut text) = (Vec::new(), Vec::new(), Vec::new());
    let rows = grid.rows as usize;
    let group = if grid.by_rows { (COLUMNS_BYTES / (rows * size_of::<Sample>())).max(1) as u32 } else { 1 };
    let mut first = 0;
    while first < grid.columns {
        let count = group.min(grid.columns - first);
        if grid.by_rows {
            columns.clear();
            columns.resize(count as usize * rows, Sample::EMPTY);
            for row in 0..grid.rows {
                reader.read(grid.cell(first, row), count as usize, &mut line)?;
                for (k, sample) in line.iter().enumerate() {
                    columns[k * rows + row as usize] = *sample;
                }
            }
        } else {
            reader.line(first, &mut columns)?;
        }
        text.clear();
        for sample in &columns {
            ptx_line(sample, has_color, &mut text).map_err(written)?;
        }
        out.write_all(&text).map_err(written)?;
        first += count;
        progress(u64::from(first), u64::from(grid.columns))?;
    }
    Ok(())
}

fn ptx_header(columns: u32, rows: u32, pose: Pose, out: &mut dyn Write) -> io::Result<()> {
    let matrix: DMat4 = pose.to_matrix();
    writeln!(out, "{columns}\n{rows}")?;
    let row = |out: &mut dyn Write, v: DVec3| writeln!(out, "{} {} {}", v.x, v.y, v.z);
    row(out, pose.translation)?;
    for axis in [matrix.x_axis, matrix.y_axis, matrix.z_axis] {
        row(out, axis.truncate())?;
    }
    for column in [matrix.x_axis, matrix.y_axis, matrix.z_axis, matrix.w_axis] {
        writeln!(out, "{} {} {} {}", column.x, column.y, column.z, column.w)?;
    }
    Ok(())
}

fn ptx_line(sample: &Sample, has_color: bool, out: &mut Vec<u8>) -> io::Result<()> {
    if sample.state.kind() != Kind::Measured {
        return out.write_all(if has_color { b"0 0 0 0.5 0 0 0\n" } else { b"0 0 0 0.5\n" });
    }
    let p = sample.position;
    let intensity = if sample.intensity.is_nan() { 0.5 } else { sample.intensity };
    write!(out, "{} {} {} {intensity}", p.x, p.y, p.z)?;
    if has_color {
        let [r, g, b] = sample.color;
        write!(out, " {r} {g} {b}")?;
    }
    out.write_all(b"\n")
}

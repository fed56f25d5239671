//! PTX, with grid and pose.

use super::{Exported, Output, Report, Request};
use crate::spool::Reader;
use crate::{ScanError, mask};
use glam::{DMat4, DVec3};
use kilwa_scan_core::{Kind, Pose, Sample};
use std::io::{self, Write};

/// Memory for columns of a grid that is stored row by row.
const COLUMNS_BYTES: usize = 64 << 20;

/// Write stations as the scans of one PTX file. PTX has intensities from 0 to 1: if one of the stations has others, those of all of them are scaled
/// linearly, by the same range, so that they can still be compared.
///
/// # Errors
/// Those of [`ptx`], before anything is written where a station is no grid.
pub fn ptx_file(request: &Request<'_>, out: &mut dyn Write, output: &mut Output<'_>) -> Result<Report, ScanError> {
    for station in &request.stations {
        check(&request.open(station)?).map_err(|e| match e {
            ScanError::Request(why) => ScanError::Request(format!("station {}: {why}", station.name)),
            other => other,
        })?;
    }
    let total = request.cells()?;
    let scaled = request.intensity()?.filter(|[min, max]| *min < 0.0 || *max > 1.0);
    let mut report = Report { scaled, ..Report::default() };
    let mut before = 0;
    for station in &request.stations {
        let mut reader = request.open(station)?;
        let header = *reader.header();
        let (cells, columns) = (header.grid.cells(), u64::from(header.grid.columns));
        let mut progress = |done: u64, _: u64| (output.progress)(before + cells / columns * done, total);
        ptx(&mut reader, station.pose.unwrap_or_default(), scaled, out, output.cannot, &mut progress)?;
        before += cells;
        let masked = mask::count(&mut reader)?;
        let points = header.statistics.measured - masked;
        report.stations.push(Exported { station: station.name.clone(), grid: Some(header.grid), points, masked });
    }
    Ok(report)
}

fn check(reader: &Reader) -> Result<(), ScanError> {
    if reader.header().is_grid {
        return Ok(());
    }
    let message = "this station is an unstructured point cloud, and PTX needs a grid; use --e57";
    Err(ScanError::Request(message.to_owned()))
}

/// Write a station as one scan of a PTX file, column by column. Coordinates are written with as many digits as their `f32` needs, so that they come back
/// exactly; so are intensities, unless they are `scaled` from a range to 0 to 1. A cell without a point is `0 0 0 0.5`; a sample without intensity has 0.5.
///
/// # Errors
/// [`ScanError::Request`] for a cloud without a grid, [`ScanError::Spool`] where the spool is damaged, `cannot` of what the system says.
pub fn ptx(
    reader: &mut Reader,
    pose: Pose,
    scaled: Option<[f32; 2]>,
    out: &mut dyn Write,
    cannot: &dyn Fn(io::Error) -> ScanError,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    check(reader)?;
    let header = *reader.header();
    let grid = header.grid;
    ptx_header(grid.columns, grid.rows, pose, out).map_err(cannot)?;
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
            ptx_line(sample, has_color, scaled, &mut text).map_err(cannot)?;
        }
        out.write_all(&text).map_err(cannot)?;
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

fn ptx_line(sample: &Sample, has_color: bool, scaled: Option<[f32; 2]>, out: &mut Vec<u8>) -> io::Result<()> {
    if sample.state.kind() != Kind::Measured {
        return out.write_all(if has_color { b"0 0 0 0.5 0 0 0\n" } else { b"0 0 0 0.5\n" });
    }
    let p = sample.position;
    let intensity = if sample.intensity.is_nan() { 0.5 } else { to_one(sample.intensity, scaled) };
    write!(out, "{} {} {} {intensity}", p.x, p.y, p.z)?;
    if has_color {
        let [r, g, b] = sample.color;
        write!(out, " {r} {g} {b}")?;
    }
    out.write_all(b"\n")
}

/// An intensity of this range as one from 0 to 1; those of a range without width are all 1.
fn to_one(intensity: f32, range: Option<[f32; 2]>) -> f32 {
    let Some([min, max]) = range.map(|range| range.map(f64::from)) else { return intensity };
    if max > min { ((f64::from(intensity) - min) / (max - min)) as f32 } else { 1.0 }
}

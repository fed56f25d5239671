//! LAS and LAZ (ASPRS, "LAS Specification 1.4"), by the crates `las` and `laz`. They have no grid and no scanner: the position must be given.
//!
//! Colours have 16 bits; many programs write 8 into them. So a file with colours is read twice: if no value exceeds 255, they are taken as they are.

use super::{Frame, Head, Input, too_far};
use crate::ScanError;
use crate::spool::Layout;
use glam::DVec3;
use kilwa_formats::read::{Place, ReadError};
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind, Rays, Sample, State};
use las::{PointData, Reader};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Points decoded at a time.
const BATCH: u64 = 16_384;

pub(super) fn read(input: &mut Input<'_>) -> Result<(), ScanError> {
    if input.options.station.is_none() {
        return Err(ScanError::NoStation { file: input.path.to_owned() });
    }
    let mut reader = open(input)?;
    let header = reader.header().clone();
    let count = header.number_of_points();
    let format = *header.point_format();
    let least = u64::from(format.len());
    let held = if format.is_compressed { u64::MAX } else { input.total / least.max(1) };
    if count == 0 {
        return Err(ScanError::Nothing { file: input.path.to_owned(), what: "it holds no points".to_owned() });
    }
    if count > held || count > u64::from(u32::MAX) {
        let found = format!("{} in the header", counted(count, "point", "points"));
        let most = held.min(u64::from(u32::MAX));
        return Err(ScanError::malformed(
            input.path,
            Place::Byte(0),
            found,
            format!("at most {most}; the file is cut, or must be split"),
        ));
    }
    let shift = if format.has_color { color_shift(input, count)? } else { 0 };
    let head = Head { crs: crs(&header), ..Head::default() };
    if !input.sink.begin(&head)? {
        return Ok(());
    }
    let frame = Frame::new(input.options, input.options.units.metres());
    let mut done = 0;
    batches(&mut reader, count, input.path, &mut |points| {
        let mut colors = points.rgb();
        let positions = points.x().zip(points.y()).zip(points.z());
        for (((position, intensity), number), k) in
            positions.zip(points.intensity()).zip(points.return_number()).zip(0..)
        {
            let ((x, y), z) = position;
            let place = || Place::Byte(u64::from(format.len()) * (done + k));
            let position = frame.place(DVec3::new(x, y, z)).map_err(|metres| too_far(input.path, place(), metres))?;
            let color = colors.as_mut().and_then(Iterator::next);
            let state = State::new(Kind::Measured, color.is_some(), number);
            let color = color.map_or([0; 3], |(r, g, b)| [r, g, b].map(|v| (v >> shift) as u8));
            input.sink.push(&Sample { position, intensity: f32::from(intensity), color, state })?;
        }
        done += points.len() as u64;
        input.sink.progress((done as f64 / count as f64 * input.total as f64) as u64)
    })?;
    let layout =
        Layout { grid: Grid::by_columns(1, count as u32), is_grid: false, rays: Rays::Central, origin: frame.origin };
    input.sink.end(layout)?;
    input.sink.progress(input.total)
}

fn open(input: &Input<'_>) -> Result<Reader, ScanError> {
    let cannot = |source| ReadError::Open { file: input.path.to_owned(), source };
    let mut file = kilwa_files::plain_file::open(input.path).map_err(cannot)?;
    if let Some((at, found, expected)) = lies(&mut file, input.total) {
        return Err(ScanError::malformed(input.path, Place::Byte(at), found, expected));
    }
    file.rewind().map_err(cannot)?;
    Reader::new(std::io::BufReader::with_capacity(1 << 20, file)).map_err(|e| damaged(input.path, 0, &e))
}

/// Counts and lengths of a file for which the crates would allocate more than the file can hold: where, what it says, and the most there
/// can be. Whatever else is wrong they find themselves.
fn lies(file: &mut (impl Read + Seek), total: u64) -> Option<(u64, String, String)> {
    let mut head = [0; 375];
    let mut read = 0;
    while let Some(rest) = head.get_mut(read..).filter(|rest| !rest.is_empty()) {
        match file.read(rest) {
            Ok(0) | Err(_) => break,
            Ok(n) => read += n,
        }
    }
    let number = |at: usize, bytes: usize| {
        let field = head.get(at..at + bytes).unwrap_or_default();
        field.iter().rev().fold(0u64, |sum, &byte| sum << 8 | u64::from(byte))
    };
    let too_many = |at: u64, found: u64, what: &str, most: u64| {
        (found > most).then(|| (at, format!("{found} {what}"), format!("at most {most} in a file of {total} bytes")))
    };
    let points_at = number(96, 4);
    let lie = too_many(96, points_at, "bytes before the points", total)
        .or_else(|| too_many(100, number(100, 4), "variable length records", total / 54));
    if lie.is_some() {
        return lie;
    }
    // Version 1.4 has extended records: 60 bytes, their length in bytes 20 to 27.
    if number(25, 1) >= 4 && read == head.len() {
        let (mut at, count) = (number(235, 8), number(243, 4));
        if let Some(lie) = too_many(243, count, "extended variable length records", total / 60) {
            return Some(lie);
        }
        for _ in 0..count {
            let length = number_at(file, at.checked_add(20)?, 8)?;
            let rest = total.saturating_sub(at).saturating_sub(60);
            if let Some(lie) = too_many(at, length, "bytes in an extended record", rest) {
                return Some(lie);
            }
            at += 60 + length;
        }
    }
    // The points of LAZ begin with the place of the table of chunks; where it is not known, the file ends with it.
    if number(104, 1) & 0xc0 != 0 {
        let table = number_at(file, points_at, 8)?;
        let in_place = table > points_at && table >> 63 == 0;
        let table = if in_place { table } else { number_at(file, total.checked_sub(8)?, 8)? };
        let chunks = number_at(file, table.checked_add(4)?, 4)?;
        // Each chunk begins with a point as it is.
        return too_many(table + 4, chunks, "chunks", total / number(105, 2).max(1));
    }
    None
}

/// A little-endian number at a place of a file, if it is there.
fn number_at(file: &mut (impl Read + Seek), at: u64, bytes: usize) -> Option<u64> {
    let mut field = [0; 8];
    file.seek(SeekFrom::Start(at)).ok()?;
    file.read_exact(field.get_mut(..bytes)?).ok()?;
    Some(u64::from_le_bytes(field))
}

fn damaged(path: &Path, point: u64, e: &las::Error) -> ScanError {
    let place = if point == 0 { "its header or its first points".to_owned() } else { format!("after point {point}") };
    ScanError::malformed(
        path,
        Place::Byte(0),
        format!("{e} ({place})"),
        "a sound LAS or LAZ file; it is cut or damaged: copy or export it again",
    )
}

/// Decode all points, a batch at a time.
fn batches(
    reader: &mut Reader,
    count: u64,
    path: &Path,
    visit: &mut dyn FnMut(&PointData) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let mut done = 0;
    while done < count {
        let points = reader.read_points(BATCH.min(count - done)).map_err(|e| damaged(path, done, &e))?;
        if points.is_empty() {
            let found = format!("the end of the file after {}", counted(done, "point", "points"));
            return Err(ScanError::malformed(path, Place::Byte(0), found, format!("{count}, as the header announces")));
        }
        done += points.len() as u64;
        visit(&points)?;
    }
    Ok(())
}

/// By how many bits colours must be shifted to have 8.
fn color_shift(input: &Input<'_>, count: u64) -> Result<u32, ScanError> {
    let mut largest = 0;
    let mut reader = open(input)?;
    batches(&mut reader, count, input.path, &mut |points| {
        for (r, g, b) in points.rgb().into_iter().flatten() {
            largest = largest.max(r).max(g).max(b);
        }
        Ok(())
    })?;
    Ok(if largest > 255 { 8 } else { 0 })
}

/// The coordinate reference system: WKT as it stands, or the EPSG code of GeoTIFF keys.
fn crs(header: &las::Header) -> Option<String> {
    if let Some(wkt) = header.get_wkt_crs_bytes() {
        let text = String::from_utf8_lossy(wkt).trim_matches(['\0', ' ', '\n']).to_owned();
        return Some(text).filter(|text| !text.is_empty());
    }
    let keys = header.get_geotiff_crs().ok().flatten()?;
    let code = keys.get_projected_crs_geo_key_value().or_else(|| keys.get_geodetic_crs_geo_key_value())?;
    // 32767 stands for "user-defined".
    (code != 0 && code != 32_767).then(|| format!("EPSG:{code}"))
}

//! E57 (ASTM E2807), with the crate `e57`: scans with their grids and poses, and the photographs of their stations.
//!
//! A cell without a sample has no record, whether nothing was recorded there or a mask hides it: E57 allows that, the rows and columns of the other
//! records stay right, and programs that do not look at invalid states (or at rows and columns) show no points at the scanner. Rays without a return keep
//! their record, with the direction (invalid state 1) or without (2), because they show where there is nothing; CloudCompare, pye57 and PDAL leave these out or
//! flag them.
//!
//! Fields are written only if a sample needs them. `isIntensityInvalid` and `isColorInvalid` are written if some points lack intensities or
//! colours that others have, and return numbers if a station has one above 1: pye57 refuses files with any of these fields (except with `read_scan`), and some versions
//! of CloudCompare understand `isIntensityInvalid` the wrong way round.

use super::photograph::{self, photographs};
use super::{Exported, Output, Report, Request};
use crate::spool::Reader;
use crate::survey::Station;
use crate::{ScanError, mask};
use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};
use e57::{IntensityLimits, PointCloudWriter};
use kilwa_scan_core::{Grid, Kind, Pose, Sample};
use std::error::Error;
use std::io::{self, Read, Seek, Write};

/// Samples that are read at a time.
const BATCH: u64 = 4096;

/// Write stations as the scans of one E57 file, into an empty file.
///
/// Coordinates are `f32` relative to the scanner, so that they can be read back exactly, as can intensities, colours, rows, columns and return numbers.
///
/// # Errors
/// [`ScanError::Spool`] or [`ScanError::Mask`] where a file of the survey is damaged, [`ScanError::Read`] for a photograph that cannot be opened, and
/// `output.cannot` for an error of the system.
pub fn e57<F: Read + Write + Seek>(
    request: &Request<'_>,
    out: F,
    output: &mut Output<'_>,
) -> Result<Report, ScanError> {
    let cannot = output.cannot;
    let failed = move |e: e57::Error| cannot(io::Error::other(causes(&e)));
    photograph::check(request)?;
    // The samples are read once to see what there is, then again to be written.
    let mut steps = Steps { done: 0, total: 2 * request.cells()?, output };
    let guids = request.stations.iter().map(|station| station_guid(request, station)).collect::<Result<Vec<_>, _>>()?;
    let crs = request.survey.crs.as_deref().filter(|_| request.stations.iter().any(|s| s.pose.is_some()));
    let mut parts: Vec<&[u8]> = guids.iter().map(String::as_bytes).collect();
    parts.push(crs.unwrap_or_default().as_bytes());
    let file_guid = guid("file", &parts);
    let mut writer = E57Writer::new(out, &file_guid).map_err(failed)?;
    writer.set_coordinate_metadata(crs.map(character_data));
    let mut report = Report::default();
    for (station, guid) in request.stations.iter().zip(&guids) {
        let mut reader = request.open(station)?;
        let about = Content::of(&mut reader, &mut steps)?;
        let masked = mask::count(&mut reader)?;
        let mut cloud = writer.add_pointcloud(guid, about.prototype()).map_err(failed)?;
        cloud.set_name(Some(station.name.clone()));
        cloud.set_sensor_model(station.instrument.as_deref().map(character_data));
        cloud.set_transform(station.pose.map(transform));
        if about.with_intensity > 0 {
            let [min, max] = about.intensity.map(|v| Some(RecordValue::Single(v)));
            cloud.set_intensity_limits(Some(IntensityLimits { intensity_min: min, intensity_max: max }));
        }
        about.write(&mut reader, &mut cloud, &mut steps, &failed)?;
        cloud.finalize().map_err(failed)?;
        let grid = about.grid();
        report.stations.push(Exported { station: station.name.clone(), grid, points: about.measured, masked });
    }
    report.photographs = photographs(request, &guids, &mut writer, &failed)?;
    writer.finalize().map_err(failed)?;
    Ok(report)
}

/// An error of the crate with its causes.
fn causes(e: &e57::Error) -> String {
    let mut text = e.to_string();
    let mut cause = e.source();
    while let Some(inner) = cause {
        text = format!("{text}: {inner}");
        cause = inner.source();
    }
    text
}

/// Counts what is done.
struct Steps<'a, 'o> {
    done: u64,
    total: u64,
    output: &'a mut Output<'o>,
}

impl Steps<'_, '_> {
    fn add(&mut self, cells: u64) -> Result<(), ScanError> {
        self.done += cells;
        (self.output.progress)(self.done, self.total)
    }
}

/// A GUID that is the same for the same content: a UUID of version 8 (RFC 9562), made of a BLAKE3 hash.
pub(super) fn guid(what: &str, parts: &[&[u8]]) -> String {
    let mut hash = blake3::Hasher::new_derive_key(&format!("kilwa scans export --e57 {what}"));
    for part in parts {
        hash.update(&(part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    let hex = hash.finalize().to_hex().to_uppercase();
    format!("{{{}-{}-8{}-8{}-{}}}", &hex[..8], &hex[8..12], &hex[12..15], &hex[15..18], &hex[18..30])
}

/// The GUID of a station: of its samples, its masks and its pose.
fn station_guid(request: &Request<'_>, station: &Station) -> Result<String, ScanError> {
    let mut reader = request.open(station)?;
    let mut parts = vec![reader.header().digest().to_vec()];
    if let Some(pose) = station.pose {
        let numbers = pose.rotation.to_array().into_iter().chain(pose.translation.to_array());
        parts.push(numbers.flat_map(f64::to_le_bytes).collect());
    }
    parts.extend(reader.masks().iter().map(|mask| mask.header().digest().to_vec()));
    Ok(guid("station", &parts.iter().map(Vec::as_slice).collect::<Vec<_>>()))
}

/// Text for the XML of the file: the crate puts it into character data as it is, so a `]]>` is split, and characters that XML does not allow are left out.
pub(super) fn character_data(text: &str) -> String {
    let sound: String = text.chars().filter(|c| matches!(c, '\t' | '\n' | '\r') || !c.is_control()).collect();
    sound.replace("]]>", "]]]]><![CDATA[>")
}

pub(super) fn transform(pose: Pose) -> Transform {
    let (q, t) = (pose.rotation, pose.translation);
    Transform {
        rotation: Quaternion { w: q.w, x: q.x, y: q.y, z: q.z },
        translation: Translation { x: t.x, y: t.y, z: t.z },
    }
}

/// What there is of a station when its masks are applied, which decides which fields its records have.
struct Content {
    grid: Grid,
    is_grid: bool,
    measured: u64,
    no_return: u64,
    colored: u64,
    with_intensity: u64,
    intensity: [f32; 2],
    max_return: u8,
    /// The last column and row with a sample.
    last: [u32; 2],
}

impl Content {
    fn of(reader: &mut Reader, steps: &mut Steps<'_, '_>) -> Result<Self, ScanError> {
        let header = *reader.header();
        let mut content = Self {
            grid: header.grid,
            is_grid: header.is_grid,
            measured: 0,
            no_return: 0,
            colored: 0,
            with_intensity: 0,
            intensity: [f32::INFINITY, f32::NEG_INFINITY],
            max_return: 0,
            last: [0; 2],
        };
        each(reader, steps, &mut |place, sample| {
            content.add(place, sample);
            Ok(())
        })?;
        Ok(content)
    }

    fn add(&mut self, place: [u32; 2], sample: &Sample) {
        self.last = [self.last[0].max(place[0]), self.last[1].max(place[1])];
        self.max_return = self.max_return.max(sample.state.return_number());
        if sample.state.kind() != Kind::Measured {
            self.no_return += 1;
            return;
        }
        self.measured += 1;
        self.colored += u64::from(sample.state.has_color());
        if !sample.intensity.is_nan() {
            self.with_intensity += 1;
            self.intensity = [self.intensity[0].min(sample.intensity), self.intensity[1].max(sample.intensity)];
        }
    }

    fn grid(&self) -> Option<Grid> {
        self.is_grid.then_some(self.grid)
    }

    /// Whether the last cell of the grid needs a record without a point, because readers know the size of a grid by its records.
    fn needs_corner(&self) -> bool {
        self.is_grid && self.last != [self.grid.columns - 1, self.grid.rows - 1]
    }

    fn has_states(&self) -> bool {
        self.no_return > 0 || self.needs_corner()
    }

    /// Whether points, and not only rays without a return, lack what others have.
    fn lacks_intensity(&self) -> bool {
        self.with_intensity > 0 && self.with_intensity < self.measured
    }

    fn lacks_color(&self) -> bool {
        self.colored > 0 && self.colored < self.measured
    }

    fn has_returns(&self) -> bool {
        self.max_return > 1
    }

    fn prototype(&self) -> Vec<Record> {
        let whole = |name, max: i64| Record { name, data_type: RecordDataType::Integer { min: 0, max } };
        let float = |name| Record { name, data_type: RecordDataType::Single { min: None, max: None } };
        let mut fields =
            vec![float(RecordName::CartesianX), float(RecordName::CartesianY), float(RecordName::CartesianZ)];
        let mut add = |is: bool, more: &[Record]| fields.extend(more.iter().filter(|_| is).cloned());
        add(self.has_states(), &[whole(RecordName::CartesianInvalidState, 2)]);
        add(self.is_grid, &[index(RecordName::ColumnIndex, self.grid.columns)]);
        add(self.is_grid, &[index(RecordName::RowIndex, self.grid.rows)]);
        add(self.with_intensity > 0, &[float(RecordName::Intensity)]);
        add(self.lacks_intensity(), &[whole(RecordName::IsIntensityInvalid, 1)]);
        let channels = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
        add(self.colored > 0, &channels.map(|name| whole(name, 255)));
        add(self.lacks_color(), &[whole(RecordName::IsColorInvalid, 1)]);
        let returns = [RecordName::ReturnIndex, RecordName::ReturnCount];
        add(self.has_returns(), &returns.map(|name| whole(name, i64::from(self.max_return))));
        fields
    }

    /// The record of a sample, in the order of the prototype.
    fn record(&self, [column, row]: [u32; 2], sample: &Sample) -> Vec<RecordValue> {
        let whole = |value: u32| RecordValue::Integer(i64::from(value));
        let flag = |is: bool| whole(u32::from(is));
        let is_measured = sample.state.kind() == Kind::Measured;
        let mut values = Vec::with_capacity(16);
        values.extend(sample.position.to_array().map(RecordValue::Single));
        if self.has_states() {
            let state = if sample.position == glam::Vec3::ZERO { 2 } else { 1 };
            values.push(whole(if is_measured { 0 } else { state }));
        }
        if self.is_grid {
            values.extend([whole(column), whole(row)]);
        }
        if self.with_intensity > 0 {
            let is_there = is_measured && !sample.intensity.is_nan();
            values.push(RecordValue::Single(if is_there { sample.intensity } else { self.intensity[0] }));
            if self.lacks_intensity() {
                values.push(flag(!is_there));
            }
        }
        if self.colored > 0 {
            let is_there = sample.state.has_color();
            values.extend(if is_there { sample.color } else { [0; 3] }.map(|v| whole(u32::from(v))));
            if self.lacks_color() {
                values.push(flag(!is_there));
            }
        }
        if self.has_returns() {
            // How many returns there were is unknown: at least as many as the number of this one.
            let number = u32::from(sample.state.return_number().max(1));
            values.extend([whole(number - 1), whole(number)]);
        }
        values
    }

    fn write<F: Read + Write + Seek>(
        &self,
        reader: &mut Reader,
        cloud: &mut PointCloudWriter<'_, F>,
        steps: &mut Steps<'_, '_>,
        failed: &dyn Fn(e57::Error) -> ScanError,
    ) -> Result<(), ScanError> {
        each(reader, steps, &mut |place, sample| cloud.add_point(self.record(place, sample)).map_err(failed))?;
        if self.needs_corner() {
            let corner = [self.grid.columns - 1, self.grid.rows - 1];
            cloud.add_point(self.record(corner, &Sample::EMPTY)).map_err(failed)?;
        }
        Ok(())
    }
}

/// A row or column of so many. Types of no bits, for grids of one, are rarely met, so there is always one.
fn index(name: RecordName, count: u32) -> Record {
    let max = i64::from(count.saturating_sub(1)).max(1);
    Record { name, data_type: RecordDataType::Integer { min: 0, max } }
}

/// Takes a sample with its column and row.
type Visit<'a> = dyn FnMut([u32; 2], &Sample) -> Result<(), ScanError> + 'a;

/// Every sample that is not an empty cell, with its column and row.
fn each(reader: &mut Reader, steps: &mut Steps<'_, '_>, visit: &mut Visit<'_>) -> Result<(), ScanError> {
    let grid = reader.header().grid;
    let (cells, length) = (grid.cells(), u64::from(grid.line_length()));
    let (mut first, mut samples) = (0, Vec::new());
    while first < cells {
        let count = BATCH.min(cells - first);
        reader.read(first, count as usize, &mut samples)?;
        for (cell, sample) in (first..).zip(&samples) {
            if sample.state.kind() != Kind::Empty {
                let (line, at) = ((cell / length) as u32, (cell % length) as u32);
                visit(if grid.by_rows { [at, line] } else { [line, at] }, sample)?;
            }
        }
        first += count;
        steps.add(count)?;
    }
    Ok(())
}

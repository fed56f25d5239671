//! E57 (ASTM E2807), by the crate `e57`: point clouds with their poses and grids, Cartesian or spherical, and the photographs beside them.
//!
//! The crate checks pages, packets and XML. This module finds out how the points lie in their grid, turns records into samples, and adds the file and
//! the byte to the crate's errors.

use super::{Frame, Head, Input, Picture, too_far};
use crate::ScanError;
use crate::spool::Layout;
use crate::survey::Camera;
use e57::{E57Reader, PointCloud, Projection, RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3};
use kilwa_formats::read::Place;
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind, Pose, Rays, Sample, State};
use std::cell::Cell;
use std::error::Error;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Points looked at to find out whether lines are rows or columns.
const PROBED: usize = 4096;
/// A grid may have this many cells for each recorded point, and a million besides: scanners leave the sky out.
const SPARSE: u64 = 64;

pub(super) type Reader = E57Reader<Tracked>;

/// Open a file of `total` bytes.
pub(super) fn open(path: &Path, file: File, total: u64) -> Result<(Reader, Errors), ScanError> {
    let at = Rc::new(Cell::new(0));
    let source = Tracked { file, buffer: Vec::new(), base: 0, position: 0, total, at: Rc::clone(&at) };
    let errors = Errors { path: path.to_owned(), at };
    let reader = E57Reader::new(source).map_err(|e| errors.wrap(&e))?;
    Ok((reader, errors))
}

pub(super) fn read(mut input: Input<'_>) -> Result<(), ScanError> {
    let file = input
        .file
        .try_clone()
        .map_err(|source| kilwa_formats::read::ReadError::Open { file: input.path.to_owned(), source })?;
    let (mut reader, errors) = open(input.path, file, input.total)?;
    let clouds = reader.pointclouds();
    let mut is_empty = true;
    for (number, cloud) in clouds.iter().enumerate() {
        is_empty &= cloud.records == 0;
        if cloud.records == 0 {
            input.sink.diagnostics().add("scans without points left out", || format!("scan {}", number + 1));
            input.sink.skip();
            continue;
        }
        one_cloud(&mut reader, cloud, number + 1, &errors, &mut input)?;
    }
    let pictures = reader.images();
    is_empty &= pictures.is_empty();
    if is_empty {
        let what = format!("it has {} and none holds a point", counted(clouds.len() as u64, "scan", "scans"));
        return Err(ScanError::Nothing { file: input.path.to_owned(), what });
    }
    for picture in &pictures {
        one_picture(&mut reader, picture, &clouds, &errors, &mut input)?;
    }
    input.sink.progress(input.total)
}

/// Adds file and byte to errors of the crate.
pub(super) struct Errors {
    path: PathBuf,
    at: Rc<Cell<u64>>,
}

impl Errors {
    pub(super) fn wrap(&self, e: &e57::Error) -> ScanError {
        let mut text = e.to_string();
        let mut cause = e.source();
        while let Some(inner) = cause {
            text = format!("{text}: {inner}");
            cause = inner.source();
        }
        self.malformed(text, "a sound E57 file; copy or export it again")
    }

    pub(super) fn malformed(&self, found: impl Into<String>, expected: impl Into<String>) -> ScanError {
        ScanError::malformed(&self.path, Place::Byte(self.at.get()), found, expected)
    }
}

/// Which record of a point holds what.
struct Columns {
    cartesian: Option<[usize; 3]>,
    cartesian_state: Option<usize>,
    spherical: Option<[usize; 3]>,
    spherical_state: Option<usize>,
    intensity: Option<usize>,
    no_intensity: Option<usize>,
    color: Option<[usize; 3]>,
    no_color: Option<usize>,
    cell: Option<[usize; 2]>,
    of_return: Option<usize>,
}

impl Columns {
    fn of(cloud: &PointCloud) -> Self {
        let find = |name: RecordName| cloud.prototype.iter().position(|r| r.name == name);
        let three = |a, b, c| Some([find(a)?, find(b)?, find(c)?]);
        let two = |a, b| Some([find(a)?, find(b)?]);
        Self {
            cartesian: three(RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ),
            cartesian_state: find(RecordName::CartesianInvalidState),
            spherical: three(RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation),
            spherical_state: find(RecordName::SphericalInvalidState),
            intensity: find(RecordName::Intensity),
            no_intensity: find(RecordName::IsIntensityInvalid),
            color: three(RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue),
            no_color: find(RecordName::IsColorInvalid),
            cell: two(RecordName::ColumnIndex, RecordName::RowIndex),
            of_return: find(RecordName::ReturnIndex),
        }
    }
}

/// Turns records into samples.
struct Decoder<'a> {
    cloud: &'a PointCloud,
    columns: Columns,
    frame: Frame,
    /// For each channel of colour what is black, and what is 255 divided by what is white less black.
    color: [(f64, f64); 3],
}

impl<'a> Decoder<'a> {
    fn new(cloud: &'a PointCloud, frame: Frame) -> Self {
        let columns = Columns::of(cloud);
        let mut color = [(0.0, 1.0); 3];
        if let Some(indices) = columns.color {
            for (channel, index) in indices.into_iter().enumerate() {
                let (black, white) = color_range(cloud, channel, &cloud.prototype[index].data_type);
                color[channel] = (black, if white > black { 255.0 / (white - black) } else { 1.0 });
            }
        }
        Self { cloud, columns, frame, color }
    }

    #[inline]
    fn number(&self, values: &[RecordValue], index: usize) -> f64 {
        match (&values[index], &self.cloud.prototype[index].data_type) {
            (RecordValue::Single(v), _) => f64::from(*v),
            (RecordValue::Double(v), _) => *v,
            (RecordValue::ScaledInteger(v), RecordDataType::ScaledInteger { scale, offset, .. }) => {
                *v as f64 * scale + offset
            }
            (RecordValue::ScaledInteger(v) | RecordValue::Integer(v), _) => *v as f64,
        }
    }

    /// The position and whether it is valid (0), a direction (1) or nothing (2), as E57 numbers these states.
    #[inline]
    fn position(&self, values: &[RecordValue]) -> (DVec3, u8) {
        let state = |index: Option<usize>| index.map_or(0, |k| self.number(values, k) as u8);
        let (mut point, mut is) = (DVec3::ZERO, 2);
        if let Some(xyz) = self.columns.cartesian {
            point = DVec3::from_array(xyz.map(|k| self.number(values, k)));
            is = state(self.columns.cartesian_state);
        }
        if let Some(spherical) = self.columns.spherical.filter(|_| is != 0) {
            let [range, azimuth, elevation] = spherical.map(|k| self.number(values, k));
            let own = state(self.columns.spherical_state);
            if own <= is {
                let range = if own == 1 { 1.0 } else { range };
                let (sin, cos) = elevation.sin_cos();
                point = DVec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin) * range;
                is = own;
            }
        }
        (point, if point.is_finite() { is } else { 2 })
    }

    /// The sample, or the distance of a point that is too far away.
    #[inline]
    fn sample(&self, values: &[RecordValue]) -> Result<Sample, f64> {
        let (point, state) = self.position(values);
        let of_return = self.columns.of_return.map_or(0, |k| (self.number(values, k) + 1.0) as u8);
        if state != 0 {
            let direction = if state == 1 { point.normalize_or_zero().as_vec3() } else { glam::Vec3::ZERO };
            return Ok(Sample {
                position: direction,
                state: State::new(Kind::NoReturn, false, of_return),
                ..Sample::EMPTY
            });
        }
        let position = self.frame.place(point)?;
        let is_valid = |flag: Option<usize>| flag.is_none_or(|k| self.number(values, k) == 0.0);
        let intensity = self.columns.intensity.filter(|_| is_valid(self.columns.no_intensity));
        let intensity = intensity.map_or(f32::NAN, |k| self.number(values, k) as f32);
        let channels = self.columns.color.filter(|_| is_valid(self.columns.no_color));
        let mut color = [0; 3];
        if let Some(channels) = channels {
            for (k, index) in channels.into_iter().enumerate() {
                let (black, scale) = self.color[k];
                color[k] = ((self.number(values, index) - black) * scale + 0.5) as u8;
            }
        }
        Ok(Sample { position, intensity, color, state: State::new(Kind::Measured, channels.is_some(), of_return) })
    }

    /// Column and row.
    #[inline]
    fn cell(&self, values: &[RecordValue]) -> Option<[f64; 2]> {
        self.columns.cell.map(|cell| cell.map(|k| self.number(values, k)))
    }
}

/// Black and white of a channel: the limits that the scan states, else those of the type, else 0 and 255.
fn color_range(cloud: &PointCloud, channel: usize, data_type: &RecordDataType) -> (f64, f64) {
    let limits = cloud
        .color_limits
        .as_ref()
        .map(|l| [(&l.red_min, &l.red_max), (&l.green_min, &l.green_max), (&l.blue_min, &l.blue_max)][channel]);
    let number = |v: &Option<RecordValue>| v.as_ref().and_then(|v| v.to_f64(data_type).ok());
    if let Some((Some(min), Some(max))) = limits.map(|(min, max)| (number(min), number(max)))
        && max > min
    {
        return (min, max);
    }
    match data_type {
        RecordDataType::Integer { min, max } if max > min => (*min as f64, *max as f64),
        RecordDataType::ScaledInteger { min, max, scale, offset } if max > min => {
            (*min as f64 * scale + offset, *max as f64 * scale + offset)
        }
        RecordDataType::Single { min: Some(min), max: Some(max) } if max > min => (f64::from(*min), f64::from(*max)),
        RecordDataType::Double { min: Some(min), max: Some(max) } if max > min => (*min, *max),
        _ => (0.0, 255.0),
    }
}

pub(super) fn pose_of(transform: Option<&e57::Transform>) -> Option<Result<Pose, f64>> {
    let transform = transform?;
    let (r, t) = (&transform.rotation, &transform.translation);
    let (rotation, translation) = (DQuat::from_xyzw(r.x, r.y, r.z, r.w), DVec3::new(t.x, t.y, t.z));
    let length = rotation.length();
    let is_sound = (length - 1.0).abs() < Pose::TOLERANCE && translation.is_finite();
    Some(if is_sound { Ok(Pose { rotation: rotation.normalize(), translation }) } else { Err(length) })
}

fn one_cloud(
    reader: &mut Reader,
    cloud: &PointCloud,
    number: usize,
    errors: &Errors,
    input: &mut Input<'_>,
) -> Result<(), ScanError> {
    check(cloud, number, input)?;
    let name = || format!("scan {number}");
    let pose = pose_of(cloud.transform.as_ref()).transpose().map_err(|length| {
        errors.malformed(
            format!("a rotation of {} whose length is {length}", name()),
            "a unit quaternion and a finite translation",
        )
    })?;
    let is_grid = Columns::of(cloud).cell.is_some();
    // Points with a pose or a grid are relative to the scanner.
    let is_placed = is_grid || pose.is_some();
    if !is_placed && input.options.station.is_none() {
        return Err(ScanError::NoStation { file: input.path.to_owned() });
    }
    let frame = if is_placed { Frame::placed(input.options, 1.0) } else { Frame::unplaced(input.options, 1.0) };
    let is_given = !is_placed || input.options.override_position;
    let pose = pose.or(is_given.then(Pose::default)).map(|pose| frame.pose(pose));
    let decoder = Decoder::new(cloud, frame);
    let instrument = [&cloud.sensor_vendor, &cloud.sensor_model, &cloud.sensor_serial];
    let instrument: Vec<&str> =
        instrument.iter().filter_map(|part| part.as_deref()).filter(|t| !t.is_empty()).collect();
    let head = Head {
        name: cloud.name.clone(),
        pose,
        instrument: (!instrument.is_empty()).then(|| instrument.join(" ")),
        is_position_given: is_given,
        samples: None,
        crs: reader.coordinate_metadata().map(str::to_owned).filter(|text| !text.trim().is_empty()),
    };
    if !input.sink.begin(&head)? {
        return Ok(());
    }
    let grid = if is_grid { Some(grid_of(reader, &decoder, number, errors, input)?) } else { None };
    let points = reader.pointcloud_raw(cloud).map_err(|e| errors.wrap(&e))?;
    let (mut count, mut doubles, mut reported) = (0_u64, 0_u64, 0);
    for values in points {
        let values = values.map_err(|e| errors.wrap(&e))?;
        let far = |metres| too_far(input.path, Place::Byte(errors.at.get()), metres);
        let sample = decoder.sample(&values).map_err(far)?;
        match (grid, decoder.cell(&values)) {
            (Some(grid), Some([column, row])) => {
                let cell = grid.cell(column as u32, row as u32);
                doubles += u64::from(!input.sink.put(cell, &sample)?);
            }
            _ => input.sink.push(&sample)?,
        }
        count += 1;
        if count % 4096 == 0 && errors.at.get() > reported + (1 << 20) {
            reported = errors.at.get();
            input.sink.progress(reported)?;
        }
    }
    if count != cloud.records {
        let found = format!("{} of {}", counted(count, "point", "points"), name());
        return Err(errors.malformed(found, format!("{}, as it announces", cloud.records)));
    }
    input.sink.diagnostics().add_many("additional returns in a cell dropped; the first in the file is kept", doubles);
    let plain = Grid::by_columns(1, count as u32);
    input.sink.end(Layout { grid: grid.unwrap_or(plain), is_grid, rays: Rays::Central, origin: frame.origin })
}

/// What can be refused from the header of a scan alone.
fn check(cloud: &PointCloud, number: usize, input: &Input<'_>) -> Result<(), ScanError> {
    let refuse = |found: String, expected: &str| {
        Err(ScanError::malformed(
            input.path,
            Place::Byte(cloud.file_offset),
            format!("scan {number}: {found}"),
            expected,
        ))
    };
    let bits = |kind: &RecordDataType| match kind {
        RecordDataType::Single { .. } => 32,
        RecordDataType::Double { .. } => 64,
        RecordDataType::Integer { min, max } | RecordDataType::ScaledInteger { min, max, .. } => {
            let range = i128::from(*max) - i128::from(*min);
            if range > 0 { u64::from(range.ilog2()) + 1 } else { 0 }
        }
    };
    let row: u64 = cloud.prototype.iter().map(|record| bits(&record.data_type)).sum();
    // Also keeps the crate from making up records of no bits for ever.
    if row == 0 {
        return refuse("records without any bits".to_owned(), "records that differ from each other");
    }
    if cloud.records > input.total.saturating_mul(8) / row {
        let found = format!("{} points of {row} bits in a file of {} bytes", cloud.records, input.total);
        return refuse(
            found,
            "no more points than the file can hold; it is truncated or damaged: copy or export it again",
        );
    }
    if u32::try_from(cloud.records).is_err() {
        return refuse(format!("{} points", cloud.records), "at most 4,294,967,295 points a scan");
    }
    if !cloud.has_cartesian() && !cloud.has_spherical() {
        return refuse("records without coordinates".to_owned(), "Cartesian or spherical coordinates");
    }
    Ok(())
}

/// The size of the grid, and the order in which its points come.
fn grid_of(
    reader: &mut Reader,
    decoder: &Decoder<'_>,
    number: usize,
    errors: &Errors,
    input: &mut Input<'_>,
) -> Result<Grid, ScanError> {
    let cloud = decoder.cloud;
    let points = reader.pointcloud_raw(cloud).map_err(|e| errors.wrap(&e))?;
    let (mut largest, mut smallest) = ([0.0_f64; 2], [0.0_f64; 2]);
    let (mut changes, mut last) = ([0_u32; 2], None::<[f64; 2]>);
    // Bounds in the header may be wrong or missing; the points are not.
    for (k, values) in points.enumerate() {
        let values = values.map_err(|e| errors.wrap(&e))?;
        let Some(cell) = decoder.cell(&values) else { break };
        for axis in 0..2 {
            largest[axis] = largest[axis].max(cell[axis]);
            smallest[axis] = smallest[axis].min(cell[axis]);
        }
        if let Some(last) = last.filter(|_| k < PROBED) {
            for axis in 0..2 {
                changes[axis] += u32::from(cell[axis] != last[axis]);
            }
        }
        last = Some(cell);
        if k % 65_536 == 0 {
            input.sink.progress(0)?;
        }
    }
    let [columns, rows] = largest.map(|v| v + 1.0);
    let (cells, limit) = (columns * rows, (cloud.records * SPARSE + (1 << 20)) as f64);
    let fits = smallest.iter().all(|v| *v >= 0.0) && columns <= f64::from(u32::MAX) && rows <= f64::from(u32::MAX);
    if !fits || cells > limit {
        return Err(errors.malformed(
            format!("scan {number}: columns {} to {}, rows {} to {}", smallest[0], largest[0], smallest[1], largest[1]),
            format!("indices from 0 on, and at most {limit} cells for {} points", cloud.records),
        ));
    }
    Ok(Grid { columns: columns as u32, rows: rows as u32, by_rows: changes[0] > changes[1] })
}

/// Where the data of a picture are, and its camera if that is sound; None if it has no data.
pub(super) fn blob_and_camera(picture: &e57::Image) -> Option<(&e57::ImageBlob, Option<Camera>)> {
    let (blob, camera) = match (&picture.projection, &picture.visual_reference) {
        (Some(Projection::Pinhole(p)), _) => {
            let q = &p.properties;
            let focal = [q.focal_length / q.pixel_width, q.focal_length / q.pixel_height];
            let (size, center) = ([q.width, q.height], [q.principal_x, q.principal_y]);
            (&p.blob, Some(Camera::Pinhole { size, focal, center }))
        }
        (Some(Projection::Spherical(p)), _) => {
            let q = &p.properties;
            (&p.blob, Some(Camera::Spherical { size: [q.width, q.height], pixel: [q.pixel_width, q.pixel_height] }))
        }
        (Some(Projection::Cylindrical(p)), _) => {
            let q = &p.properties;
            let (size, pixel) = ([q.width, q.height], [q.pixel_width, q.pixel_height]);
            (&p.blob, Some(Camera::Cylindrical { size, radius: q.radius, center: q.principal_y, pixel }))
        }
        (None, Some(p)) => (&p.blob, None),
        (None, None) => return None,
    };
    Some((blob, camera.filter(Camera::is_sound)))
}

fn one_picture(
    reader: &mut Reader,
    picture: &e57::Image,
    clouds: &[PointCloud],
    errors: &Errors,
    input: &mut Input<'_>,
) -> Result<(), ScanError> {
    let Some((blob, camera)) = blob_and_camera(picture) else {
        input.sink.diagnostics().add_many("photograph entries without image data left out", 1);
        return Ok(());
    };
    let found = Picture {
        name: picture.name.clone(),
        pose: pose_of(picture.transform.as_ref()).and_then(Result::ok),
        camera,
        extension: match blob.format {
            e57::ImageFormat::Png => "png",
            e57::ImageFormat::Jpeg => "jpg",
        },
        station: picture
            .pointcloud_guid
            .as_ref()
            .and_then(|guid| clouds.iter().position(|c| c.guid.as_ref() == Some(guid)))
            .map(|at| at as u64 + 1),
    };
    let data = &blob.data;
    input.sink.picture(&found, &mut |mut out| reader.blob(data, &mut out).map(drop).map_err(|e| errors.wrap(&e)))
}

/// The file, read in large pieces and remembering where; the crate seeks before every page.
pub(super) struct Tracked {
    file: File,
    buffer: Vec<u8>,
    base: u64,
    position: u64,
    total: u64,
    at: Rc<Cell<u64>>,
}

impl Tracked {
    const PIECE: usize = 1 << 20;
}

impl Read for Tracked {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        self.at.set(self.position);
        let is_here = |s: &Self| s.position >= s.base && s.position < s.base + s.buffer.len() as u64;
        if !is_here(self) {
            self.base = self.position;
            self.file.seek(SeekFrom::Start(self.position))?;
            self.buffer.clear();
            (&mut self.file).take(Self::PIECE as u64).read_to_end(&mut self.buffer)?;
            if self.buffer.is_empty() {
                return Ok(0);
            }
        }
        let from = (self.position - self.base) as usize;
        let n = out.len().min(self.buffer.len() - from);
        out[..n].copy_from_slice(&self.buffer[from..from + n]);
        self.position += n as u64;
        Ok(n)
    }
}

impl Seek for Tracked {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
            SeekFrom::End(by) => self.total.checked_add_signed(by),
        };
        self.position = to.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        Ok(self.position)
    }
}

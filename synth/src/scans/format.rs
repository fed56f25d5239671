//! Files of scans: PTX and E57, one scan each, written column by column.

use super::beam::Sample;
use glam::{DMat3, DQuat, DVec3};
use std::io::{self, BufWriter, Read, Seek, Write};

/// A format of scan files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScanFormat {
    /// Leica's text format.
    Ptx,
    /// ASTM E2807.
    E57,
}

/// What a file says of its scan.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) name: String,
    pub(super) guid: u64,
    pub(super) columns: u32,
    pub(super) rows: u32,
    /// The pose that is written: from the scan's frame to the site's.
    pub(super) rotation: DMat3,
    pub(super) position: DVec3,
    /// Name of the instrument.
    pub(super) instrument: &'static str,
    /// Coordinate reference system of the pose, if it has one.
    pub(super) crs: Option<&'static str>,
}

/// The columns of a scan: each has as many samples as the grid has rows, from the lowest to the highest.
pub(super) type Columns<'a> = dyn Iterator<Item = io::Result<Vec<Sample>>> + 'a;

impl ScanFormat {
    /// The extension of its files.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ptx => "ptx",
            Self::E57 => "e57",
        }
    }

    /// Write a scan into an empty file.
    pub(super) fn write<F: Read + Write + Seek>(
        self,
        file: F,
        header: &Header,
        columns: &mut Columns<'_>,
    ) -> io::Result<F> {
        match self {
            Self::Ptx => ptx(file, header, columns),
            Self::E57 => e57(file, header, columns).map_err(io::Error::other),
        }
    }
}

/// PTX: numbers of columns and rows; the instrument's position and axes; the same as a matrix for row vectors; then `x y z intensity r g b` for each
/// sample, column by column. A cell without a point is `0 0 0 0.5 0 0 0`.
fn ptx<F: Write>(file: F, header: &Header, columns: &mut Columns<'_>) -> io::Result<F> {
    let mut out = BufWriter::with_capacity(1 << 20, file);
    let Header { rotation: r, position: p, .. } = header;
    writeln!(out, "{}\n{}", header.columns, header.rows)?;
    writeln!(out, "{:.6} {:.6} {:.6}", p.x, p.y, p.z)?;
    for axis in [r.x_axis, r.y_axis, r.z_axis] {
        writeln!(out, "{:.12} {:.12} {:.12}", axis.x, axis.y, axis.z)?;
    }
    for axis in [r.x_axis, r.y_axis, r.z_axis] {
        writeln!(out, "{:.12} {:.12} {:.12} 0", axis.x, axis.y, axis.z)?;
    }
    writeln!(out, "{:.6} {:.6} {:.6} 1", p.x, p.y, p.z)?;
    let mut line = Vec::with_capacity(80);
    for column in columns {
        for sample in column? {
            line.clear();
            match sample.point {
                Some(point) => {
                    for value in point.to_array() {
                        decimal(&mut line, micrometres(value), 6);
                        line.push(b' ');
                    }
                    decimal(&mut line, (sample.intensity * 1e6).round() as i64, 6);
                    for value in sample.color {
                        line.push(b' ');
                        decimal(&mut line, i64::from(value), 0);
                    }
                }
                None => line.extend_from_slice(b"0 0 0 0.5 0 0 0"),
            }
            line.push(b'\n');
            out.write_all(&line)?;
        }
    }
    out.into_inner().map_err(io::IntoInnerError::into_error)
}

/// Coordinates are whole micrometres.
fn micrometres(metres: f64) -> i64 {
    (metres * 1e6).round() as i64
}

/// Append a whole number divided by a power of ten, with all of its decimals.
fn decimal(line: &mut Vec<u8>, value: i64, decimals: usize) {
    if value < 0 {
        line.push(b'-');
    }
    let mut digits = [b'0'; 24];
    let mut rest = value.unsigned_abs();
    let mut first = digits.len();
    while rest > 0 || digits.len() - first < decimals + 1 {
        first -= 1;
        digits[first] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    let point = digits.len() - decimals;
    line.extend_from_slice(&digits[first..point]);
    if decimals > 0 {
        line.push(b'.');
        line.extend_from_slice(&digits[point..]);
    }
}

/// E57: whole micrometres, with row and column, intensity and colour; a cell without a point has the invalid state 2.
fn e57<F: Read + Write + Seek>(file: F, header: &Header, columns: &mut Columns<'_>) -> e57::Result<F> {
    use e57::{E57Writer, Quaternion, Record, RecordDataType, RecordName, RecordValue, Transform, Translation};
    const REACH: i64 = 500_000_000;
    let failed = |source: io::Error| e57::Error::Write { desc: source.to_string(), source: Some(Box::new(source)) };
    let guid = |what: u64| {
        let h = crate::noise::mix(header.guid ^ what);
        let g = crate::noise::mix(h);
        let tail = g & 0xffff_ffff_ffff;
        format!(
            "{{{:08X}-{:04X}-4{:03X}-8{:03X}-{tail:012X}}}",
            h >> 32,
            h >> 16 & 0xffff,
            h >> 4 & 0xfff,
            g >> 48 & 0xfff
        )
    };
    let mut file = file;
    let mut writer = E57Writer::new(&mut file, &guid(1))?;
    if let Some(crs) = header.crs {
        writer.set_coordinate_metadata(Some(crs.to_owned()));
    }
    let whole = |name, max: i64| Record { name, data_type: RecordDataType::Integer { min: 0, max } };
    let length = |name| {
        let data_type = RecordDataType::ScaledInteger { min: -REACH, max: REACH, scale: 1e-6, offset: 0.0 };
        Record { name, data_type }
    };
    let prototype = vec![
        length(RecordName::CartesianX),
        length(RecordName::CartesianY),
        length(RecordName::CartesianZ),
        whole(RecordName::CartesianInvalidState, 2),
        Record { name: RecordName::Intensity, data_type: RecordDataType::Single { min: Some(0.0), max: Some(1.0) } },
        whole(RecordName::ColorRed, 255),
        whole(RecordName::ColorGreen, 255),
        whole(RecordName::ColorBlue, 255),
        whole(RecordName::RowIndex, i64::from(header.rows) - 1),
        whole(RecordName::ColumnIndex, i64::from(header.columns) - 1),
    ];
    let mut cloud = writer.add_pointcloud(&guid(2), prototype)?;
    cloud.set_name(Some(header.name.clone()));
    cloud.set_sensor_vendor(Some("kilwa synth".to_owned()));
    cloud.set_sensor_model(Some(header.instrument.to_owned()));
    let q = DQuat::from_mat3(&header.rotation);
    let q = if q.w < 0.0 { -q } else { q };
    let DVec3 { x, y, z } = header.position;
    cloud.set_transform(Some(Transform {
        rotation: Quaternion { w: q.w, x: q.x, y: q.y, z: q.z },
        translation: Translation { x, y, z },
    }));
    for (column, samples) in columns.enumerate() {
        for (row, sample) in samples.map_err(failed)?.into_iter().enumerate() {
            let point = sample.point.unwrap_or(DVec3::ZERO);
            let [x, y, z] = point.to_array().map(|v| RecordValue::ScaledInteger(micrometres(v)));
            let state = RecordValue::Integer(if sample.point.is_some() { 0 } else { 2 });
            let [r, g, b] = sample.color.map(|v| RecordValue::Integer(i64::from(v)));
            let intensity = RecordValue::Single(sample.intensity as f32);
            let place = [row, column].map(|k| RecordValue::Integer(k as i64));
            let [row, column] = place;
            cloud.add_point(vec![x, y, z, state, intensity, r, g, b, row, column])?;
        }
    }
    cloud.finalize()?;
    writer.finalize()?;
    drop(writer);
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_are_what_the_standard_library_prints() {
        for value in [0, 1, -1, 999_999, 1_000_000, -1_234_567, 80_000_000_001, -40] {
            let mut line = Vec::new();
            decimal(&mut line, value, 6);
            assert_eq!(String::from_utf8(line).unwrap(), format!("{:.6}", value as f64 / 1e6));
        }
        let mut line = Vec::new();
        decimal(&mut line, 255, 0);
        decimal(&mut line, 0, 0);
        assert_eq!(line, b"2550");
    }
}

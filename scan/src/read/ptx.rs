//! PTX (Leica, "PTX - ASCII based format"): one scan after the other, each with columns, rows, the scanner's position and axes (four lines of three
//! numbers), the matrix that takes its points to the survey (four lines of four numbers, column by column), and a line for every cell, column by column:
//! `x y z intensity [red green blue]`. A cell without return is `0 0 0`.
//!
//! The position with its axes and the matrix tell the same; the matrix counts, and a difference is reported.

use super::lines::{Lines, numbers, quote, whole};
use super::{Frame, Head, Input, too_far};
use crate::ScanError;
use crate::spool::Layout;
use glam::{DMat4, DVec3, DVec4};
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind, Pose, Rays, Sample, State};

const POINT: &str = "x y z intensity, or x y z intensity red green blue";

/// Whether a file that starts with these bytes is a PTX: two lines with a whole number each, then a line of three numbers.
pub(super) fn is_ptx(start: &[u8]) -> bool {
    let mut lines = start.split(|b| *b == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty());
    let mut is_whole = || lines.next().is_some_and(|line| whole(line).is_some());
    is_whole() && is_whole() && lines.next().is_some_and(|line| numbers(line, &mut [0.0; 4]) == Ok(3))
}

pub(super) fn read(mut input: Input<'_>) -> Result<(), ScanError> {
    let mut lines = input.lines()?;
    let mut scans = 0;
    while let Some(columns) = next_scan(&mut lines, scans == 0)? {
        scans += 1;
        match header(&mut lines, columns, &mut input) {
            Ok(header) => one_scan(&mut lines, header, scans, &mut input)?,
            // The scans before are whole.
            Err(_) if input.options.keep_incomplete && scans > 1 && lines.is_at_end()? => {
                let place = lines.place().to_string();
                input.sink.diagnostics().add("scans whose header is truncated left out", || place);
            }
            Err(e) => return Err(e),
        }
    }
    if scans == 0 {
        return Err(ScanError::Nothing { file: input.path.to_owned(), what: "it holds no scan".to_owned() });
    }
    input.sink.progress(input.total)
}

/// The next line that is not blank.
fn next_filled(lines: &mut Lines) -> Result<Option<Vec<u8>>, ScanError> {
    while let Some(line) = lines.next()? {
        if !line.trim_ascii().is_empty() {
            return Ok(Some(line.to_vec()));
        }
    }
    Ok(None)
}

/// The number of columns, with which a scan begins; `None` at the end of the file.
fn next_scan(lines: &mut Lines, is_first: bool) -> Result<Option<u64>, ScanError> {
    let Some(line) = next_filled(lines)? else { return Ok(None) };
    let why = if is_first {
        "a PTX file begins with it"
    } else {
        "the header of the next scan; the previous scan has more points than its header states"
    };
    let expected = || format!("the number of columns alone in its line ({why})");
    whole(&line).map(Some).ok_or_else(|| lines.malformed(quote(&line), expected()))
}

/// A line of the header with exactly so many numbers.
fn row<const N: usize>(lines: &mut Lines, what: &str) -> Result<[f64; N], ScanError> {
    let Some(line) = lines.next()?.map(<[u8]>::to_vec) else {
        return Err(lines.malformed("the end of the file", format!("{what}; the file is truncated")));
    };
    let mut out = [0.0; N];
    match numbers(&line, &mut out) {
        Ok(n) if n == N && out.iter().all(|v| v.is_finite()) => Ok(out),
        _ => Err(lines.malformed(quote(&line), format!("{what}: {N} numbers"))),
    }
}

/// What is known of a scan before its points.
#[derive(Debug, Clone, Copy)]
struct Header {
    columns: u32,
    rows: u32,
    pose: Pose,
}

/// The rest of the header, behind the number of columns.
fn header(lines: &mut Lines, columns: u64, input: &mut Input<'_>) -> Result<Header, ScanError> {
    let Some(line) = lines.next()?.map(<[u8]>::to_vec) else {
        return Err(lines.malformed("the end of the file", "the number of rows; the file is truncated"));
    };
    let rows = whole(&line).ok_or_else(|| lines.malformed(quote(&line), "the number of rows alone in its line"))?;
    let size = |n: u64| u32::try_from(n).ok().filter(|n| *n > 0);
    let (Some(columns), Some(rows)) = (size(columns), size(rows)) else {
        let found = format!("{columns} columns and {rows} rows");
        return Err(lines.malformed(found, "two numbers from 1 to 4,294,967,295"));
    };
    let pose = pose(lines, input.options.units.metres(), input)?;
    Ok(Header { columns, rows, pose })
}

fn one_scan(lines: &mut Lines, header: Header, scan: u64, input: &mut Input<'_>) -> Result<(), ScanError> {
    let Header { columns, rows, pose } = header;
    let frame = Frame::placed(input.options, input.options.units.metres());
    let is_position_given = input.options.override_position;
    let head = Head { pose: Some(frame.pose(pose)), is_position_given, ..Head::default() };
    let is_wanted = input.sink.begin(&head)?;
    let announced = u64::from(columns) * u64::from(rows);
    let mut points = Points { frame, values: [0.0; 7], odd_colors: 0 };
    let (mut count, mut is_cut) = (0, false);
    while count < announced {
        let Some(line) = lines.next()? else { break };
        let sample = points.sample(line);
        // A number that is cut is another number.
        let is_bad = matches!(sample, Err(Bad::Word | Bad::Header));
        is_cut = lines.is_cut() && (is_bad || sample.is_ok() && count + 1 < announced);
        if is_cut {
            break;
        }
        match sample {
            Ok(sample) => {
                if is_wanted {
                    input.sink.push(&sample)?;
                }
                count += 1;
            }
            Err(Bad::Header) => {
                lines.back();
                break;
            }
            Err(Bad::Blank) => {}
            Err(Bad::Far(metres)) => return Err(too_far(input.path, lines.place(), metres)),
            Err(Bad::Word) => {
                let line = quote(lines.last());
                return Err(lines.malformed(line, format!("point {} of scan {scan}: {POINT}", count + 1)));
            }
        }
        if let Some(done) = lines.step() {
            input.sink.progress(done)?;
        }
    }
    // A scan that goes on after its announced end is not what its header says.
    if next_scan(lines, false)?.is_some() {
        lines.back();
    }
    if count == 0 && scan > 1 && input.options.keep_incomplete {
        let place = format!("scan {scan}");
        input.sink.diagnostics().add("scans whose points are missing left out", || place);
        return Ok(());
    }
    if count < announced {
        incomplete(lines, count, is_cut, [columns, rows], scan, input)?;
    }
    if points.odd_colors > 0 {
        input.sink.diagnostics().add_many("colours outside 0 to 255 clamped to that range", points.odd_colors);
    }
    if is_wanted {
        let columns = if count < announced { count.div_ceil(u64::from(rows)) as u32 } else { columns };
        let layout = Layout {
            grid: Grid::by_columns(columns, rows),
            is_grid: true,
            rays: Rays::Central,
            origin: points.frame.origin,
        };
        input.sink.end(layout)?;
    }
    Ok(())
}

/// A scan of fewer points than its header announces: refused, or kept and counted.
fn incomplete(
    lines: &Lines,
    count: u64,
    is_cut: bool,
    [columns, rows]: [u32; 2],
    scan: u64,
    input: &mut Input<'_>,
) -> Result<(), ScanError> {
    let cut = if is_cut { ", and the file ends in the middle of a line" } else { "" };
    let found = format!("{} of scan {scan}{cut}", counted(count, "point", "points"));
    if !input.options.keep_incomplete || count == 0 {
        let announced = u64::from(columns) * u64::from(rows);
        return Err(lines.malformed(
            found,
            format!(
                "{columns} × {rows} = {announced}, as its header states; the file is truncated or the header is wrong: copy or export it again, or import the points that exist with --keep-incomplete"
            ),
        ));
    }
    let place = format!("{}: {found} of {columns} × {rows}", lines.place());
    input.sink.diagnostics().add_many("points in whose line the file ends dropped", u64::from(is_cut));
    input.sink.diagnostics().add("scans with fewer points than their header announces", || place);
    Ok(())
}

/// The eight lines of position, axes and matrix.
fn pose(lines: &mut Lines, metres: f64, input: &mut Input<'_>) -> Result<Pose, ScanError> {
    let position = DVec3::from_array(row(lines, "the position of the scanner")?);
    let mut axes = [DVec3::ZERO; 3];
    for axis in &mut axes {
        *axis = DVec3::from_array(row(lines, "an axis of the scanner")?);
    }
    let mut matrix = [DVec4::ZERO; 4];
    for line in &mut matrix {
        *line = DVec4::from_array(row(lines, "a line of the 4 × 4 matrix")?);
    }
    // Points are row vectors in PTX, so each line of the file is a column for column vectors.
    let mut matrix = DMat4::from_cols(matrix[0], matrix[1], matrix[2], matrix[3]);
    matrix.w_axis = (matrix.w_axis.truncate() * metres).extend(matrix.w_axis.w);
    let (pose, difference) = Pose::from_matrix(matrix).map_err(|e| {
        lines.malformed(
            e.to_string(),
            "the matrix of a rotation and a translation, its translation in the last of four lines; put the scale into the points",
        )
    })?;
    let place = || lines.place().to_string();
    if difference > 1e-6 {
        input.sink.diagnostics().add("matrices corrected to exact rotations", place);
    }
    let differs =
        axes.iter().zip([DVec3::X, DVec3::Y, DVec3::Z]).any(|(a, unit)| (pose.rotation * unit).distance(*a) > 2e-3);
    // Some programs leave position and axes at zero and one.
    let is_blank = position == DVec3::ZERO && axes == [DVec3::X, DVec3::Y, DVec3::Z] || axes == [DVec3::ZERO; 3];
    if !is_blank && (differs || (position * metres).distance(pose.translation) > 2e-3) {
        input.sink.diagnostics().add("scans whose position and axes differ from their matrix, which was used", place);
    }
    Ok(pose)
}

/// What is wrong with a line of a point.
enum Bad {
    /// It is one whole number: the header of the next scan.
    Header,
    Blank,
    Word,
    Far(f64),
}

struct Points {
    frame: Frame,
    values: [f64; 7],
    odd_colors: u64,
}

impl Points {
    #[inline]
    fn sample(&mut self, line: &[u8]) -> Result<Sample, Bad> {
        let count = numbers(line, &mut self.values).map_err(|_| Bad::Word)?;
        let has_color = match count {
            4 => false,
            7 => true,
            0 => return Err(Bad::Blank),
            1 if whole(line).is_some() => return Err(Bad::Header),
            _ => return Err(Bad::Word),
        };
        let [x, y, z, intensity, rgb @ ..] = self.values;
        let point = DVec3::new(x, y, z);
        if point == DVec3::ZERO || !point.is_finite() {
            return Ok(Sample { state: State::new(Kind::NoReturn, false, 0), ..Sample::EMPTY });
        }
        let position = self.frame.place(point).map_err(Bad::Far)?;
        let color = if has_color { self.color(rgb) } else { [0; 3] };
        let intensity = intensity as f32;
        Ok(Sample { position, intensity, color, state: State::new(Kind::Measured, has_color, 0) })
    }

    #[inline]
    fn color(&mut self, rgb: [f64; 3]) -> [u8; 3] {
        rgb.map(|v| {
            if !(0.0..=255.0).contains(&v) {
                self.odd_colors += 1;
            }
            (v + 0.5) as u8
        })
    }
}

//! Text files of points without a grid.
//!
//! * PTS (Leica): a line with the number of points, then `x y z [intensity [red green blue]]`; several clouds may follow each other.
//! * XYZ: `x y z`, `x y z intensity`, `x y z red green blue` or `x y z intensity red green blue`, with blanks, tabs, commas or semicolons between; lines
//!   that begin with `#` or `//` and a first line of names are passed over. Six numbers whose last three are not whole numbers from 0 to 255 are a point
//!   with its normal; normals are dropped and counted.
//!
//! Such files do not tell from where the points were seen: the position must be given.

use super::lines::{Lines, numbers, quote, whole};
use super::{Frame, Head, Input, too_far};
use crate::ScanError;
use crate::spool::Layout;
use glam::DVec3;
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind as SampleKind, Rays, Sample, State};

/// Which of the formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Pts,
    Xyz,
}

const COLUMNS: &str = "three numbers (x y z), four (with intensity), six (with red green blue) or seven (with both)";
const MAX_POINTS: u64 = u32::MAX as u64;

pub(super) fn read(mut input: Input<'_>, kind: Kind) -> Result<(), ScanError> {
    if input.options.station.is_none() {
        return Err(ScanError::NoStation { file: input.path.to_owned() });
    }
    let mut lines = input.lines()?;
    let mut clouds = 0;
    while let Some(line) = lines.next()? {
        let text = line.trim_ascii();
        if text.is_empty() {
            continue;
        }
        let announced = (kind == Kind::Pts).then(|| whole(text)).flatten();
        if announced.is_none() {
            lines.back();
        }
        clouds += 1;
        one_cloud(&mut lines, announced, kind, &mut input)?;
    }
    if clouds == 0 {
        return Err(ScanError::Nothing { file: input.path.to_owned(), what: "it holds no points".to_owned() });
    }
    input.sink.progress(input.total)
}

fn one_cloud(lines: &mut Lines, announced: Option<u64>, kind: Kind, input: &mut Input<'_>) -> Result<(), ScanError> {
    let is_wanted = input.sink.begin(&Head::default())?;
    let mut row = Row { frame: Frame::new(input.options, input.options.units.metres()), values: [0.0; 8] };
    let (mut count, mut dropped, mut normals, mut comments) = (0, 0, 0, 0);
    while announced.is_none_or(|n| count + dropped < n) {
        let Some(line) = lines.next()? else { break };
        match row.point(line) {
            Ok(Point::Measured(sample, has_normal)) => {
                normals += u64::from(has_normal);
                if is_wanted {
                    input.sink.push(&sample)?;
                }
                count += 1;
                if count > MAX_POINTS {
                    return Err(
                        lines.malformed(format!("more than {MAX_POINTS} points of one cloud"), "fewer; split the file")
                    );
                }
            }
            Ok(Point::NotFinite) => dropped += 1,
            Ok(Point::None) => {}
            Err(Bad::Far(metres)) => return Err(too_far(input.path, lines.place(), metres)),
            Err(Bad::Count(1)) if kind == Kind::Pts => {
                lines.back();
                break;
            }
            Err(Bad::Count(n)) => {
                let found = counted(n as u64, "number", "numbers").to_string();
                return Err(lines.malformed(found, COLUMNS));
            }
            // A line of names before the first point.
            Err(Bad::Word) if kind == Kind::Xyz && count == 0 && comments < 2 => comments += 1,
            Err(Bad::Word) => {
                let text = quote(line);
                return Err(lines.malformed(text, COLUMNS));
            }
        }
        if let Some(done) = lines.step() {
            input.sink.progress(done)?;
        }
    }
    check(lines, announced, count + dropped, input)?;
    let diagnostics = input.sink.diagnostics();
    diagnostics.add_many("points without finite coordinates dropped", dropped);
    diagnostics.add_many("normals of points dropped", normals);
    if is_wanted {
        let grid = Grid::by_columns(1, count as u32);
        input.sink.end(Layout { grid, is_grid: false, rays: Rays::Central, origin: row.frame.origin })?;
    }
    Ok(())
}

/// Compare the number of points with the one that a PTS announces.
fn check(lines: &Lines, announced: Option<u64>, count: u64, input: &mut Input<'_>) -> Result<(), ScanError> {
    let found = counted(count, "point", "points").to_string();
    if count == 0 {
        return Err(lines.malformed(found, "at least one point"));
    }
    let Some(announced) = announced.filter(|n| *n != count) else { return Ok(()) };
    if !input.options.keep_incomplete {
        return Err(lines.malformed(
            found,
            format!("{announced}, as the point cloud states; the file is truncated: copy or export it again, or import the points that exist with --keep-incomplete"),
        ));
    }
    let place = format!("{}: {found} of {announced}", lines.place());
    input.sink.diagnostics().add("clouds with fewer points than they announce", || place);
    Ok(())
}

enum Bad {
    Word,
    Count(usize),
    Far(f64),
}

enum Point {
    None,
    NotFinite,
    /// And whether it had a normal.
    Measured(Sample, bool),
}

struct Row {
    frame: Frame,
    values: [f64; 8],
}

impl Row {
    #[inline]
    fn point(&mut self, line: &[u8]) -> Result<Point, Bad> {
        if line.starts_with(b"#") || line.starts_with(b"//") {
            return Ok(Point::None);
        }
        let count = numbers(line, &mut self.values).map_err(|_| Bad::Word)?;
        let [x, y, z, a, b, c, d, _] = self.values;
        let color = |rgb: [f64; 3]| {
            let is = rgb.iter().all(|v| (0.0..=255.0).contains(v) && v.fract() == 0.0);
            is.then(|| rgb.map(|v| v as u8))
        };
        let (intensity, rgb, has_normal) = match count {
            0 => return Ok(Point::None),
            3 => (f64::NAN, None, false),
            4 => (a, None, false),
            6 => {
                let rgb = color([a, b, c]);
                (f64::NAN, rgb, rgb.is_none())
            }
            7 => (a, Some(color([b, c, d]).ok_or(Bad::Word)?), false),
            n => return Err(Bad::Count(n)),
        };
        let point = DVec3::new(x, y, z);
        if !point.is_finite() {
            return Ok(Point::NotFinite);
        }
        let position = self.frame.place(point).map_err(Bad::Far)?;
        let state = State::new(SampleKind::Measured, rgb.is_some(), 0);
        let sample = Sample { position, intensity: intensity as f32, color: rgb.unwrap_or_default(), state };
        Ok(Point::Measured(sample, has_normal))
    }
}

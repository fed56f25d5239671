//! Text files of points without a grid.
//!
//! * PTS (Leica): a line with the number of points, then `x y z [intensity [red green blue]]`; several clouds may follow each other.
//! * XYZ: `x y z`, `x y z intensity`, `x y z red green blue` or `x y z intensity red green blue`, with blanks, tabs, commas or semicolons between; lines
//!   that begin with `#` or `//` are passed over. A heading can name the columns in another order; without one, the first lines decide ([`order`]).
//!   Normals are dropped and counted.
//!
//! Such files do not tell from where the points were seen: the position must be given.

use super::lines::{Lines, numbers, quote, whole};
use super::order::{self, Found, LOOKED_AT, MAX_HEADINGS, Order, is_channel, is_comment};
use super::{Frame, Head, Input, too_far};
use crate::ScanError;
use crate::spool::Layout;
use glam::DVec3;
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind as SampleKind, Pose, Rays, Sample, State};

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
    let mut heading = None;
    while let Some(line) = lines.next()? {
        let text = line.trim_ascii();
        if text.is_empty() || is_comment(text) {
            heading = (!text.is_empty()).then(|| text.to_vec()).or(heading);
            continue;
        }
        let announced = (kind == Kind::Pts).then(|| whole(text)).flatten();
        if announced.is_none() {
            if clouds > 0 {
                let expected = "the number of points of the next cloud, alone in its line; the previous cloud has more points than it announces";
                return Err(lines.malformed(quote(lines.last()), expected));
            }
            lines.back();
        }
        clouds += 1;
        let order = order(&mut lines, heading.as_deref(), kind, &mut input)?;
        one_cloud(&mut lines, announced, kind, order, &mut input)?;
    }
    if clouds == 0 {
        return Err(ScanError::Nothing { file: input.path.to_owned(), what: "it holds no points".to_owned() });
    }
    input.sink.progress(input.total)
}

/// What the columns of the cloud that begins here hold.
fn order(lines: &mut Lines, heading: Option<&[u8]>, kind: Kind, input: &mut Input<'_>) -> Result<Order, ScanError> {
    let start = lines.peek(LOOKED_AT)?;
    let is_whole = start.len() < LOOKED_AT;
    let found = order::order(start, is_whole, heading, kind == Kind::Pts);
    let malformed = |ahead, found: String, expected: &str| {
        Err(ScanError::malformed(input.path, lines.place_of_next(ahead), found, expected))
    };
    match found {
        Found::Order(order, doubt) => {
            if let Some(doubt) = doubt {
                let place = lines.place_of_next(0).to_string();
                input.sink.diagnostics().add(doubt, || place);
            }
            Ok(order)
        }
        Found::DecimalCommas(ahead) => malformed(
            ahead,
            "numbers with decimal commas".to_owned(),
            "decimal points: export the points with them, because commas also separate columns",
        ),
        Found::Unknown(ahead, 7) => malformed(
            ahead,
            "seven columns without colours".to_owned(),
            "x y z, intensity, and red green blue as whole numbers from 0 to 255",
        ),
        Found::Unknown(ahead, n) => malformed(ahead, counted(n as u64, "number", "numbers").to_string(), COLUMNS),
    }
}

fn one_cloud(
    lines: &mut Lines,
    announced: Option<u64>,
    kind: Kind,
    order: Order,
    input: &mut Input<'_>,
) -> Result<(), ScanError> {
    let frame = Frame::unplaced(input.options, input.options.units.metres());
    let pose = Some(frame.pose(Pose::default()));
    let is_wanted = input.sink.begin(&Head { pose, is_position_given: true, ..Head::default() })?;
    let mut row = Row { frame, order, values: [0.0; 8] };
    let (mut count, mut dropped, mut headings, mut is_cut) = (0, 0, 0, false);
    while announced.is_none_or(|n| count + dropped < n) {
        let Some(line) = lines.next()? else { break };
        let point = row.point(line);
        // A number that is cut is another number. A file without announced numbers may lack its last line feed alone.
        let is_bad = matches!(point, Err(Bad::Word | Bad::Color | Bad::Count(_)));
        let is_point = matches!(point, Ok(Point::Measured(_) | Point::NotFinite));
        is_cut = lines.is_cut() && (is_bad || is_point && announced.is_some_and(|n| count + dropped + 1 < n));
        if is_cut {
            break;
        }
        match point {
            Ok(Point::Measured(sample)) => {
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
            // A line of names before the first point.
            Err(Bad::Word) if kind == Kind::Xyz && count == 0 && headings < MAX_HEADINGS => headings += 1,
            Err(bad) => return Err(refusal(lines, &bad, order)),
        }
        if let Some(done) = lines.step() {
            input.sink.progress(done)?;
        }
    }
    check(lines, announced, count + dropped, is_cut, input)?;
    let diagnostics = input.sink.diagnostics();
    diagnostics.add_many("points without finite coordinates dropped", dropped);
    diagnostics.add_many("normals of points dropped", if order.has_normal { count } else { 0 });
    diagnostics.add_many("points in whose line the file ends dropped", u64::from(is_cut));
    if is_wanted {
        let grid = Grid::by_columns(1, count as u32);
        input.sink.end(Layout { grid, is_grid: false, rays: Rays::Central, origin: row.frame.origin })?;
    }
    Ok(())
}

/// The error for a line that is no point.
fn refusal(lines: &Lines, bad: &Bad, order: Order) -> ScanError {
    let line = quote(lines.last());
    match bad {
        Bad::Count(n) => {
            let expected = format!("{}, as in the lines before", order.columns);
            lines.malformed(counted(*n as u64, "number", "numbers").to_string(), expected)
        }
        Bad::Color => {
            let expected = "colours as whole numbers from 0 to 255, which the first lines of the cloud have; name the columns in the first line: X Y Z R G B, or X Y Z Nx Ny Nz";
            lines.malformed(line, expected)
        }
        Bad::Word | Bad::Far(_) => lines.malformed(line, COLUMNS),
    }
}

/// Compare the number of points with the one that a PTS announces.
fn check(
    lines: &Lines,
    announced: Option<u64>,
    count: u64,
    is_cut: bool,
    input: &mut Input<'_>,
) -> Result<(), ScanError> {
    let cut = if is_cut { ", and the file ends in the middle of a line" } else { "" };
    let found = format!("{}{cut}", counted(count, "point", "points"));
    if count == 0 {
        return Err(lines.malformed(found, "at least one point"));
    }
    let is_right = announced.is_none_or(|n| n == count) && !is_cut;
    if is_right {
        return Ok(());
    }
    if !input.options.keep_incomplete {
        let expected = match announced {
            Some(n) => format!("{n}, as the point cloud states"),
            None => COLUMNS.to_owned(),
        };
        let hint =
            "the file is truncated: copy or export it again, or import the points that exist with --keep-incomplete";
        return Err(lines.malformed(found, format!("{expected}; {hint}")));
    }
    if let Some(announced) = announced {
        let place = format!("{}: {found} of {announced}", lines.place());
        input.sink.diagnostics().add("clouds with fewer points than they announce", || place);
    }
    Ok(())
}

enum Bad {
    Word,
    Color,
    Count(usize),
    Far(f64),
}

enum Point {
    None,
    NotFinite,
    Measured(Sample),
}

struct Row {
    frame: Frame,
    order: Order,
    values: [f64; 8],
}

impl Row {
    #[inline]
    fn point(&mut self, line: &[u8]) -> Result<Point, Bad> {
        if is_comment(line) {
            return Ok(Point::None);
        }
        let count = numbers(line, &mut self.values).map_err(|_| Bad::Word)?;
        if count == 0 {
            return Ok(Point::None);
        }
        if count != self.order.columns {
            return Err(Bad::Count(count));
        }
        let point = DVec3::from_array(self.order.position.map(|k| self.values[k]));
        if !point.is_finite() {
            return Ok(Point::NotFinite);
        }
        let mut color = None;
        if let Some(channels) = self.order.color {
            let channels = channels.map(|k| self.values[k]);
            if !channels.iter().all(|v| is_channel(*v)) {
                return Err(Bad::Color);
            }
            color = Some(channels.map(|v| v as u8));
        }
        let intensity = self.order.intensity.map_or(f64::NAN, |k| self.values[k]);
        let position = self.frame.place(point).map_err(Bad::Far)?;
        let state = State::new(SampleKind::Measured, color.is_some(), 0);
        let sample = Sample { position, intensity: intensity as f32, color: color.unwrap_or_default(), state };
        Ok(Point::Measured(sample))
    }
}

//! What a scanner recorded: samples in the cells of a grid.

use glam::{DVec3, Vec3};

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// Nothing is recorded for this cell.
    #[default]
    Empty,
    /// A measured point.
    Measured,
    /// The scanner looked, and no valid return came back (sky, water, out of range). The position is a unit vector along the ray,
    /// or zero if the direction is unknown.
    NoReturn,
}

/// Kind, presence of a colour, and number of the return, in one byte: bits 0 and 1 the kind, bit 2 whether there is a colour, bits 4
/// to 7 the number of the return (1 to 15; 0 where it is unknown).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct State(u8);

impl State {
    const COLOR: u8 = 4;
    /// The largest number of a return that is kept; larger ones are kept as this one.
    pub const MAX_RETURN: u8 = 15;

    /// A state; `of_return` is 0 where unknown.
    pub fn new(kind: Kind, has_color: bool, of_return: u8) -> Self {
        let kind = match kind {
            Kind::Empty => 0,
            Kind::Measured => 1,
            Kind::NoReturn => 2,
        };
        Self(kind | if has_color { Self::COLOR } else { 0 } | of_return.min(Self::MAX_RETURN) << 4)
    }

    /// The byte.
    pub fn to_byte(self) -> u8 {
        self.0
    }

    /// From the byte; `None` for bits that no version wrote.
    pub fn from_byte(byte: u8) -> Option<Self> {
        (byte & 3 != 3 && byte & 8 == 0).then_some(Self(byte))
    }

    /// What the cell holds.
    pub fn kind(self) -> Kind {
        match self.0 & 3 {
            1 => Kind::Measured,
            2 => Kind::NoReturn,
            _ => Kind::Empty,
        }
    }

    /// Whether the sample has a colour.
    pub fn has_color(self) -> bool {
        self.0 & Self::COLOR != 0
    }

    /// The number of the return, from 1; 0 where unknown.
    pub fn return_number(self) -> u8 {
        self.0 >> 4
    }
}

/// One cell of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Where, in the coordinates of the station, metres.
    pub position: Vec3,
    /// Intensity as the file has it (0 to 1, or counts); NaN where it has none.
    pub intensity: f32,
    /// sRGB; black where there is none.
    pub color: [u8; 3],
    /// What it is.
    pub state: State,
}

impl Default for Sample {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Sample {
    /// A cell without anything.
    pub const EMPTY: Self = Self { position: Vec3::ZERO, intensity: f32::NAN, color: [0; 3], state: State(0) };

    /// A measured point without attributes.
    pub fn measured(position: Vec3) -> Self {
        Self { position, state: State::new(Kind::Measured, false, 0), ..Self::EMPTY }
    }

    /// Whether a point was measured here.
    pub fn is_measured(&self) -> bool {
        self.state.kind() == Kind::Measured
    }

    /// The same cell without a valid return, looking in the same direction.
    #[must_use]
    pub fn without_return(&self) -> Self {
        let position = self.position.try_normalize().unwrap_or(Vec3::ZERO);
        Self { position, state: State::new(Kind::NoReturn, false, 0), ..Self::EMPTY }
    }
}

/// The size of a grid, and the order in which its cells are numbered: line by line, and each line cell by cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Columns (the scanner's turns about its vertical axis).
    pub columns: u32,
    /// Rows in each (the turns of its mirror).
    pub rows: u32,
    /// Whether lines are rows instead of columns.
    pub by_rows: bool,
}

impl Grid {
    /// A grid whose lines are columns, as most scanners record it.
    pub fn by_columns(columns: u32, rows: u32) -> Self {
        Self { columns, rows, by_rows: false }
    }

    /// Cells in all.
    pub fn cells(self) -> u64 {
        u64::from(self.columns) * u64::from(self.rows)
    }

    /// Lines.
    pub fn lines(self) -> u32 {
        if self.by_rows { self.rows } else { self.columns }
    }

    /// Cells of each line.
    pub fn line_length(self) -> u32 {
        if self.by_rows { self.columns } else { self.rows }
    }

    /// The number of a cell.
    pub fn cell(self, column: u32, row: u32) -> u64 {
        let (line, at) = if self.by_rows { (row, column) } else { (column, row) };
        u64::from(line) * u64::from(self.line_length()) + u64::from(at)
    }
}

/// How the rays of a scan run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rays {
    /// All from the station's own origin, as those of a terrestrial scanner.
    Central,
    /// All parallel to this unit vector, away from the scanner, as in the range grids of a triangulation scanner.
    Parallel(DVec3),
}

impl Rays {
    /// The direction of the ray to a point, a unit vector; zero for a point at the station itself.
    pub fn direction(self, position: Vec3) -> DVec3 {
        match self {
            Self::Central => position.as_dvec3().normalize_or_zero(),
            Self::Parallel(direction) => direction,
        }
    }

    /// How far two rays are from each other at the nearer of two points, metres: range times angular step.
    pub fn spacing(self, a: Vec3, b: Vec3) -> f64 {
        let (a, b) = (a.as_dvec3(), b.as_dvec3());
        match self {
            Self::Central => {
                let (ra, rb) = (a.length(), b.length());
                let far = ra.max(rb);
                // |a × b| = ra · rb · sin(angle).
                if far > 0.0 { a.cross(b).length() / far } else { 0.0 }
            }
            Self::Parallel(direction) => {
                let d = b - a;
                (d - direction * d.dot(direction)).length()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_survives_its_byte_and_no_other_byte_is_a_state() {
        let mut known = std::collections::BTreeSet::new();
        for kind in [Kind::Empty, Kind::Measured, Kind::NoReturn] {
            for has_color in [false, true] {
                for number in 0..=State::MAX_RETURN {
                    let state = State::new(kind, has_color, number);
                    let back = State::from_byte(state.to_byte()).unwrap();
                    assert_eq!((back.kind(), back.has_color(), back.return_number()), (kind, has_color, number));
                    known.insert(state.to_byte());
                }
            }
        }
        for byte in 0..=255 {
            assert_eq!(State::from_byte(byte).is_some(), known.contains(&byte), "{byte}");
        }
        assert_eq!(State::new(Kind::Measured, false, 200).return_number(), State::MAX_RETURN);
    }

    #[test]
    fn spacing_is_range_times_angle_and_does_not_depend_on_depth() {
        let ray = |angle: f32, range: f32| Vec3::new(angle.cos(), angle.sin(), 0.0) * range;
        let near = Rays::Central.spacing(ray(0.0, 10.0), ray(0.001, 10.0));
        assert!((near - 0.01).abs() < 1e-6, "{near}");
        assert!((Rays::Central.spacing(ray(0.0, 10.0), ray(0.001, 50.0)) - near).abs() < 1e-6);
        let parallel = Rays::Parallel(DVec3::Z);
        assert!((parallel.spacing(Vec3::ZERO, Vec3::new(0.3, 0.4, 7.0)) - 0.5).abs() < 1e-7);
    }
}

//! The holes of a merged surface, and why they are there: no station saw the place, stations saw through it, or what they measured there formed no surface.

use super::Source;
use super::causes;
use super::cut::Station;
use super::rims::RimVertex;
use crate::ScanError;
use glam::DVec3;

/// Why there is no surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Every station that looked there was blocked, or none looked there.
    Unseen,
    /// A ray of a station passed through: an opening.
    Free,
    /// A station measured something there, but its triangles were dropped, or were too few.
    Dropped,
    /// Stations looked there and nothing came back.
    NoReturn,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Unseen, Self::Free, Self::Dropped, Self::NoReturn];

    /// A word for it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Unseen => "unseen",
            Self::Free => "free",
            Self::Dropped => "dropped",
            Self::NoReturn => "no_return",
        }
    }
}

/// A hole.
#[derive(Debug, Clone, PartialEq)]
pub struct Hole {
    /// Its rim, metres in the survey, the first point is not repeated; the surface is on its left, seen from outside.
    pub rim: Vec<DVec3>,
    /// The area that the rim encloses, as seen along its normal; square metres.
    pub area: f64,
    /// The length of the rim, metres.
    pub length: f64,
    /// The mean of the rim.
    pub center: DVec3,
    /// The area of each cause, in the order of [`Cause::ALL`]; square metres.
    pub causes: [f64; 4],
    /// What it was filled with, if it was filled.
    pub filled: Option<Source>,
    /// The number of its rim among the loops.
    pub(super) rim_number: usize,
    /// The cause at each of its [`Self::places`].
    pub flags: Vec<Cause>,
}

impl Hole {
    /// The unit normal of its surroundings.
    pub fn normal(&self) -> DVec3 {
        let sides = self.rim.iter().zip(self.rim.iter().cycle().skip(1));
        -sides.map(|(a, b)| (*a - self.center).cross(*b - self.center)).sum::<DVec3>().normalize_or_zero()
    }

    /// The points at which the cause was tested; each represents an equal share of the area.
    pub fn places(&self) -> Vec<DVec3> {
        causes::places(self)
    }

    /// The cause of the largest part.
    pub fn cause(&self) -> Cause {
        let largest = (0..4).rev().max_by(|a, b| self.causes[*a].total_cmp(&self.causes[*b]));
        Cause::ALL[largest.unwrap_or_default()]
    }
}

/// What surrounds the surface.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Borders {
    /// Holes, largest first.
    pub holes: Vec<Hole>,
    /// The number of rims that surround a part of the surface from outside.
    pub outlines: usize,
    /// Their total length, metres.
    pub outline_length: f64,
}

/// The holes among the loops of rims, and their causes. `margin`, metres, is how far beyond a position a ray must have gone to have passed through it.
pub(super) fn borders(
    loops: &[Vec<RimVertex>],
    stations: &[Station<'_>],
    margin: f64,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<Borders, ScanError> {
    let mut borders = Borders::default();
    for (rim_number, rim) in loops.iter().enumerate() {
        let (area, is_hole) = measured(rim);
        let mut rim: Vec<DVec3> = rim.iter().map(|vertex| vertex.position).collect();
        // Numbers of vertices depend on the bounds of the survey; where a list of places begins must not.
        let least = (0..rim.len()).min_by(|a, b| order(&rim[*a], &rim[*b])).unwrap_or_default();
        rim.rotate_left(least);
        let length = rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| a.distance(*b)).sum();
        if !is_hole {
            borders.outlines += 1;
            borders.outline_length += length;
            continue;
        }
        let center = rim.iter().sum::<DVec3>() / rim.len() as f64;
        borders.holes.push(Hole {
            rim,
            area,
            length,
            center,
            causes: [0.0; 4],
            flags: Vec::new(),
            filled: None,
            rim_number,
        });
    }
    borders.holes.sort_by(|a, b| b.area.total_cmp(&a.area));
    causes::find(&mut borders.holes, stations, margin, progress)?;
    Ok(borders)
}

fn order(a: &DVec3, b: &DVec3) -> std::cmp::Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

/// The area that a rim encloses, and whether the surface is around it: then the rim runs clockwise, seen from outside.
fn measured(rim: &[RimVertex]) -> (f64, bool) {
    let origin = rim[0].position;
    let sides = rim.iter().zip(rim.iter().cycle().skip(1));
    let area: DVec3 = sides.map(|(a, b)| (a.position - origin).cross(b.position - origin)).sum::<DVec3>() / 2.0;
    let normal: DVec3 = rim.iter().map(|vertex| vertex.normal).sum();
    (area.length(), area.dot(normal) < 0.0)
}

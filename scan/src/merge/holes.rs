//! The holes of a merged surface, and why they are there: no station saw the place, stations saw through it, or what they measured there formed no surface.

use super::cut::Station;
use super::rims::RimVertex;
use crate::ScanError;
use crate::mask::range_image;
use glam::DVec3;
use kilwa_scan_core::Rays;
use kilwa_scan_core::mask::through::Seen;

/// Test points per hole.
const PLACES: usize = 64;

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
    /// The cause at each of its [`Self::places`].
    pub flags: Vec<Cause>,
}

impl Hole {
    /// The unit normal of its surroundings.
    pub fn normal(&self) -> DVec3 {
        let sides = self.rim.iter().zip(self.rim.iter().cycle().skip(1));
        -sides.map(|(a, b)| (*a - self.center).cross(*b - self.center)).sum::<DVec3>().normalize_or_zero()
    }

    /// The places at which it was tested why the surface is missing; each stands for the same part of the area.
    pub fn places(&self) -> Vec<DVec3> {
        inner(self)
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

/// What the stations saw at a test point.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    through: bool,
    at: bool,
    no_return: bool,
}

impl Tally {
    fn cause(self) -> Cause {
        match self {
            Self { through: true, .. } => Cause::Free,
            Self { at: true, .. } => Cause::Dropped,
            Self { no_return: true, .. } => Cause::NoReturn,
            _ => Cause::Unseen,
        }
    }
}

/// The holes among the loops of rims, and their causes. `margin`, metres, is how much farther a ray must have gone to have passed through.
pub(super) fn borders(
    loops: Vec<Vec<RimVertex>>,
    stations: &[Station<'_>],
    margin: f64,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<Borders, ScanError> {
    let mut borders = Borders::default();
    for rim in loops {
        let (area, is_hole) = measured(&rim);
        let rim: Vec<DVec3> = rim.into_iter().map(|vertex| vertex.position).collect();
        let length = rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| a.distance(*b)).sum();
        if !is_hole {
            borders.outlines += 1;
            borders.outline_length += length;
            continue;
        }
        let center = rim.iter().sum::<DVec3>() / rim.len() as f64;
        borders.holes.push(Hole { rim, area, length, center, causes: [0.0; 4], flags: Vec::new() });
    }
    borders.holes.sort_by(|a, b| b.area.total_cmp(&a.area));
    let places: Vec<Vec<DVec3>> = borders.holes.iter().map(inner).collect();
    let mut tallies: Vec<Vec<Tally>> = places.iter().map(|places| vec![Tally::default(); places.len()]).collect();
    for (number, station) in stations.iter().enumerate() {
        progress(number as u64, stations.len() as u64)?;
        look(station, margin, &places, &mut tallies)?;
    }
    for (hole, tallies) in borders.holes.iter_mut().zip(tallies) {
        let share = hole.area / tallies.len().max(1) as f64;
        for tally in tallies {
            let cause = Cause::ALL.iter().position(|cause| *cause == tally.cause()).unwrap_or_default();
            hole.causes[cause] += share;
            hole.flags.push(tally.cause());
        }
    }
    Ok(borders)
}

/// Record what a station saw at every test point.
fn look(
    station: &Station<'_>,
    margin: f64,
    places: &[Vec<DVec3>],
    tallies: &mut [Vec<Tally>],
) -> Result<(), ScanError> {
    let mut reader = station.open_unmasked()?;
    if reader.header().rays != Rays::Central || reader.header().statistics.measured == 0 {
        return Ok(());
    }
    let image = range_image(&mut reader, &mut |_, _| Ok(()))?;
    let station_from_survey = station.pose.inverse();
    let [metres, radians] = station.sigma();
    for (place, tally) in places.iter().flatten().zip(tallies.iter_mut().flatten()) {
        let place = station_from_survey.apply(*place);
        match image.look(place, margin + 3.0 * (metres + radians * place.length())) {
            Seen::Through => tally.through = true,
            Seen::At => tally.at = true,
            Seen::NoReturn => tally.no_return = true,
            Seen::Hidden | Seen::Outside => {}
        }
    }
    Ok(())
}

/// The area that a rim encloses, and whether the surface is around it: then the rim runs clockwise, seen from outside.
fn measured(rim: &[RimVertex]) -> (f64, bool) {
    let origin = rim[0].position;
    let sides = rim.iter().zip(rim.iter().cycle().skip(1));
    let area: DVec3 = sides.map(|(a, b)| (a.position - origin).cross(b.position - origin)).sum::<DVec3>() / 2.0;
    let normal: DVec3 = rim.iter().map(|vertex| vertex.normal).sum();
    (area.length(), area.dot(normal) < 0.0)
}

/// Places spread over the triangles from the middle of a hole to its rim, by their area.
fn inner(hole: &Hole) -> Vec<DVec3> {
    let rim = &hole.rim;
    let corners = |k: usize| [hole.center, rim[k], rim[(k + 1) % rim.len()]];
    let mut sums = Vec::with_capacity(rim.len());
    let mut sum = 0.0;
    for k in 0..rim.len() {
        let [a, b, c] = corners(k);
        sum += (b - a).cross(c - a).length();
        sums.push(sum);
    }
    let count = PLACES.min(4 * rim.len());
    let place = |k: usize| {
        let wanted = (k as f64 + 0.5) / count as f64 * sum;
        let [a, b, c] = corners(sums.partition_point(|sum| *sum < wanted).min(rim.len() - 1));
        // A sequence that fills the unit square evenly (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
        let (u, v) = ((0.5 + k as f64 * 0.754_877_666).fract(), (0.5 + k as f64 * 0.569_840_291).fract());
        let root = u.sqrt();
        a + (b - a) * (root * (1.0 - v)) + (c - a) * (root * v)
    };
    (0..count).map(place).collect()
}

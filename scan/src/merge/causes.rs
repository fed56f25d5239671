//! Why the surface is missing in a hole: what the stations saw at places spread over it.

use super::cut::Station;
use super::holes::{Cause, Hole};
use crate::ScanError;
use crate::mask::range_image;
use glam::DVec3;
use kilwa_scan_core::mask::through::{RangeImage, Seen};
use kilwa_scan_core::{Pose, Rays};

/// Test places per hole.
const PLACES: usize = 64;

/// What the stations saw at a place.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    through: bool,
    at: bool,
    no_return: bool,
}

impl Tally {
    fn add(&mut self, seen: Seen) {
        match seen {
            Seen::Through => self.through = true,
            Seen::At => self.at = true,
            Seen::NoReturn => self.no_return = true,
            Seen::Hidden | Seen::Outside => {}
        }
    }

    fn cause(self) -> Cause {
        match self {
            Self { through: true, .. } => Cause::Free,
            Self { at: true, .. } => Cause::Dropped,
            Self { no_return: true, .. } => Cause::NoReturn,
            _ => Cause::Unseen,
        }
    }
}

/// Find the causes of holes. `margin`, metres, is how much farther a ray must have gone to have passed through.
pub(super) fn find(
    holes: &mut [Hole],
    stations: &[Station<'_>],
    margin: f64,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let lists: Vec<Vec<DVec3>> = holes.iter().map(places).collect();
    for (hole, tallies) in holes.iter_mut().zip(look(stations, margin, &lists, progress)?) {
        hole.flags = tallies.into_iter().map(Tally::cause).collect();
        let share = hole.area / hole.flags.len().max(1) as f64;
        for flag in &hole.flags {
            let cause = Cause::ALL.iter().position(|cause| cause == flag).unwrap_or_default();
            hole.causes[cause] += share;
        }
    }
    Ok(())
}

/// How many places of each list stations saw through.
pub(super) fn seen_through(
    stations: &[Station<'_>],
    margin: f64,
    lists: &[Vec<DVec3>],
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<Vec<usize>, ScanError> {
    let tallies = look(stations, margin, lists, progress)?;
    Ok(tallies.iter().map(|tallies| tallies.iter().filter(|tally| tally.through).count()).collect())
}

/// What the stations saw at each place of each list.
fn look(
    stations: &[Station<'_>],
    margin: f64,
    lists: &[Vec<DVec3>],
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<Vec<Vec<Tally>>, ScanError> {
    let mut tallies: Vec<Vec<Tally>> = lists.iter().map(|places| vec![Tally::default(); places.len()]).collect();
    for (number, station) in stations.iter().enumerate() {
        progress(number as u64, stations.len() as u64)?;
        let Some(view) = View::of(station, margin)? else { continue };
        for (place, tally) in lists.iter().flatten().zip(tallies.iter_mut().flatten()) {
            tally.add(view.look(*place));
        }
    }
    Ok(tallies)
}

/// What a station saw.
struct View {
    image: RangeImage,
    station_from_survey: Pose,
    /// Metres, and radians, which add to the margin in proportion to the distance.
    margin: [f64; 2],
}

impl View {
    /// `None` for stations whose rays are parallel or that measured nothing.
    fn of(station: &Station<'_>, margin: f64) -> Result<Option<Self>, ScanError> {
        let mut reader = station.open_unmasked()?;
        if reader.header().rays != Rays::Central || reader.header().statistics.measured == 0 {
            return Ok(None);
        }
        let image = range_image(&mut reader, &mut |_, _| Ok(()))?;
        let [metres, radians] = station.sigma();
        let margin = [margin + 3.0 * metres, 3.0 * radians];
        Ok(Some(Self { image, station_from_survey: station.pose.inverse(), margin }))
    }

    fn look(&self, position: DVec3) -> Seen {
        let position = self.station_from_survey.apply(position);
        self.image.look(position, self.margin[0] + self.margin[1] * position.length())
    }
}

/// Places spread over the triangles from the middle of a hole to its rim, by their area.
pub(super) fn places(hole: &Hole) -> Vec<DVec3> {
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

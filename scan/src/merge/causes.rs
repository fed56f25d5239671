//! Why the surface is missing in a hole: what each station saw along lines through the hole.
//!
//! The missing surface need not lie in the fan of triangles from the middle of a hole to its rim. So at each test point of the fan, a line along the normal of the
//! hole is followed from outside to inside, through space that rays passed through, to the first position that no ray passed through. If nothing was measured there,
//! it is unseen, and the surface may be there. If the line meets only measured surface farther away, or nothing at all, that part of the hole is an opening.

use super::cut::Station;
use super::holes::{Cause, Hole};
use crate::ScanError;
use crate::mask::range_image;
use glam::{DVec3, IVec3};
use kilwa_scan_core::mask::through::{RangeImage, Seen};
use kilwa_scan_core::{Pose, Rays};
use std::collections::{BTreeMap, HashMap};

/// Test places per hole.
const PLACES: usize = 64;
/// Largest number of positions on each side of a place.
const STEPS: usize = 6;

const THROUGH: u8 = 1;
const AT: u8 = 2;
const NO_RETURN: u8 = 4;
/// Something was measured nearby. Searched for only if positions are farther apart than the margin, because surface may then lie between them.
const NEAR: u8 = 8;

/// The places of a hole, and what the stations saw along their lines.
struct Lines {
    places: Vec<DVec3>,
    normal: DVec3,
    /// Positions on each side of a place, and the distance between them.
    steps: usize,
    step: f64,
    /// What was seen, for the positions of each place from outside to inside.
    seen: Vec<u8>,
}

impl Lines {
    fn new(hole: &Hole, margin: f64) -> Self {
        let places = places(hole);
        // Half the radius of a disc of that area, and at least a little beyond the margin.
        let reach = ((hole.area / std::f64::consts::PI).sqrt() / 2.0).max(1.5 * margin);
        let steps = ((reach / margin).ceil() as usize).clamp(1, STEPS);
        let seen = vec![0; places.len() * (2 * steps + 1)];
        Self { normal: hole.normal(), steps, step: reach / steps as f64, seen, places }
    }

    fn positions(&self) -> impl Iterator<Item = DVec3> {
        let along = move |k: usize| self.normal * (self.step * (self.steps as f64 - k as f64));
        self.places.iter().flat_map(move |place| (0..=2 * self.steps).map(move |k| *place + along(k)))
    }

    /// The cause at each place.
    fn causes(&self, margin: f64) -> Vec<Cause> {
        self.seen.chunks_exact(2 * self.steps + 1).map(|seen| self.cause(seen, margin)).collect()
    }

    fn cause(&self, seen: &[u8], margin: f64) -> Cause {
        let here = seen[self.steps];
        let is_free = |seen: u8| seen & THROUGH != 0;
        // Where nothing is known in front of the hole, the search begins in it.
        let start = if is_free(here) {
            self.steps
        } else {
            seen.iter().position(|seen| is_free(*seen)).map_or(self.steps, |k| k.min(self.steps))
        };
        let first = (start..seen.len()).find(|k| !is_free(seen[*k]));
        let Some(first) = first else { return Cause::Free };
        let off = self.step * first.abs_diff(self.steps) as f64;
        match seen[first] {
            seen if seen & AT != 0 && off <= margin => Cause::Dropped,
            seen if seen & (AT | NEAR) != 0 && is_free(here) => Cause::Free,
            seen if seen & (AT | NEAR) != 0 => plain(here),
            seen => plain(seen),
        }
    }
}

fn plain(seen: u8) -> Cause {
    match seen {
        seen if seen & THROUGH != 0 => Cause::Free,
        seen if seen & AT != 0 => Cause::Dropped,
        seen if seen & NO_RETURN != 0 => Cause::NoReturn,
        _ => Cause::Unseen,
    }
}

/// Find the causes of holes. `margin`, metres, is how far beyond a position a ray must have gone to have passed through it.
pub(super) fn find(
    holes: &mut [Hole],
    stations: &[Station<'_>],
    margin: f64,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let mut lines: Vec<Lines> = holes.iter().map(|hole| Lines::new(hole, margin)).collect();
    let spheres = Spheres::new(&lines, margin);
    for (number, station) in stations.iter().enumerate() {
        progress(number as u64, stations.len() as u64)?;
        look(station, margin, &mut lines)?;
        spheres.search(station, &mut lines)?;
    }
    for (hole, lines) in holes.iter_mut().zip(lines) {
        hole.flags = lines.causes(margin);
        let share = hole.area / hole.flags.len().max(1) as f64;
        for flag in &hole.flags {
            let cause = Cause::ALL.iter().position(|cause| cause == flag).unwrap_or_default();
            hole.causes[cause] += share;
        }
    }
    Ok(())
}

/// Record what a station saw along every line.
fn look(station: &Station<'_>, margin: f64, lines: &mut [Lines]) -> Result<(), ScanError> {
    let Some(view) = View::of(station, margin)? else { return Ok(()) };
    for lines in lines {
        let mut seen = std::mem::take(&mut lines.seen);
        for (position, seen) in lines.positions().zip(&mut seen) {
            *seen |= match view.look(position) {
                Seen::Through => THROUGH,
                Seen::At => AT,
                Seen::NoReturn => NO_RETURN,
                Seen::Hidden | Seen::Outside => 0,
            };
        }
        lines.seen = seen;
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
    let mut through: Vec<Vec<bool>> = lists.iter().map(|places| vec![false; places.len()]).collect();
    for (number, station) in stations.iter().enumerate() {
        progress(number as u64, stations.len() as u64)?;
        let Some(view) = View::of(station, margin)? else { continue };
        for (place, through) in lists.iter().flatten().zip(through.iter_mut().flatten()) {
            *through = *through || view.look(*place) == Seen::Through;
        }
    }
    Ok(through.iter().map(|through| through.iter().filter(|through| **through).count()).collect())
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

/// What is in each cell of a grid: the line, the position, its index among those of the line.
type Grid = HashMap<IVec3, Vec<(u32, u32, DVec3)>>;

/// Spheres around positions that are farther apart than the margin, by the cells of grids that they reach into.
struct Spheres {
    /// By the edges of their cells.
    grids: BTreeMap<u64, Grid>,
}

/// Radius of a sphere, in steps.
const RADIUS: f64 = 0.75;
/// Samples read at a time.
const BATCH: u64 = 1 << 16;

impl Spheres {
    fn new(lines: &[Lines], margin: f64) -> Self {
        let mut grids: BTreeMap<u64, Grid> = BTreeMap::new();
        for (number, lines) in lines.iter().enumerate().filter(|(_, lines)| lines.step > margin) {
            let radius = RADIUS * lines.step;
            // A sphere reaches into at most eight cells.
            let edge = (2.0 * radius).log2().ceil().exp2();
            let cells = grids.entry(edge.to_bits()).or_default();
            for (k, position) in lines.positions().enumerate() {
                let [low, high] = [position - radius, position + radius].map(|p| (p / edge).floor().as_ivec3());
                for z in low.z..=high.z {
                    for (x, y) in (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y))) {
                        cells.entry(IVec3::new(x, y, z)).or_default().push((number as u32, k as u32, position));
                    }
                }
            }
        }
        Self { grids }
    }

    /// Note the spheres in which a station measured something.
    fn search(&self, station: &Station<'_>, lines: &mut [Lines]) -> Result<(), ScanError> {
        if self.grids.is_empty() {
            return Ok(());
        }
        let mut reader = station.open()?;
        let (cells, mut at, mut batch) = (reader.header().grid.cells(), 0, Vec::new());
        while at < cells {
            let count = BATCH.min(cells - at);
            reader.read(at, count as usize, &mut batch)?;
            for sample in batch.iter().filter(|sample| sample.is_measured()) {
                let place = station.pose.apply(sample.position.as_dvec3());
                for (edge, grid) in &self.grids {
                    let cell = (place / f64::from_bits(*edge)).floor().as_ivec3();
                    for (number, k, position) in grid.get(&cell).into_iter().flatten() {
                        let lines = &mut lines[*number as usize];
                        if position.distance(place) <= RADIUS * lines.step {
                            lines.seen[*k as usize] |= NEAR;
                        }
                    }
                }
            }
            at += count;
        }
        Ok(())
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

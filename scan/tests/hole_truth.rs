//! Compares the causes of holes with the simulator's ground truth; shared by a test and the example `hole_flags`.

use glam::{DVec3, IVec3};
use kilwa_scan::merge::{Cause, Hole};
use kilwa_synth::scans::{Sight, SurfacePlace};
use std::collections::{HashMap, HashSet};

/// What is truly at a place where the merged surface has a hole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Truth {
    /// No station has a line of sight to the missing surface or, if no surface is missing, to the place.
    Unseen,
    /// There is no surface that is missing, and a station has a line of sight to the place: an opening.
    Free,
    /// A station has a line of sight to the missing surface, and its rays met it there.
    Visible,
    /// Stations have a line of sight to the missing surface, but none of their rays met it.
    BetweenRays,
}

/// All of them, in the order of the columns of [`Compared::areas`].
const TRUTHS: [Truth; 4] = [Truth::Unseen, Truth::Free, Truth::Visible, Truth::BetweenRays];

/// What the flags are compared with.
pub(crate) struct Oracle {
    pub(crate) sight: Sight,
    /// Columns of the survey's dense scans.
    pub(crate) columns: u32,
    pub(crate) voxel: f64,
    merged: HashSet<IVec3>,
}

impl Oracle {
    /// For a survey of the fort of a seed, as `kilwa synth scans` makes it.
    pub(crate) fn new(seed: u64, stations: u32, columns: u32, voxel: f64) -> Self {
        Self { sight: Sight::new(seed, stations), columns, voxel, merged: HashSet::new() }
    }

    fn cell(&self, place: DVec3) -> IVec3 {
        (place / self.voxel).floor().as_ivec3()
    }

    /// Add a vertex of the merged surface.
    pub(crate) fn merged(&mut self, place: DVec3) {
        let cell = self.cell(place);
        self.merged.insert(cell);
    }

    /// Whether the merged surface has vertices within one to two voxels.
    fn is_merged(&self, place: DVec3) -> bool {
        let cell = self.cell(place);
        (0..27).any(|k| self.merged.contains(&(cell + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1)))
    }

    fn truth(&self, hole: &Hole, place: DVec3) -> Truth {
        let normal = hole.normal();
        let missing = self.sight.surfaces_at(place, normal, reach(hole, self.voxel)).into_iter().find(|s| {
            // Near the rim, the nearest surface is that of the hole, whether its neighbourhood has been merged or not.
            s.position.distance(place) <= 2.0 * self.voxel || !self.is_merged(s.position)
        });
        match missing {
            Some(surface) if self.sight.is_sampled(&surface, self.columns, reach(hole, self.voxel)) => Truth::Visible,
            Some(surface) if self.sight.is_visible(&surface) => Truth::BetweenRays,
            None if self.sight.is_in_sight(place) => Truth::Free,
            _ => Truth::Unseen,
        }
    }
}

/// Areas in square metres: rows are the causes that the merge states, columns what is true.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Compared {
    pub(crate) areas: [[f64; 4]; 4],
    /// Even samples of the true surface that no station can see and that lie in holes: their number, and how many are flagged as unseen.
    pub(crate) hidden: [u64; 2],
    /// Samples of the surface that no station can see and that are in no hole.
    pub(crate) beyond: u64,
}

impl Compared {
    /// The share of the area flagged with a cause for which that is true; the first two causes only.
    pub(crate) fn precision(&self, k: usize) -> f64 {
        self.areas[k][k] / self.areas[k][..3].iter().sum::<f64>()
    }

    /// The share of the area for which a cause is true that is flagged so; the first two causes only.
    pub(crate) fn recall(&self, k: usize) -> f64 {
        self.areas[k][k] / self.areas.iter().map(|row| row[k]).sum::<f64>()
    }

    /// The recall of `unseen`, from samples of the true surface instead of places in holes.
    pub(crate) fn surface_recall(&self) -> f64 {
        self.hidden[1] as f64 / self.hidden[0] as f64
    }
}

/// How far from the plane of its rim the surface that is missing in a hole may be, metres: half the radius of a disc of its area, and at least three voxels.
fn reach(hole: &Hole, voxel: f64) -> f64 {
    ((hole.area / std::f64::consts::PI).sqrt() / 2.0).max(3.0 * voxel)
}

/// Compare the flags with the truth at about `count` places, spread evenly over the area of the holes.
pub(crate) fn compare(holes: &[Hole], oracle: &Oracle, count: usize) -> Compared {
    let mut compared = Compared::default();
    let step = holes.iter().map(|hole| hole.area).sum::<f64>() / count as f64;
    let mut sum = step / 2.0;
    for hole in holes {
        let share = hole.area / hole.flags.len() as f64;
        for (place, flag) in hole.places().into_iter().zip(&hole.flags) {
            sum += share;
            if sum < step {
                continue;
            }
            let weight = (sum / step).floor() * step;
            sum -= weight;
            let row = Cause::ALL.iter().position(|cause| cause == flag).unwrap();
            let truth = oracle.truth(hole, place);
            let column = TRUTHS.iter().position(|t| *t == truth).unwrap();
            compared.areas[row][column] += weight;
        }
    }
    compared
}

/// A place, the number of its hole, and its flag.
type Flagged = (DVec3, usize, Cause);

/// The places of holes by cells of a grid, in grids as coarse as the holes need.
struct Places<'h> {
    holes: &'h [Hole],
    voxel: f64,
    cells: HashMap<(u64, IVec3), Vec<Flagged>>,
    sizes: Vec<f64>,
}

impl<'h> Places<'h> {
    fn new(holes: &'h [Hole], voxel: f64) -> Self {
        let mut all = Self { holes, voxel, cells: HashMap::new(), sizes: Vec::new() };
        for (number, hole) in holes.iter().enumerate() {
            let size = reach(hole, voxel).hypot(spacing(hole)).log2().ceil().exp2();
            if !all.sizes.contains(&size) {
                all.sizes.push(size);
            }
            for (place, flag) in hole.places().into_iter().zip(&hole.flags) {
                let key = (size.to_bits(), (place / size).floor().as_ivec3());
                all.cells.entry(key).or_default().push((place, number, *flag));
            }
        }
        all
    }

    /// The flag at the nearest test point of the hole in which this surface is missing.
    fn flag(&self, surface: &SurfacePlace) -> Option<Cause> {
        let mut nearest: Option<(f64, Cause)> = None;
        for (size, k) in self.sizes.iter().flat_map(|size| (0..27).map(move |k| (*size, k))) {
            let at = (surface.position / size).floor().as_ivec3() + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1;
            for (place, number, flag) in self.cells.get(&(size.to_bits(), at)).into_iter().flatten() {
                let hole = &self.holes[*number];
                let (offset, normal) = (surface.position - place, hole.normal());
                let along = offset.dot(normal);
                let is_in = along.abs() <= reach(hole, self.voxel)
                    && (offset - normal * along).length() <= spacing(hole)
                    && surface.normal.dot(normal) > 0.0;
                if is_in && nearest.is_none_or(|(best, _)| offset.length() < best) {
                    nearest = Some((offset.length(), *flag));
                }
            }
        }
        nearest.map(|(_, flag)| flag)
    }
}

/// Compare the flags with the points where `lines` random lines through a box cross the true surface.
pub(crate) fn sample(compared: &mut Compared, holes: &[Hole], oracle: &Oracle, [low, high]: [DVec3; 2], lines: u32) {
    let places = Places::new(holes, oracle.voxel);
    let mut random = fastrand::Rng::with_seed(1);
    let (center, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
    for _ in 0..lines {
        let mut on_sphere = || {
            let (z, turn) = (2.0 * random.f64() - 1.0, std::f64::consts::TAU * random.f64());
            let flat = (1.0 - z * z).sqrt();
            DVec3::new(flat * turn.cos(), flat * turn.sin(), z)
        };
        // Two random points of a sphere: a line that is random in position and direction.
        let [from, to] = [on_sphere(), on_sphere()].map(|d| center + d * radius);
        for surface in oracle.sight.crossings(from, to) {
            let p = surface.position;
            if p.cmplt(low).any() || p.cmpgt(high).any() || oracle.sight.is_visible(&surface) {
                continue;
            }
            match places.flag(&surface) {
                None => compared.beyond += 1,
                Some(flag) => {
                    compared.hidden[0] += 1;
                    compared.hidden[1] += u64::from(flag == Cause::Unseen);
                }
            }
        }
    }
}

/// The approximate distance between the test points of a hole.
fn spacing(hole: &Hole) -> f64 {
    (hole.area / hole.flags.len() as f64).sqrt()
}

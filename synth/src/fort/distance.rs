//! The masonry of the fort as a field that rays can be traced against: a bound of the distance to its surface that never changes faster
//! than the place does (1-Lipschitz), evaluated near the surface only, and a grid that says how far away that is elsewhere.
//!
//! It has the solids of [`Plan`], the ruined tops of [`standing`] and the relief of [`gentle`], and things that the mesh lacks: a thin
//! partition and thin screens. A term that changes faster than the place is divided by its slope, which leaves its zero surface where it was
//! (Hart, "Sphere tracing", The Visual Computer 12, 1996).

use super::ground::{broad, standing};
use super::masonry::{GENTLE_OUT, GENTLE_SLOPE, gentle};
use super::plan::Plan;
use super::solid::Solid;
use crate::noise::lerp;
use glam::{DVec3, IVec3};
use rayon::prelude::*;

/// Half the side of the box that holds all masonry, and its bottom and top, in metres, in the fort's frame.
const HALF: f64 = 20.0;
const BOTTOM: f64 = -5.0;
const TOP: f64 = 13.0;
/// Side of a cell of the grid of free space, in metres.
const CELL: f64 = 0.25;
/// Cells along the sides of the box.
const CELLS: IVec3 = IVec3::new(160, 160, 72);
/// Cells along the side of a region that has a list of its solids.
const REGION: i32 = 4;
/// How far beyond a region its list reaches, in metres; no step is longer where lists count.
const MARGIN: f64 = 0.45;
const MAX_STEP: f64 = 0.3;
/// Slope of the solids; steeper ones are divided down to it.
const SOLID_SLOPE: f64 = 1.07;
/// Points per metre of the grid of ruined tops.
const TOPS_PER_METRE: f64 = 8.0;
/// How fast the field grows above a ruined top in the mesh (see `Field::masonry`).
const CUT: f64 = 0.6;
/// Beyond everything.
const FAR: f64 = 1e3;
/// A place is on the surface if the field is within this of zero, in metres.
const ON: f64 = 5e-5;
/// No beam is thicker; free cells are at least so far from the surface.
const MAX_BEAM: f64 = 0.04;

/// The solids that matter in a region.
#[derive(Default)]
struct Near {
    walls: Vec<Solid>,
    openings: Vec<Solid>,
    fittings: Vec<(Solid, f64)>,
    shafts: Vec<Solid>,
    boards: Vec<Solid>,
}

/// The fort's masonry.
pub(super) struct Masonry {
    seed: u64,
    regions: Vec<Near>,
    /// See [`Masonry::free_space`].
    free: Vec<u8>,
    tops: Tops,
}

/// Where a ray, or the beam around it, first meets the masonry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Met {
    /// The surface, at this distance along the ray.
    Surface(f64),
    /// The beam or the hull ends here.
    Close(f64),
    /// Nothing.
    Nothing,
}

/// How far a ray is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Until {
    /// To the surface.
    Surface,
    /// To where the surface is closer to the axis of a beam than twice its radius; the whole cross-section is free up to there.
    Beam(Beam),
    /// Into the smooth hull of the relief, which needs no noise: good enough for shadows.
    Smooth,
}

impl Masonry {
    /// The masonry of a seed (already derived for the fort).
    pub(super) fn new(seed: u64) -> Self {
        let plan = Plan::new(&|x, y| broad(seed, x, y));
        let boards = Plan::boards();
        let fittings: Vec<Solid> = plan.fittings.iter().copied().chain([Plan::lining()]).collect();
        let tops = Tops::new(seed);
        let size = CELLS / REGION;
        let count = (size.x * size.y * size.z) as usize;
        let side = CELL * f64::from(REGION);
        let reach = side * 0.5 * 3.0_f64.sqrt();
        let regions: Vec<Near> = (0..count)
            .into_par_iter()
            .map(|k| {
                let k = k as i32;
                let at = IVec3::new(k / (size.y * size.z), k / size.z % size.y, k % size.z);
                let middle = (at.as_dvec3() + 0.5) * side + DVec3::new(-HALF, -HALF, BOTTOM);
                let close = |solid: &&Solid| solid.distance(middle) < (reach + MARGIN) * solid.slope();
                let list = |solids: &[Solid]| -> Vec<Solid> { solids.iter().filter(close).copied().collect() };
                let scaled = |s: Solid| (s, (SOLID_SLOPE / s.slope()).min(1.0));
                Near {
                    walls: list(&plan.walls),
                    openings: list(&plan.openings),
                    fittings: list(&fittings).into_iter().map(scaled).collect(),
                    shafts: list(&plan.shafts),
                    boards: list(&boards),
                }
            })
            .collect();
        let mut masonry = Self { seed, regions, free: Vec::new(), tops };
        masonry.free = masonry.free_space();
        masonry
    }

    /// The distances at a place without relief.
    fn parts(&self, near: &Near, p: DVec3) -> Parts {
        Parts {
            whole: nearest(&near.walls, p).max(-nearest(&near.openings, p)),
            cut: (p.z - self.tops.at(p.x, p.y)) * self.tops.scale,
            fittings: near.fittings.iter().fold(FAR, |d, (s, scale)| d.min(s.far_distance(p) * scale)),
            shafts: -nearest(&near.shafts, p),
            boards: nearest(&near.boards, p),
        }
    }

    /// A lower bound of the distance to the surface (negative inside), and, where the surface is near, the field that the bound is made of:
    /// it has the same sign and is about the distance on sound walls.
    fn bound(&self, near: &Near, p: DVec3) -> (f64, Option<f64>) {
        let parts = self.parts(near, p);
        let outer = parts.outer(self.tops.scale);
        if !(-0.4..=0.05).contains(&outer) {
            let bound = outer.min(parts.boards);
            return (bound, (bound < 0.05).then_some(bound));
        }
        let value = parts.with(gentle(self.seed, p), self.tops.scale);
        let fine = value / (SOLID_SLOPE + GENTLE_SLOPE);
        (fine.max(outer).min(parts.boards), Some(value.min(parts.boards)))
    }

    fn near(&self, cell: IVec3) -> &Near {
        let (at, size) = (cell / REGION, CELLS / REGION);
        &self.regions[((at.x * size.y + at.y) * size.z + at.z) as usize]
    }

    /// The field at a place: its sign is that of the distance, its zero surface is the masonry's.
    pub(super) fn value(&self, p: DVec3) -> f64 {
        let (bound, value) = self.bound(self.near(clamped(p)), p);
        value.unwrap_or(bound)
    }

    /// The field without relief, undivided.
    pub(super) fn smooth_value(&self, p: DVec3) -> f64 {
        self.parts(self.near(clamped(p)), p).with(0.0, self.tops.scale)
    }

    /// A lower bound of the distance from a place to the masonry, at most 0.3 m; negative inside.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        self.bound(self.near(clamped(p)), p).0.min(MAX_STEP)
    }

    /// The bound without short cuts.
    #[cfg(test)]
    pub(super) fn exact_bound(&self, p: DVec3) -> f64 {
        let parts = self.parts(self.near(clamped(p)), p);
        let fine = parts.with(gentle(self.seed, p), self.tops.scale) / (SOLID_SLOPE + GENTLE_SLOPE);
        fine.max(parts.outer(self.tops.scale)).min(parts.boards).min(MAX_STEP)
    }

    /// Whether the surface is certainly outside a ball.
    pub(super) fn misses(&self, middle: DVec3, radius: f64) -> bool {
        (f64::from(self.free[index(clamped(middle))]) - 1.0) * CELL >= radius
    }

    /// For each cell the Chebyshev distance to the nearest cell that holds or nearly touches the surface.
    fn free_space(&self) -> Vec<u8> {
        let diagonal = CELL * 3.0_f64.sqrt();
        let touching = diagonal / 2.0 + MAX_BEAM;
        let outer = |cell: IVec3, middle: DVec3| {
            let parts = self.parts(self.near(cell), middle);
            parts.outer(self.tops.scale).min(parts.boards)
        };
        let place = |cells: DVec3| cells * CELL + DVec3::new(-HALF, -HALF, BOTTOM);
        // A region whose middle is far from everything is free.
        let half = REGION / 2;
        let spare = diagonal * f64::from(half);
        let size = CELLS / REGION;
        let regions: Vec<bool> = (0..size.x * size.y * size.z)
            .into_par_iter()
            .map(|k| {
                let first = IVec3::new(k / (size.y * size.z), k / size.z % size.y, k % size.z) * REGION;
                outer(first, place((first + half).as_dvec3())) > touching + spare
            })
            .collect();
        let mut free: Vec<u8> = (0..CELLS.x * CELLS.y)
            .into_par_iter()
            .flat_map_iter(|column| {
                let regions = &regions;
                (0..CELLS.z).map(move |z| {
                    let cell = IVec3::new(column / CELLS.y, column % CELLS.y, z);
                    let at = cell / REGION;
                    let is_free = regions[((at.x * size.y + at.y) * size.z + at.z) as usize]
                        || outer(cell, place(cell.as_dvec3() + 0.5)) > touching;
                    if is_free { u8::MAX } else { 0 }
                })
            })
            .collect();
        chebyshev(&mut free);
        free
    }

    /// Follow a ray (origin, unit direction) from one distance to another.
    pub(super) fn meet(&self, o: DVec3, d: DVec3, from: f64, to: f64, until: Until) -> Met {
        let inverse = d.recip();
        let Some((mut t, end)) = clip(o, inverse, from, to) else { return Met::Nothing };
        let mut last: Option<(f64, f64)> = None;
        let mut steps = 0_u32;
        while t < end {
            steps += 1;
            let p = o + d * t;
            let cell = clamped(p);
            let free = self.free[index(cell)];
            if free > 0 {
                t = leave(cell, i32::from(free), o, inverse).max(t) + 1e-5;
                last = None;
                continue;
            }
            // Grazing rays would need thousands of tiny steps.
            let shortest = 5e-5 + 6e-6 * f64::from(steps);
            if until == Until::Smooth {
                let parts = self.parts(self.near(cell), p);
                let bound = parts.outer(self.tops.scale).min(parts.boards);
                if bound < 0.0 {
                    return Met::Close(t);
                }
                t += bound.clamp(0.01, MAX_STEP);
                continue;
            }
            let (bound, value) = self.bound(self.near(cell), p);
            if let Until::Beam(beam) = until {
                let radius = beam.radius(t);
                if bound < 2.0 * radius {
                    return Met::Close(t);
                }
                t += (bound - radius).min(MAX_STEP);
                continue;
            }
            let mut step = bound.min(MAX_STEP).max(shortest);
            if let Some(value) = value {
                if value < ON {
                    return Met::Surface(self.root(o, d, last, (t, value)));
                }
                // Close to the surface it is nearly flat: go where the last two values point.
                if let Some((before, higher)) = last
                    && value < 0.004
                {
                    let slope = (higher - value) / (t - before);
                    if slope > 0.1 {
                        step = step.max(value / slope + 1e-5);
                    }
                }
                last = Some((t, value));
            }
            t += step;
        }
        Met::Nothing
    }

    /// Where the field is zero between a place outside and one behind it: the Illinois method, and halving where the field jumps (risers of
    /// stairs).
    fn root(&self, o: DVec3, d: DVec3, outside: Option<(f64, f64)>, (t, value): (f64, f64)) -> f64 {
        let Some((mut a, mut va)) = outside else { return t };
        let (mut b, mut vb) = (t, value);
        if value > -ON {
            return t;
        }
        for round in 0..40 {
            let t = if round % 4 == 3 { f64::midpoint(a, b) } else { (a * vb - b * va) / (vb - va) };
            let value = self.value(o + d * t);
            if value.abs() < ON || b - a < 1e-7 {
                return t;
            }
            if value < 0.0 {
                (b, vb, va) = (t, value, va * 0.5);
            } else {
                (a, va, vb) = (t, value, vb * 0.5);
            }
        }
        b
    }
}

/// A beam of light round a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Beam {
    /// Radius at the instrument, in metres.
    pub(crate) exit: f64,
    /// Growth of the radius per metre.
    pub(crate) spread: f64,
}

impl Beam {
    /// Radius at a distance.
    pub(crate) fn radius(self, t: f64) -> f64 {
        (self.exit + self.spread * t).min(MAX_BEAM)
    }
}

/// Distances at a place without relief.
struct Parts {
    /// To the walls as they were built.
    whole: f64,
    /// To the ruined tops, above them, divided down to the slope of the solids.
    cut: f64,
    fittings: f64,
    /// Out of the shafts.
    shafts: f64,
    boards: f64,
}

impl Parts {
    /// The field with a relief.
    fn with(&self, relief: f64, scale: f64) -> f64 {
        let walls = (self.whole - relief).max(self.cut - relief * (scale / CUT));
        walls.min(self.fittings - relief).max(self.shafts)
    }

    /// A bound that no relief exceeds.
    fn outer(&self, scale: f64) -> f64 {
        self.with(GENTLE_OUT, scale) / SOLID_SLOPE
    }
}

/// Heights at which ruined masonry ends, on a grid.
struct Tops {
    heights: Vec<f32>,
    /// What a height above them is multiplied by, so that it grows no faster than a distance.
    scale: f64,
}

const TOPS: usize = (2.0 * HALF * TOPS_PER_METRE) as usize + 1;

impl Tops {
    fn new(seed: u64) -> Self {
        let place = |k: usize| k as f64 / TOPS_PER_METRE - HALF;
        let heights: Vec<f32> = (0..TOPS * TOPS)
            .into_par_iter()
            .map(|k| standing(seed, place(k / TOPS), place(k % TOPS)).max(0.2) as f32)
            .collect();
        let at = |x: usize, y: usize| f64::from(heights[x * TOPS + y]);
        let mut steepest = 0.0_f64;
        for x in 0..TOPS - 1 {
            for y in 0..TOPS - 1 {
                let along = (at(x + 1, y) - at(x, y)).abs().max((at(x + 1, y + 1) - at(x, y + 1)).abs());
                let across = (at(x, y + 1) - at(x, y)).abs().max((at(x + 1, y + 1) - at(x + 1, y)).abs());
                steepest = steepest.max(along * along + across * across);
            }
        }
        let slope = steepest.sqrt() * TOPS_PER_METRE;
        Self { heights, scale: (SOLID_SLOPE / (1.0 + slope * slope).sqrt()).min(CUT) }
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let last = (TOPS - 1) as f64;
        let (u, v) = ((x + HALF) * TOPS_PER_METRE, (y + HALF) * TOPS_PER_METRE);
        let (u, v) = (u.clamp(0.0, last), v.clamp(0.0, last));
        let (i, j) = ((u as usize).min(TOPS - 2), (v as usize).min(TOPS - 2));
        let (fu, fv) = (u - i as f64, v - j as f64);
        let h = |i: usize, j: usize| f64::from(self.heights[i * TOPS + j]);
        lerp(lerp(h(i, j), h(i + 1, j), fu), lerp(h(i, j + 1), h(i + 1, j + 1), fu), fv)
    }
}

/// Distance to the nearest of some solids.
fn nearest(solids: &[Solid], p: DVec3) -> f64 {
    solids.iter().fold(FAR, |d, s| d.min(s.distance(p)))
}

/// The cell of a place in the box; of one outside, the nearest.
fn clamped(p: DVec3) -> IVec3 {
    // Rounded towards zero: a place just below the box is clamped anyway.
    ((p - DVec3::new(-HALF, -HALF, BOTTOM)) / CELL).as_ivec3().clamp(IVec3::ZERO, CELLS - 1)
}

fn index(cell: IVec3) -> usize {
    ((cell.x * CELLS.y + cell.y) * CELLS.z + cell.z) as usize
}

/// Where a ray is in the box: from and to.
fn clip(o: DVec3, inverse: DVec3, from: f64, to: f64) -> Option<(f64, f64)> {
    let a = (DVec3::new(-HALF, -HALF, BOTTOM) - o) * inverse;
    let b = (DVec3::new(HALF, HALF, TOP) - o) * inverse;
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    let (t, end) = (from.max(near), to.min(far));
    (t < end).then_some((t, end))
}

/// Where a ray leaves the cube of free cells around a cell.
fn leave(cell: IVec3, free: i32, o: DVec3, inverse: DVec3) -> f64 {
    let low = (cell - (free - 1)).as_dvec3() * CELL + DVec3::new(-HALF, -HALF, BOTTOM);
    let high = (cell + free).as_dvec3() * CELL + DVec3::new(-HALF, -HALF, BOTTOM);
    // The inverse of a zero has the sign of the zero.
    let side = |k: usize| if inverse[k] > 0.0 { high[k] } else { low[k] };
    let exit = (DVec3::new(side(0), side(1), side(2)) - o) * inverse;
    exit.min_element()
}

/// From 0 and 255, the Chebyshev distance of each cell to the nearest 0 (two passes over half of the neighbours each).
fn chebyshev(free: &mut [u8]) {
    let all = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| IVec3::new(x, y, z))));
    let before: Vec<IVec3> = all.filter(|n| (n.x, n.y, n.z) < (0, 0, 0)).collect();
    let mut pass = |cells: &mut dyn Iterator<Item = i32>, sign: i32| {
        for k in cells {
            let cell = IVec3::new(k / (CELLS.y * CELLS.z), k / CELLS.z % CELLS.y, k % CELLS.z);
            let mut least = free[k as usize];
            for n in &before {
                let next = cell + *n * sign;
                if next.cmpge(IVec3::ZERO).all() && next.cmplt(CELLS).all() {
                    least = least.min(free[index(next)].saturating_add(1));
                }
            }
            free[k as usize] = least;
        }
    };
    let count = CELLS.x * CELLS.y * CELLS.z;
    pass(&mut (0..count), 1);
    pass(&mut (0..count).rev(), -1);
}

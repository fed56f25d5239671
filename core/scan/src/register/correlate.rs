//! Candidate relative poses of two levelled stations, found by correlating maps of their walls, seen from above.
//!
//! Scanners are levelled, so a relative pose has four unknowns: heading, x, y and height. Each station is turned into a map of its walls, whose cells hold
//! the sum of the horizontal normals as complex numbers. The map of one station, rotated in steps through all headings, is correlated with that of the other by fast Fourier
//! transforms. Walls match only if their normals do, so the two sides of a wall are distinguished; walls of one station in the free space of the other count
//! against a candidate. The result is not a single pose but all plausible ones, so that unique and ambiguous poses can be distinguished.

use super::surfels::Surfel;
use crate::Pose;
use glam::{DVec2, DVec3};
use rustc_hash::FxHashMap;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlannerScalar};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Number of headings that are tried.
const HEADINGS: usize = 120;
/// Walls have normals with at most this absolute vertical component, floors and vaults with at least that.
const WALL_MAX: f64 = 0.4;
const FLAT_MIN: f64 = 0.8;
/// Tangent of the maximum elevation at which a wall counts as level with the scanner.
const LEVEL: f64 = 0.04;
/// Scanners whose heights differ by more than this do not see the same walls at scanner height, metres.
const STOREY: f64 = 1.0;
/// Number of candidates per heading.
const PER_HEADING: usize = 8;
/// The weight of walls in free space relative to matching walls.
const AGAINST: f64 = 1.0;
/// Candidates less than this many cells and at most this many heading steps apart are the same.
const SAME_CELLS: f64 = 2.0;
const SAME_HEADINGS: usize = 2;

/// The horizontal range of view of a scanner.
#[derive(Debug, Clone)]
struct Look {
    at: DVec2,
    heading: f64,
    /// In equal steps of azimuth from -π, metres; infinite where there was no return.
    horizon: Vec<f32>,
}

/// The walls and floors of a station, or of several stations with known relative poses.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    /// Position, horizontal normal and area.
    walls: Vec<(DVec3, DVec2, f64)>,
    /// Floors and vaults: position, and whether the surface faces up.
    flats: Vec<(DVec3, bool)>,
    /// Walls at the height of the scanner: position and length.
    level: Vec<(DVec3, f64)>,
    looks: Vec<Look>,
}

impl Plan {
    /// From the planes of a station and its horizontal range of view, in equal steps of azimuth from -π (metres; infinite where there was no return; empty if unknown).
    pub fn new(surfels: &[Surfel], horizon: Vec<f32>) -> Self {
        let mut plan = Self::default();
        for s in surfels {
            if s.normal.z.abs() <= WALL_MAX {
                plan.walls.push((s.position, s.normal.truncate().normalize_or_zero(), s.edge * s.edge));
                if s.position.z.abs() <= LEVEL * s.position.truncate().length() + 0.5 * s.edge {
                    plan.level.push((s.position, s.edge));
                }
            } else if s.normal.z.abs() >= FLAT_MIN {
                plan.flats.push((s.position, s.normal.z > 0.0));
            }
        }
        if !horizon.is_empty() {
            plan.looks.push(Look { at: DVec2::ZERO, heading: 0.0, horizon });
        }
        plan
    }

    /// From several stations, in their common frame.
    pub fn joined(parts: &[(&Self, Pose)]) -> Self {
        let mut heights: Vec<f64> = parts.iter().map(|(_, pose)| pose.translation.z).collect();
        heights.sort_unstable_by(f64::total_cmp);
        let usual = heights.get(heights.len() / 2).copied().unwrap_or(0.0);
        let mut out = Self::default();
        for (part, pose) in parts {
            let turned = |n: DVec2| (pose.rotation * n.extend(0.0)).truncate().normalize_or_zero();
            out.walls.extend(part.walls.iter().map(|(p, n, area)| (pose.apply(*p), turned(*n), *area)));
            out.flats.extend(part.flats.iter().map(|(p, up)| (pose.apply(*p), *up)));
            // A scanner on a tower sees over walls.
            if (pose.translation.z - usual).abs() > STOREY {
                continue;
            }
            out.level.extend(part.level.iter().map(|(p, length)| (pose.apply(*p), *length)));
            out.looks.extend(part.looks.iter().map(|look| Look {
                at: pose.apply(look.at.extend(0.0)).truncate(),
                heading: look.heading + turned(DVec2::X).to_angle(),
                horizon: look.horizon.clone(),
            }));
        }
        out
    }

    /// The horizontal distance that contains nine tenths of the wall area; 0 without walls.
    pub fn reach(&self) -> f64 {
        let mut walls: Vec<(f64, f64)> = self.walls.iter().map(|(p, _, area)| (p.truncate().length(), *area)).collect();
        walls.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let wanted = 0.9 * walls.iter().map(|(_, area)| area).sum::<f64>();
        let mut sum = 0.0;
        let found = walls.iter().find(|(_, area)| {
            sum += area;
            sum >= wanted
        });
        found.map_or(0.0, |(distance, _)| *distance)
    }

    /// The height differences at which most floors and vaults of `other`, turned and moved, coincide with those of this station; best first, at most `keep`.
    pub fn heights(&self, other: &Self, place: &Place, cell: f64, keep: usize) -> Vec<f64> {
        let step = 0.25 * cell;
        let key = |p: DVec2, up: bool| ((p / cell).floor().as_ivec2().to_array(), up);
        let mut own: FxHashMap<([i32; 2], bool), Vec<f64>> = FxHashMap::default();
        for (p, up) in &self.flats {
            own.entry(key(p.truncate(), *up)).or_default().push(p.z);
        }
        let mut votes: FxHashMap<i32, f64> = FxHashMap::default();
        let turn = DVec2::from_angle(place.heading);
        for (p, up) in &other.flats {
            let at = turn.rotate(p.truncate()) + place.offset;
            let Some(heights) = own.get(&key(at, *up)) else { continue };
            let share = 1.0 / heights.len() as f64;
            for z in heights {
                *votes.entry(((z - p.z) / step).round() as i32).or_default() += share;
            }
        }
        let smoothed = |k: i32| {
            let at = |k: i32| votes.get(&k).copied().unwrap_or(0.0);
            at(k) + 0.5 * (at(k - 1) + at(k + 1))
        };
        let mut ranked: Vec<(f64, i32)> = votes.keys().map(|k| (smoothed(*k), *k)).collect();
        ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut out: Vec<i32> = Vec::new();
        for (_, k) in ranked {
            if out.len() == keep {
                break;
            }
            if out.iter().all(|other| (other - k).abs() > 2) {
                out.push(k);
            }
        }
        out.into_iter().map(|k| f64::from(k) * step).collect()
    }
}

/// A candidate pose of a station in the plan of another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Radians, counter-clockwise.
    pub heading: f64,
    /// Metres.
    pub offset: DVec2,
    /// Correlation of the walls, at most 1, minus the penalty for walls in free space.
    pub score: f64,
}

/// The Fourier transform of a map.
#[derive(Debug, Clone)]
pub struct Spectrum {
    walls: Vec<Complex32>,
    energy: f64,
    /// Walls at the height of the scanner as real parts, free cells as imaginary parts; conjugated for a turned map.
    level: Vec<Complex32>,
    /// The sum of the real parts.
    mass: f64,
}

/// Correlates maps with a common cell size.
pub struct Correlator {
    /// Cells along a side of a map.
    side: usize,
    cell: f64,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

impl Correlator {
    /// For stations that see walls up to `reach` metres away (walls farther away are left out), in maps with this many cells along each side.
    pub fn new(reach: f64, side: usize) -> Self {
        let mut planner = FftPlannerScalar::new();
        // A map has room for both stations side by side.
        let cell = 4.0 * reach / side as f64;
        Self { side, cell, forward: planner.plan_fft_forward(side), inverse: planner.plan_fft_inverse(side) }
    }

    /// The edge of a cell, metres.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// A map turned by a heading.
    fn spectrum(&self, plan: &Plan, heading: f64, is_turned: bool) -> Spectrum {
        let turn = DVec2::from_angle(heading);
        let mut walls = vec![Complex32::default(); self.side * self.side];
        for (p, n, area) in &plan.walls {
            let n = turn.rotate(*n) * *area;
            self.spread(turn.rotate(p.truncate()), Complex32::new(n.x as f32, n.y as f32), &mut walls);
        }
        // The square root keeps high walls from outweighing many low ones.
        for v in &mut walls {
            let size = v.norm();
            if size > 0.0 {
                *v /= size.sqrt();
            }
        }
        let energy = walls.iter().map(|v| f64::from(v.norm_sqr())).sum();
        self.transform(&mut walls, &self.forward);
        let mut level = vec![Complex32::default(); self.side * self.side];
        for (p, length) in &plan.level {
            self.spread(turn.rotate(p.truncate()), Complex32::new(*length as f32, 0.0), &mut level);
        }
        for v in &mut level {
            v.re = v.re.min(self.cell as f32);
        }
        let mass = level.iter().map(|v| f64::from(v.re)).sum();
        self.mark_free(plan, heading, &mut level);
        if is_turned {
            for v in &mut level {
                *v = v.conj();
            }
        }
        self.transform(&mut level, &self.forward);
        Spectrum { walls, energy, level, mass }
    }

    /// Distribute a value among the four cells around a position, if that is within reach.
    fn spread(&self, place: DVec2, value: Complex32, map: &mut [Complex32]) {
        if place.length() > self.cell * self.side as f64 / 4.0 {
            return;
        }
        let at = place / self.cell;
        let (low, part) = (at.floor(), at - at.floor());
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let share = (if dx == 1 { part.x } else { 1.0 - part.x }) * (if dy == 1 { part.y } else { 1.0 - part.y });
            map[self.wrap(low.y as i64 + dy) * self.side + self.wrap(low.x as i64 + dx)] += value * share as f32;
        }
    }

    /// Mark free cells, which scanners looked through, as imaginary parts.
    fn mark_free(&self, plan: &Plan, heading: f64, map: &mut [Complex32]) {
        let half = self.side as i64 / 4;
        let turn = DVec2::from_angle(-heading);
        for y in -half..half {
            for x in -half..half {
                let p = turn.rotate(DVec2::new(x as f64, y as f64) * self.cell);
                let is_free = plan.looks.iter().any(|look| {
                    let d = p - look.at;
                    let azimuth = (libm::atan2(d.y, d.x) - look.heading + TAU / 2.0).rem_euclid(TAU) / TAU;
                    let k = ((azimuth * look.horizon.len() as f64) as usize).min(look.horizon.len() - 1);
                    d.length() + 1.5 * self.cell < f64::from(look.horizon[k])
                });
                if is_free {
                    map[self.wrap(y) * self.side + self.wrap(x)].im = 1.0;
                }
            }
        }
    }

    fn wrap(&self, cell: i64) -> usize {
        cell.rem_euclid(self.side as i64) as usize
    }

    /// The transform of the unrotated map.
    pub fn upright(&self, plan: &Plan) -> Spectrum {
        self.spectrum(plan, 0.0, false)
    }

    /// The transforms of the map rotated to each heading.
    pub fn turned(&self, plan: &Plan) -> Vec<Spectrum> {
        (0..HEADINGS).map(|k| self.spectrum(plan, TAU * k as f64 / HEADINGS as f64, true)).collect()
    }

    /// Transform the rows, then the columns; each pass ends with a transposition.
    fn transform(&self, map: &mut [Complex32], fft: &Arc<dyn Fft<f32>>) {
        let mut scratch = vec![Complex32::default(); fft.get_inplace_scratch_len()];
        for _ in 0..2 {
            for row in map.chunks_exact_mut(self.side) {
                fft.process_with_scratch(row, &mut scratch);
            }
            for y in 0..self.side {
                for x in 0..y {
                    map.swap(y * self.side + x, x * self.side + y);
                }
            }
        }
    }

    /// The candidate poses of a station, given by its rotated maps, in the plan of another; best first, at most `keep`.
    pub fn places(&self, target: &Spectrum, turned: &[Spectrum], keep: usize) -> Vec<Place> {
        let mut found: Vec<(f64, usize, DVec2)> = Vec::new();
        let mut map = vec![Complex32::default(); self.side * self.side];
        for (number, source) in turned.iter().enumerate() {
            let cells = (self.side * self.side) as f64;
            let (energy, mass) = (target.energy.min(source.energy) * cells, (target.mass + source.mass) * cells);
            if energy <= 0.0 {
                continue;
            }
            let agree = (1.0 / energy) as f32;
            // The real part of i z is minus the imaginary part of z, which is where walls of one coincide with free cells of the other.
            let against = Complex32::new(0.0, if mass > 0.0 { (AGAINST / mass) as f32 } else { 0.0 });
            let walls = target.walls.iter().zip(&source.walls);
            let level = target.level.iter().zip(&source.level);
            for ((out, (a, b)), (c, d)) in map.iter_mut().zip(walls).zip(level) {
                *out = a * b.conj() * agree + c * d.conj() * against;
            }
            self.transform(&mut map, &self.inverse);
            found.extend(self.peaks(&map).into_iter().map(|(score, at)| (f64::from(score), number, at)));
        }
        found.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept: Vec<(f64, usize, DVec2)> = Vec::new();
        for (score, number, at) in found {
            if kept.len() == keep {
                break;
            }
            let is_same = |(_, other, place): &(f64, usize, DVec2)| {
                let apart = number.abs_diff(*other);
                apart.min(HEADINGS - apart) <= SAME_HEADINGS && place.distance(at) <= SAME_CELLS
            };
            if !kept.iter().any(is_same) {
                kept.push((score, number, at));
            }
        }
        let place = |(score, number, at): (f64, usize, DVec2)| Place {
            heading: TAU * number as f64 / HEADINGS as f64,
            offset: at * self.cell,
            score,
        };
        kept.into_iter().map(place).collect()
    }

    /// The highest local maxima of the real part, with their offsets in cells.
    fn peaks(&self, map: &[Complex32]) -> Vec<(f32, DVec2)> {
        let at = |x: i64, y: i64| map[self.wrap(y) * self.side + self.wrap(x)].re;
        let mut best: Vec<(f32, DVec2)> = Vec::with_capacity(PER_HEADING + 1);
        let half = self.side as i64 / 2;
        for y in -half..half {
            for x in -half..half {
                let value = at(x, y);
                if best.len() == PER_HEADING && value <= best[PER_HEADING - 1].0 {
                    continue;
                }
                let is_peak = (-1..=1).all(|dy| (-1..=1).all(|dx| (dx, dy) == (0, 0) || at(x + dx, y + dy) < value));
                if is_peak {
                    let place = best.partition_point(|(other, _)| *other >= value);
                    best.insert(place, (value, DVec2::new(x as f64, y as f64)));
                    best.truncate(PER_HEADING);
                }
            }
        }
        best
    }
}

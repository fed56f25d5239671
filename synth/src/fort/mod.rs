//! The fort: a ruined stone fort by the sea with its ground, about 50 m across, in the spirit of the Gereza of Kilwa
//! Kisiwani. The demo, the benchmark and the stress input.
//!
//! It is a signed distance field ([`field`]: [`plan`], [`masonry`], [`ground`]) whose zero surface is extracted on a
//! cubic grid by surface nets (Gibson 1998) block by block ([`net`]); [`scan`] then removes what a scanner would
//! not have seen and [`paint`] colours the rest. A vertex is a pure function of its grid cell, a triangle of its grid
//! edge, so blocks are made in any order and meet exactly. Triangles go with the inverse square of the grid constant;
//! [`Fort::new`] finds the constant that gives the number asked for.

mod distance;
mod field;
mod ground;
mod masonry;
mod net;
mod paint;
mod plan;
mod scan;
pub(crate) mod scene;
mod solid;
mod terrain;
#[cfg(test)]
mod trace_tests;

use super::noise::{derive, hash2};
use super::piece::{Piece, Site, tiling};
use field::Field;
use glam::{DVec3, UVec3};
use net::BLOCK;
use rayon::prelude::*;

/// Half the side of the square that holds the site, and its lowest and highest place, in metres.
const REACH: f64 = 28.0;
const LOWEST: f64 = -4.6;
const HIGHEST: f64 = 13.4;
/// What tells the fort's seed from those of other sites.
const SALT: u64 = 0xf027;
/// The fort's north is turned from the grid's, as on a real site.
const TURN: [f64; 2] = [0.956_304_755_963_035_4, -0.292_371_704_722_736_8];

/// The fort's frame from the site's.
fn fort_from_site(p: DVec3) -> DVec3 {
    let [c, s] = TURN;
    DVec3::new(c * p.x + s * p.y, c * p.y - s * p.x, p.z)
}

/// The fort at one sampling density.
pub(super) struct Fort {
    field: Field,
    /// Blocks along each axis.
    blocks: UVec3,
    tiles: (u32, u32),
    expected: u64,
}

/// Triangles times the square of the grid constant, about.
const AREA: f64 = 11_000.0;
/// Side of the windows in plan in which triangles are counted, in metres, and how many there are along a side.
const WINDOW: f64 = 0.5;
const WINDOWS: u32 = (2.0 * REACH / WINDOW) as u32;

impl Fort {
    /// A fort of about `triangles` triangles, to be cut into `tiles` tiles.
    pub(super) fn new(triangles: u64, seed: u64, tiles: u32) -> Self {
        let seed = derive(seed, SALT);
        let at = |step| Self::at(step, seed, tiles, triangles);
        let wanted = triangles as f64;
        if triangles <= 300_000 {
            // Few enough to count them all, until the number is right. It jumps a little as the grid shifts.
            let mut step = (AREA / wanted).sqrt();
            let mut best = (f64::MAX, step);
            for attempt in 0..12 {
                let ratio = at(step).census(1).iter().sum::<u64>() as f64 / wanted;
                if (ratio - 1.0).abs() < best.0 {
                    best = ((ratio - 1.0).abs(), step);
                }
                if best.0 < 0.004 {
                    break;
                }
                step *= if attempt < 4 { ratio.sqrt() } else { ratio.sqrt().sqrt() };
            }
            return at(best.1);
        }
        // Count a coarser fort in full and the wanted one in some windows: the numbers differ only by the relief that
        // the finer one shows, much in windows full of masonry and hardly on bare ground, so each kind has its ratio.
        let coarse = at((AREA / if triangles > 4_000_000 { 1e6 } else { 2.5e5 }).sqrt());
        let known = coarse.census(1);
        let total = known.iter().sum::<u64>() as f64;
        let fine = at(coarse.field.step * (total / wanted).sqrt());
        let every = [6, 5, 4, 3].into_iter().find(|e| triangles > 500_000 * e * e).unwrap_or(2) as u32;
        let found = fine.census(every);
        let flat = 2.0 * (WINDOW / coarse.field.step) * (WINDOW / coarse.field.step);
        let mut kinds = [[0.0_f64; 3]; 4];
        for (w, (known, found)) in known.iter().zip(&found).enumerate() {
            let fullness = *known as f64 / flat;
            let kind = [1.25, 2.5, 4.0].iter().filter(|limit| fullness > **limit).count();
            let [all, there, sample] = &mut kinds[kind];
            *all += *known as f64;
            if fine.chosen(w as u32 / WINDOWS, w as u32 % WINDOWS, every) {
                *there += *known as f64;
                *sample += *found as f64;
            }
        }
        let estimate: f64 = kinds.iter().map(|[all, there, sample]| all * sample / there.max(1.0)).sum();
        // The number goes with a power of the step a little beyond the square: that between the two forts.
        let power = libm::log(estimate / total) / libm::log(coarse.field.step / fine.field.step);
        at(fine.field.step * libm::pow(estimate / wanted, 1.0 / power.clamp(1.5, 3.0)))
    }

    fn at(step: f64, seed: u64, tiles: u32, expected: u64) -> Self {
        let side = f64::from(BLOCK) * step;
        let along = (2.0 * REACH / side).ceil() as u32;
        let up = ((HIGHEST - LOWEST) / side).ceil() as u32;
        let field = Field::new(seed, step);
        Self { field, blocks: UVec3::new(along, along, up), tiles: tiling(tiles, 1.0, 1.0), expected }
    }

    /// The largest number of tiles along one side.
    pub(super) fn max_tiles(&self) -> u32 {
        self.blocks.x
    }

    /// Whether every tile has at least a block.
    pub(super) fn tiles_fit(&self) -> bool {
        self.tiles.0.max(self.tiles.1) <= self.blocks.x
    }

    /// Whether a window is in the sample: one of each group of `every` by `every`.
    fn chosen(&self, x: u32, y: u32, every: u32) -> bool {
        let group = [x / every, y / every].map(i64::from);
        let pick = hash2(derive(self.field.seed, 0xf028), group[0], group[1]) % u64::from(every * every);
        pick == u64::from(x % every * every + y % every)
    }

    /// How many triangles lie in each window in plan: in all windows, or in one of each group of `every` by
    /// `every`.
    fn census(&self, every: u32) -> Vec<u64> {
        let chosen = |x: u32, y: u32| self.chosen(x, y, every);
        let window = |place: f64| (((place + REACH) / WINDOW).max(0.0) as u32).min(WINDOWS - 1);
        let reach = |block: u32| {
            let low = f64::from(block * BLOCK) * self.field.step - REACH;
            window(low - self.field.step)..=window(low + f64::from(BLOCK) * self.field.step)
        };
        let columns: Vec<Vec<u32>> = (0..self.blocks.x * self.blocks.y)
            .into_par_iter()
            .map(|k| [k / self.blocks.y, k % self.blocks.y])
            .filter(|[x, y]| reach(*x).any(|wx| reach(*y).any(|wy| chosen(wx, wy))))
            .map(|[x, y]| {
                let pieces = (0..self.blocks.z).map(|z| net::block(&self.field, UVec3::new(x, y, z), false));
                let windows = pieces.flat_map(|piece| {
                    let place = |t: &[u32; 3]| piece.vertices[t[0] as usize].position;
                    piece.triangles.iter().map(place).map(|p| (window(p[0]), window(p[1]))).collect::<Vec<_>>()
                });
                windows.filter(|(x, y)| chosen(*x, *y)).map(|(x, y)| x * WINDOWS + y).collect()
            })
            .collect();
        let mut counts = vec![0; (WINDOWS * WINDOWS) as usize];
        for w in columns.into_iter().flatten() {
            counts[w as usize] += 1;
        }
        counts
    }

    /// The blocks of a tile: first and behind the last along x, and along y.
    fn window(&self, tile: u32) -> [[u32; 2]; 2] {
        let share = |n: u32, k: u32, of: u32| (u64::from(n) * u64::from(k) / u64::from(of)) as u32;
        let (tx, ty) = (tile % self.tiles.0, tile / self.tiles.0);
        let UVec3 { x: nx, y: ny, .. } = self.blocks;
        [
            [share(nx, tx, self.tiles.0), share(nx, tx + 1, self.tiles.0)],
            [share(ny, ty, self.tiles.1), share(ny, ty + 1, self.tiles.1)],
        ]
    }
}

impl Site for Fort {
    fn expected_triangles(&self) -> u64 {
        self.expected
    }

    fn spacing(&self) -> f64 {
        self.field.step
    }

    fn slabs(&self, tile: u32) -> u32 {
        let [[x0, x1], _] = self.window(tile);
        x1 - x0
    }

    fn pieces(&self, tile: u32, _slab: u32) -> u32 {
        let [_, [y0, y1]] = self.window(tile);
        (y1 - y0) * self.blocks.z
    }

    fn piece(&self, tile: u32, slab: u32, index: u32) -> Piece {
        let [[x0, _], [y0, _]] = self.window(tile);
        let up = self.blocks.z;
        let mut piece = net::block(&self.field, UVec3::new(x0 + slab, y0 + index / up, index % up), true);
        for v in &mut piece.vertices {
            // The net says whether the next slab needs it too.
            if let Some((_, last)) = &mut v.shared {
                *last += slab;
            }
        }
        piece
    }
}

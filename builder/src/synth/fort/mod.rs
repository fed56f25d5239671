//! The fort: a ruined stone fort by the sea with its ground, about 50 m across, in the spirit of the Gereza of Kilwa
//! Kisiwani. The demo, the benchmark and the stress input.
//!
//! It is a signed distance field ([`field`]: [`plan`], [`masonry`], [`ground`]) whose zero surface is extracted on a
//! cubic grid by surface nets (Gibson 1998) block by block ([`net`]); [`scan`] then takes away what a scanner would
//! not have seen and [`paint`] colours the rest. A vertex is a pure function of its grid cell, a triangle of its grid
//! edge, so blocks are made in any order and meet exactly. Triangles go with the inverse square of the grid constant;
//! [`Fort::new`] finds the constant that gives the number asked for.

mod field;
mod ground;
mod masonry;
mod net;
mod paint;
mod plan;
mod scan;
mod solid;

use super::noise::{derive, hash2};
use super::piece::{Piece, Site, tiling};
use field::Field;
use net::BLOCK;
use rayon::prelude::*;

/// A point or vector, metres.
type Vec3 = [f64; 3];

/// Half the side of the square that holds the site, and its lowest and highest place, in metres.
const REACH: f64 = 26.0;
const LOWEST: f64 = -4.6;
const HIGHEST: f64 = 13.4;
/// The fort's north is turned from the grid's, as on a real site.
const TURN: [f64; 2] = [0.956_304_755_963_035_4, 0.292_371_704_722_736_8];

/// The fort's frame from the site's.
fn fort_from_site(p: Vec3) -> Vec3 {
    let [c, s] = TURN;
    [c * p[0] + s * p[1], c * p[1] - s * p[0], p[2]]
}

/// The fort at one sampling density.
pub(super) struct Fort {
    field: Field,
    /// Blocks along each axis.
    blocks: [u32; 3],
    tiles: (u32, u32),
    expected: u64,
}

/// Triangles times the square of the grid constant, about.
const AREA: f64 = 11_000.0;
/// Up to this many triangles all are counted to find the grid constant; beyond, those of a sample.
const COUNTED: u64 = 250_000;
/// How many columns of blocks the sample has, about.
const SAMPLE: u32 = 320;

impl Fort {
    /// A fort of about `triangles` triangles, to be cut into `tiles` tiles.
    pub(super) fn new(triangles: u64, seed: u64, tiles: u32) -> Self {
        let seed = derive(seed, 0xf027);
        let at = |step| Self::at(step, seed, tiles, triangles);
        // Small forts are counted in full, twice, since relief comes and goes with the grid constant.
        let counted = triangles.min(COUNTED);
        let mut fort = at((AREA / counted as f64).sqrt());
        let mut columns = fort.count(1);
        for _ in 0..4 {
            let ratio = total(&columns) / counted as f64;
            if (ratio - 1.0).abs() < 0.003 {
                break;
            }
            fort = at(fort.field.step * ratio.sqrt());
            columns = fort.count(1);
        }
        if counted == triangles {
            return fort;
        }
        // Larger ones by the ratio of what a sample has to what the counted fort had in the same places.
        let finer = at(fort.field.step * (total(&columns) / triangles as f64).sqrt());
        let every = (finer.blocks[0] * finer.blocks[1] / SAMPLE).max(1);
        let (mut found, mut foreseen) = (0.0, 0.0);
        for ([x, y], count) in finer.count(every) {
            let share = fort.share_of(&columns, finer.corner(x, y), finer.corner(x + 1, y + 1));
            foreseen += share * (fort.field.step / finer.field.step) * (fort.field.step / finer.field.step);
            found += count as f64;
        }
        let ratio: f64 = found / foreseen;
        at(finer.field.step * (ratio * total(&columns) * fort.field.step * fort.field.step
            / (triangles as f64 * finer.field.step * finer.field.step)).sqrt())
    }

    fn at(step: f64, seed: u64, tiles: u32, expected: u64) -> Self {
        let side = f64::from(BLOCK) * step;
        let along = (2.0 * REACH / side).ceil() as u32;
        let up = ((HIGHEST - LOWEST) / side).ceil() as u32;
        let field = Field::new(seed, step);
        Self { field, blocks: [along, along, up], tiles: tiling(tiles, 1.0, 1.0), expected }
    }

    /// The largest number of tiles along one side.
    pub(super) fn most_tiles(&self) -> u32 {
        self.blocks[0]
    }

    /// The south-west corner of a column of blocks.
    fn corner(&self, x: u32, y: u32) -> [f64; 2] {
        [x, y].map(|k| f64::from(k * BLOCK) * self.field.step)
    }

    /// How many triangles each column of blocks has: all columns, or one in `every` at random.
    fn count(&self, every: u32) -> Vec<([u32; 2], u64)> {
        let of_column = |[x, y]: [u32; 2]| -> u64 {
            (0..self.blocks[2]).map(|z| net::block(&self.field, [x, y, z], false).triangles.len() as u64).sum()
        };
        let salt = derive(self.field.seed, 0xf028);
        (0..self.blocks[0] * self.blocks[1])
            .into_par_iter()
            .map(|k| [k / self.blocks[1], k % self.blocks[1]])
            .filter(|[x, y]| hash2(salt, i64::from(*x), i64::from(*y)).is_multiple_of(u64::from(every)))
            .map(|column| (column, of_column(column)))
            .collect()
    }

    /// How many of the counted triangles lie in a rectangle, if those of a column lie evenly in it.
    fn share_of(&self, columns: &[([u32; 2], u64)], low: [f64; 2], high: [f64; 2]) -> f64 {
        let side = f64::from(BLOCK) * self.field.step;
        columns
            .iter()
            .map(|([x, y], count)| {
                let corner = self.corner(*x, *y);
                let overlap = |k: usize| (high[k].min(corner[k] + side) - low[k].max(corner[k])).max(0.0) / side;
                *count as f64 * overlap(0) * overlap(1)
            })
            .sum()
    }

    /// The blocks of a tile: first and behind the last along x, and along y.
    fn window(&self, tile: u32) -> [[u32; 2]; 2] {
        let share = |n: u32, k: u32, of: u32| (u64::from(n) * u64::from(k) / u64::from(of)) as u32;
        let (tx, ty) = (tile % self.tiles.0, tile / self.tiles.0);
        let [nx, ny, _] = self.blocks;
        [
            [share(nx, tx, self.tiles.0), share(nx, tx + 1, self.tiles.0)],
            [share(ny, ty, self.tiles.1), share(ny, ty + 1, self.tiles.1)],
        ]
    }
}

fn total(columns: &[([u32; 2], u64)]) -> f64 {
    columns.iter().map(|(_, count)| *count as f64).sum()
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
        (y1 - y0) * self.blocks[2]
    }

    fn piece(&self, tile: u32, slab: u32, index: u32) -> Piece {
        let [[x0, _], [y0, _]] = self.window(tile);
        let up = self.blocks[2];
        let mut piece = net::block(&self.field, [x0 + slab, y0 + index / up, index % up], true);
        for v in &mut piece.vertices {
            // The net says whether the next slab needs it too.
            if let Some((_, last)) = &mut v.shared {
                *last += slab;
            }
        }
        piece
    }
}

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
    /// Grid constant in metres.
    step: f64,
    /// Blocks along each axis.
    blocks: [u32; 3],
    tiles: (u32, u32),
    expected: u64,
}

impl Fort {
    /// A fort of about `triangles` triangles, to be cut into `tiles` tiles.
    pub(super) fn new(triangles: u64, seed: u64, tiles: u32) -> Self {
        let seed = derive_seed(seed);
        let mut step = (AREA / triangles as f64).sqrt();
        let mut fort = Self::at(step, seed, tiles, triangles);
        for _ in 0..4 {
            let ratio = fort.estimate() / triangles as f64;
            step *= ratio.sqrt();
            fort = Self::at(step, seed, tiles, triangles);
            if (ratio - 1.0).abs() < 0.004 {
                break;
            }
        }
        fort
    }

    fn at(step: f64, seed: u64, tiles: u32, expected: u64) -> Self {
        let side = f64::from(BLOCK) * step;
        let along = (2.0 * REACH / side).ceil() as u32;
        let up = ((HIGHEST - LOWEST) / side).ceil() as u32;
        let field = Field::new(seed, 1.3 * step);
        Self { field, step, blocks: [along, along, up], tiles: tiling(tiles, 1.0, 1.0), expected }
    }

    /// The largest number of tiles along one side.
    pub(super) fn most_tiles(&self) -> u32 {
        self.blocks[0]
    }

    /// About how many triangles there will be: those of all blocks while they are few, else of a sample.
    fn estimate(&self) -> f64 {
        let columns = self.blocks[0] * self.blocks[1];
        let every = (columns / SAMPLE_COLUMNS).max(1);
        let count = |column: u32| -> u64 {
            let (x, y) = (column / self.blocks[1], column % self.blocks[1]);
            (0..self.blocks[2]).map(|z| self.block([x, y, z]).triangles.len() as u64).sum()
        };
        let sample: Vec<u32> = (0..columns / every).map(|k| k * every).collect();
        let sum: u64 = sample.par_iter().map(|c| count(*c)).sum();
        sum as f64 * f64::from(columns) / sample.len() as f64
    }

    fn block(&self, block: [u32; 3]) -> Piece {
        net::block(&self.field, self.step, block)
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

/// Triangles times the square of the grid constant, about.
const AREA: f64 = 9_000.0;
/// How many columns of blocks the estimate looks at, about.
const SAMPLE_COLUMNS: u32 = 400;

fn derive_seed(seed: u64) -> u64 {
    super::noise::derive(seed, 0xf027)
}

impl Site for Fort {
    fn expected_triangles(&self) -> u64 {
        self.expected
    }

    fn spacing(&self) -> f64 {
        self.step
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
        let mut piece = self.block([x0 + slab, y0 + index / up, index % up]);
        for v in &mut piece.vertices {
            // The net says whether the next slab needs it too.
            if let Some((_, last)) = &mut v.shared {
                *last += slab;
            }
        }
        piece
    }
}

//! The wall: a standing height field of 10 m by 5 m that faces south (-y), the sharpest test of relief and colour.
//!
//! Metre waves, fractal relief, brick courses with mortar joints 20 mm deep, noise of 0.15 mm, a jittered grid,
//! fractal colours with noise of standard deviation 4. One sheet with one border: the outline, which stays straight.
//! A vertex is a pure function of the seed and its grid place.

use super::noise::{cell, derive, fractal2, hash2, lerp, noise2, normal, smooth, unit};
use super::piece::{Piece, Site, Vertex, tiling};
use glam::DVec3;

/// Width (x) in metres.
pub(super) const WIDTH: f64 = 10.0;
/// Height (z) in metres.
pub(super) const HEIGHT: f64 = 5.0;
/// Depth of a mortar joint in metres.
const JOINT_DEPTH: f64 = 0.020;
/// Standard deviation of the scanner's noise along y, in metres.
const SCANNER_NOISE: f64 = 0.000_15;
/// Standard deviation of the noise of each colour channel.
const COLOR_NOISE: f64 = 4.0;
const BRICK_LENGTH: f64 = 0.34;
const BRICK_HEIGHT: f64 = 0.125;

const ROWS_PER_PIECE: u32 = 32;
const COLUMNS_PER_PIECE: u32 = 256;

/// The wall at one sampling density.
pub(super) struct Wall {
    seed: u64,
    columns: u32,
    rows: u32,
    tiles: (u32, u32),
}

/// A tile's or piece's quads: columns `x0..x1` of rows `y0..y1`.
#[derive(Clone, Copy)]
struct Window {
    x0: u32,
    x1: u32,
    y0: u32,
    y1: u32,
}

fn share(total: u32, part: u32, parts: u32) -> u32 {
    (u64::from(total) * u64::from(part) / u64::from(parts)) as u32
}

impl Wall {
    /// A wall of about `triangles` triangles (within 2 % from 2,000 up).
    pub(super) fn new(triangles: u64, seed: u64, tiles: u32) -> Self {
        let rows = ((triangles as f64 / 4.0).sqrt().round() as u32).max(1);
        let columns = ((triangles as f64 / (2.0 * f64::from(rows))).round() as u32).max(1);
        Self { seed: derive(seed, 0x3a11), columns, rows, tiles: tiling(tiles, WIDTH, HEIGHT) }
    }

    /// The largest number of tiles that a wall of this density can surely be cut into.
    pub(super) fn max_tiles(&self) -> u32 {
        self.columns.min(self.rows)
    }

    fn tile(&self, tile: u32) -> Window {
        let (tx, ty) = (tile % self.tiles.0, tile / self.tiles.0);
        Window {
            x0: share(self.columns, tx, self.tiles.0),
            x1: share(self.columns, tx + 1, self.tiles.0),
            y0: share(self.rows, ty, self.tiles.1),
            y1: share(self.rows, ty + 1, self.tiles.1),
        }
    }

    /// Plane coordinates of a grid vertex, jittered except across the outline.
    fn plane(&self, i: u32, j: u32) -> (f64, f64) {
        let h = hash2(self.seed, i64::from(i), i64::from(j));
        let jitter = |k: u32, n: u32, lane: u32| {
            if k == 0 || k == n { 0.0 } else { (unit(h, lane) - 0.5) * 0.6 }
        };
        let x = (f64::from(i) + jitter(i, self.columns, 0)) / f64::from(self.columns) * WIDTH;
        let z = (f64::from(j) + jitter(j, self.rows, 1)) / f64::from(self.rows) * HEIGHT;
        (x, z)
    }

    fn vertex(&self, i: u32, j: u32) -> (DVec3, [u8; 3]) {
        let (x, z) = self.plane(i, j);
        let s = self.seed;
        let brick = Brick::at(s, x, z);
        let waves = 0.045 * noise2(s ^ 1, x * 0.55, z * 0.55) + 0.022 * noise2(s ^ 2, x * 1.1, z * 1.1);
        let worn = fractal2(s ^ 3, x, z, 1.7, 4, 0.55);
        let relief = 0.004 * fractal2(s ^ 4, x, z, 0.11, 5, 0.6);
        let erosion = smooth(0.25, 0.9, worn);
        let depth = lerp(JOINT_DEPTH * brick.joint, 0.014 + 0.006 * brick.joint, erosion);
        let noise = SCANNER_NOISE * normal(hash2(s ^ 5, i64::from(i), i64::from(j)));
        let out = waves + relief + brick.offset - depth - 0.02 * erosion + noise;
        let color = self.color(x, z, &brick, worn, erosion, hash2(s ^ 6, i64::from(i), i64::from(j)));
        (DVec3::new(x, -out, z), color)
    }

    fn color(&self, x: f64, z: f64, brick: &Brick, worn: f64, erosion: f64, h: u64) -> [u8; 3] {
        const BRICKS: [[f64; 3]; 3] = [[164.0, 98.0, 72.0], [182.0, 120.0, 88.0], [141.0, 84.0, 66.0]];
        const MORTAR: [f64; 3] = [196.0, 186.0, 166.0];
        let tone = BRICKS[(brick.id % 3) as usize];
        let shade = 1.0 + 0.16 * (unit(brick.id, 1) - 0.5) + 0.10 * worn - 0.12 * erosion;
        let cloud = 1.0 + 0.09 * fractal2(self.seed ^ 7, x, z, 0.6, 4, 0.6);
        let damp = 1.0 - 0.35 * smooth(0.8, 0.0, z + 0.4 * worn);
        let green = 0.5 * smooth(0.9, 0.0, z + 0.5 * worn) * smooth(0.0, 0.5, worn);
        std::array::from_fn(|k| {
            let base = lerp(tone[k] * shade, MORTAR[k], brick.joint * 0.85) * cloud * damp;
            let mossy = lerp(base, [96.0, 108.0, 62.0][k], green);
            let noise = COLOR_NOISE * normal(super::noise::mix(h ^ (k as u64 + 1)));
            (mossy + noise).round().clamp(0.0, 255.0) as u8
        })
    }
}

/// Which brick a place belongs to and how much of a joint it is.
struct Brick {
    id: u64,
    /// 1 in the middle of a mortar joint, 0 on the face.
    joint: f64,
    /// How far the brick stands out, in metres.
    offset: f64,
}

impl Brick {
    fn at(seed: u64, x: f64, z: f64) -> Self {
        let wobble = 0.006 * noise2(seed ^ 8, x * 1.3, z * 1.3);
        let (course, v) = cell(z + wobble, BRICK_HEIGHT);
        let shift = 0.5 * (course.rem_euclid(2)) as f64 + 0.15 * unit(hash2(seed ^ 9, course, 0), 0);
        let (column, u) = cell(x + shift * BRICK_LENGTH + wobble, BRICK_LENGTH);
        let id = hash2(seed ^ 0x0a, column, course);
        let across = u.min(1.0 - u) * BRICK_LENGTH;
        let along = v.min(1.0 - v) * BRICK_HEIGHT;
        let joint = 1.0 - smooth(0.004, 0.011, across.min(along));
        let tilt = (unit(id, 2) - 0.5) * 0.006 * (u - 0.5);
        Self { id, joint, offset: ((unit(id, 0) - 0.5) * 0.006 + tilt) * (1.0 - joint) }
    }
}

impl Site for Wall {
    fn expected_triangles(&self) -> u64 {
        2 * u64::from(self.columns) * u64::from(self.rows)
    }

    fn spacing(&self) -> f64 {
        WIDTH / f64::from(self.columns)
    }

    fn slabs(&self, tile: u32) -> u32 {
        let w = self.tile(tile);
        (w.y1 - w.y0).div_ceil(ROWS_PER_PIECE)
    }

    fn pieces(&self, tile: u32, _slab: u32) -> u32 {
        let w = self.tile(tile);
        (w.x1 - w.x0).div_ceil(COLUMNS_PER_PIECE)
    }

    fn piece(&self, tile: u32, slab: u32, index: u32) -> Piece {
        let t = self.tile(tile);
        let x0 = t.x0 + index * COLUMNS_PER_PIECE;
        let y0 = t.y0 + slab * ROWS_PER_PIECE;
        let w = Window { x0, x1: (x0 + COLUMNS_PER_PIECE).min(t.x1), y0, y1: (y0 + ROWS_PER_PIECE).min(t.y1) };
        let mut piece = Piece::default();
        for j in w.y0..=w.y1 {
            for i in w.x0..=w.x1 {
                let (position, color) = self.vertex(i, j);
                let edge = i == w.x0 || i == w.x1 || j == w.y0 || j == w.y1;
                let key = u64::from(j) * (u64::from(self.columns) + 1) + u64::from(i);
                let last = slab + u32::from(j == w.y1);
                piece.vertices.push(Vertex { position, color, shared: edge.then_some((key, last)) });
            }
        }
        let stride = w.x1 - w.x0 + 1;
        for j in 0..w.y1 - w.y0 {
            for i in 0..w.x1 - w.x0 {
                let a = j * stride + i;
                let (b, c, d) = (a + 1, a + stride + 1, a + stride);
                let corners = [a, b, c, d].map(|v| piece.vertices[v as usize].position);
                if corners[0].distance_squared(corners[2]) <= corners[1].distance_squared(corners[3]) {
                    piece.triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    piece.triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        piece
    }
}

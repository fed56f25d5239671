//! Surface nets (Gibson, "Constrained Elastic Surface Nets", MICCAI 1998): one vertex in each grid cell that the
//! surface crosses, one quad across each grid edge that it crosses.
//!
//! A block owns the grid edges that start at its corners, and makes the vertices of all cells round them, which are its
//! own cells and one layer before them: blocks need nothing of each other. Only small cubes near the surface are looked
//! at; where the surface leaves such a cube its neighbour is looked at too, so steep relief is not lost.

use super::field::{Field, Near};
use super::ground::Ground;
use super::{LOWEST, REACH, fort_from_site, paint, scan};
use crate::noise::{self, derive, hash3, unit};
use crate::piece::{Piece, Vertex};
use glam::{DVec3, I64Vec3, IVec3, UVec3};

/// Cells along the side of a block.
pub(super) const BLOCK: u32 = 16;
/// Cells along the side of the cubes that are looked at or left out.
const CUBE: i32 = 4;
const CUBES: i32 = BLOCK as i32 / CUBE;
/// Corners along a side: one layer before the block's own and one behind.
const SIDE: i32 = BLOCK as i32 + 2;
/// How far a vertex is moved along the surface at random, in grid constants.
const JITTER: f64 = 0.42;
/// Standard deviation of the scanner's noise across the surface, in metres.
const SCANNER_NOISE: f64 = 0.000_9;

/// A grid place relative to the block: -1 ..= BLOCK.
type Local = IVec3;

struct Block<'a> {
    field: &'a Field,
    painted: bool,
    near: Near,
    first: I64Vec3,
    values: Vec<f32>,
    columns: Vec<Option<Ground>>,
    cells: Vec<u32>,
    kept: Vec<bool>,
    piece: Piece,
}

/// Make a block: the triangles of its grid edges. A shared vertex says 1 where the next block along x needs it, else 0.
/// Colours are left black where `painted` is false.
pub(super) fn block(field: &Field, block: UVec3, painted: bool) -> Piece {
    let step = field.step;
    let first = block.as_i64vec3() * i64::from(BLOCK);
    let side = f64::from(BLOCK) * step;
    let middle = fort_from_site(site(step, first, IVec3::splat(BLOCK as i32 / 2)));
    let reach = (side / 2.0 + step) * 3.0_f64.sqrt();
    let near = field.near(middle, reach + 1.0);
    if field.clear(&near, middle, reach) {
        return Piece::default();
    }
    let slots = (SIDE * SIDE * SIDE) as usize;
    let mut b = Block {
        field,
        painted,
        near,
        first,
        values: vec![f32::NAN; slots],
        columns: vec![None; (SIDE * SIDE) as usize],
        cells: vec![u32::MAX; slots],
        kept: Vec::new(),
        piece: Piece::default(),
    };
    b.run();
    b.piece
}

/// The place of a grid corner in the site's frame.
fn site(step: f64, first: I64Vec3, l: Local) -> DVec3 {
    (first + l.as_i64vec3()).as_dvec3() * step + DVec3::new(-REACH, -REACH, LOWEST)
}

fn slot(l: Local) -> usize {
    (((l.x + 1) * SIDE + l.y + 1) * SIDE + l.z + 1) as usize
}

impl Block<'_> {
    fn run(&mut self) {
        let index = |c: Local| ((c.x * CUBES + c.y) * CUBES + c.z) as usize;
        let mut seen = [false; (CUBES * CUBES * CUBES) as usize];
        let mut queue = Vec::new();
        for x in 0..CUBES {
            for y in 0..CUBES {
                for z in 0..CUBES {
                    let cube = IVec3::new(x, y, z);
                    if self.may_cross(cube) {
                        seen[index(cube)] = true;
                        queue.push(cube);
                    }
                }
            }
        }
        let mut edges = Vec::new();
        while let Some(cube) = queue.pop() {
            for (axis, side) in self.look(cube, &mut edges) {
                let mut next = cube;
                next[axis] += side;
                if (0..CUBES).contains(&next[axis]) && !seen[index(next)] {
                    seen[index(next)] = true;
                    queue.push(next);
                }
            }
        }
        // The order of the queue must not show.
        edges.sort_unstable_by_key(|(corner, axis)| (corner.to_array(), *axis));
        for (corner, axis) in edges {
            self.quad(corner, axis);
        }
    }

    /// Whether the surface may pass through a cube.
    fn may_cross(&mut self, cube: Local) -> bool {
        let middle = cube * CUBE + CUBE / 2;
        let radius = f64::from(CUBE) * self.field.step * 0.87;
        let p = fort_from_site(site(self.field.step, self.first, middle));
        if self.field.clear(&self.near, p, radius) {
            return false;
        }
        f64::from(self.value(middle)).abs() < radius * 1.35 + 0.02
    }

    /// Collect the crossed edges of a cube; gives the sides through which the surface leaves.
    fn look(&mut self, cube: Local, edges: &mut Vec<(Local, usize)>) -> Vec<(usize, i32)> {
        let low = cube * CUBE;
        let mut leaves = [[false; 2]; 3];
        for x in 0..=CUBE {
            for y in 0..=CUBE {
                for z in 0..=CUBE {
                    let at = IVec3::new(x, y, z);
                    let corner = low + at;
                    let inside = self.value(corner) < 0.0;
                    for axis in 0..3 {
                        if at[axis] == CUBE {
                            continue;
                        }
                        let mut next = corner;
                        next[axis] += 1;
                        if (self.value(next) < 0.0) == inside {
                            continue;
                        }
                        if at.cmplt(IVec3::splat(CUBE)).all() {
                            edges.push((corner, axis));
                        }
                        for k in (0..3).filter(|k| *k != axis) {
                            leaves[k][0] |= at[k] == 0;
                            leaves[k][1] |= at[k] == CUBE;
                        }
                    }
                }
            }
        }
        let sides = (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]);
        sides.filter(|(axis, side)| leaves[*axis][usize::from(*side == 1)]).collect()
    }

    fn ground(&mut self, l: Local) -> Ground {
        let at = ((l.x + 1) * SIDE + l.y + 1) as usize;
        if let Some(g) = self.columns[at] {
            return g;
        }
        let p = fort_from_site(site(self.field.step, self.first, l));
        let g = self.field.ground(p[0], p[1]);
        self.columns[at] = Some(g);
        g
    }

    /// Signed distance at a grid corner.
    fn value(&mut self, l: Local) -> f32 {
        let at = slot(l);
        if self.values[at].is_nan() {
            let g = self.ground(l);
            let p = fort_from_site(site(self.field.step, self.first, l));
            let d = self.field.fine(&self.near, p, &g).all as f32;
            // Never exactly on a corner: a crossing then lies inside its edge.
            self.values[at] = if d == 0.0 { 1e-6 } else { d };
        }
        self.values[at]
    }

    /// The two triangles across the edge from a corner along an axis.
    fn quad(&mut self, corner: Local, axis: usize) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let inside = self.value(corner) < 0.0;
        let mut ring = [0_u32; 4];
        for (k, (du, dv)) in [(-1, -1), (0, -1), (0, 0), (-1, 0)].into_iter().enumerate() {
            let mut cell = corner;
            cell[u] += du;
            cell[v] += dv;
            ring[if inside { k } else { 3 - k }] = self.vertex(cell);
        }
        let [a, b, c, d] = ring;
        let at = ring.map(|v| self.piece.vertices[v as usize].position);
        let halves = if at[0].distance_squared(at[2]) <= at[1].distance_squared(at[3]) {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        };
        for t in halves {
            if t.iter().all(|v| self.kept[*v as usize]) {
                self.piece.triangles.push(t);
            }
        }
    }

    /// The vertex of a cell: a pure function of the cell.
    fn vertex(&mut self, cell: Local) -> u32 {
        let at = slot(cell);
        if self.cells[at] != u32::MAX {
            return self.cells[at];
        }
        let (mut crossing, slope) = self.crossing(cell);
        let length = slope.length().max(1e-9);
        let normal = slope / length;
        let whole = self.first + cell.as_i64vec3();
        let h = hash3(derive(self.field.seed, 0x91), whole.x, whole.y, whole.z);
        let push = (DVec3::new(unit(h, 0), unit(h, 1), unit(h, 2)) - 0.5) * JITTER;
        let across = push.dot(normal);
        let grain = SCANNER_NOISE * noise::normal(noise::mix(h ^ 0x55)) / self.field.step;
        let inside = |c: DVec3| c.clamp(DVec3::splat(0.02), DVec3::splat(0.98));
        crossing = inside(crossing + push + (grain - across) * normal);
        let corner = site(self.field.step, self.first, cell);
        let step = self.field.step;
        let place = |c: DVec3| corner + c * step;
        let (p, across) = (fort_from_site(place(crossing)), fort_from_site(normal));
        // High above the ground and below the ruin's edge, what the cell's corner has will do.
        let mut ground = self.ground(cell);
        if p[2] - ground.height < 1.0 || p[2] > ground.standing - 1.5 {
            ground = self.field.ground(p[0], p[1]);
        }
        let distance = self.field.fine(&self.near, p, &ground);
        // The mean of the crossings lies a little off the surface, in a pattern that the eye finds: one Newton step.
        let steepness = (length / (4.0 * self.field.step)).max(1.0);
        let off = (distance.all / (steepness * self.field.step)).clamp(-0.4, 0.4);
        let position = place(inside(crossing - off * normal));
        let edge = cell.to_array().iter().any(|c| *c == -1 || *c == BLOCK as i32 - 1);
        let key = whole.to_array().iter().fold(0_u64, |key, c| key << 21 | ((c + 1) as u64 & 0x1f_ffff));
        let shared = edge.then_some((key, u32::from(cell.x == BLOCK as i32 - 1)));
        let kept = scan::seen(self.field.seed, p, across, &distance);
        let color = if kept && self.painted {
            let spot = paint::Spot { p, normal: across, distance, ground, hash: h };
            paint::color(self.field, &self.near, &spot)
        } else {
            [0; 3]
        };
        let index = self.piece.vertices.len() as u32;
        self.piece.vertices.push(Vertex { position, color, shared });
        self.kept.push(kept);
        self.cells[at] = index;
        index
    }

    /// Mean of the crossings of a cell's edges, in cells, and the mean slope.
    fn crossing(&mut self, cell: Local) -> (DVec3, DVec3) {
        let mut value = [0.0_f64; 8];
        for (k, v) in value.iter_mut().enumerate() {
            let l = cell + IVec3::new((k & 1) as i32, (k >> 1 & 1) as i32, (k >> 2) as i32);
            *v = f64::from(self.value(l));
        }
        let (mut sum, mut count, mut slope) = (DVec3::ZERO, 0.0, DVec3::ZERO);
        for axis in 0..3 {
            let bit = 1 << axis;
            for k in (0..8).filter(|k| k & bit == 0) {
                let (a, b) = (value[k], value[k | bit]);
                slope[axis] += b - a;
                if (a < 0.0) != (b < 0.0) {
                    let t = a / (a - b);
                    for other in 0..3 {
                        sum[other] += if other == axis { t } else { (k >> other & 1) as f64 };
                    }
                    count += 1.0;
                }
            }
        }
        (sum / count, slope)
    }
}

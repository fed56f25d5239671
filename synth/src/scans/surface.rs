//! The true surface of the fort as a mesh: surface nets (Gibson 1998) on the field that the scans were traced against, and the bars of the grilles.
//!
//! Unlike the mesh of `kilwa synth fort` it has no faults. A vertex is a pure function of its grid cell, moved onto the surface.

use super::props::{Prop, Shape};
use crate::fort::scene::{HALF, Scene};
use crate::piece::{Piece, Site, Vertex};
use glam::{DVec3, IVec3, UVec3};

/// Cells along the side of a block.
const BLOCK: i32 = 16;
/// Corners along a side: one layer before the block's own and one behind.
const SIDE: i32 = BLOCK + 2;
/// Half the side of the part that is meshed, and its bottom and top, in metres: just inside the ground's borders.
const REACH: f64 = HALF - 0.1;
const BOTTOM: f64 = -5.2;
const TOP: f64 = 13.4;
/// Triangles times the square of the grid's spacing, about.
const AREA: f64 = 11_600.0;
/// Sides of a bar.
const SIDES: u32 = 12;

/// The true surface at one spacing.
pub(super) struct Surface<'a> {
    scene: &'a Scene,
    bars: Vec<Prop>,
    step: f64,
    cells: IVec3,
    blocks: UVec3,
    expected: u64,
}

impl<'a> Surface<'a> {
    /// The surface in about so many triangles.
    pub(super) fn new(scene: &'a Scene, bars: Vec<Prop>, triangles: u64) -> Self {
        let step = (AREA / triangles as f64).sqrt();
        let along = (2.0 * REACH / step) as i32;
        let cells = IVec3::new(along, along, ((TOP - BOTTOM) / step) as i32);
        let blocks = ((cells + BLOCK - 1) / BLOCK).as_uvec3();
        Self { scene, bars, step, cells, blocks, expected: triangles }
    }

    fn block(&self, at: UVec3) -> Piece {
        let first = at.as_ivec3() * BLOCK;
        let middle = self.corner(first + BLOCK / 2);
        let reach = (f64::from(BLOCK) / 2.0 + 1.0) * self.step * 3.0_f64.sqrt();
        if self.scene.is_clear(middle, reach) {
            return Piece::default();
        }
        let slots = (SIDE * SIDE * SIDE) as usize;
        let mut block = Block {
            surface: self,
            slab: at.x,
            first,
            values: Vec::with_capacity(slots),
            vertices: vec![u32::MAX; slots],
            piece: Piece::default(),
        };
        block.run();
        block.piece
    }

    /// The place of a corner of the grid, in the fort's frame.
    fn corner(&self, corner: IVec3) -> DVec3 {
        corner.as_dvec3() * self.step + DVec3::new(-REACH, -REACH, BOTTOM)
    }

    /// A bar as a tube with flat ends.
    fn bar(prop: &Prop) -> Piece {
        let Shape::Capsule { a, b, radius } = prop.shape else { return Piece::default() };
        let mut piece = Piece::default();
        let color = rgb(prop.color);
        let mut vertex = |p: DVec3| {
            piece.vertices.push(Vertex { position: Scene::to_site(p), color, shared: None });
            piece.vertices.len() as u32 - 1
        };
        let axis = (b - a).normalize();
        let (u, v) = (axis.any_orthonormal_vector(), axis.cross(axis.any_orthonormal_vector()));
        let ends = [a, b].map(|end| {
            let ring: Vec<u32> = (0..SIDES)
                .map(|k| {
                    let (s, c) = libm::sincos(std::f64::consts::TAU * f64::from(k) / f64::from(SIDES));
                    vertex(end + (u * c + v * s) * radius)
                })
                .collect();
            (vertex(end), ring)
        });
        let [(foot, low), (head, high)] = ends;
        for k in 0..SIDES as usize {
            let next = (k + 1) % SIDES as usize;
            piece.triangles.extend([
                [low[k], low[next], high[next]],
                [low[k], high[next], high[k]],
                [foot, low[next], low[k]],
                [head, high[k], high[next]],
            ]);
        }
        piece
    }
}

fn rgb(color: [f64; 3]) -> [u8; 3] {
    color.map(|c| c.round().clamp(0.0, 255.0) as u8)
}

impl Site for Surface<'_> {
    fn expected_triangles(&self) -> u64 {
        self.expected
    }

    fn spacing(&self) -> f64 {
        self.step
    }

    /// The blocks, and the bars at the end.
    fn slabs(&self, _tile: u32) -> u32 {
        self.blocks.x + 1
    }

    fn pieces(&self, _tile: u32, slab: u32) -> u32 {
        if slab == self.blocks.x { self.bars.len() as u32 } else { self.blocks.y * self.blocks.z }
    }

    fn piece(&self, _tile: u32, slab: u32, index: u32) -> Piece {
        if slab == self.blocks.x {
            return Self::bar(&self.bars[index as usize]);
        }
        self.block(UVec3::new(slab, index / self.blocks.z, index % self.blocks.z))
    }
}

/// A block being made: it owns the grid edges that start at its corners, and makes the vertices of all cells around them.
struct Block<'a> {
    surface: &'a Surface<'a>,
    slab: u32,
    first: IVec3,
    values: Vec<f64>,
    vertices: Vec<u32>,
    piece: Piece,
}

/// The slot of a corner or cell of a block, from -1 to 16 along each axis.
fn slot(l: IVec3) -> usize {
    (((l.x + 1) * SIDE + l.y + 1) * SIDE + l.z + 1) as usize
}

impl Block<'_> {
    fn run(&mut self) {
        for k in 0..SIDE * SIDE * SIDE {
            let l = IVec3::new(k / (SIDE * SIDE), k / SIDE % SIDE, k % SIDE) - 1;
            let value = self.surface.scene.value(self.surface.corner(self.first + l));
            self.values.push(if value == 0.0 { 1e-9 } else { value });
        }
        for k in 0..BLOCK * BLOCK * BLOCK {
            let l = IVec3::new(k / (BLOCK * BLOCK), k / BLOCK % BLOCK, k % BLOCK);
            for axis in [IVec3::X, IVec3::Y, IVec3::Z] {
                if (self.values[slot(l)] < 0.0) != (self.values[slot(l + axis)] < 0.0) {
                    self.quad(l, axis);
                }
            }
        }
    }

    /// The two triangles across the edge from a corner along an axis, where the grid goes on around it.
    fn quad(&mut self, corner: IVec3, axis: IVec3) {
        // The other two axes, in the order that makes a right-handed frame.
        let (u, v) = (IVec3::new(axis.z, axis.x, axis.y), IVec3::new(axis.y, axis.z, axis.x));
        let cells = [corner - u - v, corner - v, corner, corner - u];
        let whole = |cell: &IVec3| {
            let at = self.first + *cell;
            at.cmpge(IVec3::ZERO).all() && at.cmplt(self.surface.cells).all()
        };
        if !cells.iter().all(whole) {
            return;
        }
        let mut ring = cells.map(|cell| self.vertex(cell));
        if self.values[slot(corner)] >= 0.0 {
            ring.reverse();
        }
        let [a, b, c, d] = ring;
        let at = ring.map(|v| self.piece.vertices[v as usize].position);
        let halves = if at[0].distance_squared(at[2]) <= at[1].distance_squared(at[3]) {
            [[a, b, c], [a, c, d]]
        } else {
            [[a, b, d], [b, c, d]]
        };
        self.piece.triangles.extend(halves);
    }

    /// The vertex of a cell: the mean of the crossings of its edges, moved onto the surface along the mean slope.
    fn vertex(&mut self, cell: IVec3) -> u32 {
        let at = slot(cell);
        if self.vertices[at] != u32::MAX {
            return self.vertices[at];
        }
        let corner = |k: i32| IVec3::new(k & 1, k >> 1 & 1, k >> 2);
        let value: [f64; 8] = std::array::from_fn(|k| self.values[slot(cell + corner(k as i32))]);
        let (mut sum, mut count, mut slope) = (DVec3::ZERO, 0.0, DVec3::ZERO);
        for axis in 0..3 {
            for k in (0..8).filter(|k| k & (1 << axis) == 0) {
                let (a, b) = (value[k], value[k | 1 << axis]);
                slope[axis] += (b - a) / (4.0 * self.surface.step);
                if (a < 0.0) != (b < 0.0) {
                    let mut crossing = corner(k as i32).as_dvec3();
                    crossing[axis] = a / (a - b);
                    sum += crossing;
                    count += 1.0;
                }
            }
        }
        let scene = self.surface.scene;
        let low = self.surface.corner(self.first + cell);
        let mut p = low + sum / count * self.surface.step;
        let across = slope / slope.length_squared().max(0.09);
        for _ in 0..2 {
            let moved = p - across * scene.value(p);
            // Not quite to the side of the cell, where it could meet a neighbour's.
            p = moved.clamp(low + 0.02 * self.surface.step, low + 0.98 * self.surface.step);
        }
        let on_ground = scene.is_ground(p);
        let normal = slope.normalize_or(DVec3::Z);
        let color = rgb(scene.albedo(p, normal, on_ground));
        let border = cell.to_array().iter().any(|c| *c == -1 || *c == BLOCK - 1);
        let whole = (self.first + cell).to_array();
        let key = whole.iter().fold(0_u64, |key, c| key << 21 | (i64::from(*c) + 1) as u64 & 0x1f_ffff);
        let shared = border.then_some((key, self.slab + u32::from(cell.x == BLOCK - 1)));
        let index = self.piece.vertices.len() as u32;
        self.piece.vertices.push(Vertex { position: Scene::to_site(p), color, shared });
        self.vertices[at] = index;
        index
    }
}

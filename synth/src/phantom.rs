//! Phantoms: closed analytic solids whose lengths, areas and volumes are known, for tests of measuring.
//!
//! Each is the surface of a set of cells of an integer lattice, carried into space by a map: the boundary squares of
//! the set are cut into `detail` by `detail` quads. A vertex is known by its lattice point, so the surface closes
//! exactly; all are z up and oriented outward.
//!
//! | shape | analytic solid (metres) |
//! |---|---|
//! | cube | [0,1]^3 |
//! | ramp | wedge 2 long (x), 1 wide (y), rising 30 degrees: z from 0 to 2 tan 30 |
//! | cylinder | radius 2, height 4, axis z |
//! | sphere | radius 1, centre (0, 0, 1) |
//! | stepped wall | five steps of 0.4 x 0.25, 2 wide (y) |
//! | bent wall | a quarter ring, radii 2.75 to 3.25, height 2 |

use super::noise::{derive, hash3, normal, smooth};
use super::piece::{Piece, Site, Vertex};
use glam::{DVec3, I64Vec3, IVec3};
use std::cmp::Ordering;

/// Which phantom.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phantom {
    /// The unit cube.
    Cube,
    /// A wedge that rises at 30 degrees.
    Ramp,
    /// A cylinder of radius 2 and height 4.
    Cylinder,
    /// A sphere of radius 1.
    Sphere,
    /// A wall with five steps.
    SteppedWall,
    /// A wall along a quarter circle.
    BentWall,
}

impl Phantom {
    /// All phantoms.
    pub const ALL: [Self; 6] =
        [Self::Cube, Self::Ramp, Self::Cylinder, Self::Sphere, Self::SteppedWall, Self::BentWall];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cube => "cube",
            Self::Ramp => "ramp",
            Self::Cylinder => "cylinder",
            Self::Sphere => "sphere",
            Self::SteppedWall => "stepped-wall",
            Self::BentWall => "bent-wall",
        }
    }

    /// Volume of the analytic solid, in cubic metres.
    pub fn volume(self) -> f64 {
        match self {
            Self::Cube => 1.0,
            Self::Ramp => 0.5 * RAMP_LENGTH * ramp_height(),
            Self::Cylinder => std::f64::consts::PI * CYLINDER_RADIUS * CYLINDER_RADIUS * CYLINDER_HEIGHT,
            Self::Sphere => 4.0 / 3.0 * std::f64::consts::PI,
            Self::SteppedWall => STEP_WIDTH * 15.0 * STEP_RUN * STEP_RISE,
            Self::BentWall => BENT_ANGLE / 2.0 * (BENT_OUTER * BENT_OUTER - BENT_INNER * BENT_INNER) * BENT_HEIGHT,
        }
    }

    /// Surface area of the analytic solid, in square metres.
    pub fn area(self) -> f64 {
        let pi = std::f64::consts::PI;
        match self {
            Self::Cube => 6.0,
            Self::Ramp => {
                let h = ramp_height();
                RAMP_LENGTH + h + (RAMP_LENGTH * RAMP_LENGTH + h * h).sqrt() + RAMP_LENGTH * h
            }
            Self::Cylinder => 2.0 * pi * CYLINDER_RADIUS * (CYLINDER_RADIUS + CYLINDER_HEIGHT),
            Self::Sphere => 4.0 * pi,
            Self::SteppedWall => STEP_WIDTH * 2.0 * 5.0 * (STEP_RUN + STEP_RISE) + 2.0 * 15.0 * STEP_RUN * STEP_RISE,
            Self::BentWall => {
                let plan = BENT_ANGLE / 2.0 * (BENT_OUTER * BENT_OUTER - BENT_INNER * BENT_INNER);
                let faces = BENT_ANGLE * (BENT_OUTER + BENT_INNER) * BENT_HEIGHT;
                2.0 * plan + faces + 2.0 * (BENT_OUTER - BENT_INNER) * BENT_HEIGHT
            }
        }
    }
}

const RAMP_LENGTH: f64 = 2.0;
const CYLINDER_RADIUS: f64 = 2.0;
const CYLINDER_HEIGHT: f64 = 4.0;
const STEP_RUN: f64 = 0.4;
const STEP_RISE: f64 = 0.25;
const STEP_WIDTH: f64 = 2.0;
const BENT_INNER: f64 = 2.75;
const BENT_OUTER: f64 = 3.25;
const BENT_HEIGHT: f64 = 2.0;
const BENT_ANGLE: f64 = std::f64::consts::FRAC_PI_2;

fn ramp_height() -> f64 {
    RAMP_LENGTH / 3.0_f64.sqrt()
}

/// Rows of quads of a piece.
const ROWS_PER_PIECE: u32 = 64;

/// A square of the surface in lattice cells: its origin and the two edges, whose cross product points outward.
#[derive(Debug, Clone, Copy)]
struct Square {
    origin: IVec3,
    u: IVec3,
    v: IVec3,
    /// Only the half below the diagonal from the origin (the sides of the ramp).
    half: bool,
}

/// A phantom at one sampling density.
pub(super) struct Solid {
    shape: Phantom,
    seed: u64,
    /// Cells of the lattice along each axis.
    cells: IVec3,
    squares: Vec<Square>,
    detail: u32,
    tiles: u32,
    noise: f64,
}

impl Solid {
    /// A phantom of about `triangles` triangles.
    pub(super) fn new(shape: Phantom, triangles: u64, seed: u64, tiles: u32) -> Self {
        let cells = match shape {
            Phantom::Cube | Phantom::Sphere => [1, 1, 1],
            Phantom::Ramp => [2, 1, 2],
            Phantom::Cylinder => [3, 3, 4],
            Phantom::SteppedWall => [5, 5, 5],
            Phantom::BentWall => [10, 1, 4],
        };
        let cells = IVec3::from(cells);
        let mut solid =
            Self { shape, seed: derive(seed, 0x9a27), cells, squares: Vec::new(), detail: 1, tiles, noise: 0.0 };
        solid.squares = solid.boundary();
        let unit: u64 = solid.squares.iter().map(|s| if s.half { 1 } else { 2 }).sum();
        solid.detail = ((triangles as f64 / unit as f64).sqrt().round() as u32).max(1);
        solid
    }

    /// The same with noise of this standard deviation, metres, on each axis of every vertex.
    pub(super) fn with_noise(self, noise: f64) -> Self {
        Self { noise, ..self }
    }

    /// Strips of quads: what can go to different files.
    pub(super) fn strips(&self) -> u32 {
        self.squares.len() as u32 * self.strips_per_square()
    }

    fn strips_per_square(&self) -> u32 {
        self.detail.div_ceil(ROWS_PER_PIECE)
    }

    /// Whether a cell is inside; the ramp's cells on the diagonal are half inside.
    fn solid(&self, c: IVec3) -> bool {
        let inside = c.cmpge(IVec3::ZERO).all() && c.cmplt(self.cells).all();
        inside
            && match self.shape {
                Phantom::SteppedWall | Phantom::Ramp => c[2] <= c[0],
                _ => true,
            }
    }

    fn boundary(&self) -> Vec<Square> {
        let ramp = self.shape == Phantom::Ramp;
        let mut squares = Vec::new();
        for x in 0..self.cells.x {
            for y in 0..self.cells.y {
                for z in 0..self.cells.z {
                    let c = IVec3::new(x, y, z);
                    if !self.solid(c) {
                        continue;
                    }
                    let diagonal = ramp && x == z;
                    for axis in 0..3 {
                        for side in [0, 1] {
                            let mut next = c;
                            next[axis] += 2 * side - 1;
                            let cut = diagonal && ((axis == 0 && side == 0) || (axis == 2 && side == 1));
                            if !cut && !self.solid(next) {
                                squares.push(face(c, axis, side, diagonal && axis == 1));
                            }
                        }
                    }
                    if diagonal {
                        squares.push(Square { origin: c, u: IVec3::new(1, 0, 1), v: IVec3::Y, half: false });
                    }
                }
            }
        }
        squares
    }

    /// The point in space of a lattice point in units of `1 / detail` cells.
    fn place(&self, k: I64Vec3) -> DVec3 {
        let n = f64::from(self.detail);
        let s = k.as_dvec3() / (n * self.cells.as_dvec3());
        match self.shape {
            Phantom::Cube => s,
            Phantom::Ramp => DVec3::new(s.x * RAMP_LENGTH, s.y, s.z * ramp_height()),
            Phantom::SteppedWall => DVec3::new(s.x * 5.0 * STEP_RUN, s.y * STEP_WIDTH, s.z * 5.0 * STEP_RISE),
            Phantom::BentWall => {
                let angle = (1.0 - s.x) * BENT_ANGLE;
                let r = BENT_INNER + s.y * (BENT_OUTER - BENT_INNER);
                DVec3::new(r * libm::cos(angle), r * libm::sin(angle), s.z * BENT_HEIGHT)
            }
            Phantom::Cylinder => {
                let [x, y] = disc(2.0 * s.x - 1.0, 2.0 * s.y - 1.0);
                DVec3::new(x * CYLINDER_RADIUS, y * CYLINDER_RADIUS, s.z * CYLINDER_HEIGHT)
            }
            Phantom::Sphere => {
                // Equal angles along the cube's edges keep the triangles near one size.
                let q = s.map(|t| libm::tan((2.0 * t - 1.0) * std::f64::consts::FRAC_PI_4));
                let unit = q / q.length();
                unit.with_z(unit.z + 1.0)
            }
        }
    }

    fn color(&self, p: DVec3, k: I64Vec3) -> [u8; 3] {
        let band = |t: f64| (t * 4.0 + 1e-6).floor() as i64;
        let checker = (band(p[0]) + band(p[1]) + band(p[2])).rem_euclid(2) as f64;
        let height = smooth(0.0, 4.0, p[2]);
        let noise = 1.5 * normal(hash3(self.seed, k[0], k[1], k[2]));
        let grey = 150.0 + 14.0 * checker + noise;
        [grey + 22.0 * height, grey + 4.0 * height, grey - 14.0 * height].map(|c| c.round().clamp(0.0, 255.0) as u8)
    }

    fn vertex(&self, square: Square, i: u32, j: u32, outline: bool) -> Vertex {
        let [origin, u, v] = [square.origin, square.u, square.v].map(glam::IVec3::as_i64vec3);
        let k = origin * i64::from(self.detail) + u * i64::from(i) + v * i64::from(j);
        let place = self.place(k);
        let noise = [1, 2, 3].map(|axis| self.noise * normal(hash3(derive(self.seed, axis), k[0], k[1], k[2])));
        let position = place + DVec3::from(noise);
        let key = (k[0] as u64) << 42 | (k[1] as u64) << 21 | k[2] as u64;
        Vertex { position, color: self.color(place, k), shared: outline.then_some((key, u32::MAX)) }
    }

    /// First strip of a tile.
    fn first(&self, tile: u32) -> u32 {
        (u64::from(self.strips()) * u64::from(tile) / u64::from(self.tiles)) as u32
    }
}

/// The face of a cell towards `side` of `axis`.
fn face(cell: IVec3, axis: usize, side: i32, half: bool) -> Square {
    let (mut u, mut v, mut origin) = (IVec3::ZERO, IVec3::ZERO, cell);
    u[(axis + 1) % 3] = 1;
    v[(axis + 2) % 3] = 1;
    origin[axis] += side;
    if side == 0 {
        std::mem::swap(&mut u, &mut v);
    }
    Square { origin, u, v, half }
}

/// The square [-1,1]^2 onto the unit disc (elliptical mapping), exact on the outline up to rounding.
fn disc(x: f64, y: f64) -> [f64; 2] {
    [x * (1.0 - y * y / 2.0).sqrt(), y * (1.0 - x * x / 2.0).sqrt()]
}

impl Site for Solid {
    fn expected_triangles(&self) -> u64 {
        let unit: u64 = self.squares.iter().map(|s| if s.half { 1 } else { 2 }).sum();
        unit * u64::from(self.detail) * u64::from(self.detail)
    }

    fn spacing(&self) -> f64 {
        (self.shape.area() / (self.expected_triangles() as f64 / 2.0)).sqrt()
    }

    fn slabs(&self, _tile: u32) -> u32 {
        1
    }

    fn pieces(&self, tile: u32, _slab: u32) -> u32 {
        self.first(tile + 1) - self.first(tile)
    }

    fn piece(&self, tile: u32, _slab: u32, index: u32) -> Piece {
        let strip = self.first(tile) + index;
        let square = self.squares[(strip / self.strips_per_square()) as usize];
        let low = strip % self.strips_per_square() * ROWS_PER_PIECE;
        let (n, high) = (self.detail, (low + ROWS_PER_PIECE).min(self.detail));
        let mut piece = Piece::default();
        let stride = n + 1;
        let mut local: Vec<Option<u32>> = vec![None; (stride * (high - low + 1)) as usize];
        for j in low..high {
            for i in 0..n {
                let ring = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let kept = match (square.half, i.cmp(&j)) {
                    (false, _) => 4,
                    (true, Ordering::Equal) => 3,
                    // The half to keep lies on the side of the longer x, which is `u` or `v` by the face's side.
                    (true, order) => {
                        if (order == Ordering::Greater) == (square.u[0] == 1) {
                            4
                        } else {
                            0
                        }
                    }
                };
                if kept == 0 {
                    continue;
                }
                let mut corners = [0_u32; 4];
                for (corner, (i, j)) in corners.iter_mut().zip(ring) {
                    let slot = &mut local[((j - low) * stride + i) as usize];
                    *corner = *slot.get_or_insert(piece.vertices.len() as u32);
                    if *corner as usize == piece.vertices.len() {
                        let outline = i == 0 || i == n || j == low || j == high || (square.half && i == j);
                        piece.vertices.push(self.vertex(square, i, j, outline));
                    }
                }
                let [a, b, c, d] = corners;
                if kept == 3 {
                    piece.triangles.push(if square.u[0] == 1 { [a, b, c] } else { [a, c, d] });
                } else if shorter_ac(&piece, corners) {
                    piece.triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    piece.triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        piece
    }
}

fn shorter_ac(piece: &Piece, corners: [u32; 4]) -> bool {
    let [a, b, c, d] = corners.map(|v| piece.vertices[v as usize].position);
    a.distance_squared(c) <= b.distance_squared(d)
}

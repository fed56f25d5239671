//! The surface where the field is zero, brick by brick.

use super::backing::{Backing, Sample};
use super::cubes::{Cubes, EDGES, INSIDE};
use super::field::{BRICK, Brick, DISTANCE_LOG2, FULL, Field, Voxel};
use super::piece::INTENSITY_LOG2;
use super::{Piece, REACH, Variance};
use glam::{DVec3, IVec3};

/// The minimum distance of a vertex from the voxel centres that it lies between, so that no two vertices coincide.
const NEAREST: f64 = 1.0 / 64.0;
/// The minimum coverage of a vertex, relative to a plane; at a straight rim it is 0.5.
pub(super) const COVERAGE: f64 = 0.3;

/// Identifies a vertex: the lower voxel of its edge and the axis (0 to 2), or a cell and the number of a loop in it (3 and more).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EdgeKey {
    /// The voxel.
    pub at: [i32; 3],
    /// The axis.
    pub axis: u8,
}

/// A vertex of the merged surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchVertex {
    /// Its key.
    pub key: EdgeKey,
    /// Where, voxels.
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// sRGB, where a station has one.
    pub color: Option<[u8; 3]>,
    /// The mean, if a station has one.
    pub intensity: Option<f32>,
    /// The sum of the qualities of all stations, as a share of the best quality: see [`super::pieces`].
    pub quality: f64,
    /// Stations that contributed.
    pub stations: u16,
    /// The variance of a coordinate due to the stations, if known.
    pub variance: Option<Variance>,
    /// The level of the [`Backing`] that it rests on; `None` for the scans at their own voxels.
    pub backing: Option<u8>,
}

/// The surface of a brick.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patch {
    /// Vertices, also those on edges that other bricks have too.
    pub vertices: Vec<PatchVertex>,
    /// How many of the vertices belong to measured triangles; they come first.
    pub measured: usize,
    /// Measured triangles by vertices of this patch, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles that rest on the backing, with at least one vertex that no measured triangle has.
    pub filled: Vec<[u32; 3]>,
}

/// Voxels along an axis: a brick and the first of the next brick, which the last cells need.
const SIDE: i32 = BRICK + 1;
/// With one more on either side: the neighbours that decide the sign of voxels that no piece reaches.
const WIDE: i32 = SIDE + 2;
const COUNT: usize = (WIDE * WIDE * WIDE) as usize;

/// Distances at the voxels of a brick and around it, in voxels; NaN where no piece reaches.
struct Values([f32; COUNT]);

impl Values {
    /// The number of a voxel, relative to the first of the brick.
    fn index(at: IVec3) -> usize {
        (((at.z + 1) * WIDE + at.y + 1) * WIDE + at.x + 1) as usize
    }

    fn at(&self, at: IVec3) -> f32 {
        self.0[Self::index(at)]
    }

    /// Read the voxels from `low` to `high`, exclusive, for which `wanted` holds.
    fn read(&mut self, field: &Field, first: IVec3, low: i32, high: i32, wanted: impl Fn(IVec3) -> bool) {
        let home = first >> BRICK.ilog2();
        // The bricks around, by -1, 0 and 1 along each axis.
        let around: [Option<&Brick>; 27] = std::array::from_fn(|k| {
            let k = k as i32;
            field.brick(home + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))
        });
        for z in low..high {
            for y in low..high {
                for x in low..high {
                    let at = IVec3::new(x, y, z);
                    if !wanted(at) {
                        continue;
                    }
                    let which = (at >> BRICK.ilog2()) + 1;
                    if let Some(brick) = around[(which.x + 3 * which.y + 9 * which.z) as usize] {
                        self.0[Self::index(at)] = distance(brick.voxel(at));
                    }
                }
            }
        }
    }

    /// Give voxels that no piece reaches the truncation distance, with the sign of their neighbours if these agree.
    fn extended(&self) -> Self {
        let mut out = Self(self.0);
        for z in 0..SIDE {
            for y in 0..SIDE {
                for x in 0..SIDE {
                    let at = IVec3::new(x, y, z);
                    if self.at(at).is_nan() {
                        out.0[Self::index(at)] = self.side(at);
                    }
                }
            }
        }
        out
    }

    fn side(&self, at: IVec3) -> f32 {
        let (mut negative, mut positive) = (false, false);
        for axis in [IVec3::X, IVec3::Y, IVec3::Z] {
            for neighbour in [self.at(at - axis), self.at(at + axis)] {
                negative |= neighbour < 0.0;
                positive |= neighbour >= 0.0;
            }
        }
        match (negative, positive) {
            (true, false) => -REACH as f32,
            (false, true) => REACH as f32,
            _ => f32::NAN,
        }
    }
}

fn distance(voxel: &Voxel) -> f32 {
    if voxel.weight == 0 {
        return f32::NAN;
    }
    // Rounded to 1/2^DISTANCE_LOG2 voxel.
    let parts = (voxel.distance as f64 / voxel.weight as f64).round();
    parts as f32 / (1 << DISTANCE_LOG2) as f32
}

impl Field {
    /// The surface in the cells of a brick of the region, or nothing. Without a backing, nothing is filled; the measured part is the same with and without it.
    pub fn patch(&self, cubes: &Cubes, brick: IVec3, backing: Option<&Backing>) -> Option<Patch> {
        let first = brick * BRICK;
        let mut values = Values([f32::NAN; COUNT]);
        values.read(self, first, 0, SIDE, |_| true);
        let is_both = |values: &Values| values.0.iter().any(|d| *d < 0.0) && values.0.iter().any(|d| *d >= 0.0);
        let backing = backing.filter(|backing| backing.reaches(brick));
        if !is_both(&values) && backing.is_none() {
            return None;
        }
        let is_around = |at: IVec3| at.min_element() < 0 || at.max_element() >= SIDE;
        values.read(self, first, -1, SIDE + 1, is_around);
        let values = values.extended();
        let mut making = Making {
            field: self,
            backing: None,
            first,
            values,
            is_backed: [false; COUNT],
            slots: [u32::MAX; 3 * COUNT],
            patch: Patch::default(),
        };
        making.cells(cubes);
        making.patch.measured = making.patch.vertices.len();
        if let Some(backing) = backing
            && making.back(backing)
        {
            making.cells(cubes);
        }
        let patch = making.patch;
        (!patch.triangles.is_empty() || !patch.filled.is_empty()).then_some(patch)
    }
}

fn corner(bits: u8) -> IVec3 {
    IVec3::new(i32::from(bits & 1), i32::from(bits >> 1 & 1), i32::from(bits >> 2))
}

struct Making<'a> {
    field: &'a Field,
    /// In the second pass over the cells.
    backing: Option<&'a Backing>,
    first: IVec3,
    values: Values,
    /// Voxels whose distance is that of the backing.
    is_backed: [bool; COUNT],
    /// The vertex of each edge, by its lower voxel and axis.
    slots: [u32; 3 * COUNT],
    patch: Patch,
}

impl<'a> Making<'a> {
    /// Give voxels without a distance the distance of the backing. Returns whether there can then be a surface.
    fn back(&mut self, backing: &'a Backing) -> bool {
        let blocks = backing.blocks(self.first, SIDE - 1);
        let own = [self.values.0.iter().any(|d| *d < 0.0), self.values.0.iter().any(|d| *d >= 0.0)];
        let [negative, positive] =
            blocks.iter().fold(own, |[a, b], block| [a || block.signs()[0], b || block.signs()[1]]);
        if !(negative && positive) {
            return false;
        }
        self.backing = Some(backing);
        for at in (0..SIDE.pow(3)).map(|k| IVec3::new(k % SIDE, k / SIDE % SIDE, k / (SIDE * SIDE))) {
            if self.values.at(at).is_nan()
                && let Some(distance) = blocks.iter().map(|block| block.at(self.first + at)).find(|d| !d.is_nan())
            {
                self.values.0[Values::index(at)] = distance as f32;
                self.is_backed[Values::index(at)] = true;
            }
        }
        true
    }

    fn cells(&mut self, cubes: &Cubes) {
        for z in 0..BRICK {
            for y in 0..BRICK {
                for x in 0..BRICK {
                    self.cell(cubes, IVec3::new(x, y, z));
                }
            }
        }
    }

    fn cell(&mut self, cubes: &Cubes, cell: IVec3) {
        let mut case = 0;
        let mut is_backed = false;
        for bits in 0..8 {
            is_backed |= self.is_backed[Values::index(cell + corner(bits))];
            let distance = self.values.at(cell + corner(bits));
            if distance.is_nan() {
                return;
            }
            case |= u8::from(distance < 0.0) << bits;
        }
        for (number, part) in cubes.cases[usize::from(case)].iter().enumerate() {
            let mut crossings = Vec::with_capacity(part.edges.len() + 1);
            for edge in &part.edges {
                let Some(crossing) = self.crossing(cell, *edge) else { break };
                crossings.push(crossing);
            }
            // A loop is kept whole or dropped, so that each of its vertices has a single fan of triangles.
            if crossings.len() < part.edges.len() || !faces_scanners(&crossings) {
                continue;
            }
            let is_measured = !is_backed && crossings.iter().all(|vertex| vertex.backing.is_none());
            // The first pass made the measured triangles.
            if is_measured && self.backing.is_some() {
                continue;
            }
            if !is_measured {
                self.fill(cell, number, &crossings);
                continue;
            }
            if part.triangles.iter().flatten().any(|v| *v == INSIDE) {
                let key = EdgeKey { at: (self.first + cell).to_array(), axis: 3 + number as u8 };
                crossings.push(PatchVertex { key, ..middle(&crossings) });
            }
            let numbers: Vec<u32> = crossings.iter().map(|vertex| self.number(vertex)).collect();
            let place = |v: u8| {
                if v == INSIDE { part.edges.len() } else { part.edges.iter().position(|e| *e == v).unwrap_or_default() }
            };
            self.patch.triangles.extend(part.triangles.iter().map(|t| t.map(|v| numbers[place(v)])));
        }
    }

    /// A loop that rests on the backing, as a fan from its middle, so that each triangle has a vertex of its own.
    fn fill(&mut self, cell: IVec3, number: usize, crossings: &[PatchVertex]) {
        let key = EdgeKey { at: (self.first + cell).to_array(), axis: 3 + number as u8 };
        let backing =
            crossings.iter().filter_map(|vertex| vertex.backing).max().or(self.backing.map(Backing::first_level));
        let center =
            self.number(&PatchVertex { key, backing, quality: 0.0, stations: 0, variance: None, ..middle(crossings) });
        let numbers: Vec<u32> = crossings.iter().map(|vertex| self.number(vertex)).collect();
        let sides = numbers.iter().zip(numbers.iter().cycle().skip(1));
        self.patch.filled.extend(sides.map(|(a, b)| [*a, *b, center]));
    }

    fn number(&mut self, vertex: &PatchVertex) -> u32 {
        let key = vertex.key;
        let next = self.patch.vertices.len() as u32;
        if key.axis < 3 {
            let slot =
                &mut self.slots[3 * Values::index(IVec3::from_array(key.at) - self.first) + usize::from(key.axis)];
            if *slot != u32::MAX {
                return *slot;
            }
            *slot = next;
        }
        self.patch.vertices.push(*vertex);
        next
    }

    /// The vertex on an edge of a cell, if enough of a surface is there.
    fn crossing(&self, cell: IVec3, edge: u8) -> Option<PatchVertex> {
        let (low, axis) = EDGES[usize::from(edge)];
        let at = cell + corner(low);
        let step = corner(1 << axis);
        let [from, to] = [at, at + step].map(|at| f64::from(self.values.at(at)));
        let t = (from / (from - to)).clamp(NEAREST, 1.0 - NEAREST);
        // Rounded, so that positions lie on a lattice.
        let parts = f64::from(1 << DISTANCE_LOG2);
        let t = (t * parts).round() / parts;
        let place = self.first + at;
        let none = Voxel::default();
        let [a, b] = [place, place + step].map(|at| self.field.voxel(at).unwrap_or(&none));
        let mixed = |x: f64, y: f64| x * (1.0 - t) + y * t;
        let is_backed = [at, at + step].iter().any(|at| self.is_backed[Values::index(*at)]);
        if is_backed || mixed(a.coverage as f64, b.coverage as f64) < COVERAGE * FULL {
            let position = place.as_dvec3() + step.as_dvec3() * t;
            let sample = self.backing?.sample(position)?;
            return backed(EdgeKey { at: place.to_array(), axis }, position, &sample);
        }
        let normal = DVec3::from_array([0, 1, 2].map(|k| mixed(a.normal[k] as f64, b.normal[k] as f64)));
        let color_weight = mixed(a.color_weight as f64, b.color_weight as f64);
        let color = |k: usize| (mixed(a.color[k] as f64, b.color[k] as f64) / color_weight).round() as u8;
        let intensity_weight = mixed(a.intensity_weight as f64, b.intensity_weight as f64);
        let intensity =
            mixed(a.intensity as f64, b.intensity as f64) / intensity_weight / f64::from(1 << INTENSITY_LOG2);
        Some(PatchVertex {
            key: EdgeKey { at: place.to_array(), axis },
            position: place.as_dvec3() + step.as_dvec3() * t,
            normal: normal.try_normalize()?,
            color: (color_weight > 0.0).then(|| [color(0), color(1), color(2)]),
            intensity: (intensity_weight > 0.0).then_some(intensity as f32),
            quality: mixed(a.weight as f64, b.weight as f64) / (FULL / Piece::AREA_ONE * Piece::WEIGHT_ONE),
            stations: a.stations.max(b.stations),
            variance: self.variance([place, place + step], t),
            backing: None,
        })
    }

    /// The variance at a point between two voxels.
    fn variance(&self, places: [IVec3; 2], t: f64) -> Option<Variance> {
        let parts = places.into_iter().zip([1.0 - t, t]);
        Variance::mean(parts.filter_map(|(at, share)| {
            let (variance, weight) = self.field.variance(at)?;
            Some((variance, weight * share))
        }))
    }
}

/// A vertex that rests on the backing. It has no quality, because nothing was measured there.
fn backed(key: EdgeKey, position: DVec3, sample: &Sample) -> Option<PatchVertex> {
    let sums = &sample.sums;
    let color = (sums.color / sums.color_weight).round().to_array();
    let intensity = sums.intensity / sums.intensity_weight / f64::from(1 << INTENSITY_LOG2);
    Some(PatchVertex {
        key,
        position,
        normal: sums.normal.try_normalize()?,
        color: (sums.color_weight > 0.0).then(|| color.map(|c| c as u8)),
        intensity: (sums.intensity_weight > 0.0).then_some(intensity as f32),
        quality: 0.0,
        stations: 0,
        variance: None,
        backing: Some(sample.level),
    })
}

/// Whether a loop faces the side from which its surface was scanned. Between two layers the field changes back from negative to positive; that crossing is not a surface.
fn faces_scanners(vertices: &[PatchVertex]) -> bool {
    // Newell's normal of a polygon.
    let sides = vertices.iter().zip(vertices.iter().cycle().skip(1));
    let normal: DVec3 =
        sides.map(|(a, b)| (a.position - vertices[0].position).cross(b.position - vertices[0].position)).sum();
    let seen: DVec3 = vertices.iter().map(|v| v.normal).sum();
    normal.dot(seen) > 0.0
}

/// The vertex in the middle of a loop.
fn middle(vertices: &[PatchVertex]) -> PatchVertex {
    let count = vertices.len() as f64;
    let mean = |of: &dyn Fn(&PatchVertex) -> f64| vertices.iter().map(of).sum::<f64>() / count;
    let colors: Vec<[u8; 3]> = vertices.iter().filter_map(|v| v.color).collect();
    let color = |k: usize| (colors.iter().map(|c| u32::from(c[k])).sum::<u32>() / colors.len() as u32) as u8;
    let bright: Vec<f32> = vertices.iter().filter_map(|v| v.intensity).collect();
    PatchVertex {
        key: vertices[0].key,
        position: vertices.iter().map(|v| v.position).sum::<DVec3>() / count,
        normal: vertices.iter().map(|v| v.normal).sum::<DVec3>().normalize_or(vertices[0].normal),
        color: (!colors.is_empty()).then(|| [color(0), color(1), color(2)]),
        intensity: (!bright.is_empty()).then(|| bright.iter().sum::<f32>() / bright.len() as f32),
        quality: mean(&|v| v.quality),
        stations: vertices.iter().map(|v| v.stations).max().unwrap_or_default(),
        variance: Variance::mean(vertices.iter().filter_map(|v| Some((v.variance?, 1.0)))),
        backing: None,
    }
}

//! Where a tileset lies: the frame of its tiles, the grid that all their vertices are on, and the one transform at its root.
//!
//! All coordinates in tiles are whole multiples of one power of two, so that the offset of a tile and the positions in it add up without
//! rounding: a vertex has the same position, bit for bit, in every tile that it is in. Every vertex has at most 24 bits in its tile, which is
//! what a float holds, and what the exponential filter of meshopt holds.

use crate::extract::ExtractError;
use glam::{DMat3, DVec3, IVec3};
use kilwa_geometry::{Lattice, LatticePoint, Sphere};
use kilwa_pack::{Reader, Source};

/// Places world coordinates on the earth.
pub trait Earth: Sync {
    /// The geocentric coordinates (ECEF, EPSG:4978), in metres, of world coordinates in metres; `None` where there are none.
    fn geocentric(&self, world: DVec3) -> Option<DVec3>;
}

/// How far, in metres, an affine map may be from the exact one. Beyond it every vertex is converted by itself.
pub const AFFINE_RESIDUAL: f64 = 2e-4;
/// Exponent of the grid for vertices that are converted one by one, unless the lattice is finer or the model too wide: rounding moves them by less than a millimetre.
const CONVERTED: i32 = -10;
/// Steps of the grid that a tile can be wide: 24 bits with a sign.
const WIDEST: f64 = 16_777_214.0;
/// Exponents of the grid that the exponential filter holds, with room.
const EXPONENTS: std::ops::RangeInclusive<i32> = -100..=100;

/// The frame of the tiles; z is up.
pub(super) struct Frame<'a> {
    lattice: Lattice,
    map: Map<'a>,
    /// The grid has a spacing of 2^this metres.
    pub(super) grid_log2: i32,
    /// To the frame above, column by column.
    pub(super) transform: [f64; 16],
    /// No length in the lattice becomes longer than so many times its own, in metres.
    scale: f64,
    /// Largest distance between the affine map and the exact one, metres, if there is one.
    pub(super) residual: Option<f64>,
}

enum Map<'a> {
    /// Metres from this lattice point; coarser than the lattice by so many bits.
    Lattice { center: LatticePoint, coarser: u32 },
    /// East, north and up of a point on the earth.
    Curved { earth: &'a dyn Earth, origin: DVec3, geocentric_from_local: DMat3, normals: DMat3 },
}

impl<'a> Frame<'a> {
    /// The frame of a pack, on the earth if it has a place there.
    ///
    /// # Errors
    /// If the earth has no place for it, or if floats cannot hold it.
    pub(super) fn new<S: Source>(reader: &Reader<S>, earth: Option<&'a dyn Earth>) -> Result<Self, ExtractError> {
        let lattice = reader.header().lattice;
        let bounds = reader.entries().iter().fold(kilwa_geometry::Aabb::EMPTY, |all, e| all.union(&e.bounds));
        if bounds.is_empty() {
            return Err(ExtractError::Empty);
        }
        let center = bounds.min + (bounds.max - bounds.min) / 2;
        let samples = samples(&lattice, bounds.min, bounds.max);
        let median_edge = reader.metadata().median_edge;
        let Some(earth) = earth else {
            let place = DMat3::IDENTITY;
            return Self::on_lattice(
                lattice,
                center,
                &samples,
                median_edge,
                (place, lattice.world_from_lattice(center)),
            );
        };
        let exact = samples.map(|world| located(earth, world));
        let mut found = [DVec3::ZERO; 27];
        for (found, exact) in found.iter_mut().zip(exact) {
            *found = exact?;
        }
        let middle = lattice.world_from_lattice(center);
        let (origin, jacobian) = (located(earth, middle)?, jacobian(earth, middle, &samples)?);
        let affine = |world: DVec3| origin + jacobian * (world - middle);
        let residual = samples.iter().zip(&found).map(|(w, e)| affine(*w).distance(*e)).fold(0.0, f64::max);
        if residual <= AFFINE_RESIDUAL {
            let frame = Self::on_lattice(lattice, center, &samples, median_edge, (jacobian, origin))?;
            return Ok(Self { residual: Some(residual), ..frame });
        }
        let geocentric_from_local = east_north_up(earth, middle)?;
        let local = found.map(|e| geocentric_from_local.transpose() * (e - origin));
        // Two lattice points are at least a step apart: rounded to half a step they stay apart.
        let grid_log2 = grid((lattice.step_log2 - 1).min(CONVERTED), &local, median_edge)?;
        let normals = geocentric_from_local.transpose() * jacobian;
        Ok(Self {
            lattice,
            map: Map::Curved { earth, origin, geocentric_from_local, normals },
            grid_log2,
            transform: columns(geocentric_from_local, origin),
            scale: scale(earth, &samples)?,
            residual: None,
        })
    }

    fn on_lattice(
        lattice: Lattice,
        center: LatticePoint,
        samples: &[DVec3; 27],
        median_edge: f64,
        (linear, origin): (DMat3, DVec3),
    ) -> Result<Self, ExtractError> {
        let grid_log2 = grid(lattice.step_log2, samples, median_edge)?;
        let coarser = (grid_log2 - lattice.step_log2).unsigned_abs();
        let transform = columns(linear, origin);
        Ok(Self { lattice, map: Map::Lattice { center, coarser }, grid_log2, transform, scale: 1.0, residual: None })
    }

    /// The spacing of the grid, metres.
    pub(super) fn spacing(&self) -> f64 {
        libm::scalbn(1.0, self.grid_log2)
    }

    /// No length in the lattice becomes longer than so many times its own, in metres.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// Whether vertices are converted one by one.
    pub(super) fn is_curved(&self) -> bool {
        matches!(self.map, Map::Curved { .. })
    }

    /// Where a vertex lies on the grid.
    ///
    /// # Errors
    /// If it has no place on the earth.
    pub(super) fn point(&self, p: LatticePoint) -> Result<IVec3, ExtractError> {
        match &self.map {
            Map::Lattice { center, coarser: 0 } => Ok(p - *center),
            Map::Lattice { center, coarser } => {
                let half = 1i64 << (coarser - 1);
                Ok(((p - *center).as_i64vec3() + half).map(|x| x >> coarser).as_ivec3())
            }
            Map::Curved { .. } => {
                let local = self.local(self.lattice.world_from_lattice(p))?;
                Ok((local * libm::scalbn(1.0, -self.grid_log2)).round().as_ivec3())
            }
        }
    }

    /// The direction of a normal.
    pub(super) fn normal(&self, n: DVec3) -> DVec3 {
        match &self.map {
            Map::Lattice { .. } => n,
            Map::Curved { normals, .. } => (*normals * n).normalize_or(DVec3::Z),
        }
    }

    /// A ball in lattice units, in metres of the frame, round whatever vertices were in it.
    ///
    /// # Errors
    /// If its centre has no place on the earth.
    pub(super) fn sphere(&self, ball: &Sphere) -> Result<Sphere, ExtractError> {
        if ball.radius < 0.0 {
            return Ok(Sphere::EMPTY);
        }
        let center = match &self.map {
            Map::Lattice { center, .. } => (ball.center - center.as_dvec3()) * self.lattice.step(),
            Map::Curved { .. } => self.local(self.lattice.world_from_steps(ball.center))?,
        };
        // A vertex is rounded by at most half a spacing on each axis.
        Ok(Sphere { center, radius: ball.radius * self.lattice.step() * self.scale + self.spacing() })
    }

    fn local(&self, world: DVec3) -> Result<DVec3, ExtractError> {
        match &self.map {
            Map::Lattice { center, .. } => Ok(world - self.lattice.world_from_lattice(*center)),
            Map::Curved { earth, origin, geocentric_from_local, .. } => {
                Ok(geocentric_from_local.transpose() * (located(*earth, world)? - *origin))
            }
        }
    }
}

/// The corners of a box in world coordinates, and the points half way between them.
fn samples(lattice: &Lattice, min: LatticePoint, max: LatticePoint) -> [DVec3; 27] {
    let (min, max) = (lattice.world_from_lattice(min), lattice.world_from_lattice(max));
    std::array::from_fn(|i| {
        let part = DVec3::new((i % 3) as f64, (i / 3 % 3) as f64, (i / 9) as f64) / 2.0;
        min + (max - min) * part
    })
}

fn located(earth: &dyn Earth, world: DVec3) -> Result<DVec3, ExtractError> {
    earth.geocentric(world).filter(|found| found.is_finite()).ok_or(ExtractError::NoPlace { world })
}

/// Derivatives of the geocentric coordinates, from differences across the model.
fn jacobian(earth: &dyn Earth, at: DVec3, samples: &[DVec3; 27]) -> Result<DMat3, ExtractError> {
    let half = ((samples[26] - samples[0]) / 2.0).max(DVec3::ONE);
    let mut columns = [DVec3::ZERO; 3];
    for (axis, column) in columns.iter_mut().enumerate() {
        let mut step = DVec3::ZERO;
        step[axis] = half[axis];
        *column = (located(earth, at + step)? - located(earth, at - step)?) / (2.0 * half[axis]);
    }
    Ok(DMat3::from_cols(columns[0], columns[1], columns[2]))
}

/// By how much lengths grow at most: of the derivatives at samples, and a ten-thousandth more.
fn scale(earth: &dyn Earth, samples: &[DVec3; 27]) -> Result<f64, ExtractError> {
    let mut largest = 0.0f64;
    for at in samples {
        let j = jacobian(earth, *at, &[*at; 27])?;
        let square = j.transpose() * j;
        // No eigenvalue is larger than the largest sum of a column (Gershgorin).
        let sums = [square.x_axis, square.y_axis, square.z_axis].map(|c| c.abs().element_sum());
        largest = sums.into_iter().fold(largest, f64::max);
    }
    Ok(libm::sqrt(largest) * 1.0001)
}

/// East, north and up at a place, as columns.
fn east_north_up(earth: &dyn Earth, at: DVec3) -> Result<DMat3, ExtractError> {
    let up = (located(earth, at + 100.0 * DVec3::Z)? - located(earth, at - 100.0 * DVec3::Z)?).normalize_or(DVec3::Z);
    let east = DVec3::Z.cross(up).normalize_or(DVec3::Y);
    Ok(DMat3::from_cols(east, up.cross(east), up))
}

fn columns(linear: DMat3, origin: DVec3) -> [f64; 16] {
    let mut all = [0.0; 16];
    for (i, column) in [linear.x_axis, linear.y_axis, linear.z_axis, origin].into_iter().enumerate() {
        all[4 * i..4 * i + 3].copy_from_slice(&column.to_array());
    }
    all[15] = 1.0;
    all
}

/// The exponent of the grid: `finest`, or coarser in a model that would be too wide for it.
fn grid(finest: i32, points: &[DVec3; 27], median_edge: f64) -> Result<i32, ExtractError> {
    let min = points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let max = points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    // On the earth, straight edges of the box bulge between the samples.
    let wide = (max - min).max_element() * 1.01;
    let mut grid_log2 = finest;
    while wide > WIDEST * libm::scalbn(1.0, grid_log2) && grid_log2 < *EXPONENTS.end() {
        grid_log2 += 1;
    }
    let refused = |why: String| Err(ExtractError::Numbers(why));
    if !EXPONENTS.contains(&grid_log2) || !wide.is_finite() {
        return refused(format!(
            "3D Tiles cannot store coordinates with a spacing of 2^{grid_log2} m; build the pack again with another --step"
        ));
    }
    let spacing = libm::scalbn(1.0, grid_log2);
    if grid_log2 > finest && spacing > median_edge * 0.5 {
        return refused(format!(
            "the model is {wide:.0} m wide: 32-bit floats would round it to {spacing} m, which is more than half its median edge of {median_edge} m; \
             build packs of parts of it (kilwa build --crop)"
        ));
    }
    Ok(grid_log2)
}

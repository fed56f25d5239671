//! The sums at voxels, in bricks that are allocated only where there are pieces.

use super::sigma::{Sigma, Sums, Variance};
use super::{Piece, REACH, SIDE, SUB_LOG2};
use glam::{IVec3, Vec4};

/// Voxels along the edge of a brick.
pub const BRICK: i32 = 8;
const BRICK_LOG2: u32 = BRICK.trailing_zeros();
const VOXELS: usize = (BRICK * BRICK * BRICK) as usize;

/// Fixed-point scale of distances: 2^10 is one voxel.
pub(super) const DISTANCE_LOG2: u32 = 10;
/// Fixed-point scale of kernels: 2^10 is 1.
const KERNEL_LOG2: u32 = 10;
/// The reach of a piece along any axis, in 1/2^SUB_LOG2 voxel: `hypot(REACH, SIDE)`.
const BOX: i32 = (2.5 * (1 << SUB_LOG2) as f64) as i32;

/// The sums at a voxel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Voxel {
    /// Weighted distances, positive outside.
    pub(super) distance: i64,
    pub(super) weight: u64,
    /// Weighted normals.
    pub(super) normal: [i64; 3],
    pub(super) color: [u64; 3],
    pub(super) color_weight: u64,
    pub(super) intensity: i128,
    pub(super) intensity_weight: u64,
    /// Area of the pieces around, by the lateral kernel and without quality: [`FULL`] where one station sampled the whole surface.
    pub(super) coverage: u64,
    /// Stations that added something.
    pub(super) stations: u16,
    /// The last station that contributed, counted from 1; 0 for none.
    last: u16,
}

/// The coverage of a voxel at a plane: the integral of the kernel to the side, `π SIDE² / 3`.
pub(super) const FULL: f64 = std::f64::consts::PI * SIDE * SIDE / 3.0 * (1 << KERNEL_LOG2) as f64 * Piece::AREA_ONE;

pub(super) struct Brick {
    voxels: Box<[Voxel; VOXELS]>,
    /// Present only if the uncertainties of the stations are known.
    sigmas: Option<Box<[Sums; VOXELS]>>,
}

impl Brick {
    fn new(has_sigmas: bool) -> Self {
        Self { voxels: boxed(), sigmas: has_sigmas.then(boxed) }
    }

    /// A voxel by its coordinates in the field.
    pub(super) fn voxel(&self, at: IVec3) -> &Voxel {
        &self.voxels[inner(at)]
    }
}

/// Allocated directly on the heap, because a brick does not fit on the stack of a thread.
fn boxed<T: Clone + Default>() -> Box<[T; VOXELS]> {
    let all = vec![T::default(); VOXELS].into_boxed_slice();
    all.try_into().unwrap_or_else(|_| unreachable!("of that length"))
}

/// A cube of bricks: the voxels from `min`, `bricks` times [`BRICK`] along each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// The first brick.
    pub min: IVec3,
    /// Bricks along each axis.
    pub bricks: i32,
}

impl Region {
    /// Whether a piece matters to the surface of the region, which depends on pieces up to `margin` voxels outside it: [`MARGIN`], or, with coarser voxels in the
    /// [`Backing`](super::Backing), [`MARGIN`] of the coarsest.
    pub fn needs(&self, piece: &Piece, margin: i32) -> bool {
        let low = (self.min * BRICK - margin) << SUB_LOG2;
        let high = ((self.min + self.bricks) * BRICK + margin) << SUB_LOG2;
        piece.at.cmpge(low).all() && piece.at.cmplt(high).all()
    }
}

/// The field in a region and one brick around it, where the sums are incomplete beyond [`MARGIN`](super::MARGIN).
pub struct Field {
    /// The first brick that may have sums, and how many there are along each axis.
    base: IVec3,
    side: i32,
    bricks: Vec<Option<Brick>>,
    count: usize,
}

impl Field {
    /// Bytes of a brick; `has_sigmas`: whether the uncertainties of the stations are known.
    pub const fn brick_bytes(has_sigmas: bool) -> usize {
        VOXELS * (size_of::<Voxel>() + if has_sigmas { size_of::<Sums>() } else { 0 })
    }

    /// An empty field.
    pub fn new(region: Region) -> Self {
        let side = region.bricks + 2;
        let bricks = (0..side * side * side).map(|_| None).collect();
        Self { base: region.min - 1, side, bricks, count: 0 }
    }

    /// Bricks that have sums.
    pub fn bricks(&self) -> usize {
        self.count
    }

    fn index(&self, brick: IVec3) -> Option<usize> {
        let at = brick - self.base;
        let is_in = at.cmpge(IVec3::ZERO).all() && at.cmplt(IVec3::splat(self.side)).all();
        is_in.then(|| ((at.z * self.side + at.y) * self.side + at.x) as usize)
    }

    pub(super) fn brick(&self, brick: IVec3) -> Option<&Brick> {
        self.bricks[self.index(brick)?].as_ref()
    }

    pub(super) fn voxel(&self, at: IVec3) -> Option<&Voxel> {
        Some(self.brick(at >> BRICK_LOG2)?.voxel(at))
    }

    /// The variance of the surface at a voxel, with the weight of the voxel; `None` if it is not known, or if the voxel has no weight.
    pub(super) fn variance(&self, at: IVec3) -> Option<(Variance, f64)> {
        let brick = self.brick(at >> BRICK_LOG2)?;
        let weight = brick.voxel(at).weight;
        let sums = brick.sigmas.as_ref().filter(|_| weight > 0)?[inner(at)];
        Some((sums.variance(weight), weight as f64))
    }

    /// Add a piece of a station, counted from 1. All pieces of a station must be added consecutively, because each voxel counts its stations. `sigma` is the
    /// uncertainty of the station there; it must be known for all pieces of a field or for none.
    pub fn add(&mut self, station: u16, piece: &Piece, sigma: Option<Sigma>) {
        let unit = 1 << SUB_LOG2;
        let low = (piece.at - BOX + (unit - 1)) >> SUB_LOG2;
        let high = (piece.at + BOX) >> SUB_LOG2;
        let (first, last) = (low >> BRICK_LOG2, high >> BRICK_LOG2);
        // At most two along each axis.
        let mut places = [None; 8];
        for (k, place) in places.iter_mut().enumerate() {
            let k = k as i32;
            let brick = first + IVec3::new(k & 1, k >> 1 & 1, k >> 2);
            if brick.cmple(last).all() {
                *place = self.index(brick);
            }
        }
        let normal = piece.normal.map(f32::from);
        let dx = low.x * unit - piece.at.x;
        for z in low.z..=high.z {
            let dz = (z * unit - piece.at.z) as f32;
            for y in low.y..=high.y {
                let dy = (y * unit - piece.at.y) as f32;
                let Some((along, kernels)) = row(normal, dx as f32, dy, dz) else { continue };
                for (x, (along, kernels)) in (low.x..=high.x).zip(along.into_iter().zip(kernels)) {
                    if kernels[0] == 0 {
                        continue;
                    }
                    let at = IVec3::new(x, y, z);
                    let which = (at >> BRICK_LOG2) - first;
                    let Some(index) = places[(which.x | which.y << 1 | which.z << 2) as usize] else { continue };
                    let brick = self.bricks[index].get_or_insert_with(|| {
                        self.count += 1;
                        Brick::new(sigma.is_some())
                    });
                    let known = brick.sigmas.as_mut().zip(sigma);
                    let known = known.map(|(sums, sigma)| (&mut sums[inner(at)], sigma));
                    add(&mut brick.voxels[inner(at)], station, piece, along, kernels, known);
                }
            }
        }
    }
}

/// Voxels of a row that are computed at once; a piece reaches at most six.
const ROW: usize = 8;

/// For a row of voxels that begins at `dx`, `dy`, `dz` from a piece: the distances from its plane, and the kernels to the side, and of both; `None` where
/// it reaches none of them.
///
/// Products and sums of 32-bit floats have the same results on every machine; their operands are whole numbers that depend on the piece and the voxel alone.
fn row([nx, ny, nz]: [f32; 3], dx: f32, dy: f32, dz: f32) -> Option<([i32; ROW], [[u32; 2]; ROW])> {
    const UNIT: f32 = (1 << SUB_LOG2) as f32;
    let square = dy * dy + dz * dz;
    if square > ((REACH * REACH + SIDE * SIDE) as f32) * UNIT * UNIT {
        return None;
    }
    let to_plane = ny * dy + nz * dz;
    let (mut along, mut kernels) = ([0; ROW], [[0; 2]; ROW]);
    let mut any = 0;
    for half in 0..2 {
        let dx = Vec4::splat(dx) + Vec4::new(0.0, UNIT, 2.0 * UNIT, 3.0 * UNIT) + 4.0 * half as f32 * UNIT;
        let distance = (dx * nx + to_plane) * (1.0 / (Piece::NORMAL_ONE as f32 * UNIT));
        let far = distance * distance;
        let reach = (Vec4::ONE - far * (1.0 / (REACH * REACH) as f32)).max(Vec4::ZERO);
        let beside = ((dx * dx + square) * (1.0 / (UNIT * UNIT)) - far).max(Vec4::ZERO);
        let near = (Vec4::ONE - beside * (1.0 / (SIDE * SIDE) as f32)).max(Vec4::ZERO);
        let near = near * near;
        let side = whole(near * (1 << KERNEL_LOG2) as f32);
        let both = whole(near * (reach * reach) * (1 << KERNEL_LOG2) as f32);
        let distance = whole(distance * (1 << DISTANCE_LOG2) as f32);
        let is_reached = reach.cmpgt(Vec4::ZERO);
        for k in 0..4 {
            along[4 * half + k] = distance[k];
            // Beyond the reach there is no coverage either.
            kernels[4 * half + k] =
                if is_reached.test(k) { [side[k].cast_unsigned(), both[k].cast_unsigned()] } else { [0; 2] };
            any |= kernels[4 * half + k][0];
        }
    }
    (any > 0).then_some((along, kernels))
}

/// Round to integers below 2²² by adding a float whose unit in the last place is 1.
fn whole(v: Vec4) -> [i32; 4] {
    const LARGE: f32 = 12_582_912.0;
    (v + LARGE).to_array().map(|v| v.to_bits().cast_signed().wrapping_sub(LARGE.to_bits().cast_signed()))
}

fn inner(at: IVec3) -> usize {
    let at = at & (BRICK - 1);
    ((at.z * BRICK + at.y) * BRICK + at.x) as usize
}

fn add(
    voxel: &mut Voxel,
    station: u16,
    piece: &Piece,
    along: i32,
    [side, both]: [u32; 2],
    known: Option<(&mut Sums, Sigma)>,
) {
    let weight = u64::from(piece.weight) * u64::from(both);
    voxel.coverage += u64::from(piece.area) * u64::from(side);
    if weight == 0 {
        return;
    }
    voxel.distance += i64::from(along) * weight as i64;
    voxel.weight += weight;
    for (sum, n) in voxel.normal.iter_mut().zip(piece.normal) {
        *sum += i64::from(n >> 4) * weight as i64;
    }
    if piece.has & Piece::HAS_COLOR != 0 {
        for (sum, c) in voxel.color.iter_mut().zip(piece.color) {
            *sum += u64::from(c) * weight;
        }
        voxel.color_weight += weight;
    }
    if piece.has & Piece::HAS_INTENSITY != 0 {
        voxel.intensity += i128::from(piece.intensity) * i128::from(weight);
        voxel.intensity_weight += weight;
    }
    if let Some((sums, sigma)) = known {
        sums.add(sigma, weight, voxel.last != station);
    }
    if voxel.last != station {
        voxel.last = station;
        voxel.stations += 1;
    }
}

//! A point on the lattice, as it lies in scratch files.

use super::{Placement, Point};
use glam::{DVec3, IVec3};
use kilwa_geometry::normal;
use kilwa_pack::chunk::splat::{self, MIN_RADIUS};

/// Bytes of a [`Splat`].
pub(super) const BYTES: usize = size_of::<Splat>();
/// Bits that a coordinate of a normal keeps at most: a degree and a half, less than the noise of a scan leaves.
pub(super) const NORMAL_BITS: u8 = 7;
/// Bits of the mantissa that an intensity keeps.
const INTENSITY_BITS: u32 = 7;
/// A radius that is to be found out.
const UNKNOWN: u8 = 0;

/// A point on the lattice.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Splat {
    pub(super) position: [i32; 3],
    pub(super) intensity: f32,
    /// Lattice units: no place of a finest splat that this one stands for is farther from its centre.
    pub(super) reach: f32,
    pub(super) normal: [i16; 2],
    pub(super) color: [u8; 3],
    /// Code of the radius; 0 where that is to be found out.
    pub(super) radius: u8,
}

impl Splat {
    /// `None` for a point outside of the lattice.
    pub(super) fn new(point: &Point, place: &Placement, normal_bits: u8) -> Option<Self> {
        let position = place.lattice.snap(point.position)?;
        let cube = 1i64 << place.cube_log2;
        if position.to_array().iter().any(|&x| i64::from(x) >= cube) {
            return None;
        }
        let steps = f64::from(point.spacing) / place.lattice.step();
        let radius = if steps > 0.0 { splat::code_of(steps).min(place.largest) } else { UNKNOWN };
        let mut splat = Self {
            position: position.to_array(),
            intensity: rounded(point.intensity),
            reach: 0.0,
            normal: normal_of(point.normal.as_dvec3(), normal_bits),
            color: point.color,
            radius,
        };
        splat.be_finest();
        Some(splat)
    }

    /// Of the finest level: it stands for itself.
    pub(super) fn be_finest(&mut self) {
        // Corners are rounded by less than a step.
        self.reach = (splat::radius(self.radius.max(MIN_RADIUS)) + 1.0) as f32;
    }

    /// Whether its radius is to be found out.
    pub(super) fn is_unknown(&self) -> bool {
        self.radius == UNKNOWN
    }

    pub(super) fn center(&self) -> IVec3 {
        self.position.into()
    }

    /// Place along Morton's curve, x before y before z.
    pub(super) fn code(&self) -> u128 {
        let [x, y, z] = self.position.map(|x| spread(x.cast_unsigned()));
        x << 2 | y << 1 | z
    }

    /// All values, for an order that depends on nothing else.
    pub(super) fn key(&self) -> (u128, u8, [u8; 3], [i16; 2], u32) {
        // Of two at one place, one whose radius is known comes first.
        (self.code(), self.radius.wrapping_sub(1), self.color, self.normal, self.intensity.to_bits())
    }
}

/// 30 bits with two zeros between each.
fn spread(x: u32) -> u128 {
    let third = |x: u32| {
        // 16 bits to 46.
        let mut x = u64::from(x);
        x = (x | x << 16) & 0x00ff_0000_ff00_00ff;
        x = (x | x << 8) & 0xf00f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x30c3_0c30_c30c_30c3;
        (x | x << 2) & 0x9249_2492_4924_9249
    };
    u128::from(third(x & 0x7fff)) | u128::from(third(x >> 15)) << 45
}

/// An octahedral normal that ends in zeros.
pub(super) fn normal_of(n: DVec3, bits: u8) -> [i16; 2] {
    let dropped = 16 - u32::from(bits.min(NORMAL_BITS));
    let largest = (i32::from(i16::MAX) >> dropped) << dropped;
    normal::encode(n).map(|x| {
        let rounded = (i32::from(x) + (1 << (dropped - 1))) >> dropped << dropped;
        rounded.clamp(-largest, largest) as i16
    })
}

/// A number with fewer bits.
pub(super) fn rounded(x: f32) -> f32 {
    let dropped = 23 - INTENSITY_BITS;
    if x.is_nan() {
        return f32::NAN;
    }
    let x = x.clamp(f32::MIN, f32::MAX);
    let cut = |bits: u32| f32::from_bits(bits >> dropped << dropped);
    let near = cut(x.to_bits() + (1 << (dropped - 1)));
    if near.is_finite() { near } else { cut(x.to_bits()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_interleaved_bits() {
        let mut random = fastrand::Rng::with_seed(1);
        for _ in 0..1000 {
            let [a, b] = [0; 2].map(|_| [0; 3].map(|_| random.i32(0..1 << 30)));
            let of = |position| Splat { position, ..bytemuck::Zeroable::zeroed() };
            assert_eq!(of(a).code() < of(b).code(), splat::is_before(a.into(), b.into()));
        }
        let all = Splat { position: [(1 << 30) - 1; 3], ..bytemuck::Zeroable::zeroed() };
        assert_eq!(all.code(), (1 << 90) - 1);
    }

    #[test]
    fn rounded_normals_and_intensities_are_near_and_end_in_zeros() {
        let mut random = fastrand::Rng::with_seed(2);
        for _ in 0..1000 {
            let n = DVec3::from([0; 3].map(|_| random.f64() - 0.5)).normalize();
            let back = normal_of(n, 10);
            assert!(
                normal::decode(back).dot(n) > 2.4f64.to_radians().cos() && back.iter().all(|x| x.trailing_zeros() >= 9)
            );
            let x = random.f32() * 5000.0 - 2000.0;
            assert!((rounded(x) - x).abs() <= x.abs() / 200.0);
        }
        assert!(rounded(f32::NAN).is_nan());
        for x in [f32::MAX, f32::MIN, f32::INFINITY, -f32::INFINITY] {
            assert!(rounded(x).is_finite() && rounded(x).signum() == x.signum());
        }
    }
}

//! Normals: predicted from the geometry that is known by then, the residuals coded. FORMAT section 5.18.

use super::super::attributes::{quantize, round_to, unquantize};
use super::super::border::{Connectivity, Placed};
use super::super::payload::ends_of;
use super::fit;
use super::rans::Coder;
use super::tables::{Line, TABLES, quarter_octave};
use super::values::Grains;
use kilwa_geometry::normal::OctNormal;
use kilwa_geometry::{LatticePoint, Mesh};

/// Largest residual that is remembered.
const LARGEST: u32 = 1 << 22;
/// Kinds of vertices.
pub(super) const KINDS: usize = 4;

/// A normal came out of range, which no encoder writes.
pub(super) struct OutOfRange;

/// All that is fitted to the normals of a chunk: for each kind of vertex the line of the first coordinate, and whether any
/// prediction fails; the line of the second coordinate.
#[derive(Clone, Copy, Default)]
pub(super) struct Fitted {
    fails: [bool; KINDS],
    first: [Line; KINDS],
    second: Line,
}

impl Fitted {
    /// As it is stored.
    pub(super) fn code(mut self, coder: &mut impl Coder) -> Self {
        for (fails, line) in self.fails.iter_mut().zip(&mut self.first) {
            *fails = coder.raw32(1, u32::from(*fails)) == 1;
            if *fails {
                *line = line.code(coder);
            }
        }
        if self.fails.contains(&true) {
            self.second = self.second.code(coder);
        }
        self
    }
}

/// Residuals that a dry run has met.
#[derive(Default)]
pub(super) struct SeenNormals {
    first: [fit::Seen; KINDS],
    second: fit::Seen,
    fails: [bool; KINDS],
}

impl SeenNormals {
    pub(super) fn fit(&mut self) -> Fitted {
        let mut fitted = Fitted { fails: self.fails, second: self.second.best(), ..Fitted::default() };
        for ((line, seen), _) in
            fitted.first.iter_mut().zip(&mut self.first).zip(self.fails).filter(|(_, fails)| *fails)
        {
            *line = seen.best();
        }
        fitted
    }

    /// A dry run codes as if every kind had residuals.
    pub(super) fn all() -> Fitted {
        Fitted { fails: [true; KINDS], ..Fitted::default() }
    }
}

/// Normals of so many bits, beside those predicted.
pub(super) struct Normals<'a> {
    pub(super) bits: u8,
    pub(super) predicted: &'a [Predicted],
    /// Of the positions.
    pub(super) grains: &'a [u8],
    pub(super) wanted: Option<&'a [u8]>,
    pub(super) fitted: Fitted,
}

impl Normals<'_> {
    #[inline(never)]
    pub(super) fn code<C: Coder>(
        &self,
        coder: &mut C,
        values: &mut [OctNormal],
        seen: &mut SeenNormals,
    ) -> Result<(), OutOfRange> {
        let bits = self.bits;
        let Fitted { fails, first, second } = self.fitted;
        let any = fails.contains(&true);
        let any_grain = any && coder.raw32(1, u32::from(self.wanted.is_some())) == 1;
        let mut grains = Grains::new(any_grain);
        let mut recent = [0u32; KINDS];
        let levels = Levels::new(bits);
        for (v, (value, predicted)) in values.iter_mut().zip(self.predicted).enumerate() {
            let kind = usize::from(predicted.kind) % KINDS;
            let level = predicted.normal.map(|x| quantize(x, bits));
            if C::DRY
                && value.map(|x| quantize(x, bits)) != level
                && let Some(fails) = seen.fails.get_mut(kind)
            {
                *fails = true;
            }
            if fails.get(kind) != Some(&true) {
                *value = levels.normal(level)?;
                continue;
            }
            let (Some(first), Some(recent)) = (first.get(kind), recent.get_mut(kind)) else { return Err(OutOfRange) };
            let near = self.grains.get(v).copied().unwrap_or(0);
            let grain = grains.code(coder, near, self.wanted.and_then(|w| w.get(v)).copied().unwrap_or(0));
            let p = level.map(|x| round_to(x, grain));
            let [wu, wv] = value.map(|x| quantize(x, bits) >> grain);
            let t = quarter_octave(*recent >> grain);
            let scale = first.scale(t);
            let u = TABLES.one(coder, 0, scale, wu.wrapping_sub(p[0]));
            let size = u.unsigned_abs().min(LARGEST);
            let of_second = quarter_octave((2 * size + (*recent >> grain)) >> 1);
            let scale = second.scale(of_second);
            let w = TABLES.one(coder, 1, scale, wv.wrapping_sub(p[1]));
            if C::DRY {
                if let Some(seen) = seen.first.get_mut(kind) {
                    seen.add(t, u);
                }
                seen.second.add(of_second, w);
            }
            let size = (size + w.unsigned_abs().min(LARGEST)).min(LARGEST) << grain.min(8);
            *recent = *recent - *recent / 4 + size / 4;
            *value = levels.normal([p[0].wrapping_add(u) << grain, p[1].wrapping_add(w) << grain])?;
        }
        Ok(())
    }
}

/// The coordinates of levels of so many bits: those that few bits have are made once, because each takes a division.
struct Levels {
    bits: u8,
    of: Vec<i16>,
}

impl Levels {
    fn new(bits: u8) -> Self {
        let most = if bits <= 11 { (1 << (bits - 1)) - 1 } else { -1 };
        Self { bits, of: (0..=most).filter_map(|level| unquantize(level, bits)).collect() }
    }

    #[inline]
    fn coordinate(&self, level: i32) -> Result<i16, OutOfRange> {
        if let Some(&known) = self.of.get(level.unsigned_abs() as usize) {
            // Without a branch: signs cannot be foreseen.
            let mask = (level >> 31) as i16;
            return Ok((known ^ mask).wrapping_sub(mask));
        }
        unquantize(level, self.bits).ok_or(OutOfRange)
    }

    #[inline]
    fn normal(&self, [u, v]: [i32; 2]) -> Result<OctNormal, OutOfRange> {
        Ok([self.coordinate(u)?, self.coordinate(v)?])
    }
}

/// A predicted normal, and the kind of its vertex, below [`KINDS`].
#[derive(Clone, Copy)]
pub(super) struct Predicted {
    normal: OctNormal,
    kind: u8,
}

/// Accumulated over the triangles of a vertex.
#[derive(Clone, Copy)]
struct Seen {
    sum: [i64; 3],
    /// The patch of its first triangle.
    patch: u32,
    kind: u8,
}

/// Predict all normals from the chunk's own triangles: the sum of the cross products at each vertex, in whole numbers modulo
/// 2^64, as octahedral coordinates. Chunk borders see only their own side.
///
/// Bit 0 of a kind is set beside a patch that is not of the finest level, as `coarse` says of each patch; bit 1 where the chunk
/// sees only one side, and at coarse vertices that several patches share: these are given the mean of the finer normals, because
/// another chunk may hold one of the patches without the other.
#[inline(never)]
pub(super) fn predicted(mesh: &Mesh, made: &Connectivity, coarse: &[bool]) -> Vec<Predicted> {
    let new = |_: &LatticePoint| Seen { sum: [0; 3], patch: u32::MAX, kind: 0 };
    let mut seen: Vec<Seen> = mesh.positions.iter().map(new).collect();
    let at = |v: u32| mesh.positions.get(v as usize).map_or([0; 3], LatticePoint::to_array);
    for &Placed { corners: [a, b, c], patch } in &made.triangles {
        let (p, q, r) = (at(a), at(b), at(c));
        let less = |x: [i32; 3]| [0, 1, 2].map(|i: usize| i64::from(axis(x, i).wrapping_sub(axis(p, i))));
        let ([ux, uy, uz], [vx, vy, vz]) = (less(q), less(r));
        // Differences of two points of the lattice have 31 bits.
        let n = [(uy * vz).wrapping_sub(uz * vy), (uz * vx).wrapping_sub(ux * vz), (ux * vy).wrapping_sub(uy * vx)];
        let is_coarse = u8::from(coarse.get(patch as usize) == Some(&true));
        for corner in [a, b, c] {
            let Some(seen) = seen.get_mut(corner as usize) else { continue };
            let Seen { sum: [x, y, z], patch: first, kind } = *seen;
            let first = if first == u32::MAX { patch } else { first };
            // Bit 2: several patches.
            let kind = kind | is_coarse | u8::from(first != patch) << 2;
            *seen =
                Seen { sum: [x.wrapping_add(n[0]), y.wrapping_add(n[1]), z.wrapping_add(n[2])], patch: first, kind };
        }
    }
    for v in made.open.iter().flat_map(|&edge| ends_of(made, edge)) {
        if let Some(seen) = seen.get_mut(v as usize) {
            seen.kind |= 2;
        }
    }
    let predicted =
        |Seen { sum, kind, .. }| Predicted { normal: octahedral(sum), kind: kind & 3 | (kind & kind >> 2 & 1) << 1 };
    seen.into_iter().map(predicted).collect()
}

#[inline]
fn axis([x, y, z]: [i32; 3], i: usize) -> i32 {
    match i {
        0 => x,
        1 => y,
        _ => z,
    }
}

/// As `kilwa_geometry::normal::encode`, of a sum in whole numbers.
#[inline]
fn octahedral(n: [i64; 3]) -> OctNormal {
    let [x, y, z] = n.map(|c| c as f64);
    let sum = x.abs() + y.abs() + z.abs();
    if sum == 0.0 {
        return [0, 0];
    }
    let (u, v) = (x / sum, y / sum);
    let (u, v) = if z < 0.0 { ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v)) } else { (u, v) };
    // Neither is beyond 1.
    [u, v].map(|x| {
        #[expect(clippy::cast_possible_truncation, reason = "between -32767 and 32767")]
        let nearest = (x * 32767.0 + 0.5f64.copysign(x)) as i32 as i16;
        nearest
    })
}

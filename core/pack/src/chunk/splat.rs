//! Codec 3: splats. A chunk of points, each with a normal and a radius, that decodes to a square per point. FORMAT sections 5.20
//! and 5.21. (Rusinkiewicz and Levoy, "QSplat", SIGGRAPH 2000, for drawing points of a hierarchy as oriented splats.)
//!
//! The entropy coder is that of codec 2.

use super::second::model::{Adaptive, Wide};
use super::second::rans::{Coder, Decoder, Encoder, Stored};
use super::{Attributes, Declared, PatchRange, attributes};
use crate::PackError;
use crate::bytes::Cursor;
use glam::{DVec3, IVec3};
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::normal::{self, OctNormal};
use kilwa_geometry::{LatticePoint, Mesh};

/// Number of this codec.
pub(super) const CODEC: u8 = 3;
/// Triangles of a splat.
pub const TRIANGLES: u32 = 2;
/// Vertices of a splat.
pub const VERTICES: u32 = 4;
/// Border bits of its two triangles, which share the edge from the first vertex to the third.
const BORDERS: [u8; 2] = [0b011, 0b110];
/// Smallest radius code: two steps, so that no square is without area.
pub const MIN_RADIUS: u8 = 4;
/// Largest radius code: 2^28 steps.
pub const MAX_RADIUS: u8 = 112;
/// Bits of a coordinate.
const COORDINATE_BITS: u32 = 30;
/// Quarters of an octave, in 4096ths.
const QUARTERS: [u32; 4] = [4096, 4871, 5793, 6889];

/// Splats in the order in which they are coded: by patch, and in a patch along Morton's curve (x before y before z).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Splats {
    /// Centres.
    pub positions: Vec<LatticePoint>,
    /// Normals.
    pub normals: Vec<OctNormal>,
    /// Codes of the radii, [`MIN_RADIUS`] to [`MAX_RADIUS`]; see [`radius`].
    pub radii: Vec<u8>,
    /// sRGB colours, or empty.
    pub colors: Vec<[u8; 3]>,
    /// Scalars, one `Vec` per channel.
    pub scalars: Vec<Vec<f32>>,
}

/// The radius of a code in lattice steps: 2^(code / 4), with the fourth roots of 2 to 12 bits.
pub fn radius(code: u8) -> f64 {
    let quarter = QUARTERS.get(usize::from(code & 3)).copied().unwrap_or(4096);
    f64::from(quarter) / 4096.0 * f64::from(1u32 << (code >> 2 & 31))
}

/// The code of the smallest radius that is at least so many steps, or the largest there is.
pub fn code_of(steps: f64) -> u8 {
    (MIN_RADIUS..MAX_RADIUS).find(|&code| radius(code) >= steps).unwrap_or(MAX_RADIUS)
}

/// Whether `a` comes before `b` along Morton's curve. Coordinates are not negative.
pub fn is_before(a: LatticePoint, b: LatticePoint) -> bool {
    difference(a, b).is_some_and(|(bit, axis)| b.to_array().get(axis).is_some_and(|x| x >> bit & 1 == 1))
}

/// The most significant bit in which two points differ, and its axis; of equal bits the first axis.
fn difference(a: LatticePoint, b: LatticePoint) -> Option<(u32, usize)> {
    let differ = (a ^ b).to_array();
    let bit = differ.into_iter().fold(0, |a, b| a | b).checked_ilog2()?;
    Some((bit, differ.iter().position(|d| d >> bit & 1 == 1)?))
}

/// The corners of a splat, counter-clockwise seen from where its normal points to.
pub fn corners(center: LatticePoint, n: OctNormal, code: u8) -> [LatticePoint; 4] {
    let n = normal::decode(n);
    let size = n.abs();
    let axis = if size.x <= size.y && size.x <= size.z {
        DVec3::X
    } else if size.y <= size.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let u = n.cross(axis);
    let u = u / u.length();
    let r = radius(code);
    let [u, v] = [u, n.cross(u)].map(|d| {
        let d = d * r;
        #[expect(clippy::cast_possible_truncation, reason = "at most 2^28")]
        let whole = [d.x, d.y, d.z].map(|x| libm::floor(x + 0.5) as i32);
        IVec3::from(whole)
    });
    [center + u, center + v, center - u, center - v]
}

/// The centre and the radius, in steps, of the square whose corners are four vertices.
pub fn center_of(corners: [LatticePoint; 4]) -> (LatticePoint, f64) {
    let [a, b, c, d] = corners;
    let radius = |p: IVec3, q: IVec3| (p - q).as_dvec3().length() / 2.0;
    ((a + c) / 2, radius(a, c).max(radius(b, d)))
}

impl Splats {
    /// Number of splats.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Their squares.
    pub fn mesh(&self) -> Mesh {
        let count = self.len();
        let mut mesh = Mesh {
            positions: Vec::with_capacity(4 * count),
            normals: self.normals.iter().flat_map(|&n| [n; 4]).collect(),
            colors: self.colors.iter().flat_map(|&c| [c; 4]).collect(),
            scalars: self.scalars.iter().map(|s| s.iter().flat_map(|&x| [x; 4]).collect()).collect(),
            triangles: Vec::with_capacity(2 * count),
            borders: BORDERS.repeat(count),
        };
        for ((&p, &n), &code) in self.positions.iter().zip(&self.normals).zip(&self.radii) {
            mesh.positions.extend(corners(p, n, code));
        }
        mesh.triangles.extend((0u32..).step_by(4).take(count).flat_map(|v| [[v, v + 1, v + 2], [v, v + 2, v + 3]]));
        mesh
    }

    /// The splats of a mesh that [`Splats::mesh`] made: of small ones, whose squares may be the same for two codes, that with the smaller code.
    ///
    /// # Errors
    /// [`PackError::Invalid`] for another mesh.
    pub fn of(mesh: &Mesh) -> Result<Self, PackError> {
        let first = |i: usize| 4 * i;
        let count = mesh.positions.len() / 4;
        let mut splats = Self { scalars: vec![Vec::with_capacity(count); mesh.scalars.len()], ..Self::default() };
        for (i, square) in mesh.positions.as_chunks::<4>().0.iter().enumerate() {
            let (center, size) = center_of(*square);
            let n = mesh.normals.get(first(i)).copied().unwrap_or_default();
            // The corners were rounded: the code is one of those nearby.
            let near = code_of(size);
            let nearby = near.saturating_sub(4).max(MIN_RADIUS)..=near.saturating_add(4).min(MAX_RADIUS);
            let code = nearby.into_iter().find(|&c| corners(center, n, c) == *square);
            splats.positions.push(center);
            splats.normals.push(n);
            splats.radii.push(code.ok_or_else(|| PackError::invalid("chunk", "it has triangles that are not splats"))?);
            splats.colors.extend(mesh.colors.get(first(i)));
            for (to, from) in splats.scalars.iter_mut().zip(&mesh.scalars) {
                to.extend(from.get(first(i)));
            }
        }
        if splats.mesh() == *mesh {
            Ok(splats)
        } else {
            Err(PackError::invalid("chunk", "it has triangles that are not splats"))
        }
    }
}

/// Encode all of a chunk but its patch table; `patches` count triangles, as everywhere.
///
/// # Errors
/// [`PackError::Invalid`] if the splats are incomplete, or not ordered as they have to be.
pub fn encode_body(splats: &Splats, patches: &[PatchRange], attributes: Attributes) -> Result<Vec<u8>, PackError> {
    let count = splats.len();
    let bad = |why: &str| Err(PackError::invalid("chunk", why));
    let colors = if attributes.colors { count } else { 0 };
    if splats.normals.len() != count
        || splats.radii.len() != count
        || splats.colors.len() != colors
        || splats.scalars.len() != usize::from(attributes.scalars)
        || splats.scalars.iter().any(|s| s.len() != count)
    {
        return bad("an attribute of a splat is missing");
    }
    if splats.radii.iter().any(|r| !(MIN_RADIUS..=MAX_RADIUS).contains(r)) {
        return bad("a splat has an invalid radius");
    }
    let sum: u64 = patches.iter().map(|p| u64::from(p.count)).sum();
    if sum != u64::from(TRIANGLES) * count as u64 || patches.iter().any(|p| !p.count.is_multiple_of(TRIANGLES)) {
        return bad("its patches do not match its splats");
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let mut first = 0;
    for patch in patches {
        let end = first + (patch.count / TRIANGLES) as usize;
        let run = splats.positions.get(first..end).unwrap_or_default();
        if !run.windows(2).all(|w| matches!(w, [a, b] if is_before(*a, *b))) {
            return bad("its splats are out of order, or two have the same place");
        }
        first = end;
    }
    let mut encoder = Encoder::default();
    code(&mut encoder, &mut splats.clone(), patches, attributes)?;
    Ok(encoder.body())
}

/// Decode the body of a chunk that is not empty, to the squares; the caller checks the result.
pub(super) fn decode_body(
    body: &[u8],
    declared: Declared,
    attributes: Attributes,
    patches: &[PatchRange],
) -> Result<Mesh, PackError> {
    let c = Cursor::new(body, "chunk");
    let mut parts = Cursor::new(body, "chunk");
    let length = parts.varint()? as usize;
    let words = parts.take(length)?;
    let raw = parts.take(parts.remaining())?;
    let stored = Stored::new(words, raw).ok_or_else(|| c.invalid("its coded part is cut off"))?;
    let sum: u64 = patches.iter().map(|p| u64::from(p.count)).sum();
    let count = declared.triangles / TRIANGLES;
    if sum != u64::from(declared.triangles)
        || patches.iter().any(|p| !p.count.is_multiple_of(TRIANGLES))
        || declared.vertices != VERTICES * count
    {
        return Err(c.invalid("its patches do not match its splats"));
    }
    let count = count as usize;
    let mut splats = Splats {
        positions: vec![LatticePoint::ZERO; count],
        normals: vec![[0; 2]; count],
        radii: vec![MIN_RADIUS; count],
        colors: vec![[0; 3]; if attributes.colors { count } else { 0 }],
        scalars: vec![vec![0.0; count]; attributes.scalars.into()],
    };
    let mut decoder = Decoder::new(&stored);
    code(&mut decoder, &mut splats, patches, attributes)?;
    decoder.end(&c)?;
    Ok(splats.mesh())
}

/// Models of everything.
struct Models {
    bit: Adaptive<32>,
    axis: Adaptive<4>,
    radius: Wide,
    color: [Wide; 3],
    normal: [Wide; 2],
}

impl Models {
    fn new() -> Self {
        Self {
            bit: Adaptive::unknown(COORDINATE_BITS as usize),
            axis: Adaptive::unknown(3),
            radius: Wide::new(),
            color: [Wide::new(), Wide::new(), Wide::new()],
            normal: [Wide::new(), Wide::new()],
        }
    }
}

/// Code all splats: the same on both sides. An encoder's splats are checked before.
fn code<C: Coder>(
    coder: &mut C,
    splats: &mut Splats,
    patches: &[PatchRange],
    attributes: Attributes,
) -> Result<(), PackError> {
    let bad = |why: &str| Err(PackError::invalid("chunk", why));
    let shift = shared_zeros(splats.normals.as_flattened().iter().map(|&x| i32::from(x)));
    let shift = coder.raw32(4, shift.min(15));
    let mut models = Models::new();
    let mut before = Known::default();
    let mut number = 0;
    for patch in patches {
        for within in 0..patch.count / TRIANGLES {
            let mut now = if C::ENCODES { Known::at(splats, number) } else { Known::default() };
            if within == 0 {
                coder.check()?;
                let axes = now.position.to_array().map(|x| coder.raw32(COORDINATE_BITS, x.cast_unsigned()));
                now.position = axes.map(u32::cast_signed).into();
            } else if !step(coder, &mut models, before.position, &mut now.position) {
                return bad("its splats are out of order");
            }
            now.code(coder, &mut models, &before, shift, attributes.colors);
            if !(i32::from(MIN_RADIUS)..=i32::from(MAX_RADIUS)).contains(&now.radius)
                || now.normal.iter().any(|&x| i16::try_from(x).is_err())
                || now.color.iter().any(|&x| u8::try_from(x).is_err())
                || now.position.cmpgt(IVec3::splat(MAX_COORDINATE)).any()
            {
                return bad("a value of a splat is out of range");
            }
            if !C::ENCODES {
                now.put(splats, number);
            }
            before = now;
            number += 1;
        }
    }
    for channel in &mut splats.scalars {
        coder.check()?;
        scalars(coder, channel);
    }
    Ok(())
}

/// A position from the one before it in its patch; whether it comes after that.
fn step<C: Coder>(coder: &mut C, models: &mut Models, before: LatticePoint, now: &mut LatticePoint) -> bool {
    let (bit, axis) = if C::ENCODES { difference(before, *now).unwrap_or((0, 0)) } else { (0, 0) };
    let bit = models.bit.code(coder, 0, bit as usize).min(COORDINATE_BITS as usize - 1);
    let axis = models.axis.code(coder, 1, axis);
    let old = before.to_array();
    let mut new = now.to_array();
    let mut comes_after = false;
    for (a, (new, old)) in new.iter_mut().zip(old).enumerate() {
        // Axes before `axis` are equal down to this bit, those behind it above it.
        #[expect(clippy::cast_possible_truncation, reason = "at most 30")]
        let low = (bit + usize::from(a > axis)) as u32;
        let mask = (1i32 << low) - 1;
        let rest = coder.raw32(low, (*new & mask).cast_unsigned()).cast_signed();
        let kept = old & !mask;
        if a == axis {
            comes_after = old >> bit & 1 == 0;
            *new = kept | 1 << bit | rest;
        } else {
            *new = kept | rest;
        }
    }
    *now = new.into();
    comes_after
}

/// A splat's values as numbers.
#[derive(Clone, Copy, Default)]
struct Known {
    position: LatticePoint,
    normal: [i32; 2],
    radius: i32,
    color: [i32; 3],
}

impl Known {
    fn at(splats: &Splats, i: usize) -> Self {
        Self {
            position: splats.positions.get(i).copied().unwrap_or_default(),
            normal: splats.normals.get(i).copied().unwrap_or_default().map(i32::from),
            radius: splats.radii.get(i).copied().unwrap_or_default().into(),
            color: splats.colors.get(i).copied().unwrap_or_default().map(i32::from),
        }
    }

    fn put(&self, splats: &mut Splats, i: usize) {
        if let Some(to) = splats.positions.get_mut(i) {
            *to = self.position;
        }
        if let Some(to) = splats.normals.get_mut(i) {
            *to = self.normal.map(|x| i16::try_from(x).unwrap_or(0));
        }
        if let Some(to) = splats.radii.get_mut(i) {
            *to = u8::try_from(self.radius).unwrap_or(MIN_RADIUS);
        }
        if let Some(to) = splats.colors.get_mut(i) {
            *to = self.color.map(|x| u8::try_from(x).unwrap_or(0));
        }
    }

    /// All but the position, from the splat before: differences, those of red and blue less that of green.
    fn code<C: Coder>(&mut self, coder: &mut C, models: &mut Models, before: &Self, shift: u32, colors: bool) {
        let mut one = |model: &mut Wide, state, value: &mut i32, from: i32| {
            *value = from.wrapping_add(model.code(coder, state, value.wrapping_sub(from)));
        };
        one(&mut models.radius, 2, &mut self.radius, before.radius);
        for ((model, value), from) in models.normal.iter_mut().zip(&mut self.normal).zip(before.normal) {
            let mut level = *value >> shift;
            one(model, 0, &mut level, from >> shift);
            *value = level.wrapping_shl(shift);
        }
        if colors {
            let ([red, green, blue], [r, g, b]) = (&mut self.color, before.color);
            let [of_green, of_red, of_blue] = &mut models.color;
            one(of_green, 1, green, g);
            let tint = green.wrapping_sub(g);
            one(of_red, 2, red, r.wrapping_add(tint));
            one(of_blue, 0, blue, b.wrapping_add(tint));
        }
    }
}

/// A channel of scalars: differences of ordered bits (FORMAT section 5.9), without the zeros that all of them end in.
fn scalars<C: Coder>(coder: &mut C, channel: &mut [f32]) {
    let shift = shared_zeros(channel.iter().map(|x| attributes::ordered_bits(*x)));
    let shift = coder.raw32(5, shift.min(31));
    let (mut model, mut before) = (Wide::new(), 0i32);
    for x in channel {
        let level = attributes::ordered_bits(*x) >> shift;
        before = before.wrapping_add(model.code(coder, 1, level.wrapping_sub(before)));
        *x = attributes::from_ordered_bits(before.wrapping_shl(shift));
    }
}

/// How many zeros all numbers end in.
fn shared_zeros(numbers: impl Iterator<Item = i32>) -> u32 {
    numbers.fold(0, |a, b| a | b).trailing_zeros()
}

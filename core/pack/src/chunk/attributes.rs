//! Positions, colours, normals and scalars: predicted from vertices that are known, the residuals coded. FORMAT sections
//! 5.6 to 5.9. Encoder and decoder run the same code: the encoder's values are in the arrays, the decoder's are put there.

use super::border::Link;
pub(super) use super::number::MAX_GRAIN;
use super::number::{Grains, Residuals, Wide};
use super::predict::Weights;
use super::range::{Bit, Coder, DryRun};
use kilwa_geometry::LatticePoint;
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_geometry::normal::OctNormal;

/// Contexts of position residuals: half octaves of the sum of two residuals nearby.
const NEARBY: usize = 48;
/// Largest residual that is remembered.
const LARGEST: u32 = 1 << 22;
/// Bits of the fraction of a tint.
const TINT_BITS: u32 = 4;

/// Half octaves of `sum + 1`.
#[inline]
fn half_octave(sum: u32) -> usize {
    let x = sum.saturating_add(1);
    let top = x.ilog2();
    (2 * top + (x << 1 >> top & 1)) as usize
}

/// Grains of vertices, for an encoder: the number of zero bits at the end of what all its values have in common. Zeros that
/// only chance made are not worth saying.
pub(super) fn grains<const N: usize>(values: impl Iterator<Item = [i32; N]>) -> Option<Vec<u8>> {
    let zeros = |v: [i32; N]| v.into_iter().fold(0, |a, b| a | b).trailing_zeros().min(MAX_GRAIN);
    let mut grains: Vec<u8> = values.map(|v| u8::try_from(zeros(v)).unwrap_or(0)).collect();
    let mut counts = [0usize; MAX_GRAIN as usize + 1];
    for &grain in &grains {
        if let Some(n) = counts.get_mut(usize::from(grain)) {
            *n += 1;
        }
    }
    // Of vertices with at least one grain, one in 2^N has a coarser one by chance.
    let mut merged = [0u8; MAX_GRAIN as usize + 1];
    let (mut last, mut by_chance) = (0, 0);
    for ((merged_grain, &count), grain) in merged.iter_mut().zip(&counts).zip(0u8..) {
        if grain == 0 || count > 2 * by_chance + grains.len() / 32 {
            (last, by_chance) = (grain, count.max(by_chance));
        }
        by_chance >>= N;
        *merged_grain = last;
    }
    if last == 0 {
        return None;
    }
    for grain in &mut grains {
        *grain = merged.get(usize::from(*grain)).copied().unwrap_or(0);
    }
    Some(grains)
}

/// The grains of one attribute while it is coded.
#[derive(Clone)]
struct Grained {
    model: Grains,
    wanted: Vec<u8>,
    known: Vec<u8>,
}

impl Grained {
    fn new(coder: &mut impl Coder, wanted: Option<Vec<u8>>, vertices: usize) -> Self {
        let model = Grains::new(coder, wanted.is_some());
        Self { model, wanted: wanted.unwrap_or_default(), known: Vec::with_capacity(vertices) }
    }

    /// The grain of the next vertex.
    #[inline]
    fn next(&mut self, coder: &mut impl Coder, near: u32) -> u8 {
        let near = self.known.get(near as usize).copied().unwrap_or(0);
        let wanted = self.wanted.get(self.known.len()).copied().unwrap_or(0);
        let grain = self.model.code(coder, near, wanted);
        self.known.push(grain);
        grain
    }
}

/// The nearest multiple of `2^grain`, in that unit.
#[inline]
pub(super) fn round_to(x: i32, grain: u8) -> i32 {
    x.wrapping_add((1 << grain) >> 1) >> grain
}

/// Positions, one for every link. Those of a decoder that are out of range are found by whoever checks the mesh.
pub(super) fn positions<C: Coder>(coder: &mut C, links: &[Link], values: &mut [LatticePoint], wanted: Option<Vec<u8>>) {
    // The coder takes positions and colours alike, as triples of numbers.
    let values: &mut [[i32; 3]] = bytemuck::cast_slice_mut(values);
    let weights = if C::ENCODES { Weights::best(values, links) } else { Weights::default() };
    let weights = weights.code(&mut |bits, value| coder.raw(bits, value));
    let grains = Grained::new(coder, wanted, values.len());
    let depth = if C::ENCODES {
        positions_with(&mut DryRun, links, &mut values.to_vec(), weights, grains.clone(), 5)
    } else {
        2
    };
    let depth = coder.raw(2, depth - 2) + 2;
    positions_with(coder, links, values, weights, grains, depth);
}

/// All positions, after what is fitted to them. Returns the depth that would have been enough.
fn positions_with<C: Coder>(
    coder: &mut C,
    links: &[Link],
    values: &mut [[i32; 3]],
    weights: Weights,
    mut grains: Grained,
    depth: u32,
) -> u32 {
    let mut models = vec![Residuals::<NEARBY>::new(depth); 2];
    let [of_one, of_two] = models.as_mut_slice() else { return depth };
    let mut sizes: Vec<[u32; 3]> = Vec::with_capacity(values.len());
    let mut local = coder.taken();
    for (v, link) in links.iter().enumerate() {
        let predicted = weights.predict(values, link).map(|x| x.clamp(0, MAX_COORDINATE.into()));
        let beside = link.edge;
        let [a, b] = beside.map(|n| sizes.get(n as usize).copied().unwrap_or_default());
        let grain = grains.next(&mut local, link.edge[0]);
        let model = if link.is_two() { &mut *of_two } else { &mut *of_one };
        let Some(value) = values.get_mut(v) else { break };
        let mut size = [0; 3];
        for ((((x, p), size), a), b) in value.iter_mut().zip(predicted).zip(&mut size).zip(a).zip(b) {
            let p = round_to(i32::try_from(p).unwrap_or(0), grain);
            let r = model.code(&mut local, half_octave((a + b) >> grain), (*x >> grain).wrapping_sub(p));
            *x = p.wrapping_add(r) << grain;
            *size = (r.unsigned_abs().min(LARGEST) << grain).min(LARGEST);
        }
        sizes.push(size);
    }
    *coder = local;
    of_one.needed().max(of_two.needed())
}

/// How much of the residual of one channel is in another's, in units of 1 / 16.
#[derive(Clone, Copy, Default)]
pub(super) struct Tint {
    pub(super) red_of_green: i32,
    pub(super) blue_of_green: i32,
    pub(super) blue_of_red: i32,
}

impl Tint {
    /// The weights with the smallest sum of squared errors.
    pub(super) fn best(links: &[Link], values: &[[u8; 3]], weights: Weights) -> Self {
        let [mut gg, mut gr, mut gb, mut rr, mut rb] = [0.0f64; 5];
        for (&value, link) in values.iter().zip(links) {
            let [pr, pg, pb] = predicted_color(weights, values, link);
            let [r, g, b] = value.map(i32::from);
            let [r, g, b] = [r - pr, g - pg, b - pb].map(|x| f64::from(wrap(x, 0)));
            gg += g * g;
            gr += g * r;
            gb += g * b;
            rr += r * r;
            rb += r * b;
        }
        let determinant = gg * rr - gr * gr;
        let (of_green, of_red) = if determinant > 1e-3 * gg * rr {
            ((gb * rr - rb * gr) / determinant, (rb * gg - gb * gr) / determinant)
        } else {
            (gb / gg, 0.0)
        };
        let [red_of_green, blue_of_green, blue_of_red] = [gr / gg, of_green, of_red].map(|x| {
            #[expect(clippy::cast_possible_truncation, reason = "a whole number between -64 and 63")]
            let stored = libm::round(x * f64::from(1 << TINT_BITS)).clamp(-64.0, 63.0) as i32;
            if x.is_finite() { stored } else { 1 << TINT_BITS }
        });
        Self { red_of_green, blue_of_green, blue_of_red }
    }

    /// As it is stored: 7 bits each, 64 more than the value.
    pub(super) fn code(self, raw: &mut impl FnMut(u32, u32) -> u32) -> Self {
        let [red_of_green, blue_of_green, blue_of_red] = [self.red_of_green, self.blue_of_green, self.blue_of_red]
            .map(|x| (raw(7, (x + 64).cast_unsigned() & 127) & 127).cast_signed() - 64);
        Self { red_of_green, blue_of_green, blue_of_red }
    }
}

/// A channel's prediction, with what other channels' residuals say.
#[inline]
pub(super) fn tinted(p: i32, of_residuals: i32) -> i32 {
    (p + ((of_residuals + (1 << TINT_BITS >> 1)) >> TINT_BITS)).clamp(0, 255)
}

#[inline]
fn predicted_color(weights: Weights, values: &[[u8; 3]], link: &Link) -> [i32; 3] {
    weights.predict(values, link).map(|x| (x.clamp(0, 255) & 0xff) as u8).map(i32::from)
}

/// Colours, one for every link: green, red, blue.
pub(super) fn colors<C: Coder>(coder: &mut C, links: &[Link], values: &mut [[u8; 3]], wanted: Option<Vec<u8>>) {
    let weights = if C::ENCODES { Weights::best(values, links) } else { Weights::default() };
    let weights = weights.code(&mut |bits, value| coder.raw(bits, value));
    let tint = if C::ENCODES { Tint::best(links, values, weights) } else { Tint::default() };
    let tint = tint.code(&mut |bits, value| coder.raw(bits, value));
    let grains = Grained::new(coder, wanted, values.len());
    let about = (weights, tint);
    let depth =
        if C::ENCODES { colors_with(&mut DryRun, links, &mut values.to_vec(), about, grains.clone(), 4) } else { 2 };
    let depth = coder.raw(2, depth - 2) + 2;
    colors_with(coder, links, values, about, grains, depth);
}

/// All colours, after what is fitted to them. Returns the depth that would have been enough.
fn colors_with<C: Coder>(
    coder: &mut C,
    links: &[Link],
    values: &mut [[u8; 3]],
    (weights, tint): (Weights, Tint),
    mut grains: Grained,
    depth: u32,
) -> u32 {
    let mut models = vec![Residuals::<1>::new(depth); 3];
    let [of_green, of_red, of_blue] = models.as_mut_slice() else { return depth };
    let mut local = coder.taken();
    for (v, link) in links.iter().enumerate() {
        let [pr, pg, pb] = predicted_color(weights, values, link);
        let grain = grains.next(&mut local, link.edge[0]).min(7);
        let Some(value) = values.get_mut(v) else { break };
        let [red, green, blue] = value.map(i32::from);
        let mut channel = |model: &mut Residuals<1>, x: i32, p: i32| {
            let p = round_to(p, grain);
            let r = model.code(&mut local, 0, wrap((x >> grain).wrapping_sub(p), grain));
            p.wrapping_add(r) << grain & 0xff
        };
        let green = channel(of_green, green, pg);
        let red = channel(of_red, red, tinted(pr, tint.red_of_green * (green - pg)));
        let others = tint.blue_of_green * (green - pg) + tint.blue_of_red * (red - pr);
        let blue = channel(of_blue, blue, tinted(pb, others));
        *value = [red, green, blue].map(|x| (x & 0xff) as u8);
    }
    *coder = local;
    of_green.needed().max(of_red.needed()).max(of_blue.needed())
}

/// The shortest way round, of `8 - grain` bits.
#[inline]
pub(super) fn wrap(x: i32, grain: u8) -> i32 {
    let half = 0x80 >> grain;
    (x & (2 * half - 1) ^ half) - half
}

/// A normal came out of range, which no encoder writes.
pub(super) struct OutOfRange;

/// Normals of `bits` bits, one for every link, beside those predicted. `kinds` tell vertices apart whose predictions are
/// good in different ways, 0 to 3.
pub(super) fn normals<C: Coder>(
    coder: &mut C,
    links: &[Link],
    values: &mut [OctNormal],
    (predicted, kinds): (&[OctNormal], &[u8]),
    (bits, wanted): (u8, Option<Vec<u8>>),
) -> Result<(), OutOfRange> {
    let mut grains = Grained::new(coder, wanted, values.len());
    // A residual of levels of so many bits has at most one bit more.
    let mut models = vec![Residuals::<24>::new(if bits < 15 { 4 } else { 5 }); 2];
    let [of_first, of_second] = models.as_mut_slice() else { return Ok(()) };
    let mut differs = [[Bit::NEW; 16]; 4];
    let mut recent = [0u32; 4];
    let mut local = coder.taken();
    for (((value, &guess), &kind), &link) in values.iter_mut().zip(predicted).zip(kinds).zip(links) {
        let kind = usize::from(kind & 3);
        let (Some(differs), Some(recent)) = (differs.get_mut(kind), recent.get_mut(kind)) else { return Ok(()) };
        let grain = grains.next(&mut local, link.edge[0]);
        let [gu, gv] = guess.map(|x| round_to(quantize(x, bits), grain));
        let [wu, wv] = value.map(|x| quantize(x, bits) >> grain);
        let near = half_octave(*recent >> grain);
        let (mut u, mut v) = (0, 0);
        let Some(model) = differs.get_mut(near.min(15)) else { return Ok(()) };
        if local.bit(model, [gu, gv] != [wu, wv]) {
            u = of_first.code(&mut local, near, wu.wrapping_sub(gu));
            v = of_second.code(&mut local, half_octave(2 * u.unsigned_abs().min(LARGEST)), wv.wrapping_sub(gv));
        }
        let size = (u.unsigned_abs().min(LARGEST) + v.unsigned_abs().min(LARGEST)).min(LARGEST) << grain.min(8);
        *recent = *recent - *recent / 4 + size / 4;
        let level = |g: i32, r: i32| unquantize(g.wrapping_add(r) << grain, bits).ok_or(OutOfRange);
        *value = [level(gu, u)?, level(gv, v)?];
    }
    *coder = local;
    Ok(())
}

/// Normals as levels of so many bits, to find their grains.
pub(super) fn levels(values: &[OctNormal], bits: u8) -> impl Iterator<Item = [i32; 2]> {
    values.iter().map(move |n| n.map(|x| quantize(x, bits)))
}

/// The fewest bits, from 6 on, that hold all normals exactly.
pub(super) fn normal_bits(values: &[OctNormal]) -> u8 {
    let exact = |bits: &u8| values.as_flattened().iter().all(|&x| unquantize(quantize(x, *bits), *bits) == Some(x));
    (6..16).find(exact).unwrap_or(16)
}

/// An octahedral coordinate as a level of `bits` bits, `-(2^(bits-1) - 1) ..= 2^(bits-1) - 1`; at 16 bits itself.
pub(super) fn quantize(x: i16, bits: u8) -> i32 {
    let x = i32::from(x);
    if bits >= 16 {
        return x;
    }
    let levels = (1u32 << (bits - 1)) - 1;
    // Without a branch: signs cannot be foreseen.
    let level = ((2 * x.unsigned_abs() * levels + 32767) / 65534).cast_signed();
    let mask = x >> 31;
    (level ^ mask) - mask
}

/// The coordinate that a level represents, or none when it is out of range.
pub(super) fn unquantize(level: i32, bits: u8) -> Option<i16> {
    if bits >= 16 {
        return i16::try_from(level).ok();
    }
    let levels = (1 << (bits - 1)) - 1;
    if !(-levels..=levels).contains(&level) {
        return None;
    }
    i16::try_from((65534 * level.abs() + levels) / (2 * levels) * level.signum()).ok()
}

/// One scalar channel, as ordered bits.
pub(super) fn scalars<C: Coder>(coder: &mut C, links: &[Link], values: &mut [i32]) {
    let mut model = Wide::new();
    scalars_with(&mut |x| model.code(coder, x), links, values);
}

/// One scalar channel, by a function that codes residuals.
pub(super) fn scalars_with(code: &mut impl FnMut(i32) -> i32, links: &[Link], values: &mut [i32]) {
    for (v, link) in links.iter().enumerate() {
        let [a, b] = link.edge.map(|n| values.get(n as usize).copied().unwrap_or(0));
        let predicted = (a & b).wrapping_add((a ^ b) >> 1);
        let Some(x) = values.get_mut(v) else { return };
        *x = predicted.wrapping_add(code(x.wrapping_sub(predicted)));
    }
}

/// The bits of a float as an integer in the order of the numbers, so that near values have near integers. Lossless.
pub(super) fn ordered_bits(x: f32) -> i32 {
    let bits = x.to_bits().cast_signed();
    if bits < 0 { !bits ^ i32::MIN } else { bits }
}

pub(super) fn from_ordered_bits(x: i32) -> f32 {
    f32::from_bits(if x < 0 { !(x ^ i32::MIN) } else { x }.cast_unsigned())
}

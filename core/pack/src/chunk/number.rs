//! Models of numbers on top of the entropy coder. FORMAT section 5.3.

use super::range::{Bit, Coder, MAX_RAW_BITS};

/// A symbol of `BITS` bits, most significant first, each with a probability that depends on those before.
#[derive(Clone)]
pub(super) struct Tree<const NODES: usize>([Bit; NODES]);

impl<const NODES: usize> Tree<NODES> {
    pub(super) const fn new() -> Self {
        Self([Bit::NEW; NODES])
    }

    /// `value` has `bits` bits, `2^bits <= NODES`.
    #[expect(clippy::inline_always, reason = "keeps the coder in registers: a half more speed, measured")]
    #[inline(always)]
    pub(super) fn code(&mut self, coder: &mut impl Coder, bits: u32, value: u32) -> u32 {
        let mut node = 1u32;
        for k in (0..bits).rev() {
            let Some(model) = self.0.get_mut(node as usize) else { break };
            let bit = coder.bit(model, value >> k & 1 == 1);
            node = node << 1 | u32::from(bit);
        }
        node & ((1 << bits) - 1)
    }
}

/// Unsigned numbers of unknown size: the number of bits of `value + 1` as a symbol, then the bits below the first.
#[derive(Clone)]
pub(super) struct Number {
    size: Tree<32>,
    upper: [Bit; 32],
}

impl Number {
    pub(super) const fn new() -> Self {
        Self { size: Tree::new(), upper: [Bit::NEW; 32] }
    }

    /// `value` is at most 2^31 - 2.
    pub(super) fn code(&mut self, coder: &mut impl Coder, value: u32) -> u32 {
        let up = value.wrapping_add(1) & 0x7fff_ffff;
        let size = self.size.code(coder, 5, up.checked_ilog2().unwrap_or(0));
        mantissa(&mut self.upper, coder, size, up).wrapping_sub(1)
    }
}

/// The `size` bits below the first one of `value`: the uppermost adaptive, the others raw. Returns the value with its first bit.
fn mantissa(upper: &mut [Bit; 32], coder: &mut impl Coder, size: u32, value: u32) -> u32 {
    let Some(model) = upper.get_mut(size as usize) else { return value };
    if size == 0 {
        return 1;
    }
    let mut left = size - 1;
    let mut out = 2 | u32::from(coder.bit(model, value >> left & 1 == 1));
    while left > 0 {
        let now = left.min(MAX_RAW_BITS);
        left -= now;
        out = out << now | coder.raw(now, value >> left & ((1 << now) - 1));
    }
    out
}

/// Signed residuals, in `CONTEXTS` contexts: by how large residuals nearby are.
#[derive(Clone)]
pub(super) struct Residuals<const CONTEXTS: usize> {
    /// Bits of the symbol that says how large a residual is.
    depth: u32,
    size: [Tree<32>; CONTEXTS],
    upper: [Bit; 32],
    /// Sizes seen, or-ed: what an encoder chooses the depth by.
    seen: u32,
}

impl<const CONTEXTS: usize> Residuals<CONTEXTS> {
    /// `depth`, 2 to 5: sizes, the number of bits of a residual's magnitude, are below `2^depth`.
    pub(super) const fn new(depth: u32) -> Self {
        Self { depth, size: [const { Tree::new() }; CONTEXTS], upper: [Bit::NEW; 32], seen: 0 }
    }

    /// The depth that would have been enough.
    pub(super) fn needed(&self) -> u32 {
        (32 - self.seen.leading_zeros()).clamp(2, 5)
    }

    /// Code a residual whose magnitude is below 2^31.
    #[inline(never)]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, context: usize, value: i32) -> i32 {
        let magnitude = value.unsigned_abs();
        if C::DRY {
            self.seen |= 32 - magnitude.leading_zeros();
            return value;
        }
        let Some(tree) = self.size.get_mut(context.min(CONTEXTS - 1)) else { return 0 };
        let size = tree.code(coder, self.depth, 32 - magnitude.leading_zeros());
        self.seen |= size;
        if size == 0 {
            return 0;
        }
        let (mut top, mut rest) = (1, 0);
        if size > 1 {
            let Some(model) = self.upper.get_mut(size as usize) else { return 0 };
            rest = size - 2;
            top = 2 | u32::from(coder.bit(model, magnitude >> rest & 1 == 1));
        }
        if rest >= MAX_RAW_BITS {
            let high = rest - (MAX_RAW_BITS - 1);
            rest = MAX_RAW_BITS - 1;
            top = top << high | coder.raw(high, magnitude >> rest & ((1 << high) - 1));
        }
        // The sign is the lowest of the raw bits.
        let tail = coder.raw(rest + 1, (magnitude & ((1 << rest) - 1)) << 1 | u32::from(value < 0));
        let (magnitude, negative) = (top << rest | tail >> 1, tail & 1);
        (magnitude ^ negative.wrapping_neg()).wrapping_add(negative).cast_signed()
    }
}

/// How coarse values are: the number of zero bits at the end that all coordinates of a vertex have, at least. Coarse
/// forms are rounded, vertices that they share with finer ones are not.
#[derive(Clone)]
pub(super) struct Grains {
    trees: Option<[Tree<16>; 16]>,
}

/// Largest grain.
pub(super) const MAX_GRAIN: u32 = 15;

impl Grains {
    /// Whether there are any is one raw bit.
    pub(super) fn new(coder: &mut impl Coder, any: bool) -> Self {
        let any = coder.raw(1, u32::from(any)) == 1;
        Self { trees: if any { Some([const { Tree::new() }; 16]) } else { None } }
    }

    /// The grain of a vertex, that of a neighbour being `near`.
    #[expect(clippy::inline_always, reason = "keeps the coder in registers: a half more speed, measured")]
    #[inline(always)]
    pub(super) fn code(&mut self, coder: &mut impl Coder, near: u8, grain: u8) -> u8 {
        let tree = self.trees.as_mut().and_then(|trees| trees.get_mut(usize::from(near)));
        tree.map_or(0, |tree| (tree.code(coder, 4, grain.into()) & MAX_GRAIN) as u8)
    }
}

/// Signed numbers of all 32 bits: the size of `2 |x|`, less one where x is negative, then its bits.
pub(super) struct Wide {
    size: Tree<64>,
    upper: [Bit; 32],
}

impl Wide {
    pub(super) const fn new() -> Self {
        Self { size: Tree::new(), upper: [Bit::NEW; 32] }
    }

    pub(super) fn code(&mut self, coder: &mut impl Coder, value: i32) -> i32 {
        let u = (value << 1 ^ value >> 31).cast_unsigned();
        let size = self.size.code(coder, 6, 32 - u.leading_zeros()).min(32);
        let u = if size == 0 { 0 } else { mantissa(&mut self.upper, coder, size - 1, u) };
        (u >> 1).cast_signed() ^ -(u & 1).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::super::range::{Decoder, Encoder};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_numbers_round_trip(values in proptest::collection::vec(any::<i32>(), 0..300), shift in 0u32..31) {
            let values: Vec<i32> = values.iter().map(|v| v >> shift).collect();
            let run = |coder: &mut dyn FnMut(&mut Wide, &mut Residuals<2>, &mut Number, i32) -> [i32; 3]| {
                let mut models = (Wide::new(), Residuals::new(5), Number::new());
                values.iter().map(|&v| coder(&mut models.0, &mut models.1, &mut models.2, v)).collect::<Vec<_>>()
            };
            let legal = |v: i32| v.max(-i32::MAX);
            let mut encoder = Encoder::new();
            run(&mut |wide, residuals, number, v| {
                wide.code(&mut encoder, v);
                residuals.code(&mut encoder, v as usize & 1, legal(v));
                number.code(&mut encoder, v.unsigned_abs() >> 1);
                [0; 3]
            });
            let (bytes, raw) = encoder.finish();
            let mut decoder = Decoder::new(&bytes, &raw);
            let back = run(&mut |wide, residuals, number, v| {
                let w = wide.code(&mut decoder, 0);
                [w, residuals.code(&mut decoder, v as usize & 1, 0), number.code(&mut decoder, 0) as i32]
            });
            let wanted: Vec<[i32; 3]> = values.iter().map(|&v| [v, legal(v), (v.unsigned_abs() >> 1) as i32]).collect();
            prop_assert_eq!(back, wanted);
        }
    }
}

//! The entropy coder: an adaptive binary range coder. FORMAT section 5.2. (Martin, "Range encoding", 1979; binary and
//! adaptive as in LZMA, with 64-bit intervals so that rounding costs nothing, and rates that begin fast and slow down.)
//!
//! A [`Bit`] is an adaptive probability. The stream is one binary fraction, most significant byte first; up to 8
//! zero bytes at its end are not stored. The decoder reads zeros behind the end, and never more than 8 of them. Bits
//! that no model helps with are raw: they are stored beside the stream, least significant first.

use crate::PackError;
use crate::bytes::Cursor;

/// Probabilities are in units of 2^-16.
const ONE_BITS: u32 = 16;
/// Adaptation slows down until a probability has seen so many bits.
const SLOWEST: u8 = 126;
/// Most bits that one call codes with equal probabilities.
pub(super) const MAX_RAW_BITS: u32 = 16;

/// `2^17 / (2 n + 3)`: the rate after `n` bits.
#[expect(clippy::indexing_slicing, reason = "known at compile time to be in range")]
const RATES: [u32; SLOWEST as usize + 1] = {
    let mut rates = [0; SLOWEST as usize + 1];
    let mut n = 0;
    let mut odd = 3;
    while n < rates.len() {
        rates[n] = (1 << 17) / odd;
        n += 1;
        odd += 2;
    }
    rates
};

/// The probability that a bit is 0, learnt from the bits before.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bit {
    /// 1 to 65,535.
    zero: u16,
    /// Bits seen, at most [`SLOWEST`].
    seen: u8,
}

impl Bit {
    /// Nothing is known.
    pub(super) const NEW: Self = Self { zero: 1 << 15, seen: 0 };

    #[inline]
    fn learn(&mut self, bit: bool) {
        let zero = u32::from(self.zero);
        let rate = RATES.get(usize::from(self.seen)).copied().unwrap_or(0);
        // Without a branch: what it would depend on is what cannot be foreseen.
        let (up, down) = (((0xffff - zero) * rate) >> ONE_BITS, (zero * rate) >> ONE_BITS);
        let mask = u32::from(bit).wrapping_neg();
        let next = zero + (up & !mask) - (down & mask);
        self.zero = (next & 0xffff) as u16;
        self.seen += u8::from(self.seen < SLOWEST);
    }
}

/// The coder of a value: [`Encoder`] or [`Decoder`]. The models are the same code on both sides; on the decoder's
/// side the value that is passed in is ignored and the one that was coded comes out.
pub(super) trait Coder: Sized {
    /// Whether this is an encoder: then the arrays hold the values, and choices can be fitted to them.
    const ENCODES: bool;

    /// Whether nothing comes of it but what the models have seen: they then learn nothing.
    const DRY: bool = false;

    /// Move the coder to where a loop can keep it in registers; it has to be put back after.
    #[must_use]
    fn taken(&mut self) -> Self;
    /// Code one bit with an adaptive probability.
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool;
    /// Code up to [`MAX_RAW_BITS`] bits as they are.
    fn raw(&mut self, bits: u32, value: u32) -> u32;
}

/// Writes a stream.
pub(super) struct Encoder {
    low: u64,
    range: u64,
    words: Vec<u32>,
    raw: Vec<u8>,
    held: u64,
    held_bits: u32,
}

impl Encoder {
    pub(super) fn new() -> Self {
        Self { low: 0, range: u64::MAX, words: Vec::new(), raw: Vec::new(), held: 0, held_bits: 0 }
    }

    /// Bytes written so far: where the parts of a chunk end, for reports.
    pub(super) fn bytes(&self) -> usize {
        self.words.len() * 4 + (64 - self.range.ilog2() as usize) / 8 + self.raw.len()
    }

    fn add(&mut self, to_low: u64) {
        let (low, carried) = self.low.overflowing_add(to_low);
        self.low = low;
        if carried {
            for word in self.words.iter_mut().rev() {
                let (next, again) = word.overflowing_add(1);
                *word = next;
                if !again {
                    break;
                }
            }
        }
    }

    fn renormalise(&mut self) {
        while self.range >> 32 == 0 {
            self.words.push((self.low >> 32 & 0xffff_ffff) as u32);
            self.low <<= 32;
            self.range <<= 32;
        }
    }

    /// The finished stream and the raw bits.
    pub(super) fn finish(mut self) -> (Vec<u8>, Vec<u8>) {
        if self.held_bits > 0 {
            self.raw.push((self.held & 0xff) as u8);
        }
        // The number of the interval with the most zeros at its end.
        let mut zeros = 63;
        let value = loop {
            let mask = (1u64 << zeros) - 1;
            let up = (mask - (self.low.wrapping_sub(1) & mask)) & mask;
            if up < self.range {
                break up;
            }
            zeros -= 1;
        };
        self.add(value);
        let mut out: Vec<u8> = self.words.iter().flat_map(|w| w.to_be_bytes()).collect();
        out.extend(self.low.to_be_bytes());
        for _ in 0..8 {
            if out.last() == Some(&0) {
                out.pop();
            }
        }
        (out, self.raw)
    }
}

impl Coder for Encoder {
    const ENCODES: bool = true;

    fn taken(&mut self) -> Self {
        std::mem::replace(self, Self::new())
    }

    #[inline]
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool {
        let bound = (self.range >> ONE_BITS) * u64::from(model.zero);
        if bit {
            self.add(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        model.learn(bit);
        self.renormalise();
        bit
    }

    #[inline]
    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        self.held |= u64::from(value) << self.held_bits;
        self.held_bits += bits;
        while self.held_bits >= 8 {
            self.raw.push((self.held & 0xff) as u8);
            self.held >>= 8;
            self.held_bits -= 8;
        }
        value
    }
}

/// Reads a stream.
#[derive(Clone, Copy)]
pub(super) struct Decoder<'a> {
    bytes: &'a [u8],
    code: u64,
    range: u64,
    /// Zero bytes read behind the end.
    missing: usize,
    raw: &'a [u8],
    held: u64,
    held_bits: u32,
}

impl<'a> Decoder<'a> {
    /// `bytes` and `raw` as [`Encoder::finish`] gave them.
    pub(super) fn new(bytes: &'a [u8], raw: &'a [u8]) -> Self {
        let mut new = Self { bytes, code: 0, range: u64::MAX, missing: 0, raw, held: 0, held_bits: 0 };
        new.code = u64::from(new.word()) << 32 | u64::from(new.word());
        new
    }

    #[inline]
    fn word(&mut self) -> u32 {
        if let Some((word, rest)) = self.bytes.split_first_chunk::<4>() {
            self.bytes = rest;
            return u32::from_be_bytes(*word);
        }
        self.last_word()
    }

    #[cold]
    fn last_word(&mut self) -> u32 {
        let mut word = [0; 4];
        for (to, from) in word.iter_mut().zip(self.bytes) {
            *to = *from;
        }
        self.missing = self.missing.saturating_add(4 - self.bytes.len());
        self.bytes = &[];
        u32::from_be_bytes(word)
    }

    /// Whether more was read than an encoder can have left out: then the rest is meaningless.
    pub(super) fn is_past_end(&self) -> bool {
        self.missing > 8
    }

    /// Fails unless exactly the stream was read.
    pub(super) fn end(&self, c: &Cursor<'_>) -> Result<(), PackError> {
        if self.is_past_end() {
            return Err(c.invalid("its coded part ends too early"));
        }
        if !self.bytes.is_empty() || !self.raw.is_empty() || self.held_bits >= 8 || self.held != 0 {
            return Err(c.invalid("bytes are left over in its coded part"));
        }
        Ok(())
    }

    /// Hold at least `bits` raw bits; zeros behind the end.
    fn refill(&mut self, bits: u32) {
        if let Some((word, rest)) = self.raw.split_first_chunk::<4>() {
            self.raw = rest;
            self.held |= u64::from(u32::from_le_bytes(*word)) << self.held_bits;
            self.held_bits += 32;
            return;
        }
        while self.held_bits < bits {
            if let Some((byte, rest)) = self.raw.split_first() {
                self.raw = rest;
                self.held |= u64::from(*byte) << self.held_bits;
            } else {
                self.missing = usize::MAX;
            }
            self.held_bits += 8;
        }
    }

    #[inline]
    fn renormalise(&mut self) {
        if self.range >> 32 == 0 {
            self.range <<= 32;
            self.code = self.code << 32 | u64::from(self.word());
        }
    }
}

impl Coder for Decoder<'_> {
    const ENCODES: bool = false;

    fn taken(&mut self) -> Self {
        *self
    }

    #[expect(clippy::inline_always, reason = "keeps the coder in registers: a half more speed, measured")]
    #[inline(always)]
    fn bit(&mut self, model: &mut Bit, _: bool) -> bool {
        let bound = (self.range >> ONE_BITS) * u64::from(model.zero);
        let bit = self.code >= bound;
        let mask = u64::from(bit).wrapping_neg();
        self.code -= bound & mask;
        self.range = bound ^ ((bound ^ (self.range - bound)) & mask);
        model.learn(bit);
        self.renormalise();
        bit
    }

    #[inline]
    fn raw(&mut self, bits: u32, _: u32) -> u32 {
        if self.held_bits < bits {
            self.refill(bits);
        }
        let value = self.held & ((1 << bits) - 1);
        self.held >>= bits;
        self.held_bits -= bits;
        (value & 0xffff_ffff) as u32
    }
}

/// Codes nothing and agrees with everything: to find out how an encoder will do.
pub(super) struct DryRun;

impl Coder for DryRun {
    const ENCODES: bool = true;
    const DRY: bool = true;

    fn taken(&mut self) -> Self {
        Self
    }

    fn bit(&mut self, _: &mut Bit, bit: bool) -> bool {
        bit
    }

    fn raw(&mut self, _: u32, value: u32) -> u32 {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bits with a model of 8 (skewed by `skew`) mixed with raw bits.
    fn code(coder: &mut impl Coder, values: &[u32], skew: u32) -> Vec<u32> {
        let mut models = [Bit::NEW; 8];
        let one = |&x: &u32| {
            let bit = coder.bit(&mut models[x as usize & 7], (x >> 3) % (1 << skew) == 0);
            u32::from(bit) << 31 | coder.raw(x % 17, x >> 15 & ((1 << (x % 17)) - 1))
        };
        values.iter().map(one).collect()
    }

    proptest! {
        #[test]
        fn any_bits_round_trip(values in proptest::collection::vec(any::<u32>(), 0..3000), skew in 0u32..12) {
            let mut encoder = Encoder::new();
            let wanted = code(&mut encoder, &values, skew);
            let (bytes, raw) = encoder.finish();
            let mut decoder = Decoder::new(&bytes, &raw);
            // The decoder gets the models and widths, never the bits.
            let hidden: Vec<u32> = values.clone();
            prop_assert_eq!(decoded(&mut decoder, &hidden), wanted);
            prop_assert!(decoder.end(&Cursor::new(&[], "test")).is_ok());
        }
    }

    fn decoded(coder: &mut impl Coder, values: &[u32]) -> Vec<u32> {
        let mut models = [Bit::NEW; 8];
        let one = |&x: &u32| u32::from(coder.bit(&mut models[x as usize & 7], false)) << 31 | coder.raw(x % 17, 0);
        values.iter().map(one).collect()
    }

    #[test]
    fn a_million_equal_bits_take_less_than_two_thousand_bytes() {
        let mut encoder = Encoder::new();
        let mut model = Bit::NEW;
        for _ in 0..1_000_000 {
            encoder.bit(&mut model, true);
        }
        let bytes = encoder.finish().0;
        assert!(bytes.len() < 2000, "{}", bytes.len());
    }

    #[test]
    fn carries_propagate_through_long_runs() {
        // Raw values at the very top of the interval make runs of 0xff that a later carry has to cross.
        for tail in 0..200 {
            let mut encoder = Encoder::new();
            let mut models = [Bit::NEW; 2];
            let bits: Vec<bool> = (0..400).map(|i| i < 300 || (i * 7919 + tail) % 3 == 0).collect();
            for &bit in &bits {
                encoder.raw(16, 0xffff);
                encoder.bit(&mut models[0], bit);
            }
            let (bytes, raw) = encoder.finish();
            let mut decoder = Decoder::new(&bytes, &raw);
            let mut models = [Bit::NEW; 2];
            for &bit in &bits {
                assert_eq!(decoder.raw(16, 0), 0xffff);
                assert_eq!(decoder.bit(&mut models[0], false), bit);
            }
        }
    }
}

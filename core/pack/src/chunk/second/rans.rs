//! The entropy coder of codec 2. FORMAT section 5.12. (Duda, "Asymmetric numeral systems", 2013; interleaved states over
//! one stream: Giesen, "Interleaved entropy coders", 2014.)
//!
//! Three states of 32 bits take turns as the format says; each step gives a symbol of a table whose widths sum to
//! [`TOTAL`], and takes at most one word of 16 bits. Bits that no table helps with are raw: they are stored beside the
//! words, least significant first.

use crate::PackError;
use crate::bytes::{Cursor, push_varint};

/// Widths of a table sum to `2^TOTAL_BITS`.
const TOTAL_BITS: u32 = 12;
/// See [`TOTAL_BITS`].
pub(in crate::chunk) const TOTAL: u32 = 1 << TOTAL_BITS;
/// Number of states.
pub(in crate::chunk) const STATES: usize = 3;
/// Least value of a state between two symbols, and what each begins as in the encoder.
const LOWEST: u32 = 1 << 16;
/// Most bits that one call codes raw.
pub(in crate::chunk) const MAX_RAW_BITS: u32 = 56;
/// Zeros behind the raw bits, so that eight bytes can always be loaded.
const RAW_PADDING: usize = 16;

/// Parts of a chunk.
#[derive(Clone, Copy, Default)]
pub(in crate::chunk) enum Part {
    #[default]
    Connectivity,
    Borders,
    Positions,
    Colors,
    Normals,
    Scalars,
}

/// Number of [`Part`]s.
pub(in crate::chunk) const PARTS: usize = 6;

/// The coder of a value: [`Encoder`] or [`Decoder`]. The models are the same code on both sides; on the decoder's
/// side the value that is passed in is ignored and the one that was coded comes out.
pub(in crate::chunk) trait Coder {
    /// Whether this is an encoder: then the arrays hold the values, and choices can be fitted to them.
    const ENCODES: bool;
    /// Whether nothing comes of it but what is counted on the way.
    const DRY: bool = false;

    /// Where in `0..TOTAL` a state points; the symbol is the one whose part of the table this is.
    fn slot(&self, state: usize) -> u32;
    /// Code the symbol that begins at `start` and is `width` wide.
    fn advance(&mut self, state: usize, start: u32, width: u32);
    /// Code up to [`MAX_RAW_BITS`] bits as they are.
    fn raw(&mut self, bits: u32, value: u64) -> u64;

    /// What is coded from here on, for reports.
    #[inline]
    fn part(&mut self, _: Part) {}

    /// Fails if a decoder has read beyond the end of the stream.
    #[inline]
    fn check(&self) -> Result<(), PackError> {
        Ok(())
    }

    /// Code up to 32 bits as they are.
    #[inline]
    fn raw32(&mut self, bits: u32, value: u32) -> u32 {
        (self.raw(bits, value.into()) & 0xffff_ffff) as u32
    }
}

#[inline]
fn of<T>([x, y, z]: &mut [T; STATES], state: usize) -> &mut T {
    match state {
        0 => x,
        1 => y,
        _ => z,
    }
}

/// Collects symbols; they are coded backwards at the end.
#[derive(Clone, Default)]
pub(in crate::chunk) struct Encoder {
    /// Start, width << 12, state << 25, part << 27.
    steps: Vec<u32>,
    raw: Vec<u8>,
    held: u64,
    held_bits: u32,
    part: Part,
    raw_bits: [usize; PARTS],
}

impl Encoder {
    /// Bits of each part. For reports.
    pub(in crate::chunk) fn bits(&self) -> [f64; PARTS] {
        let mut bits = self.raw_bits.map(|bits| bits as f64);
        for step in &self.steps {
            if let Some(bits) = bits.get_mut((step >> 27) as usize) {
                *bits += f64::from(TOTAL_BITS) - libm::log2(f64::from(step >> TOTAL_BITS & 0x1fff));
            }
        }
        bits
    }

    /// The body of a chunk: the length of the words, the words, the raw bits. FORMAT section 5.12.
    pub(in crate::chunk) fn body(self) -> Vec<u8> {
        let (words, raw) = self.finish();
        let mut body = Vec::with_capacity(words.len() + raw.len() + 5);
        push_varint(&mut body, u32::try_from(words.len()).unwrap_or(u32::MAX));
        body.extend(words);
        body.extend(raw);
        body
    }

    /// The words, states first, and the raw bits.
    pub(in crate::chunk) fn finish(mut self) -> (Vec<u8>, Vec<u8>) {
        while self.held_bits > 0 {
            self.raw.push((self.held & 0xff) as u8);
            self.held >>= 8;
            self.held_bits = self.held_bits.saturating_sub(8);
        }
        let mut states = [LOWEST; STATES];
        let mut words: Vec<u16> = Vec::new();
        for step in self.steps.iter().rev() {
            let (start, width) = (step & (TOTAL - 1), step >> TOTAL_BITS & 0x1fff);
            let state = of(&mut states, (step >> 25 & 3) as usize);
            if u64::from(*state) >= u64::from(width) << (32 - TOTAL_BITS) {
                words.push((*state & 0xffff) as u16);
                *state >>= 16;
            }
            *state = ((*state / width) << TOTAL_BITS) + *state % width + start;
        }
        let mut out: Vec<u8> = states.iter().flat_map(|s| s.to_le_bytes()).collect();
        out.extend(words.iter().rev().flat_map(|w| w.to_le_bytes()));
        (out, self.raw)
    }
}

impl Coder for Encoder {
    const ENCODES: bool = true;

    fn slot(&self, _: usize) -> u32 {
        0
    }

    #[inline]
    fn advance(&mut self, state: usize, start: u32, width: u32) {
        #[expect(clippy::cast_possible_truncation, reason = "below 4")]
        let state = (state & 3) as u32;
        self.steps.push(start | width << TOTAL_BITS | state << 25 | (self.part as u32) << 27);
    }

    fn part(&mut self, part: Part) {
        self.part = part;
    }

    fn raw(&mut self, bits: u32, value: u64) -> u64 {
        if let Some(sum) = self.raw_bits.get_mut(self.part as usize) {
            *sum += bits as usize;
        }
        self.held |= value << self.held_bits;
        self.held_bits += bits;
        while self.held_bits >= 8 {
            self.raw.push((self.held & 0xff) as u8);
            self.held >>= 8;
            self.held_bits -= 8;
        }
        value
    }
}

/// What a [`Decoder`] reads.
pub(in crate::chunk) struct Stored {
    states: [u32; STATES],
    words: Vec<u16>,
    raw: Vec<u8>,
}

impl Stored {
    /// `words` and `raw` as [`Encoder::finish`] gave them; none if there are no states, or half a word.
    pub(in crate::chunk) fn new(words: &[u8], raw: &[u8]) -> Option<Self> {
        let (states, words) = words.split_at_checked(4 * STATES)?;
        let mut numbers = states.chunks_exact(4).filter_map(|s| s.try_into().ok()).map(u32::from_le_bytes);
        let states = [numbers.next()?, numbers.next()?, numbers.next()?];
        if !words.len().is_multiple_of(2) || states.iter().any(|&s| s < LOWEST) {
            return None;
        }
        let words = words.chunks_exact(2).filter_map(|w| w.try_into().ok()).map(u16::from_le_bytes).collect();
        let mut padded = Vec::with_capacity(raw.len() + RAW_PADDING);
        padded.extend_from_slice(raw);
        padded.resize(raw.len() + RAW_PADDING, 0);
        Some(Self { states, words, raw: padded })
    }
}

/// Reads a stream.
#[derive(Clone, Copy)]
pub(in crate::chunk) struct Decoder<'a> {
    states: [u32; STATES],
    words: &'a [u16],
    /// Words taken, also from beyond the end.
    next: usize,
    raw: &'a [u8],
    /// Next byte of `raw` that is not wholly in `held`.
    at: usize,
    held: u64,
    held_bits: u32,
}

impl<'a> Decoder<'a> {
    pub(in crate::chunk) fn new(stored: &'a Stored) -> Self {
        let Stored { states, words, raw } = stored;
        Self { states: *states, words, next: 0, raw, at: 0, held: 0, held_bits: 0 }
    }

    /// Whether more was read than there is: then the rest is meaningless.
    pub(in crate::chunk) fn is_past_end(&self) -> bool {
        self.next > self.words.len() || self.consumed() > self.raw_bits()
    }

    /// Raw bits that were read.
    fn consumed(&self) -> u64 {
        (8 * self.at as u64).saturating_sub(self.held_bits.into())
    }

    /// Raw bits that are stored.
    fn raw_bits(&self) -> u64 {
        8 * (self.raw.len() - RAW_PADDING) as u64
    }

    /// Fails unless exactly the stream was read, and the states are those that an encoder begins with.
    pub(in crate::chunk) fn end(&self, c: &Cursor<'_>) -> Result<(), PackError> {
        if self.is_past_end() {
            return Err(c.invalid("its coded part ends too early"));
        }
        let (read, bits) = (self.consumed(), self.raw_bits());
        let rest = self.held & ((1u64 << (bits - read).min(63)) - 1);
        if self.next != self.words.len() || bits - read >= 8 || rest != 0 {
            return Err(c.invalid("bytes are left over in its coded part"));
        }
        if self.states != [LOWEST; STATES] {
            return Err(c.invalid("its coded part ends in the wrong state"));
        }
        Ok(())
    }

    #[inline]
    fn refill(&mut self) {
        let bytes = self.raw.get(self.at..).and_then(<[u8]>::first_chunk::<8>);
        let Some(bytes) = bytes else { return self.refill_past_end() };
        self.held |= u64::from_le_bytes(*bytes) << self.held_bits;
        self.at += (63 - self.held_bits as usize) >> 3;
        self.held_bits |= 0b11_1000;
    }

    #[cold]
    fn refill_past_end(&mut self) {
        self.at = self.at.saturating_add(8);
        self.held_bits = 63;
    }
}

impl Coder for Decoder<'_> {
    const ENCODES: bool = false;

    fn check(&self) -> Result<(), PackError> {
        if self.is_past_end() {
            return Err(PackError::invalid("chunk", "its coded part ends too early"));
        }
        Ok(())
    }

    #[inline]
    fn slot(&self, state: usize) -> u32 {
        let [x, y, z] = self.states;
        let state = match state {
            0 => x,
            1 => y,
            _ => z,
        };
        state & (TOTAL - 1)
    }

    #[expect(clippy::inline_always, reason = "keeps the states in registers")]
    #[inline(always)]
    fn advance(&mut self, state: usize, start: u32, width: u32) {
        let word = self.words.get(self.next).copied().unwrap_or(0);
        let state = of(&mut self.states, state);
        let slot = *state & (TOTAL - 1);
        let x = width.wrapping_mul(*state >> TOTAL_BITS).wrapping_add(slot).wrapping_sub(start);
        let is_low = x < LOWEST;
        *state = if is_low { x << 16 | u32::from(word) } else { x };
        self.next += usize::from(is_low);
    }

    #[expect(clippy::inline_always, reason = "keeps the bits in a register")]
    #[inline(always)]
    fn raw(&mut self, bits: u32, _: u64) -> u64 {
        if self.held_bits < bits {
            self.refill();
        }
        let value = self.held & ((1 << bits) - 1);
        self.held >>= bits;
        self.held_bits = self.held_bits.wrapping_sub(bits);
        value
    }
}

/// Writes nothing: for an encoder to collect statistics of what it will have to code.
pub(in crate::chunk) struct DryRun;

impl Coder for DryRun {
    const ENCODES: bool = true;
    const DRY: bool = true;

    fn slot(&self, _: usize) -> u32 {
        0
    }

    fn advance(&mut self, _: usize, _: u32, _: u32) {}

    fn raw(&mut self, _: u32, value: u64) -> u64 {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::{Adaptive, Bit, Number, Wide};
    use super::super::tables::{COLOR_ROWS, MAX_SCALE, Scale, TABLES};
    use super::*;
    use proptest::prelude::*;

    /// A stream with one of everything, and what was coded: the models are the same code on both sides.
    fn all<C: Coder>(coder: &mut C, values: &[i32]) -> Vec<i64> {
        let (mut bit, mut number, mut wide) = (Bit::unknown(2), Number::new(22), Wide::new());
        let mut symbol = Adaptive::<16>::unknown(16);
        let mut out = Vec::new();
        for (i, &v) in values.iter().enumerate() {
            let small = v.unsigned_abs() & 0x1f_ffff;
            out.push(i64::from(bit.is(coder, i % 3, v > 0)));
            out.push(symbol.code(coder, i % 3, small as usize % 16) as i64);
            out.push(number.code(coder, i % 3, small).into());
            out.push(wide.code(coder, i % 3, v).into());
            out.push((coder.raw(MAX_RAW_BITS, u64::from(small) << 35 | 5) & 0xffff_ffff_ffff) as i64);
            let scale = Scale::new(i as u32 % (MAX_SCALE + 1));
            out.push(TABLES.one(coder, i % 3, scale, v).into());
            let color = Scale::of_color(i as u8 % COLOR_ROWS);
            out.push(TABLES.one(coder, i % 3, color, v).into());
        }
        out
    }

    fn coded(values: &[i32]) -> (Vec<u8>, Vec<u8>, Vec<i64>) {
        let mut encoder = Encoder::default();
        let there = all(&mut encoder, values);
        let (words, raw) = encoder.finish();
        (words, raw, there)
    }

    fn ends(words: &[u8], raw: &[u8], values: usize) -> Option<Result<Vec<i64>, PackError>> {
        let stored = Stored::new(words, raw)?;
        let mut decoder = Decoder::new(&stored);
        let back = all(&mut decoder, &vec![0; values]);
        Some(decoder.end(&Cursor::new(&[], "chunk")).map(|()| back))
    }

    proptest! {
        #[test]
        fn symbols_numbers_and_residuals_of_every_scale_come_back(
            values in proptest::collection::vec(prop_oneof![any::<i32>(), -9i32..9, Just(i32::MIN), Just(i32::MAX)], 1..300),
        ) {
            let (words, raw, there) = coded(&values);
            let back = ends(&words, &raw, values.len()).expect("is a stream").expect("ends as it should");
            prop_assert_eq!(back, there);
        }
    }

    #[test]
    fn a_stream_that_is_longer_or_shorter_or_ends_in_another_state_is_refused() {
        let values = [3, -70_000, 0, i32::MIN, 12];
        let (words, raw, _) = coded(&values);
        let refused = |words: &[u8], raw: &[u8]| !matches!(ends(words, raw, values.len()), Some(Ok(_)));
        assert!(!refused(&words, &raw));
        assert!(refused(&words[..words.len() - 1], &raw), "half a word");
        assert!(refused(&words[..words.len() - 2], &raw), "a word is missing");
        assert!(refused(&words[..11], &raw), "a state is cut off");
        assert!(refused(&[&words[..], &[0, 0]].concat(), &raw), "a word is left over");
        assert!(refused(&words, &raw[..raw.len() - 1]), "a raw byte is missing");
        assert!(refused(&words, &[&raw[..], &[0]].concat()), "a raw byte is left over");
        let mut low = words.clone();
        low[..4].copy_from_slice(&(LOWEST - 1).to_le_bytes());
        assert!(Stored::new(&low, &raw).is_none(), "a state below the lowest");
    }
}

//! Prediction residuals as entropy-coded tokens with raw low bits. FORMAT section 5.4.
//!
//! A residual is mapped to an unsigned number (0, -1, 1, -2 … become 0, 1, 2, 3 …). Numbers below 16 are their own
//! token; larger ones share a token by their two leading bits, and the other bits are stored as they are.

use super::rans;
use crate::PackError;
use crate::bytes::Cursor;

/// Writes streams of residuals.
#[derive(Default)]
pub(super) struct Writer {
    tokens: Vec<u8>,
    bits: BitWriter,
    /// The finished streams of tokens.
    pub(super) streams: Vec<u8>,
}

impl Writer {
    /// Add a residual to the current stream.
    pub(super) fn push(&mut self, residual: i32) {
        let u = ((residual << 1) ^ (residual >> 31)).cast_unsigned();
        if u < 16 {
            self.tokens.push((u & 15) as u8);
            return;
        }
        let top = u.ilog2();
        let below = top - 1;
        let second = (u >> below) & 1;
        self.tokens.push(((16 + (top - 4) * 2 + second) & 0xff) as u8);
        self.bits.push(u & ((1 << below) - 1), below);
    }

    /// Finish the current stream.
    pub(super) fn finish_stream(&mut self) {
        rans::encode(&self.tokens, &mut self.streams);
        self.tokens.clear();
    }

    /// All raw bits.
    pub(super) fn into_bits(self) -> Vec<u8> {
        self.bits.finish()
    }
}

/// Reads streams of residuals.
pub(super) struct Reader<'a> {
    bits: BitReader<'a>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bits: &'a [u8]) -> Self {
        Self { bits: BitReader { bytes: bits, held: 0, count: 0 } }
    }

    /// The next stream: `count` residuals.
    pub(super) fn stream(&mut self, c: &mut Cursor<'_>, count: usize) -> Result<Vec<i32>, PackError> {
        let tokens = rans::decode(c, count)?;
        let mut out = Vec::with_capacity(count);
        for token in tokens {
            let u = if token < 16 {
                u32::from(token)
            } else {
                let below = u32::from(token - 16) / 2 + 3;
                let raw = if below > 30 { None } else { self.bits.take(below) };
                let raw = raw.ok_or_else(|| c.invalid("a residual has bits that are not there"))?;
                (2 + u32::from(token & 1)) << below | raw
            };
            out.push((u >> 1).cast_signed() ^ -(u & 1).cast_signed());
        }
        Ok(out)
    }

    /// Fails when raw bits are left over.
    pub(super) fn end(&self, c: &Cursor<'_>) -> Result<(), PackError> {
        if self.bits.bytes.is_empty() && self.bits.count < 8 && self.bits.held == 0 {
            return Ok(());
        }
        Err(c.invalid("raw bits are left over"))
    }
}

/// Least significant bit first.
#[derive(Default)]
struct BitWriter {
    out: Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter {
    /// `count` at most 32.
    fn push(&mut self, value: u32, count: u32) {
        self.held |= u64::from(value) << self.count;
        self.count += count;
        while self.count >= 8 {
            self.out.push((self.held & 0xff) as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.out.push((self.held & 0xff) as u8);
        }
        self.out
    }
}

struct BitReader<'a> {
    bytes: &'a [u8],
    held: u64,
    count: u32,
}

impl BitReader<'_> {
    /// `count` at most 32.
    fn take(&mut self, count: u32) -> Option<u32> {
        while self.count < count {
            if let Some((word, rest)) = self.bytes.split_first_chunk::<4>() {
                self.held |= u64::from(u32::from_le_bytes(*word)) << self.count;
                self.bytes = rest;
                self.count += 32;
            } else {
                let (byte, rest) = self.bytes.split_first()?;
                self.held |= u64::from(*byte) << self.count;
                self.bytes = rest;
                self.count += 8;
            }
        }
        let value = self.held & ((1u64 << count) - 1);
        self.held >>= count;
        self.count -= count;
        Some((value & 0xffff_ffff) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_residuals_come_back(values in proptest::collection::vec(any::<i32>(), 1..500), shift in 0u32..31) {
            let values: Vec<i32> = values.iter().map(|v| v >> shift).collect();
            let mut w = Writer::default();
            for v in &values {
                w.push(*v);
            }
            w.finish_stream();
            let streams = w.streams.clone();
            let bits = w.into_bits();
            let mut c = Cursor::new(&streams, "test");
            let mut r = Reader::new(&bits);
            prop_assert_eq!(r.stream(&mut c, values.len()).expect("decodes"), values);
            r.end(&c).expect("all bits read");
        }
    }

    #[test]
    fn the_extremes_come_back() {
        let mut w = Writer::default();
        for v in [i32::MIN, i32::MAX, 0, -1, 7, 8, -8, -9] {
            w.push(v);
        }
        w.finish_stream();
        let streams = w.streams.clone();
        let bits = w.into_bits();
        let back = Reader::new(&bits).stream(&mut Cursor::new(&streams, "test"), 8).expect("decodes");
        assert_eq!(back, [i32::MIN, i32::MAX, 0, -1, 7, 8, -8, -9]);
    }
}

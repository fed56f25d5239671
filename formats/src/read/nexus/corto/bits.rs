//! A bit stream: numbers of variable bit length in 32-bit words, most significant bit first.

use super::super::bytes::{Cursor, Fault};

/// Reads bits.
pub(super) struct Bits<'b> {
    words: &'b [u8],
    /// Bits read so far.
    at: usize,
    /// Offset of the words in the file.
    base: u64,
}

impl<'b> Bits<'b> {
    /// Reads the number of words, aligns to four bytes, and takes the words.
    pub(super) fn open(from: &mut Cursor<'b>) -> Result<Self, Fault> {
        let words = from.u32("the length of a bit stream")? as usize;
        from.align("a bit stream")?;
        let base = from.offset();
        Ok(Self { words: from.take(words.saturating_mul(4), "a bit stream")?, at: 0, base })
    }

    /// The next number of `n` bits, at most 32.
    pub(super) fn read(&mut self, n: usize) -> Result<u32, Fault> {
        let fault = |found: String, expected: &str| {
            let expected = format!("{expected}; the file is damaged: copy it again");
            Fault { at: self.base + (self.at / 32 * 4) as u64, found, expected }
        };
        if n > 32 {
            return Err(fault(format!("a number of {n} bits"), "at most 32 bits"));
        }
        let end = self.at + n;
        if end > 8 * self.words.len() {
            return Err(fault("the end of the bit stream".to_owned(), &format!("{n} more bits")));
        }
        let word = |i: usize| {
            self.words.get(4 * i..4 * i + 4).map_or(0, |b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        };
        let first = self.at / 32;
        let both = word(first) << 32 | word(first + 1);
        let value = both << (self.at % 32) >> 32 >> (32 - n);
        self.at = end;
        Ok(value as u32)
    }
}

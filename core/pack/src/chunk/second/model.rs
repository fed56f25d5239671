//! Symbols whose frequencies are learnt, and numbers made of them. FORMAT section 5.13.

use super::rans::{Coder, TOTAL};

/// What one occurrence adds to a count.
const STEP: u16 = 16;
/// Counts are halved when their sum passes this.
const MOST: u32 = 16_384;
/// Symbols until the table is made again: at first, and at most.
const PAUSES: [u16; 2] = [4, 64];

/// A symbol of up to `LANES` kinds: counts, and a table that is made from them again and again.
#[derive(Clone, Copy)]
pub(in crate::chunk) struct Adaptive<const LANES: usize> {
    /// Where each symbol's part of the table begins; [`TOTAL`] for those that do not exist.
    starts: [u16; LANES],
    counts: [u16; LANES],
    /// Symbols until the table is made again.
    left: u16,
    pause: u16,
}

impl<const LANES: usize> Adaptive<LANES> {
    /// Symbols and what is known of their frequencies: counts in sixteenths of an occurrence, from 1 on, 0 for those that
    /// do not exist; these come last.
    pub(in crate::chunk) fn new(counts: [u16; LANES]) -> Self {
        let [first, _] = PAUSES;
        let mut new = Self { starts: [0; LANES], counts, left: first, pause: first };
        new.make();
        new
    }

    /// Nothing is known: `n` symbols with the same small count.
    pub(in crate::chunk) fn unknown(n: usize) -> Self {
        let mut counts = [0; LANES];
        counts.iter_mut().take(n).for_each(|count| *count = STEP / 2);
        Self::new(counts)
    }

    #[expect(clippy::inline_always, reason = "keeps the coder in registers")]
    #[inline(always)]
    pub(in crate::chunk) fn code<C: Coder>(&mut self, coder: &mut C, state: usize, symbol: usize) -> usize {
        let symbol = if C::ENCODES {
            symbol
        } else {
            let slot = (coder.slot(state) & 0xffff) as u16;
            // One branch after another, likelier symbols first: what is foreseen does not wait for the state.
            self.starts.iter().skip(1).take_while(|&&start| start <= slot).count()
        };
        let start = self.starts.get(symbol).copied().map_or(0, u32::from);
        let end = self.starts.get(symbol + 1).copied().map_or(TOTAL, u32::from);
        coder.advance(state, start, end.wrapping_sub(start));
        if let Some(count) = self.counts.get_mut(symbol) {
            *count += STEP;
        }
        self.left -= 1;
        if self.left == 0 {
            self.pause = (2 * self.pause).min(PAUSES[1]);
            self.left = self.pause;
            self.make();
        }
        symbol
    }

    /// The table from the counts: each symbol gets 1 and its share of the rest, the last one what remains.
    #[inline(never)]
    fn make(&mut self) {
        let mut sum: u32 = self.counts.iter().map(|&c| u32::from(c)).sum();
        if sum > MOST {
            self.counts.iter_mut().for_each(|c| *c -= *c / 2);
            sum = self.counts.iter().map(|&c| u32::from(c)).sum();
        }
        let used = self.counts.iter().map(|&c| u32::from(c > 0)).sum::<u32>();
        let share = ((TOTAL - used) << 16) / sum.max(1);
        let mut at = 0;
        for (start, &count) in self.starts.iter_mut().zip(&self.counts) {
            *start = if count > 0 { (at & 0xffff) as u16 } else { (TOTAL & 0xffff) as u16 };
            at += if count > 0 { 1 + ((u32::from(count) * share) >> 16) } else { 0 };
        }
    }
}

/// A yes or no whose probability is learnt.
pub(in crate::chunk) type Bit = Adaptive<2>;

impl Bit {
    pub(in crate::chunk) fn is(&mut self, coder: &mut impl Coder, state: usize, yes: bool) -> bool {
        self.code(coder, state, usize::from(yes)) == 1
    }
}

/// Unsigned numbers of unknown size: the number of bits of `value + 1` as a symbol, then the bits below the first.
#[derive(Clone)]
pub(in crate::chunk) struct Number {
    size: Adaptive<32>,
}

impl Number {
    /// Numbers below `2^sizes - 1`.
    pub(in crate::chunk) fn new(sizes: usize) -> Self {
        Self { size: Adaptive::unknown(sizes) }
    }

    /// `value` is at most 2^32 - 2.
    #[cold]
    #[inline(never)]
    pub(in crate::chunk) fn code(&mut self, coder: &mut impl Coder, state: usize, value: u32) -> u32 {
        let up = value.wrapping_add(1);
        #[expect(clippy::cast_possible_truncation, reason = "below 32")]
        let size = (self.size.code(coder, state, up.checked_ilog2().unwrap_or(0) as usize) & 31) as u32;
        let low = (1u32 << size) - 1;
        (1u32 << size | coder.raw32(size, up & low)).wrapping_sub(1)
    }
}

/// Signed numbers of all 32 bits: the number of bits of `2 |x|`, less one where x is negative, then those below the first.
pub(in crate::chunk) struct Wide {
    size: Adaptive<40>,
}

impl Wide {
    pub(in crate::chunk) fn new() -> Self {
        Self { size: Adaptive::unknown(33) }
    }

    pub(in crate::chunk) fn code(&mut self, coder: &mut impl Coder, state: usize, value: i32) -> i32 {
        let u = (value << 1 ^ value >> 31).cast_unsigned();
        #[expect(clippy::cast_possible_truncation, reason = "at most 32")]
        let size = self.size.code(coder, state, (32 - u.leading_zeros()) as usize).min(32) as u32;
        let u = match size.checked_sub(1) {
            None => 0,
            Some(below) => 1 << below | coder.raw32(below, u & ((1u32 << below) - 1)),
        };
        (u >> 1).cast_signed() ^ -(u & 1).cast_signed()
    }
}

//! Entropy coding of byte streams: static order-0 range ANS with two interleaved states (Duda, "Asymmetric numeral
//! systems", 2013; word-wise variant after Giesen, "Interleaved entropy coders", 2014). FORMAT section 5.3.
//!
//! Each stream carries its own table of frequencies, which sum to 4096. A decoder that ends in the initial state with
//! all words read has read what was written; anything else is refused.

use crate::PackError;
use crate::bytes::{Cursor, push_varint};

/// Frequencies sum to 2 to this power.
const SCALE_BITS: u32 = 12;
const SCALE: u32 = 1 << SCALE_BITS;
/// States stay in `LOW .. LOW << 16`.
const LOW: u32 = 1 << 16;

/// Append `symbols`, coded; their number is not written.
pub(super) fn encode(symbols: &[u8], out: &mut Vec<u8>) {
    if symbols.is_empty() {
        return;
    }
    let frequencies = normalised(symbols);
    write_table(&frequencies, out);
    let mut starts = [0u32; 256];
    let mut sum = 0;
    for (start, f) in starts.iter_mut().zip(frequencies) {
        *start = sum;
        sum += f;
    }
    let mut states = [LOW; 2];
    let mut words: Vec<u16> = Vec::new();
    for (i, symbol) in symbols.iter().enumerate().rev() {
        let at = usize::from(*symbol);
        let f = u64::from(frequencies.get(at).copied().unwrap_or(1));
        let start = u64::from(starts.get(at).copied().unwrap_or(0));
        let [even, odd] = &mut states;
        let state = if i % 2 == 0 { even } else { odd };
        let mut x = u64::from(*state);
        if x >= f << (32 - SCALE_BITS) {
            words.push((x & 0xffff) as u16);
            x >>= 16;
        }
        let next = ((x / f) << SCALE_BITS) + x % f + start;
        *state = (next & 0xffff_ffff) as u32;
    }
    push_varint(out, u32::try_from(words.len()).unwrap_or(u32::MAX));
    for state in states {
        out.extend(state.to_le_bytes());
    }
    for word in words.iter().rev() {
        out.extend(word.to_le_bytes());
    }
}

/// Read `count` symbols that [`encode`] wrote.
pub(super) fn decode(c: &mut Cursor<'_>, count: usize) -> Result<Vec<u8>, PackError> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let slots = read_table(c)?;
    let words = c.varint()? as usize;
    let mut states = [c.u32()?, c.u32()?];
    if states.iter().any(|&x| x < LOW) {
        return Err(c.invalid("an entropy coder begins in an impossible state"));
    }
    let coded = c.take(words.saturating_mul(2))?;
    let (pairs, _) = coded.as_chunks::<2>();
    let mut input = pairs.iter().map(|w| u16::from_le_bytes(*w));
    let mut out = Vec::with_capacity(count);
    let [even, odd] = &mut states;
    let mut step = |x: &mut u32| -> Option<u8> {
        let slot = *slots.get((*x & (SCALE - 1)) as usize)?;
        *x = slot.frequency * (*x >> SCALE_BITS) + u32::from(slot.offset);
        if *x < LOW {
            *x = *x << 16 | u32::from(input.next()?);
        }
        Some(slot.symbol)
    };
    for _ in 0..count / 2 {
        let (Some(a), Some(b)) = (step(even), step(odd)) else {
            return Err(c.invalid("an entropy-coded stream ends too early"));
        };
        out.extend([a, b]);
    }
    if count % 2 == 1 {
        out.push(step(even).ok_or_else(|| c.invalid("an entropy-coded stream ends too early"))?);
    }
    if states != [LOW; 2] || input.next().is_some() {
        return Err(c.invalid("an entropy-coded stream does not end where it should"));
    }
    Ok(out)
}

/// What a slot of the scale stands for.
#[derive(Clone, Copy, Default)]
struct Slot {
    frequency: u32,
    /// Slot number minus the symbol's first slot.
    offset: u16,
    symbol: u8,
}

/// Frequencies that sum to [`SCALE`], at least 1 for every symbol that occurs.
fn normalised(symbols: &[u8]) -> [u32; 256] {
    let mut counts = [0u64; 256];
    for symbol in symbols {
        if let Some(n) = counts.get_mut(usize::from(*symbol)) {
            *n += 1;
        }
    }
    let total = symbols.len() as u64;
    let share = |n: u64| if n == 0 { 0 } else { (n * u64::from(SCALE) / total).max(1) };
    let mut frequencies = counts.map(|n| u32::try_from(share(n)).unwrap_or(SCALE));
    // Rounding is made good where it costs least: at the largest frequencies.
    let mut sum: u32 = frequencies.iter().sum();
    while sum != SCALE {
        let largest = frequencies.iter().copied().max().unwrap_or(0);
        let Some(f) = frequencies.iter_mut().find(|f| **f == largest) else { break };
        if sum < SCALE {
            *f += SCALE - sum;
            sum = SCALE;
        } else {
            let less = (sum - SCALE).min((*f / 2).max(1));
            *f -= less;
            sum -= less;
        }
    }
    frequencies
}

/// For every symbol from 0: its frequency; after a 0 the number of further symbols that do not occur. Ends when the
/// sum is reached.
fn write_table(frequencies: &[u32; 256], out: &mut Vec<u8>) {
    let mut sum = 0;
    let mut rest = frequencies.iter().peekable();
    while sum < SCALE {
        let Some(&f) = rest.next() else { break };
        push_varint(out, f);
        sum += f;
        if f == 0 {
            let mut run = 0;
            while rest.next_if(|f| **f == 0).is_some() {
                run += 1;
            }
            push_varint(out, run);
        }
    }
}

fn read_table(c: &mut Cursor<'_>) -> Result<Vec<Slot>, PackError> {
    let mut slots = Vec::with_capacity(SCALE as usize);
    let mut symbol = 0u32;
    while slots.len() < SCALE as usize {
        let frequency = c.varint()?;
        let Ok(name) = u8::try_from(symbol) else {
            return Err(c.invalid("a frequency table has more than 256 symbols"));
        };
        if frequency == 0 {
            symbol = symbol.saturating_add(c.varint()?);
        } else if frequency as usize > SCALE as usize - slots.len() {
            return Err(c.invalid("a frequency table sums to more than 4096"));
        }
        slots.extend((0u16..).take(frequency as usize).map(|offset| Slot { frequency, offset, symbol: name }));
        symbol = symbol.saturating_add(1);
    }
    Ok(slots)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_bytes_come_back(symbols in proptest::collection::vec(any::<u8>(), 0..2000), skew in 0u32..8) {
            let symbols: Vec<u8> = symbols.iter().map(|s| s >> skew).collect();
            let mut out = Vec::new();
            encode(&symbols, &mut out);
            let mut c = Cursor::new(&out, "test");
            prop_assert_eq!(decode(&mut c, symbols.len()).expect("decodes"), symbols);
            prop_assert_eq!(c.remaining(), 0);
        }
    }

    #[test]
    fn a_constant_stream_costs_a_few_bytes() {
        let mut out = Vec::new();
        encode(&vec![7; 100_000], &mut out);
        assert!(out.len() < 20, "{}", out.len());
        assert_eq!(decode(&mut Cursor::new(&out, "test"), 100_000).expect("decodes"), vec![7; 100_000]);
    }

    #[test]
    fn all_symbols_with_one_dominating_come_back() {
        let symbols: Vec<u8> = (0..=255).chain(std::iter::repeat_n(3, 1_000_000)).collect();
        let mut out = Vec::new();
        encode(&symbols, &mut out);
        assert_eq!(decode(&mut Cursor::new(&out, "test"), symbols.len()).expect("decodes"), symbols);
    }
}

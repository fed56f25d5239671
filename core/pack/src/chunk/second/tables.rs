//! Residuals: fixed tables for every scale, and some for colours. FORMAT section 5.15.
//!
//! A residual is a symbol, which is the highest bits of its magnitude, and raw bits. Its *scale*, in quarter octaves, chooses the table:
//! up to 19 there is one for each; above, four repeat, and so many more bits are raw.

use super::rans::{Coder, MAX_RAW_BITS, TOTAL};
use super::widths::WIDTHS;
use std::sync::LazyLock;

/// Symbols of a table.
const SYMBOLS: usize = 16;
/// Tables for scales; those for colours follow.
const ROWS: u8 = 24;
/// Tables for colours.
pub(super) const COLOR_ROWS: u8 = 32;
/// Scales below this have tables of their own; from here on four repeat.
const REPEAT: u32 = 20;
/// Largest scale.
pub(super) const MAX_SCALE: u32 = 115;
/// The last symbol: the magnitude follows in full.
const ESCAPE: usize = SYMBOLS - 1;
/// Raw bits that state how many bits an escaped magnitude has.
const ESCAPE_BITS: u32 = 5;
/// Least magnitude of each symbol, without the raw bits of its scale.
const LEAST: [u16; SYMBOLS] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 32, 64, 128];
/// Raw bits of each symbol beside those of its scale.
const EXTRA: [u8; ESCAPE] = [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 2, 3, 3, 5, 6];
/// Contexts, in quarter octaves.
pub(super) const NEARBY: usize = 128;

/// What a decoder needs of one symbol at one scale, in one word: where it begins (12 bits), its width (13), its raw bits with those of
/// the scale and the sign (6), whether there is a sign; its least magnitude (31 bits), and whether a negative one is a complement.
#[derive(Clone, Copy)]
struct Entry(u64);

impl Entry {
    fn new(start: u16, width: u16, symbol: usize, scale_bits: u32) -> Self {
        let least = LEAST.get(symbol).copied().map_or(0, u64::from) << scale_bits;
        let sign = u32::from(scale_bits > 0 || symbol > 0);
        // More than can be read at once: the decoder takes the slow path.
        let raw = EXTRA.get(symbol).map_or(63, |&extra| u32::from(extra) + scale_bits + sign);
        let low = u64::from(start) | u64::from(width) << 12 | u64::from(raw) << 25 | u64::from(sign) << 31;
        Self(low | least << 32 | u64::from(scale_bits > 0) << 63)
    }

    #[inline]
    fn start(self) -> u32 {
        (self.0 & 0xfff) as u32
    }

    #[inline]
    fn width(self) -> u32 {
        (self.0 >> 12 & 0x1fff) as u32
    }

    /// Raw bits, the sign included; more than [`MAX_RAW_BITS`] where the magnitude escapes.
    #[inline]
    fn raw_bits(self) -> u32 {
        (self.0 >> 25 & 0x3f) as u32
    }

    /// 1 or 0.
    #[inline]
    fn sign(self) -> u32 {
        (self.0 >> 31 & 1) as u32
    }

    #[inline]
    fn least(self) -> u32 {
        (self.0 >> 32 & 0x7fff_ffff) as u32
    }

    /// The residual whose raw bits these are; the sign is the lowest.
    #[inline]
    fn value(self, raw: u32) -> i32 {
        let sign = self.sign();
        let magnitude = self.least().wrapping_add(raw >> sign);
        let negative = raw & sign;
        let less = negative & !((self.0 >> 63) as u32);
        (magnitude ^ negative.wrapping_neg()).wrapping_add(less).cast_signed()
    }
}

/// Rows that there is room for: a power of two, so that an index can be masked.
const ROOM: usize = 64;
/// Places of all rows.
const PLACES: usize = ROOM * TOTAL as usize;
/// Scales and colour rows that there is room for.
const SCALES: usize = 256;
/// Symbols of all scales.
const ENTRIES: usize = SCALES * SYMBOLS;

/// All tables, in a form that is fast to use.
pub(super) struct Tables {
    /// The symbol at each place of each table.
    symbols: Box<[u8; PLACES]>,
    entries: Box<[Entry; ENTRIES]>,
    /// Bits that each symbol costs.
    costs: Vec<f32>,
}

/// The tables; made when a chunk is first coded.
pub(super) static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let mut symbols = Vec::with_capacity(PLACES);
    let mut costs = Vec::new();
    for row in &WIDTHS {
        for (symbol, &width) in (0u8..).zip(row) {
            symbols.extend(std::iter::repeat_n(symbol, width.into()));
            costs.push(log2_of_share(width));
        }
    }
    symbols.resize(PLACES, 0);
    let mut entries = Vec::with_capacity(ENTRIES);
    for scale in (0..=MAX_SCALE).map(Scale::new).chain((0..COLOR_ROWS).map(Scale::of_color)) {
        let mut start = 0;
        for (symbol, &width) in WIDTHS.get(scale.row()).into_iter().flatten().enumerate() {
            entries.push(Entry::new(start, width, symbol, scale.bits()));
            start += width;
        }
    }
    entries.resize(ENTRIES, Entry(0));
    let symbols = symbols.into_boxed_slice().try_into().unwrap_or_else(|_| Box::new([0; PLACES]));
    let entries = entries.into_boxed_slice().try_into().unwrap_or_else(|_| Box::new([Entry(0); ENTRIES]));
    Tables { symbols, entries, costs }
});

#[expect(clippy::cast_possible_truncation, reason = "a few digits are enough to compare costs")]
fn log2_of_share(width: u16) -> f32 {
    (f64::from(TOTAL.ilog2()) - libm::log2(f64::from(width))) as f32
}

/// A scale, or a row for colours: its number among both, and the row.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub(super) struct Scale {
    number: u8,
    row: u8,
}

impl Scale {
    /// The table of a scale, 0 to [`MAX_SCALE`].
    #[inline]
    pub(super) fn new(scale: u32) -> Self {
        let number = (scale.min(MAX_SCALE) & 0xff) as u8;
        let repeat = (REPEAT & 0xff) as u8;
        Self { number, row: if number < repeat { number } else { repeat + number % 4 } }
    }

    /// A table for colours.
    pub(super) fn of_color(row: u8) -> Self {
        let row = row % COLOR_ROWS;
        Self { number: (MAX_SCALE & 0xff) as u8 + 1 + row, row: ROWS + row }
    }

    fn row(self) -> usize {
        self.row.into()
    }

    /// Raw bits of the scale.
    #[inline]
    fn bits(self) -> u32 {
        let is_scale = u32::from(self.number) <= MAX_SCALE;
        if is_scale { (u32::from(self.number) / 4).saturating_sub(4) } else { 0 }
    }
}

/// Quarter octaves of `sum + 1`.
#[inline]
pub(super) fn quarter_octave(sum: u32) -> usize {
    let x = sum.saturating_add(1);
    let top = x.ilog2();
    // Two bits below the highest.
    let below = (u64::from(x) << 2 >> top) & 3;
    4 * top as usize + below as usize
}

/// The magnitude that is coded: with scale bits there is no -0, so that every bit pattern has a meaning.
#[inline]
fn magnitude(value: i32, scale_bits: u32) -> u32 {
    if scale_bits > 0 { (value ^ value >> 31).cast_unsigned() } else { value.unsigned_abs() }
}

/// The symbol of a residual.
#[inline]
fn symbol_of(value: i32, scale: Scale) -> usize {
    let high = magnitude(value, scale.bits()) >> scale.bits();
    if high < 8 {
        return high as usize;
    }
    LEAST.iter().rposition(|&least| u32::from(least) <= high).unwrap_or(0)
}

impl Tables {
    #[inline]
    fn entry(&self, scale: Scale, symbol: usize) -> Entry {
        self.entries.get((usize::from(scale.number) * SYMBOLS + symbol) % ENTRIES).copied().unwrap_or(Entry(0))
    }

    /// Bits that a residual takes, a sign included.
    pub(super) fn cost(&self, scale: Scale, value: i32) -> f32 {
        let symbol = symbol_of(value, scale);
        let cost = self.costs.get(scale.row() * SYMBOLS + symbol).copied().unwrap_or(0.0);
        let raw = if symbol == ESCAPE { 38 } else { self.entry(scale, symbol).raw_bits() };
        cost + raw as f32
    }

    #[expect(clippy::inline_always, reason = "keeps the coder in registers")]
    #[inline(always)]
    fn symbol<C: Coder>(&self, coder: &mut C, state: usize, scale: Scale, value: i32) -> Entry {
        let symbol = if C::ENCODES {
            symbol_of(value, scale)
        } else {
            let place = scale.row() * TOTAL as usize + coder.slot(state) as usize;
            self.symbols.get(place % PLACES).copied().unwrap_or(0).into()
        };
        let entry = self.entry(scale, symbol);
        coder.advance(state, entry.start(), entry.width());
        entry
    }

    /// Code one residual.
    #[inline]
    pub(super) fn one<C: Coder>(&self, coder: &mut C, state: usize, scale: Scale, value: i32) -> i32 {
        let entry = self.symbol(coder, state, scale, value);
        rest(coder, entry, scale, value)
    }

    /// Code residuals of three axes or channels, each with its state.
    #[expect(clippy::inline_always, reason = "keeps the coder in registers")]
    #[inline(always)]
    pub(super) fn three<C: Coder>(&self, coder: &mut C, scales: [Scale; 3], values: [i32; 3]) -> [i32; 3] {
        let ([f, g, h], [a, b, c]) = (scales, values);
        let p = self.symbol(coder, 0, f, a);
        let q = self.symbol(coder, 1, g, b);
        let r = self.symbol(coder, 2, h, c);
        let [i, j, k] = [p, q, r].map(Entry::raw_bits);
        let all = i + j + k;
        if C::ENCODES || all > MAX_RAW_BITS {
            return [rest(coder, p, f, a), rest(coder, q, g, b), rest(coder, r, h, c)];
        }
        let raw = coder.raw(all, 0);
        let part = |shift: u32, bits: u32| (raw >> shift & ((1 << bits) - 1) & 0xffff_ffff) as u32;
        [p.value(part(0, i)), q.value(part(i, j)), r.value(part(i + j, k))]
    }
}

/// The raw bits of a residual.
#[inline]
fn rest<C: Coder>(coder: &mut C, entry: Entry, scale: Scale, value: i32) -> i32 {
    let bits = entry.raw_bits();
    if bits > MAX_RAW_BITS {
        return escaped(coder, value);
    }
    let above = magnitude(value, scale.bits()).wrapping_sub(entry.least());
    let raw = u64::from(above) << entry.sign() | u64::from(value < 0 && entry.sign() > 0);
    entry.value((coder.raw(bits, if C::ENCODES { raw } else { 0 }) & 0xffff_ffff) as u32)
}

/// A residual that is too large for its table: the number of bits of its magnitude, the magnitude, the sign.
#[cold]
fn escaped<C: Coder>(coder: &mut C, value: i32) -> i32 {
    // i32::MIN is its own negative: it goes as 31 bits of -0.
    let magnitude = value.unsigned_abs() & 0x7fff_ffff;
    let bits = coder.raw32(ESCAPE_BITS, 32 - magnitude.leading_zeros());
    let raw = coder.raw(bits + 1, u64::from(magnitude) << 1 | u64::from(value < 0));
    let (magnitude, negative) = ((raw >> 1 & 0x7fff_ffff) as u32, raw & 1 == 1);
    match (negative, magnitude) {
        (true, 0) => i32::MIN,
        (true, _) => magnitude.wrapping_neg().cast_signed(),
        _ => magnitude.cast_signed(),
    }
}

/// How the scale of a residual follows from what is nearby: `offset + slope t / 8 - 24`, t in quarter octaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Line {
    pub(super) offset: u32,
    pub(super) slope: u32,
}

impl Line {
    /// As it is stored: 11 bits.
    pub(super) fn code(self, coder: &mut impl Coder) -> Self {
        Self { offset: coder.raw32(7, self.offset), slope: coder.raw32(4, self.slope) }
    }

    /// Whether `other` is tried in the fine search around this one.
    pub(super) fn is_near(self, other: Self) -> bool {
        let moved =
            2 * i64::from(self.slope) - 2 * i64::from(other.slope) + i64::from(self.offset) - i64::from(other.offset);
        self.slope.abs_diff(other.slope) <= 1 && moved.abs() <= 8
    }

    /// The number of the scale where `nearby` quarter octaves are nearby.
    #[inline]
    pub(super) fn scale_number(self, nearby: u32) -> u32 {
        (self.offset + ((self.slope * nearby) >> 3)).saturating_sub(OFFSET).min(MAX_SCALE)
    }

    /// The scale where so many quarter octaves are nearby.
    #[inline]
    pub(super) fn scale(self, nearby: usize) -> Scale {
        #[expect(clippy::cast_possible_truncation, reason = "below 128")]
        let nearby = (nearby & (NEARBY - 1)) as u32;
        Scale::new(self.scale_number(nearby))
    }

    /// All of them.
    pub(super) fn scales(self) -> [Scale; NEARBY] {
        let mut scales = [Scale::default(); NEARBY];
        for (scale, nearby) in scales.iter_mut().zip(0..) {
            *scale = Scale::new(self.scale_number(nearby));
        }
        scales
    }
}

/// Offsets are stored with so much added: lines with a slope can begin below 0.
pub(super) const OFFSET: u32 = 24;

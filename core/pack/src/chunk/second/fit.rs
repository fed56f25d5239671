//! The encoder's choice of a [`Line`] for residuals that it has seen.

use super::tables::{COLOR_ROWS, Line, MAX_SCALE, NEARBY, OFFSET, Scale, TABLES};

/// Scales on each side of the likeliest that are tried.
const WINDOW: u32 = 12;
/// Steeper lines are not tried.
const STEEPEST: u32 = 12;

/// Residuals, by what was nearby.
#[derive(Default)]
pub(super) struct Seen {
    /// What was nearby, and the residual less [`i32::MIN`]; of large ones only the highest bits are kept.
    keys: Vec<u64>,
}

/// A residual, and how often it was seen.
type Count = (i32, u32);

impl Seen {
    /// One more residual.
    pub(super) fn add(&mut self, nearby: usize, residual: i32) {
        let residual = rounded(residual).cast_unsigned() ^ 1 << 31;
        self.keys.push((nearby.min(NEARBY - 1) as u64) << 32 | u64::from(residual));
    }

    /// The residuals for each size of what is nearby, ascending.
    fn rows(&mut self) -> Vec<(u32, Vec<Count>)> {
        self.keys.sort_unstable();
        let mut rows: Vec<(u32, Vec<Count>)> = Vec::new();
        for same in self.keys.chunk_by(|a, b| a == b) {
            let Some(key) = same.first() else { continue };
            let nearby = (key >> 32 & 0xff) as u32;
            let residual = ((key & 0xffff_ffff) as u32 ^ 1 << 31).cast_signed();
            let count = (residual, u32::try_from(same.len()).unwrap_or(u32::MAX));
            match rows.last_mut() {
                Some((t, row)) if *t == nearby => row.push(count),
                _ => rows.push((nearby, vec![count])),
            }
        }
        rows
    }

    /// The table for colours that takes the fewest bits.
    pub(super) fn best_color(&mut self) -> u8 {
        let rows = self.rows();
        let bits = |row: u8| -> f32 {
            let scale = Scale::of_color(row);
            let all = rows.iter().flat_map(|(_, row)| row);
            all.map(|&(residual, count)| TABLES.cost(scale, residual) * count as f32).sum()
        };
        let first = |best: (f32, u8), row| {
            let bits = bits(row);
            if bits < best.0 { (bits, row) } else { best }
        };
        (0..COLOR_ROWS).fold((f32::INFINITY, 0), first).1
    }

    /// The line that takes the fewest bits: looked for from coarse to fine.
    pub(super) fn best(&mut self) -> Line {
        let costs = costs(&self.rows());
        let bits = |line: Line| -> f32 {
            let cost = |(t, row): &(u32, Vec<f32>)| row.get(line.scale_number(*t) as usize).copied().unwrap_or(0.0);
            costs.iter().map(cost).sum()
        };
        let mut best = (f32::INFINITY, Line { offset: OFFSET, slope: 0 });
        for (slopes, offsets) in [((0..=STEEPEST).step_by(2), 4), ((0..=STEEPEST).step_by(1), 1)] {
            let around = best;
            for slope in slopes {
                for offset in (0..128).step_by(offsets) {
                    let line = Line { offset, slope };
                    if around.0 < f32::INFINITY && !around.1.is_near(line) {
                        continue;
                    }
                    let bits = bits(line);
                    if bits < best.0 {
                        best = (bits, line);
                    }
                }
            }
        }
        best.1
    }
}

/// For each size of what is nearby the bits at every scale; far from the likeliest one only that they are many.
fn costs(rows: &[(u32, Vec<Count>)]) -> Vec<(u32, Vec<f32>)> {
    let cost = |row: &Vec<Count>| {
        let count: u32 = row.iter().map(|r| r.1).sum();
        let sum: u64 = row.iter().map(|r| u64::from(r.0.unsigned_abs()) * u64::from(r.1)).sum();
        let likeliest = likeliest(sum, count);
        let (low, high) = (likeliest.saturating_sub(WINDOW), (likeliest + WINDOW).min(MAX_SCALE));
        let bits = |scale: u32| {
            let scale = Scale::new(scale);
            row.iter().map(|&(residual, count)| TABLES.cost(scale, residual) * count as f32).sum()
        };
        let near: Vec<f32> = (low..=high).map(bits).collect();
        let (first, last) = (near.first().copied().unwrap_or(0.0), near.last().copied().unwrap_or(0.0));
        // Below, residuals escape, which costs the same at every scale; above, each octave costs a raw bit.
        let below = std::iter::repeat_n(first, low as usize);
        let above = (1..=MAX_SCALE - high).map(|more| last + (more * count) as f32 / 4.0);
        below.chain(near.iter().copied()).chain(above).collect()
    };
    rows.iter().map(|(t, row)| (*t, cost(row))).collect()
}

/// A value with the four highest bits of its magnitude.
fn rounded(x: i32) -> i32 {
    let shift = (28 - x.unsigned_abs().leading_zeros().min(28)).min(27);
    x >> shift << shift
}

/// The scale whose mean magnitude is about that of so many residuals: a mean of 4 is scale 20, four more double it.
fn likeliest(sum: u64, count: u32) -> u32 {
    let eighths = (sum * 64 / u64::from(count.max(1)) + 1).min(1 << 40);
    let top = eighths.ilog2();
    let quarters = 4 * top + ((eighths << 2 >> top) & 3) as u32;
    // 256 sixty-fourths: 32.
    (quarters + 20).saturating_sub(32).min(MAX_SCALE)
}

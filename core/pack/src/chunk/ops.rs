//! The choices of the cut-border machine as codec 1 codes them: one binary decision after another. FORMAT section 5.4.

use super::border::{Choices, Impossible, MAX_AT_VERTEX, Near, Op, REACH};
use super::number::Number;
use super::range::{Bit, Coder};

/// Adaptive probabilities.
pub(super) struct Models<C> {
    pub(super) coder: C,
    /// Whether a gate brings a new vertex, is a border, closes to the right, to the left; by the triangles at both ends
    /// and whether the gates before and behind are dead.
    ops: Vec<[Bit; 4]>,
    along: Bit,
    distance: Number,
    back: Number,
    same_patch: [Bit; 16],
    other_patch: Bit,
    seed_new: [Bit; 3],
}

impl<C> Models<C> {
    pub(super) fn new(coder: C) -> Self {
        Self {
            coder,
            ops: vec![[Bit::NEW; 4]; 4 * (usize::from(MAX_AT_VERTEX) + 1).pow(2)],
            along: Bit::NEW,
            distance: Number::new(),
            back: Number::new(),
            same_patch: [Bit::NEW; 16],
            other_patch: Bit::NEW,
            seed_new: [Bit::NEW; 3],
        }
    }
}

impl<C: Coder> Choices for Models<C> {
    fn op(&mut self, about: Near, last: u32, op: Op) -> Result<Op, Impossible> {
        let Near { triangles: [a, b], left, right } = about;
        let context = usize::from(a) * (usize::from(MAX_AT_VERTEX) + 1) + usize::from(b);
        let context = context * 4 + usize::from(left) * 2 + usize::from(right);
        let [new, border, close_right, close_left] = self.ops.get_mut(context).ok_or(Impossible)?;
        if self.coder.bit(new, op == Op::New) {
            return Ok(Op::New);
        }
        if right && self.coder.bit(close_right, op == Op::Right) {
            return Ok(Op::Right);
        }
        if left && self.coder.bit(close_left, op == Op::Left) {
            return Ok(Op::Left);
        }
        if self.coder.bit(border, op == Op::Border) {
            return Ok(Op::Border);
        }
        if self.coder.bit(&mut self.along, matches!(op, Op::Along(_))) {
            let steps = self.distance.code(&mut self.coder, if let Op::Along(steps) = op { steps } else { 0 });
            return if steps < 2 * REACH { Ok(Op::Along(steps)) } else { Err(Impossible) };
        }
        self.known(last, if let Op::Known(v) = op { v } else { 0 }).map(Op::Known)
    }

    fn known(&mut self, last: u32, v: u32) -> Result<u32, Impossible> {
        last.checked_sub(self.back.code(&mut self.coder, last.wrapping_sub(v))).ok_or(Impossible)
    }

    fn fresh(&mut self, k: usize, new: bool) -> bool {
        self.seed_new.get_mut(k).is_some_and(|model| self.coder.bit(model, new))
    }

    fn same_patch(&mut self, context: usize, same: bool) -> bool {
        self.same_patch.get_mut(context).is_some_and(|model| self.coder.bit(model, same))
    }

    fn guess(&mut self, right: bool) -> bool {
        self.coder.bit(&mut self.other_patch, right)
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        self.coder.raw(bits, value)
    }
}

//! The choices of the cut-border machine as codec 2 codes them: one symbol for an operation. FORMAT section 5.14.

use super::super::border::{Choices, Impossible, Near, Op, REACH};
use super::model::{Adaptive, Bit, Number};
use super::prior::{OPS, SAME};
use super::rans::Coder;
use std::sync::LazyLock;

/// Triangles at a vertex that make a difference.
const MAX_AT_VERTEX: u8 = 7;
/// Kinds of operations: new, left, right, border, along, known.
const KINDS: usize = 6;

/// The models of operations as they are at first.
static FIRST: LazyLock<Vec<Adaptive<8>>> = LazyLock::new(|| {
    let op = |&[a, b, c, d, e, f]: &[u16; KINDS]| Adaptive::new([a, b, c, d, e, f, 0, 0]);
    OPS.iter().map(op).collect()
});

/// Models of everything that the machine asks.
pub(super) struct Models<C> {
    pub(super) coder: C,
    /// By the triangles at both ends and whether the gates before and behind are open.
    ops: Vec<Adaptive<8>>,
    distance: Number,
    back: Number,
    same_patch: [Bit; 16],
    other_patch: Bit,
    fresh: [Bit; 3],
}

impl<C> Models<C> {
    pub(super) fn new(coder: C) -> Self {
        Self {
            coder,
            ops: FIRST.clone(),
            distance: Number::new(6),
            back: Number::new(22),
            same_patch: SAME.map(|same| Adaptive::new([256 - same, same])),
            other_patch: Adaptive::unknown(2),
            fresh: [Adaptive::unknown(2); 3],
        }
    }
}

impl<C: Coder> Choices for Models<C> {
    #[inline]
    fn op(&mut self, about: Near, last: u32, op: Op) -> Result<Op, Impossible> {
        let Near { triangles, left, right } = about;
        let [a, b] = triangles.map(|n| usize::from(n.clamp(1, MAX_AT_VERTEX) - 1));
        let context = if right { a * usize::from(MAX_AT_VERTEX) + b } else { usize::from(MAX_AT_VERTEX).pow(2) };
        let model = self.ops.get_mut(2 * context + usize::from(left)).ok_or(Impossible)?;
        let kind = match op {
            Op::New => 0,
            Op::Left => 1,
            Op::Right => 2,
            Op::Border => 3,
            Op::Along(_) => 4,
            Op::Known(_) => 5,
        };
        match model.code(&mut self.coder, 0, kind) {
            0 => Ok(Op::New),
            1 if left => Ok(Op::Left),
            2 if right => Ok(Op::Right),
            3 => Ok(Op::Border),
            4 => {
                let steps = if let Op::Along(steps) = op { steps } else { 0 };
                let steps = self.distance.code(&mut self.coder, 2, steps);
                if steps < 2 * REACH { Ok(Op::Along(steps)) } else { Err(Impossible) }
            }
            5 => self.known(last, if let Op::Known(v) = op { v } else { 0 }).map(Op::Known),
            _ => Err(Impossible),
        }
    }

    fn known(&mut self, last: u32, v: u32) -> Result<u32, Impossible> {
        last.checked_sub(self.back.code(&mut self.coder, 2, last.wrapping_sub(v))).ok_or(Impossible)
    }

    fn fresh(&mut self, k: usize, new: bool) -> bool {
        self.fresh.get_mut(k).is_some_and(|model| model.is(&mut self.coder, 2, new))
    }

    #[inline]
    fn same_patch(&mut self, context: usize, same: bool) -> bool {
        self.same_patch.get_mut(context).is_some_and(|model| model.is(&mut self.coder, 1, same))
    }

    fn guess(&mut self, right: bool) -> bool {
        self.other_patch.is(&mut self.coder, 2, right)
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        self.coder.raw32(bits, value)
    }
}

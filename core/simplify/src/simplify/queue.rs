//! The edges in order of their costs, and those that wait.

use super::NONE;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Keys, smallest first. Those that are there from the beginning are sorted once, which is much cheaper than a heap of all; only what comes
/// later goes to one.
#[derive(Default)]
pub(super) struct Queue {
    sorted: Vec<u64>,
    next: usize,
    later: BinaryHeap<Reverse<u64>>,
}

impl Queue {
    pub(super) fn new(mut keys: Vec<u64>) -> Self {
        keys.sort_unstable();
        Self { sorted: keys, next: 0, later: BinaryHeap::new() }
    }

    pub(super) fn push(&mut self, key: u64) {
        self.later.push(Reverse(key));
    }

    /// The smallest key.
    pub(super) fn peek(&self) -> Option<u64> {
        match (self.sorted.get(self.next), self.later.peek()) {
            (Some(first), Some(Reverse(later))) => Some(*first.min(later)),
            (first, later) => first.copied().or(later.map(|Reverse(key)| *key)),
        }
    }

    /// Take the smallest key.
    pub(super) fn pop(&mut self) -> Option<u64> {
        match (self.sorted.get(self.next), self.later.peek()) {
            (Some(first), later) if later.is_none_or(|Reverse(later)| first <= later) => {
                self.next += 1;
                Some(*first)
            }
            _ => self.later.pop().map(|Reverse(key)| key),
        }
    }
}

/// Edges that wait for a change at a point: a list for each point, all in one array.
#[derive(Default)]
pub(super) struct Waiting {
    /// Whether an edge waits. It may be on lists where it does not any more.
    waits: Vec<bool>,
    /// The first entry of each point.
    first: Vec<u32>,
    /// An edge and the next entry.
    entries: Vec<(u32, u32)>,
    /// Entries that are in no list, as a list.
    free: u32,
}

impl Waiting {
    /// Nothing waits.
    pub(super) fn reset(&mut self, points: usize, edges: usize) {
        self.waits.clear();
        self.waits.resize(edges, false);
        self.first.clear();
        self.first.resize(points, NONE);
        self.entries.clear();
        self.free = NONE;
    }

    /// Let an edge wait for a change at any of some points.
    pub(super) fn put(&mut self, edge: u32, at: [u32; 2]) {
        self.waits[edge as usize] = true;
        for point in at {
            let first = &mut self.first[point as usize];
            let entry = (edge, *first);
            if self.free == NONE {
                *first = self.entries.len() as u32;
                self.entries.push(entry);
            } else {
                *first = self.free;
                let slot = &mut self.entries[self.free as usize];
                self.free = slot.1;
                *slot = entry;
            }
        }
    }

    /// Hand out the edges that wait at a point; they wait no longer.
    pub(super) fn take(&mut self, point: u32, mut edge: impl FnMut(u32)) {
        let mut at = std::mem::replace(&mut self.first[point as usize], NONE);
        while at != NONE {
            let (waiting, next) = self.entries[at as usize];
            self.entries[at as usize].1 = self.free;
            self.free = at;
            if std::mem::take(&mut self.waits[waiting as usize]) {
                edge(waiting);
            }
            at = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_come_in_order_whenever_they_were_put_in() {
        let mut random = fastrand::Rng::with_seed(5);
        let mut keys: Vec<u64> = (0..500).map(|_| random.u64(..1000)).collect();
        let mut queue = Queue::new(keys.clone());
        for _ in 0..2000 {
            if random.bool() {
                let key = random.u64(..1000);
                keys.push(key);
                queue.push(key);
            } else {
                keys.sort_unstable_by_key(|key| Reverse(*key));
                assert_eq!(queue.peek(), keys.last().copied());
                assert_eq!(queue.pop(), keys.pop());
            }
        }
    }

    #[test]
    fn what_waits_at_either_end_is_handed_out_once() {
        let mut waiting = Waiting::default();
        waiting.reset(4, 3);
        let taken = |waiting: &mut Waiting, point| {
            let mut out = Vec::new();
            waiting.take(point, |edge| out.push(edge));
            out.sort_unstable();
            out
        };
        waiting.put(0, [0, 1]);
        waiting.put(1, [1, 2]);
        assert_eq!(taken(&mut waiting, 0), [0]);
        assert_eq!(taken(&mut waiting, 1), [1], "the other has been handed out");
        for _ in 0..3 {
            waiting.put(0, [0, 1]);
            waiting.put(2, [1, 3]);
        }
        assert_eq!(taken(&mut waiting, 1), [0, 2]);
        assert!((0..4).all(|point| taken(&mut waiting, point).is_empty()));
        assert!(waiting.entries.len() <= 16, "entries are used again");
    }
}

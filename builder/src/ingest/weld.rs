//! Welding the corners of a bucket: corners equal in position and attributes become one vertex (a wedge), vertices at
//! one place one point. Numbers are given in order of first use.

/// An empty slot.
const EMPTY: u32 = u32::MAX;

/// Numbers of vertices or points by a hash of their words: open addressing, at most half full.
#[derive(Debug)]
struct Table {
    slots: Vec<u32>,
    shift: u32,
}

impl Table {
    fn new(entries: usize) -> Self {
        let log2 = (entries.max(8) * 2).next_power_of_two().ilog2();
        Self { slots: vec![EMPTY; 1 << log2], shift: 64 - log2 }
    }

    /// The number with this hash for which `same` holds, or `next`, which is then kept.
    #[inline]
    fn find(&mut self, hash: u64, next: u32, same: impl Fn(u32) -> bool) -> u32 {
        let mask = self.slots.len() - 1;
        let mut at = (hash >> self.shift) as usize;
        loop {
            let found = self.slots[at];
            if found == EMPTY {
                self.slots[at] = next;
                return next;
            }
            if same(found) {
                return found;
            }
            at = (at + 1) & mask;
        }
    }

    /// Reserve space for twice as many.
    fn grow(&mut self, count: u32, hash: impl Fn(u32) -> u64) {
        *self = Self::new(self.slots.len());
        for i in 0..count {
            self.find(hash(i), i, |_| false);
        }
    }

    fn is_full(&self, count: u32) -> bool {
        2 * count as usize >= self.slots.len()
    }
}

/// Multiply and rotate, as `rustc-hash` does; the upper bits are the good ones.
#[inline]
fn hash(words: &[u32]) -> u64 {
    words.iter().fold(0u64, |h, w| (h.rotate_left(23) ^ u64::from(*w)).wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

/// The welded vertices of a bucket.
#[derive(Debug)]
pub(super) struct Weld {
    width: usize,
    /// Words of all vertices.
    pub(super) vertices: Vec<u32>,
    /// The point of each vertex.
    pub(super) point_of: Vec<u32>,
    /// The first vertex at each point.
    pub(super) vertex_at: Vec<u32>,
    by_vertex: Table,
    by_point: Table,
}

impl Weld {
    /// For vertices of `width` words; about `expected` of them.
    pub(super) fn new(width: usize, expected: usize) -> Self {
        Self {
            width,
            vertices: Vec::with_capacity(expected * width),
            point_of: Vec::with_capacity(expected),
            vertex_at: Vec::with_capacity(expected),
            by_vertex: Table::new(expected),
            by_point: Table::new(expected),
        }
    }

    /// The number of a vertex.
    #[inline]
    pub(super) fn vertex(&mut self, words: &[u32]) -> u32 {
        let (width, next) = (self.width, self.point_of.len() as u32);
        let vertices = &self.vertices;
        // Word by word: these are a few words, for which a call costs more than comparing.
        let same = |v: u32| vertices[v as usize * width..][..width].iter().zip(words).all(|(a, b)| a == b);
        let found = self.by_vertex.find(hash(words), next, same);
        if found == next {
            self.push(words);
        }
        found
    }

    fn push(&mut self, words: &[u32]) {
        let (width, vertex) = (self.width, self.point_of.len() as u32);
        self.vertices.extend_from_slice(words);
        let next = self.vertex_at.len() as u32;
        let (vertices, vertex_at) = (&self.vertices, &self.vertex_at);
        let place = |v: u32| &vertices[v as usize * width..][..3];
        let point = self.by_point.find(hash(&words[..3]), next, |p| *place(vertex_at[p as usize]) == words[..3]);
        self.point_of.push(point);
        if point == next {
            self.vertex_at.push(vertex);
            if self.by_point.is_full(next + 1) {
                let (vertices, vertex_at) = (&self.vertices, &self.vertex_at);
                self.by_point.grow(next + 1, |p| hash(&vertices[vertex_at[p as usize] as usize * width..][..3]));
            }
        }
        if self.by_vertex.is_full(vertex + 1) {
            let vertices = &self.vertices;
            self.by_vertex.grow(vertex + 1, |v| hash(&vertices[v as usize * width..][..width]));
        }
    }

    /// Vertices so far.
    pub(super) fn vertex_count(&self) -> usize {
        self.point_of.len()
    }

    /// Points so far.
    pub(super) fn point_count(&self) -> usize {
        self.vertex_at.len()
    }

    /// Where a vertex is.
    #[inline]
    pub(super) fn position(&self, vertex: u32) -> [u32; 3] {
        let at = vertex as usize * self.width;
        [self.vertices[at], self.vertices[at + 1], self.vertices[at + 2]]
    }

    /// Where a point is.
    #[inline]
    pub(super) fn position_of_point(&self, point: u32) -> [u32; 3] {
        self.position(self.vertex_at[point as usize])
    }

    /// Give the memory of the tables back.
    pub(super) fn close(&mut self) {
        (self.by_vertex, self.by_point) = (Table::new(0), Table::new(0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_keys_are_one_vertex_and_equal_positions_one_point() {
        let mut weld = Weld::new(4, 0);
        let mut numbers = Vec::new();
        for round in 0..2 {
            for i in 0..5000u32 {
                // Every place twice, with two colours.
                let v = weld.vertex(&[i / 2, i / 200, 7, i % 2]);
                if round == 0 {
                    numbers.push(v);
                } else {
                    assert_eq!(numbers[i as usize], v);
                }
            }
        }
        assert_eq!((weld.vertex_count(), weld.point_count()), (5000, 2500));
        assert!((0..5000usize).all(|i| weld.point_of[i] == weld.point_of[i ^ 1]));
        assert_eq!(weld.position_of_point(weld.point_of[301]), [150, 1, 7]);
    }
}

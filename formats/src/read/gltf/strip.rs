//! Triangles from a sequence of vertices: lists, strips and fans (specification, section 3.7.2.1).

/// How a sequence of vertices makes triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    List,
    Strip,
    Fan,
}

impl Mode {
    /// By the number in the file; `None` for points and lines, and for what is no mode.
    pub(super) fn of(mode: u32) -> Option<Self> {
        match mode {
            4 => Some(Self::List),
            5 => Some(Self::Strip),
            6 => Some(Self::Fan),
            _ => None,
        }
    }
}

/// Takes vertices one by one.
pub(super) struct Assembler {
    mode: Mode,
    /// Turn every triangle round.
    mirrored: bool,
    seen: u64,
    first: u64,
    /// The last two.
    before: [u64; 2],
}

impl Assembler {
    pub(super) fn new(mode: Mode, mirrored: bool) -> Self {
        Self { mode, mirrored, seen: 0, first: 0, before: [0; 2] }
    }

    /// The next vertex, and the triangle that it completes. Strips and fans join their parts by triangles that name a
    /// vertex twice: these are none.
    pub(super) fn push(&mut self, vertex: u64) -> Option<[u64; 3]> {
        if self.seen == 0 {
            self.first = vertex;
        }
        let place = self.seen;
        self.seen += 1;
        let [a, b] = self.before;
        self.before = [b, vertex];
        let triangle = match self.mode {
            Mode::List if place % 3 == 2 => [a, b, vertex],
            Mode::Strip if place >= 2 && place.is_multiple_of(2) => [a, b, vertex],
            Mode::Strip if place >= 2 => [a, vertex, b],
            Mode::Fan if place >= 2 => [b, vertex, self.first],
            _ => return None,
        };
        let [a, b, c] = triangle;
        if self.mode != Mode::List && (a == b || b == c || c == a) {
            return None;
        }
        Some(if self.mirrored { [a, c, b] } else { triangle })
    }

    /// Whether vertices are left that make no triangle.
    pub(super) fn is_incomplete(&self) -> bool {
        match self.mode {
            Mode::List => !self.seen.is_multiple_of(3),
            Mode::Strip | Mode::Fan => self.seen == 1 || self.seen == 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(mode: u32, mirrored: bool, vertices: &[u64]) -> Vec<[u64; 3]> {
        let mut assembler = Assembler::new(Mode::of(mode).unwrap(), mirrored);
        vertices.iter().filter_map(|v| assembler.push(*v)).collect()
    }

    #[test]
    fn strips_and_fans_keep_the_orientation_of_their_first_triangle() {
        assert_eq!(all(4, false, &[0, 1, 2, 3, 4, 5, 6]), [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(all(5, false, &[0, 1, 2, 3, 4]), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(all(6, false, &[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(all(5, true, &[0, 1, 2, 3]), [[0, 2, 1], [1, 2, 3]]);
    }

    #[test]
    fn degenerate_joints_of_strips_are_skipped() {
        assert_eq!(all(5, false, &[0, 1, 2, 2, 5, 5, 6, 7]), [[0, 1, 2], [5, 7, 6]]);
    }
}

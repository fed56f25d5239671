//! Splits triangles that span many texels, so that colours of vertices keep what a picture shows.
//!
//! No crack opens: whether an edge is split is decided by the edge alone, that is by the places of its two ends. In a
//! first pass every triangle with a picture notes how many texels each of its edges spans ([`Detail::note`]); in the
//! second every triangle, with a picture or without, is split along each edge as often as any triangle at that edge noted
//! ([`split`]). Edges are halved at the mean of their ends, which is the same number from both sides, so neighbours get the
//! same vertices bit for bit, across inputs too where the coordinates of their files are equal.
//!
//! What was noted lies in a table of fixed size without the edges themselves; two edges that fall into one place both get
//! the finer of the two. So memory does not grow with the mesh, an edge is never split less than it needs, and
//! neighbours still agree. The surface stays the same: new vertices lie on the old triangles.

use glam::DVec3;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU8, Ordering};

/// Places of the table: 64 MiB, for some tens of millions of edges that differ.
const PLACES: usize = 1 << 26;

/// An edge is halved this often at the most, into 2048 parts: one wrong texture coordinate must not fill the disk.
const DEEPEST: u8 = 11;

/// How far triangles are to be split, and what the first pass noted.
#[derive(Debug)]
pub struct Detail {
    /// Texels that an edge may span.
    texels: f64,
    /// An edge is halved this often at the most.
    deepest: u8,
    /// How often edges are to be halved, by two hashes of each.
    noted: Vec<AtomicU8>,
}

impl Detail {
    /// No edge is to span more than `texels`, which must be above 0; nothing is noted yet.
    pub fn new(texels: f64) -> Self {
        Self::with_places(texels, DEEPEST, PLACES)
    }

    /// As [`Self::new`], for a mesh of about so many edges, with four places for each of them, up to 512 MiB.
    pub fn for_edges(texels: f64, edges: u64) -> Self {
        let places = edges.saturating_mul(4).clamp(1 << 16, 1 << 29) as usize;
        Self::with_places(texels, DEEPEST, places)
    }

    fn with_places(texels: f64, deepest: u8, places: usize) -> Self {
        Self { texels, deepest, noted: (0..places).map(|_| AtomicU8::new(0)).collect() }
    }

    /// Texels that an edge may span.
    pub fn texels(&self) -> f64 {
        self.texels
    }

    /// Whether an edge of so many texels is longer than can be followed.
    pub fn is_beyond(&self, texels: f64) -> bool {
        texels > self.texels * f64::from(1u32 << self.deepest)
    }

    /// A triangle with a picture has an edge between these places that spans so many texels.
    pub fn note(&self, a: DVec3, b: DVec3, texels: f64) {
        let level = self.halvings(texels);
        if level > 0 {
            for place in self.places(a, b) {
                self.noted[place].fetch_max(level, Ordering::Relaxed);
            }
        }
    }

    /// How often the edge between these places is to be halved.
    pub fn level(&self, a: DVec3, b: DVec3) -> u8 {
        let [one, two] = self.places(a, b).map(|place| self.noted[place].load(Ordering::Relaxed));
        one.min(two)
    }

    /// How often an edge of so many texels must be halved.
    fn halvings(&self, texels: f64) -> u8 {
        // What is not finite has no length that halving could reduce.
        let mut left = if texels.is_finite() { texels / self.texels } else { 0.0 };
        let mut level = 0;
        while left > 1.0 && level < self.deepest {
            left *= 0.5;
            level += 1;
        }
        level
    }

    /// Where an edge is noted, whichever end is named first.
    fn places(&self, a: DVec3, b: DVec3) -> [usize; 2] {
        // Adding zero makes the two zeros one.
        let bits = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
        let (a, b) = (bits(a), bits(b));
        let (low, high) = if a <= b { (a, b) } else { (b, a) };
        let mix = |h: u64, v: u64| {
            let h = (h ^ v).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            h ^ (h >> 29)
        };
        [1, 0x5bd1_e995_97f4_a7c5].map(|seed| {
            let hash = low.into_iter().chain(high).fold(seed, mix);
            (mix(hash, seed) >> 7) as usize % self.noted.len()
        })
    }
}

/// A vertex that edges can be split at.
pub trait Vertex: Copy {
    /// Where it is.
    fn position(&self) -> DVec3;
    /// The vertex in the middle between two, the same whichever is asked; its position is [`middle`] of theirs, possibly rounded.
    #[must_use]
    fn between(&self, other: &Self) -> Self;
    /// The edge between two vertices may be halved this often at the most.
    fn most_halvings(&self, _other: &Self) -> u8 {
        u8::MAX
    }
}

/// The mean of two places, the same whichever is named first.
pub fn middle(a: DVec3, b: DVec3) -> DVec3 {
    let mean = (a + b) * 0.5;
    DVec3::select(mean.is_finite_mask(), mean, a * 0.5 + b * 0.5)
}

/// Split a triangle and hand its parts to `out`, turning as it does. `texels` gives how many texels lie between two of
/// its vertices, 0 where it has no picture. The parts together cover the triangle once.
///
/// # Errors
/// What `out` returns.
pub fn split<V: Vertex, E>(
    detail: &Detail,
    corners: [V; 3],
    texels: impl Fn(&V, &V) -> f64,
    mut out: impl FnMut([V; 3]) -> Result<(), E>,
) -> Result<(), E> {
    let level = |a: &V, b: &V| detail.level(a.position(), b.position()).min(a.most_halvings(b));
    let levels = [0, 1, 2].map(|k| level(&corners[k], &corners[(k + 1) % 3]));
    // Where the picture is too large to follow, distances in it are made smaller, so that halving comes to an end.
    let longest = [0, 1, 2].map(|k| texels(&corners[k], &corners[(k + 1) % 3])).into_iter().fold(0.0, f64::max);
    let max = detail.texels * f64::from(1u32 << detail.deepest);
    let scale = if longest > max { max / longest } else { 1.0 };
    let texels = |a: &V, b: &V| texels(a, b) * scale;
    // Edge k runs from corner k to corner k + 1.
    let mut parts = vec![(corners, levels)];
    while let Some((corners, levels)) = parts.pop() {
        // Of edges that are to be halved as often, the longest first: else parts could get ever thinner without end.
        let length = |k: usize| texels(&corners[k], &corners[(k + 1) % 3]);
        let finer = |i: &usize, k: &usize| levels[*i].cmp(&levels[*k]).then_with(|| length(*i).total_cmp(&length(*k)));
        let Some(k) = (0..3).max_by(finer).filter(|&k| levels[k] > 0) else {
            out(corners)?;
            continue;
        };
        let [a, b, c] = [0, 1, 2].map(|i| corners[(k + i) % 3]);
        let [ab, bc, ca] = [0, 1, 2].map(|i| levels[(k + i) % 3]);
        let m = a.between(&b);
        // Both parts have the edge from m to c, which nobody else has.
        let inner = detail.halvings(texels(&m, &c)).min(ab).min(m.most_halvings(&c));
        parts.push(([a, m, c], [ab - 1, inner, ca]));
        parts.push(([m, b, c], [ab - 1, bc, inner]));
    }
    Ok(())
}

/// Numbers of the vertices of one split triangle, by their places, so that its parts share them.
#[derive(Debug, Default)]
pub struct Shared {
    numbers: HashMap<[u64; 3], u64>,
}

impl Shared {
    /// Numbers remembered at a time; a vertex that was forgotten is made again, and welded later.
    const MAX: usize = 1 << 16;

    /// Forget all.
    pub fn clear(&mut self) {
        self.numbers.clear();
    }

    /// The number of the vertex at this place, if it is remembered.
    pub fn get(&self, position: DVec3) -> Option<u64> {
        self.numbers.get(&position.to_array().map(f64::to_bits)).copied()
    }

    /// Remember it.
    pub fn insert(&mut self, position: DVec3, number: u64) {
        if self.numbers.len() >= Self::MAX {
            self.numbers.clear();
        }
        self.numbers.insert(position.to_array().map(f64::to_bits), number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use proptest::prelude::*;
    use std::collections::BTreeMap;
    use std::convert::Infallible;

    /// Position and texel coordinates.
    #[derive(Debug, Clone, Copy)]
    struct Point(DVec3, DVec2);

    impl Vertex for Point {
        fn position(&self) -> DVec3 {
            self.0
        }

        fn between(&self, other: &Self) -> Self {
            Self(middle(self.0, other.0), self.1.midpoint(other.1))
        }
    }

    fn texels(a: &Point, b: &Point) -> f64 {
        (a.1.x - b.1.x).hypot(a.1.y - b.1.y)
    }

    fn parts(detail: &Detail, triangle: [Point; 3], textured: bool) -> Vec<[Point; 3]> {
        let mut all = Vec::new();
        let count = |a: &Point, b: &Point| if textured { texels(a, b) } else { 0.0 };
        let Ok(()) = split(detail, triangle, count, |t| {
            all.push(t);
            Ok::<(), Infallible>(())
        });
        all
    }

    fn note(detail: &Detail, t: &[Point; 3]) {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            detail.note(a.0, b.0, texels(&a, &b));
        }
    }

    /// Twice the area with its direction.
    fn area(t: &[Point; 3]) -> DVec3 {
        (t[1].0 - t[0].0).cross(t[2].0 - t[0].0)
    }

    /// How often each edge is run along, forwards counted up and backwards down: 0 for edges that two parts share.
    fn open_edges(parts: &[[Point; 3]]) -> usize {
        let mut edges: BTreeMap<[[u64; 3]; 2], i64> = BTreeMap::new();
        for t in parts {
            for k in 0..3 {
                let [a, b] = [t[k].0, t[(k + 1) % 3].0].map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
                let (key, way) = if a < b { ([a, b], 1) } else { ([b, a], -1) };
                *edges.entry(key).or_default() += way;
            }
        }
        edges.values().filter(|n| **n != 0).count()
    }

    #[test]
    fn the_number_of_subdivisions_is_the_smallest_that_suffices() {
        let detail = Detail::with_places(4.0, DEEPEST, 1024);
        for (texels, level) in
            [(0.0, 0), (4.0, 0), (4.1, 1), (8.0, 1), (8.1, 2), (64.0, 4), (f64::MAX, DEEPEST), (f64::INFINITY, 0)]
        {
            assert_eq!(detail.halvings(texels), level, "{texels}");
        }
        assert_eq!(detail.halvings(f64::NAN), 0);
    }

    #[test]
    fn an_edge_has_the_same_key_from_both_ends_and_for_both_signs_of_zero() {
        let detail = Detail::with_places(1.0, DEEPEST, 1 << 16);
        let other = DVec3::new(3.0, 4.0, 5.0);
        detail.note(DVec3::new(0.0, 1.0, 2.0), other, 8.0);
        assert_eq!(detail.level(other, DVec3::new(-0.0, 1.0, 2.0)), 3);
        assert_eq!(detail.level(other, DVec3::new(0.0, 1.0, 2.5)), 0);
    }

    #[test]
    fn an_untextured_neighbour_splits_the_shared_edge_at_the_same_points() {
        let detail = Detail::with_places(10.0, DEEPEST, 1 << 16);
        let p = |x: f64, y: f64, u: f64, v: f64| Point(DVec3::new(x, y, 0.3 * x), DVec2::new(u, v));
        let textured = [p(0.0, 0.0, 0.0, 0.0), p(0.1, 0.0, 90.0, 0.0), p(0.0, 0.1, 0.0, 35.0)];
        let plain = [p(0.1, 0.0, 0.0, 0.0), p(0.1, 0.1, 0.0, 0.0), p(0.0, 0.1, 0.0, 0.0)];
        note(&detail, &textured);
        let (a, b) = (parts(&detail, textured, true), parts(&detail, plain, false));
        let together: Vec<[Point; 3]> = a.iter().chain(&b).copied().collect();
        // 16 and 4 on the outer edges of the first, 2 on those of the second that nobody noted.
        assert_eq!(open_edges(&together), 16 + 4 + 2);
        assert!(b.len() > 1);
    }

    #[test]
    fn colliding_edges_are_only_ever_split_finer() {
        let detail = Detail::with_places(1.0, DEEPEST, 7);
        let p = |i: u32| f64::from(i) * DVec3::X;
        for i in 0..100 {
            detail.note(p(i), p(i + 1), f64::from(i % 9));
        }
        for i in 0..100 {
            assert!(detail.level(p(i), p(i + 1)) >= detail.halvings(f64::from(i % 9)));
        }
    }

    #[test]
    fn a_texture_too_large_to_resolve_is_resolved_up_to_the_limit() {
        let detail = Detail::with_places(1.0, 4, 1 << 16);
        for uvs in [[[0.0, 0.0], [1e9, 0.0], [0.0, 1e9]], [[0.0, 0.0], [3e8, 1.0], [1e9, 2.0]]] {
            let triangle =
                [0, 1, 2].map(|k| Point(DVec3::new(f64::from(k == 1), f64::from(k == 2), 0.0), uvs[k as usize].into()));
            note(&detail, &triangle);
            let parts = parts(&detail, triangle, true);
            assert_eq!(open_edges(&parts), 3 * 16);
            assert!(parts.len() < 4096, "{}", parts.len());
        }
    }

    proptest! {
        /// Whatever the triangle: the parts cover it once, turn as it does, span no more texels than asked for, and
        /// meet without a gap.
        #[test]
        fn parts_cover_the_triangle(
            places in proptest::array::uniform3(proptest::array::uniform3(-100.0f64..100.0)),
            uvs in proptest::array::uniform3(proptest::array::uniform2(0.0f64..60.0)),
            limit in 4.0f64..20.0,
        ) {
            let triangle = [0, 1, 2].map(|k| Point(places[k].into(), uvs[k].into()));
            let whole = area(&triangle);
            let size = whole.length();
            prop_assume!(size > 1.0);
            let detail = Detail::with_places(limit, DEEPEST, 1 << 16);
            note(&detail, &triangle);
            let parts = parts(&detail, triangle, true);
            let mut sum = DVec3::ZERO;
            for t in &parts {
                let part = area(t);
                prop_assert!(part.dot(whole) >= -1e-6 * size);
                sum += part;
                for k in 0..3 {
                    prop_assert!(texels(&t[k], &t[(k + 1) % 3]) <= limit * (1.0 + 1e-9));
                }
            }
            prop_assert!(sum.abs_diff_eq(whole, 1e-9 * size.max(1.0)));
            let outer: usize = (0..3).map(|k| 1usize << detail.level(places[k].into(), places[(k + 1) % 3].into())).sum();
            prop_assert_eq!(open_edges(&parts), outer);
        }
    }
}

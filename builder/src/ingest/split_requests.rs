//! Split requests: which tetrahedra must be split, because they contain too many triangles and splitting helps.
//!
//! A tetrahedron requests a split if it contains more *distinct* centroids than a leaf may have, not counting those of triangles
//! much larger than itself: no subdivision separates coincident triangles, or a fan around one vertex. If a half requests
//! a split, so does the whole, because it contains all centroids of the half and allows for larger triangles. So
//! the split requests do not depend on the order of splitting, and are found bucket by bucket.

use super::buckets::Buckets;
use kilwa_geometry::tetra::max_level;
use kilwa_geometry::{DiamondKey, Tetra};
use rustc_hash::{FxHashMap, FxHashSet};
use serde::{Deserialize, Serialize};

/// Classes of the size of triangles: powers of two.
const CLASSES: usize = 32;

/// What is known of one bucket, for the tetrahedra above it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Above {
    wants: bool,
    /// Different places by the size of the smallest triangle there; not counted where `wants`.
    places: Vec<u64>,
}

/// Distinct centroids, as sums of corners, with the size of the smallest triangle at each.
pub(super) type Places = FxHashMap<[u32; 3], u32>;

fn add(places: &mut Places, sum: [u32; 3], size: u32) {
    places.entry(sum).and_modify(|s| *s = (*s).min(size)).or_insert(size);
}

/// Add a triangle.
pub(super) fn add_place(places: &mut Places, corners: [[u32; 3]; 3]) {
    add(places, sum_of(corners), size_of(corners));
}

/// Three times the centroid of a triangle.
pub(super) fn sum_of([a, b, c]: [[u32; 3]; 3]) -> [u32; 3] {
    // Coordinates have 30 bits, unless the scratch file is damaged, which is only known when all of it has been read.
    std::array::from_fn(|i| a[i].wrapping_add(b[i]).wrapping_add(c[i]))
}

/// The longest side of the bounding box of a triangle.
pub(super) fn size_of([a, b, c]: [[u32; 3]; 3]) -> u32 {
    let side = |i: usize| a[i].max(b[i]).max(c[i]) - a[i].min(b[i]).min(c[i]);
    side(0).max(side(1)).max(side(2))
}

impl Above {
    /// For a bucket with these places, in which nothing requests a split.
    pub(super) fn of_places(smallest: &Places) -> Self {
        let mut places = vec![0; CLASSES];
        for size in smallest.values() {
            places[class(*size)] += 1;
        }
        Self { wants: false, places }
    }
}

/// The triangles of a bucket.
pub(super) struct SplitRequests<'a> {
    /// Sums of corners.
    pub(super) sums: &'a [[u32; 3]],
    /// Longest side of the box round each triangle, in lattice units.
    pub(super) sizes: &'a [u32],
    pub(super) leaf_triangles: usize,
    pub(super) deepest: u8,
    /// The diamonds that are wanted.
    pub(super) keys: Vec<DiamondKey>,
    /// Groups of triangles that fit into a leaf: three times a centroid, and the number of triangles.
    pub(super) groups: Vec<Group>,
}

/// Triangles that are close to each other: three times one of their centroids, and their number.
pub(super) type Group = ([u32; 3], u32);

impl SplitRequests<'_> {
    /// The split requests inside a bucket whose tetrahedron is `tetra`.
    pub(super) fn collect(&mut self, tetra: &Tetra) -> Above {
        let mut order: Vec<u32> = (0..self.sums.len() as u32).collect();
        if self.descend(tetra, &mut order) {
            return Above { wants: true, places: Vec::new() };
        }
        let mut places = Places::default();
        for (sum, size) in self.sums.iter().zip(self.sizes) {
            add(&mut places, *sum, *size);
        }
        Above::of_places(&places)
    }

    fn descend(&mut self, tetra: &Tetra, triangles: &mut [u32]) -> bool {
        if triangles.len() <= self.leaf_triangles || tetra.level >= self.deepest {
            self.groups.extend(triangles.first().map(|t| (self.sums[*t as usize], triangles.len() as u32)));
            return false;
        }
        let plane = tetra.split_plane();
        let mut first = 0;
        for i in 0..triangles.len() {
            if plane.child_of_sum(self.sums[triangles[i] as usize].map(i64::from).into()) == 0 {
                triangles.swap(first, i);
                first += 1;
            }
        }
        let (a, b) = triangles.split_at_mut(first);
        let [left, right] = tetra.children();
        // Always descend into both: the requests of both count.
        let wants = self.descend(&left, a) | self.descend(&right, b) || self.has_many_places(tetra, triangles);
        if wants {
            self.keys.push(DiamondKey::of(tetra));
        }
        wants
    }

    fn has_many_places(&self, tetra: &Tetra, triangles: &[u32]) -> bool {
        let largest = 2 * edge_of(tetra);
        let mut places = FxHashSet::default();
        triangles.iter().map(|t| *t as usize).any(|t| {
            u64::from(self.sizes[t]) <= largest && places.insert(self.sums[t]) && places.len() > self.leaf_triangles
        })
    }
}

/// The split requests of the tetrahedra above the buckets.
pub(super) fn above(buckets: &Buckets, known: &[Above], cube_log2: u32, leaf_triangles: usize) -> Vec<DiamondKey> {
    let mut keys = Vec::new();
    buckets.fold(&mut |b| known[b as usize].clone(), &mut |tetra, a: Above, b: Above| {
        let mut both = Above { wants: a.wants || b.wants, places: Vec::new() };
        if !both.wants {
            both.places = a.places.iter().zip(&b.places).map(|(a, b)| a + b).collect();
            let classes = edge_of(tetra).ilog2() as usize + 1;
            both.wants = tetra.level < max_level(cube_log2)
                && both.places.iter().take(classes).sum::<u64>() > leaf_triangles as u64;
        }
        if both.wants {
            keys.push(DiamondKey::of(tetra));
        }
        both
    });
    keys
}

/// The side of the cube that a tetrahedron belongs to, in lattice units: a power of two.
fn edge_of(tetra: &Tetra) -> u64 {
    (0..3).map(|i| u64::from(tetra.v[0][i].abs_diff(tetra.v[3][i]))).max().unwrap_or(0)
}

/// The logarithm of the smallest edge of a tetrahedron in which a triangle of this size counts.
fn class(size: u32) -> usize {
    (size.max(2) - 1).ilog2() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_class_of_a_size_is_the_smallest_edge_at_least_half_as_long() {
        for size in 1..5000u32 {
            let edge = 1u32 << class(size);
            assert!(size <= 2 * edge && (edge == 1 || size > edge), "{size}");
        }
    }
}

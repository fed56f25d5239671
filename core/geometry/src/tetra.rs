//! Tetrahedra of the subdivision: a root cube split into six round its main diagonal, each bisected at the midpoint of
//! its unique longest edge (Maubach 1995; Cignoni et al. 2004). Everything is exact in integers.
//!
//! Vertex order carries the structure: `v[0] - v[3]` is always the longest edge (the one that a bisection splits).
//! With Maubach's rule the tag (level mod 3) selects which vertex goes where, so that this holds at every level.

use crate::lattice::LatticePoint;
use glam::{DVec3, I64Vec3, IVec3};
use std::cmp::Ordering;

/// Levels of bisection at which a cube of side 2 is reached from a cube of side `2^log2`.
pub fn max_level(cube_log2: u32) -> u8 {
    (3 * cube_log2.saturating_sub(1)) as u8
}

/// One tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Tetra {
    /// Corners on the lattice; the edge `v[0]`–`v[3]` is the longest.
    pub v: [LatticePoint; 4],
    /// Bisections from the root; the roots have level 0.
    pub level: u8,
}

impl Ord for Tetra {
    fn cmp(&self, other: &Self) -> Ordering {
        self.v.map(|p| p.to_array()).cmp(&other.v.map(|p| p.to_array())).then(self.level.cmp(&other.level))
    }
}

impl PartialOrd for Tetra {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Tetra {
    /// The six root tetrahedra of the cube `0..2^cube_log2`, in a fixed order.
    pub fn roots(cube_log2: u32) -> [Self; 6] {
        let s = 1i32 << cube_log2;
        // One per permutation of the axes: walk from the origin to the far corner one axis at a time.
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]].map(|axes: [usize; 3]| {
            let mut v = [IVec3::ZERO; 4];
            for i in 0..3 {
                v[i + 1] = v[i];
                v[i + 1][axes[i]] = s;
            }
            Self { v, level: 0 }
        })
    }

    /// The midpoint of the longest edge: the name of the diamond that splits this tetrahedron.
    pub fn midpoint(&self) -> LatticePoint {
        // A cube of 2^30 steps has sums of 2^31.
        ((self.v[0].as_i64vec3() + self.v[3].as_i64vec3()) / 2).as_ivec3()
    }

    /// The two halves. Child 0 keeps `v[0]`, child 1 keeps `v[3]`.
    /// Maubach, "Local bisection refinement for n-simplicial grids", 1995, with k = 3 - level mod 3.
    pub fn children(&self) -> [Self; 2] {
        let [a, b, c, d] = self.v;
        let m = self.midpoint();
        let level = self.level + 1;
        // Each child's corners are ordered so that its longest edge is first-last again (checked by a test).
        let (first, second) = match self.level % 3 {
            0 => ([a, b, c, m], [d, c, b, m]),
            1 => ([a, b, m, c], [d, b, m, c]),
            _ => ([a, m, b, c], [d, m, b, c]),
        };
        let fix = |v: [LatticePoint; 4]| Self { v: longest_first_last(v), level };
        [fix(first), fix(second)]
    }

    /// The four tetrahedra after two bisections: those of child 0, then those of child 1.
    pub fn quarters(&self) -> [Self; 4] {
        let [first, second] = self.children().map(|half| half.children());
        [first[0], first[1], second[0], second[1]]
    }

    /// The plane that separates the two children.
    pub fn split_plane(&self) -> SplitPlane {
        // It contains the midpoint and the two vertices off the longest edge; v[0] lies on its positive side.
        let m = self.midpoint();
        let mut n = shortest_normal([m, self.v[1], self.v[2]]);
        if n.dot(between(m, self.v[0])) < 0 {
            n = -n;
        }
        SplitPlane { normal: n, through3: 3 * m.as_i64vec3() }
    }

    /// Its interior, without the faces.
    pub fn interior(&self) -> Interior {
        Interior(std::array::from_fn(|i| {
            let face @ [a, _, _] = [self.v[(i + 1) % 4], self.v[(i + 2) % 4], self.v[(i + 3) % 4]];
            let mut n = shortest_normal(face);
            if n.dot(between(a, self.v[i])) < 0 {
                n = -n;
            }
            (n, n.dot(a.as_i64vec3()))
        }))
    }

    /// Its four faces, for [`Faces::violation`].
    pub fn faces(&self) -> Faces {
        Faces(std::array::from_fn(|i| {
            let [a, b, c] = [self.v[(i + 1) % 4], self.v[(i + 2) % 4], self.v[(i + 3) % 4]];
            let mut n = between(a, b).cross(between(a, c)).as_dvec3();
            if n.dot((self.v[i] - a).as_dvec3()) > 0.0 {
                n = -n;
            }
            (n / n.length() / 3.0, 3 * a.as_i64vec3())
        }))
    }

    /// [`Faces::violation`] of a single point.
    pub fn violation(&self, sum: I64Vec3) -> f64 {
        self.faces().violation(sum)
    }
}

/// The interior of a tetrahedron: for each face, the normal pointing in, and its dot product with a point of the face.
#[derive(Debug, Clone, Copy)]
pub struct Interior([(I64Vec3, i64); 4]);

impl Interior {
    /// Whether a point is inside and on no face. Exact.
    #[inline]
    pub fn contains(&self, point: I64Vec3) -> bool {
        self.0.iter().all(|(normal, face)| normal.dot(point) > *face)
    }
}

/// The faces of a tetrahedron: normals pointing out, and three times a point of each.
#[derive(Debug, Clone, Copy)]
pub struct Faces([(DVec3, I64Vec3); 4]);

impl Faces {
    /// How far the point `sum / 3` lies outside the tetrahedron, as a non-negative number comparable between
    /// tetrahedra of one diamond (largest plane violation, in lattice units); 0 inside.
    pub fn violation(&self, sum: I64Vec3) -> f64 {
        let out = |(n, a): &(DVec3, I64Vec3)| n.dot((sum - a).as_dvec3());
        self.0.iter().map(out).fold(0.0, f64::max)
    }
}

/// A bisecting plane: its normal has components -1, 0 or 1 (the subdivision knows no others).
#[derive(Debug, Clone, Copy)]
pub struct SplitPlane {
    normal: I64Vec3,
    through3: I64Vec3,
}

impl SplitPlane {
    /// The child (0 or 1) that a point, given as the *sum of three vertices* (three times a triangle's centroid),
    /// belongs to. Exact; ties go to child 0.
    #[inline]
    pub fn child_of_sum(&self, sum: I64Vec3) -> usize {
        usize::from(self.normal.dot(sum - self.through3) < 0)
    }
}

/// Reorder so that the longest edge is first-last, keeping child order deterministic.
fn longest_first_last(v: [LatticePoint; 4]) -> [LatticePoint; 4] {
    let mut best = (0, 3, -1);
    for (i, j) in [(0, 3), (0, 1), (0, 2), (1, 2), (1, 3), (2, 3)] {
        let l = between(v[i], v[j]).length_squared();
        if l > best.2 {
            best = (i, j, l);
        }
    }
    let (i, j, _) = best;
    let mut rest = (0..4).filter(|&k| k != i && k != j).map(|k| v[k]);
    let b = rest.next().unwrap_or(v[0]);
    let c = rest.next().unwrap_or(v[0]);
    [v[i], b, c, v[j]]
}

/// `to - from`. Corners lie within 2^30 of each other, so that a cross product of two of these and the square of one fit `i64`.
fn between(from: LatticePoint, to: LatticePoint) -> I64Vec3 {
    to.as_i64vec3() - from.as_i64vec3()
}

/// The shortest normal with integer components of the plane through three lattice points.
fn shortest_normal([a, b, c]: [LatticePoint; 3]) -> I64Vec3 {
    let n = between(a, b).cross(between(a, c));
    n / gcd(gcd(n.x.unsigned_abs(), n.y.unsigned_abs()), n.z.unsigned_abs()).max(1) as i64
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume6(t: &Tetra) -> i64 {
        let [b, c, d] = [t.v[1], t.v[2], t.v[3]].map(|p| between(t.v[0], p));
        b.dot(c.cross(d)).abs()
    }

    #[test]
    fn ten_levels_keep_the_longest_edge_first_and_halve_the_volume() {
        let mut level: Vec<Tetra> = Tetra::roots(6).to_vec();
        for l in 0..10u8 {
            let expected = [3, 2, 1][usize::from(l) % 3] * (1i64 << (6 - i64::from(l / 3))).pow(2);
            let mut next = Vec::new();
            for t in &level {
                // Level 0 mod 3: sqrt(3) s; 1: sqrt(2) s; 2: s, where s halves every third level.
                assert_eq!(between(t.v[0], t.v[3]).length_squared(), expected, "level {l}: {t:?}");
                let unique = (0..4)
                    .flat_map(|i| (i + 1..4).map(move |j| (i, j)))
                    .filter(|&(i, j)| between(t.v[i], t.v[j]).length_squared() == expected);
                assert_eq!(unique.count(), 1, "the longest edge is unique");
                for c in t.children() {
                    assert_eq!(volume6(&c) * 2, volume6(t));
                    next.push(c);
                }
            }
            level = next;
        }
    }

    #[test]
    fn the_largest_cube_divides_like_a_small_one() {
        let (mut large, mut small) = (Tetra::roots(30).to_vec(), Tetra::roots(20).to_vec());
        for _ in 0..5 {
            large = large.iter().flat_map(Tetra::children).collect();
            small = small.iter().flat_map(Tetra::children).collect();
            for (l, s) in large.iter().zip(&small) {
                assert_eq!(l.v, s.v.map(|p| p << 10));
            }
        }
    }

    #[test]
    fn every_point_is_assigned_to_a_child_that_contains_it() {
        let mut generator = fastrand::Rng::with_seed(7);
        let mut random = || generator.i64(0..64 * 3);
        for _ in 0..2000 {
            let sum = I64Vec3::new(random(), random(), random());
            let mut t = *Tetra::roots(6).iter().find(|t| t.violation(sum) <= 1e-9).expect("the roots tile the cube");
            for _ in 0..9 {
                t = t.children()[t.split_plane().child_of_sum(sum)];
                assert!(t.violation(sum) <= 1e-9, "{t:?} {sum:?}");
            }
        }
    }
}

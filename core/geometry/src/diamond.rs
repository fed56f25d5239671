//! Diamonds: all tetrahedra that share their longest edge, named by that edge's midpoint.
//!
//! | level mod 3 | longest edge | tetrahedra inside | parents | children |
//! |---|---|---|---|---|
//! | 0 | cube diagonal | 6 | 3 | 6 |
//! | 1 | face diagonal | 4 | 2 | 4 |
//! | 2 | cube edge | 8 | 4 | 8 |
//!
//! On the hull of the root cube some of these do not exist.

use crate::lattice::LatticePoint;
use crate::tetra::Tetra;
use glam::IVec3;
use std::cmp::Ordering;

/// The name of a diamond. The level follows from the midpoint and the cube; it is carried because it orders diamonds
/// coarse to fine, which every list of them is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DiamondKey {
    /// Level of the tetrahedra in this diamond.
    pub level: u8,
    /// Midpoint of the shared longest edge.
    pub midpoint: LatticePoint,
}

impl Ord for DiamondKey {
    fn cmp(&self, other: &Self) -> Ordering {
        self.level.cmp(&other.level).then_with(|| self.midpoint.to_array().cmp(&other.midpoint.to_array()))
    }
}

impl PartialOrd for DiamondKey {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl DiamondKey {
    /// The diamond that splits a tetrahedron.
    pub fn of(t: &Tetra) -> Self {
        Self { level: t.level, midpoint: t.midpoint() }
    }

    /// The diamonds of the level above whose tetrahedra, when split, give this diamond's tetrahedra: all of them must
    /// be refined before this one can be. Up to 4, inside the cube `0..=2^cube_log2`; empty at level 0.
    pub fn parents(&self, cube_log2: u32) -> Vec<Self> {
        if self.level == 0 {
            return Vec::new();
        }
        let side = 1i32 << cube_log2;
        let m = self.midpoint;
        // Side of the cubes at this level's triple: level 0..2 -> side, 3..5 -> side / 2, ...
        let s = side >> (self.level / 3);
        let mut candidates: Vec<LatticePoint> = Vec::with_capacity(4);
        let offset = |p: LatticePoint, axis: usize, by: i32| {
            let mut q = p;
            q[axis] += by;
            q
        };
        match self.level % 3 {
            1 => {
                // A face centre: two coordinates are odd multiples of s/2, the third (the face's normal) is a multiple of s.
                for axis in 0..3 {
                    if m[axis] % s == 0 {
                        candidates.extend([offset(m, axis, -s / 2), offset(m, axis, s / 2)]);
                    }
                }
            }
            2 => {
                // An edge midpoint: one coordinate is an odd multiple of s/2; the faces round the edge lie on the other axes.
                for axis in 0..3 {
                    if m[axis] % s == 0 {
                        candidates.extend([offset(m, axis, -s / 2), offset(m, axis, s / 2)]);
                    }
                }
            }
            _ => {
                // The centre of a cube of side s inside a cube of side 2s. The corner of the small cube that is also a
                // corner of the large one is the one with all coordinates multiples of 2s; the three large edges at it
                // have their midpoints one small side away along each axis.
                let corner = (m - s / 2).map(|low| if low % (2 * s) == 0 { low } else { low + s });
                for axis in 0..3 {
                    let towards = if m[axis] > corner[axis] { s } else { -s };
                    candidates.push(offset(corner, axis, towards));
                }
            }
        }
        let level = self.level - 1;
        candidates.retain(|p| p.cmpge(IVec3::ZERO).all() && p.cmple(IVec3::splat(side)).all());
        candidates.into_iter().map(|midpoint| Self { level, midpoint }).collect()
    }

    /// The diamonds two levels above in which this diamond's tetrahedra lie, ascending. Up to 4, inside the cube
    /// `0..=2^cube_log2`; empty at levels 0 and 1.
    pub fn grandparents(&self, cube_log2: u32) -> Vec<Self> {
        let mut found: Vec<Self> = self.parents(cube_log2).iter().flat_map(|p| p.parents(cube_log2)).collect();
        found.sort_unstable();
        found.dedup();
        let is_here = |t: &Tetra| Self::of(t) == *self;
        found.retain(|g| g.tetrahedra(cube_log2).iter().any(|t| t.quarters().iter().any(is_here)));
        found
    }

    /// The tetrahedra of the diamond inside the cube `0..=2^cube_log2`, in no particular order.
    pub fn tetrahedra(&self, cube_log2: u32) -> Vec<Tetra> {
        if !self.level.is_multiple_of(3) {
            let above = self.parents(cube_log2).into_iter().flat_map(|p| p.tetrahedra(cube_log2));
            return above.flat_map(|t| t.children()).filter(|t| Self::of(t) == *self).collect();
        }
        // A cube: its diagonal begins at the corner that is also one of the cube around it.
        let s = (1i32 << cube_log2) >> (self.level / 3);
        let near: [bool; 3] = std::array::from_fn(|i| i64::from(self.midpoint[i] - s / 2) % (2 * i64::from(s)) == 0);
        let step = IVec3::from(near.map(|near| if near { s } else { -s }));
        let start = self.midpoint - step / 2;
        let walk = |axes: [usize; 3]| {
            let mut v = [start; 4];
            for i in 0..3 {
                v[i + 1] = v[i];
                v[i + 1][axes[i]] += step[axes[i]];
            }
            Tetra { v, level: self.level }
        };
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]].map(walk).to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// Uniform refinement of the whole cube, diamonds found by brute force: the formula must agree with it.
    #[test]
    fn parents_and_counts_agree_with_an_exhaustive_enumeration() {
        const LOG2: u32 = 5;
        let side = 1 << LOG2;
        let mut level: Vec<(Tetra, Option<DiamondKey>)> = Tetra::roots(LOG2).map(|t| (t, None)).to_vec();
        for l in 0..10u8 {
            let mut tets: BTreeMap<DiamondKey, usize> = BTreeMap::new();
            let mut parents: BTreeMap<DiamondKey, BTreeSet<DiamondKey>> = BTreeMap::new();
            let mut next = Vec::new();
            for (t, parent) in &level {
                let key = DiamondKey::of(t);
                *tets.entry(key).or_default() += 1;
                parents.entry(key).or_default().extend(parent.iter());
                next.extend(t.children().map(|c| (c, Some(key))));
            }
            for (key, found) in &parents {
                let mut parents: Vec<_> = key.parents(LOG2);
                parents.sort();
                assert_eq!(parents, found.iter().copied().collect::<Vec<_>>(), "level {l} {key:?}");
                if key.midpoint.to_array().iter().all(|&x| x > 0 && x < side) {
                    assert_eq!(tets[key], [6, 4, 8][usize::from(l) % 3], "{key:?}");
                }
            }
            level = next;
        }
    }

    /// The same for two bisections at once, and the tetrahedra of a diamond made from its name alone.
    #[test]
    fn grandparents_and_tetrahedra_agree_with_an_exhaustive_enumeration() {
        const LOG2: u32 = 5;
        // The corners identify a tetrahedron; their order depends on the path.
        let corners = |t: &Tetra| {
            let mut v = t.v;
            v.sort_unstable_by_key(IVec3::to_array);
            v.map(|p| p.to_array())
        };
        let mut level: Vec<(Tetra, Option<DiamondKey>)> = Tetra::roots(LOG2).map(|t| (t, None)).to_vec();
        for _ in 0..5 {
            let mut inside: BTreeMap<DiamondKey, BTreeSet<[[i32; 3]; 4]>> = BTreeMap::new();
            let mut above: BTreeMap<DiamondKey, BTreeSet<DiamondKey>> = BTreeMap::new();
            let mut next = Vec::new();
            for (t, from) in &level {
                let key = DiamondKey::of(t);
                inside.entry(key).or_default().insert(corners(t));
                above.entry(key).or_default().extend(from.iter());
                next.extend(t.quarters().map(|c| (c, Some(key))));
            }
            for (key, found) in &above {
                assert_eq!(key.grandparents(LOG2), found.iter().copied().collect::<Vec<_>>(), "{key:?}");
                assert!(found.len() <= 4);
                assert_eq!(key.tetrahedra(LOG2).iter().map(corners).collect::<BTreeSet<_>>(), inside[key], "{key:?}");
            }
            level = next;
        }
    }
}

//! Leaving out small components where a fragment cannot be simplified otherwise: 10^5 floating islands, each a few
//! triangles that nothing can be taken from, must not stay at full number up to the coarsest level.
//!
//! Only whole components without locked points go, so nothing outside is affected, and the largest always stays. What their
//! absence means for the error the certifier finds as for everything else.

use super::{NONE, Simplifier};
use glam::DVec3;

/// Fragments of no more triangles than this are small enough as they are.
const SMALL: usize = 1024;

/// A component that may be left out.
struct Component {
    /// Logarithm of its size.
    size: i32,
    /// Where it is, on a space-filling curve.
    place: u32,
    root: u32,
    triangles: usize,
}

/// A component and its bounding box.
struct Found {
    root: u32,
    triangles: usize,
    locked: bool,
    min: DVec3,
    max: DVec3,
}

impl Simplifier<'_> {
    /// Leave out components, small ones first and every second one along a space-filling curve, until `target` triangles
    /// are left or no component may go.
    pub(super) fn prune(&mut self, target: usize) {
        let target = target.max(SMALL);
        if self.triangles <= target {
            return;
        }
        let mut root: Vec<u32> = (0..self.points.len() as u32).collect();
        for t in (0..self.alive.len()).filter(|t| self.alive[*t]) {
            let a = find(&mut root, self.point[t * 3]);
            for k in 1..3 {
                let b = find(&mut root, self.point[t * 3 + k]);
                root[b as usize] = a;
            }
        }
        let mut gone = vec![false; self.points.len()];
        let mut left = self.components(&mut root);
        // The largest stays in any case.
        left.pop();
        while self.triangles > target && !left.is_empty() {
            let mut next = Vec::new();
            let count = left.len();
            for (i, c) in left.into_iter().enumerate() {
                // Of a single one left over there is no second.
                if self.triangles > target && (i % 2 == 1 || count == 1) {
                    gone[c.root as usize] = true;
                    self.triangles -= c.triangles;
                } else {
                    next.push(c);
                }
            }
            left = next;
        }
        for t in 0..self.alive.len() {
            if self.alive[t] && gone[find(&mut root, self.point[t * 3]) as usize] {
                self.alive[t] = false;
            }
        }
        for p in 0..self.points.len() as u32 {
            if self.merged_into[p as usize] == p && gone[find(&mut root, p) as usize] {
                self.points[p as usize].head = NONE;
            }
        }
    }

    /// The components without locked points, small ones first, each size along a space-filling curve.
    fn components(&self, root: &mut [u32]) -> Vec<Component> {
        let mut number = vec![NONE; self.points.len()];
        let mut all: Vec<Found> = Vec::new();
        for t in (0..self.alive.len()).filter(|t| self.alive[*t]) {
            let r = find(root, self.point[t * 3]);
            if number[r as usize] == NONE {
                number[r as usize] = all.len() as u32;
                all.push(Found { root: r, triangles: 0, locked: false, min: DVec3::MAX, max: DVec3::MIN });
            }
            let c = &mut all[number[r as usize] as usize];
            c.triangles += 1;
            for k in 0..3 {
                let p = &self.points[self.point[t * 3 + k] as usize];
                c.locked |= p.locked;
                c.min = c.min.min(p.local);
                c.max = c.max.max(p.local);
            }
        }
        let whole = all.iter().fold((DVec3::MAX, DVec3::MIN), |(a, b), c| (a.min(c.min), b.max(c.max)));
        let mut out: Vec<Component> = all
            .into_iter()
            .filter(|c| !c.locked)
            .map(|Found { root, triangles, min, max, .. }| {
                let size = max.distance_squared(min);
                let width = (whole.1 - whole.0).max(DVec3::ONE);
                let cell = (((min + max) * 0.5 - whole.0) / width * 1023.0).to_array().map(|x| x as u32);
                Component { size: libm::log2(size.max(1.0)) as i32, place: morton(cell), root, triangles }
            })
            .collect();
        out.sort_by_key(|c| (c.size, c.place, c.root));
        out
    }
}

fn find(root: &mut [u32], mut p: u32) -> u32 {
    while root[p as usize] != p {
        root[p as usize] = root[root[p as usize] as usize];
        p = root[p as usize];
    }
    p
}

/// Interleaves ten bits of each.
fn morton(cell: [u32; 3]) -> u32 {
    (0..10)
        .flat_map(|bit| (0..3).map(move |i| (bit, i)))
        .fold(0, |m, (bit, i)| m | ((cell[i] >> bit) & 1) << (bit * 3 + i))
}

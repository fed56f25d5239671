//! Connected components: triangles that hang together by points, over all buckets.
//!
//! Inside of a bucket by union and find over its points. A component that reaches a point which other buckets may use
//! gets a number, and a record (point, number) for each such point; records of one point join their components. Memory
//! follows the number of such components, the records are sorted outside of memory.

use crate::scratch::{Records, Scratch, ScratchError, point_of, record, tetrahedron_of};
use kilwa_geometry::LatticePoint;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU32, Ordering};

/// A component that lies in one bucket.
pub(super) const INNER: u32 = u32::MAX;

/// Disjoint sets of numbers; each is named by its smallest.
#[derive(Debug)]
struct Sets(Vec<u32>);

impl Sets {
    fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            // Halve the path.
            self.0[x as usize] = self.0[self.0[x as usize] as usize];
            x = self.0[x as usize];
        }
        x
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// The components of one bucket.
#[derive(Debug, Default)]
pub(super) struct LocalComponents {
    /// The component of each point.
    of_point: Vec<u32>,
    /// Triangles of each component.
    triangles: Vec<u64>,
    /// The number of each component that reaches other buckets, [`INNER`] for others.
    numbers: Vec<u32>,
}

impl LocalComponents {
    /// `triangles` refer to points `0..points`, and use every one of them.
    pub(super) fn of(triangles: &[[u32; 3]], points: usize) -> Self {
        let mut sets = Sets::new(points);
        for t in triangles {
            sets.join(t[0], t[1]);
            sets.join(t[0], t[2]);
        }
        let mut of_point = vec![0; points];
        let mut count = 0;
        for p in 0..points as u32 {
            let root = sets.find(p);
            // A root is the smallest of its set, so it has its component before the others ask.
            of_point[p as usize] = if root == p { count } else { of_point[root as usize] };
            count += u32::from(root == p);
        }
        let mut sizes = vec![0; count as usize];
        for t in triangles {
            sizes[of_point[t[0] as usize] as usize] += 1;
        }
        Self { of_point, triangles: sizes, numbers: vec![INNER; count as usize] }
    }

    /// The number of a point's component, or [`INNER`].
    pub(super) fn number(&self, point: u32) -> u32 {
        self.numbers[self.of_point[point as usize] as usize]
    }

    /// Triangles of a point's component in this bucket.
    pub(super) fn triangles(&self, point: u32) -> u64 {
        self.triangles[self.of_point[point as usize] as usize]
    }
}

/// Components of the whole model while buckets are worked on.
#[derive(Debug)]
pub(super) struct Joining {
    links: Records,
    next: AtomicU32,
}

/// What is kept of the components of a bucket.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Part {
    /// Sizes of components that lie in the bucket, ascending, with how often.
    inner: Vec<(u64, u64)>,
    /// Number and triangles of the others.
    outer: Vec<(u32, u64)>,
}

impl Part {
    /// Add `first` to all numbers. Returns `false` if one of them was not below `count`.
    pub(super) fn renumber(&mut self, first: u32, count: u32) -> bool {
        self.outer.iter_mut().for_each(|(number, _)| *number = number.wrapping_add(first));
        self.outer.iter().all(|(number, _)| (first..first + count).contains(number))
    }
}

pub(crate) const LINKS: &str = "links";

impl Joining {
    pub(super) fn create(scratch: &Scratch) -> Result<Self, ScratchError> {
        Ok(Self { links: Records::create(scratch, LINKS)?, next: AtomicU32::new(0) })
    }

    /// Complete the records, for [`Joining::take`] in another folder. Returns how many numbers were assigned.
    pub(super) fn hand_over(self) -> Result<u32, ScratchError> {
        self.links.finish()?;
        Ok(self.next.into_inner())
    }

    /// Reserve `count` numbers for components that were numbered elsewhere, from 0. Returns the offset to add to them.
    pub(super) fn make_room(&mut self, count: u32) -> Option<u32> {
        let next = self.next.get_mut();
        let first = *next;
        *next = first.checked_add(count).filter(|end| *end < INNER)?;
        Some(first)
    }

    /// Add records from elsewhere, with `first` added to their numbers.
    pub(super) fn take(&self, records: &[u128], first: u32) -> Result<(), ScratchError> {
        // A number that no region assigned comes from a damaged file, which is detected once all of it has been read.
        let moved = |r: &u128| record(point_of(*r), tetrahedron_of(*r).wrapping_add(first));
        self.links.append(&records.iter().map(moved).collect::<Vec<_>>())
    }

    /// Number the components of a bucket that reach points which others may use; `shared` are these points and where
    /// they are.
    pub(super) fn add(
        &self,
        local: &mut LocalComponents,
        shared: impl Iterator<Item = (u32, LatticePoint)>,
    ) -> Result<Part, ScratchError> {
        let mut records = Vec::new();
        let mut part = Part::default();
        for (point, place) in shared {
            let component = local.of_point[point as usize] as usize;
            if local.numbers[component] == INNER {
                local.numbers[component] = self.next.fetch_add(1, Ordering::Relaxed);
                part.outer.push((local.numbers[component], local.triangles[component]));
            }
            records.push(record(place, local.numbers[component]));
        }
        self.links.append(&records)?;
        let inner = |(_, number): &(&u64, &u32)| **number == INNER;
        let mut sizes: Vec<u64> =
            local.triangles.iter().zip(&local.numbers).filter(inner).map(|(size, _)| *size).collect();
        sizes.sort_unstable();
        part.inner = sizes.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u64)).collect();
        Ok(part)
    }

    /// Join what hangs together.
    pub(super) fn finish(self, scratch: &Scratch, memory: u64, parts: &[Part]) -> Result<Joined, ScratchError> {
        let mut sets = Sets::new(self.next.into_inner() as usize);
        let links = self.links.finish()?;
        let mut last: Option<u128> = None;
        links.sorted(scratch, "links-sorted", memory, |r| -> Result<(), ScratchError> {
            if let Some(before) = last.filter(|l| point_of(*l) == point_of(r)) {
                sets.join(tetrahedron_of(before), tetrahedron_of(r));
            }
            last = Some(r);
            Ok(())
        })?;
        drop(links);
        scratch.remove(LINKS)?;
        let mut sizes = vec![0; sets.0.len()];
        for (number, triangles) in parts.iter().flat_map(|p| &p.outer) {
            sizes[sets.find(*number) as usize] += triangles;
        }
        let roots: Vec<u32> = (0..sets.0.len() as u32).map(|n| sets.find(n)).collect();
        let outer = sizes.iter().filter(|n| **n > 0);
        let inner = parts.iter().flat_map(|p| &p.inner);
        let components = Components {
            count: outer.clone().count() as u64 + inner.clone().map(|(_, n)| n).sum::<u64>(),
            largest: outer.max().copied().unwrap_or(0).max(inner.map(|(size, _)| *size).max().unwrap_or(0)),
        };
        Ok(Joined { components, triangles: roots.iter().map(|r| sizes[*r as usize]).collect() })
    }
}

/// The components of the whole model.
#[derive(Debug)]
pub(super) struct Joined {
    pub(super) components: Components,
    /// Triangles of the whole component, by the number of a part.
    pub(super) triangles: Vec<u64>,
}

/// How many components there are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Components {
    pub(super) count: u64,
    /// Triangles of the largest.
    pub(super) largest: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_component_across_several_buckets_is_one_component() {
        let scratch = Scratch::temporary().unwrap();
        let joining = Joining::create(&scratch).unwrap();
        // A strip over three buckets, an island in the first, a pair that touches in a point of the second and third.
        let mut first = LocalComponents::of(&[[0, 1, 2], [1, 2, 3], [4, 5, 6]], 7);
        let mut second = LocalComponents::of(&[[0, 1, 2], [3, 4, 5]], 6);
        let mut third = LocalComponents::of(&[[0, 1, 2], [3, 4, 5]], 6);
        let at = |x: i32| LatticePoint::new(x, 0, 0);
        let parts = [
            joining.add(&mut first, [(3, at(1))].into_iter()).unwrap(),
            joining.add(&mut second, [(0, at(1)), (2, at(2)), (4, at(3))].into_iter()).unwrap(),
            joining.add(&mut third, [(1, at(2)), (3, at(3))].into_iter()).unwrap(),
        ];
        let joined = joining.finish(&scratch, 1 << 20, &parts).unwrap();
        assert_eq!(joined.components, Components { count: 3, largest: 4 });
        assert_eq!((first.number(5), first.triangles(5)), (INNER, 1));
        assert_eq!(joined.triangles[first.number(0) as usize], 4);
        assert_eq!(joined.triangles[third.number(5) as usize], 2);
    }
}

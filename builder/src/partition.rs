//! Splitting the model into tetrahedra until no leaf holds more than `leaf_triangles`, diamond by diamond, so that the
//! leaves conform (design/hierarchy.md, construction steps 2 and 3).
//!
//! A triangle is never cut: it goes whole to the tetrahedron that holds its centroid, by an exact integer rule that
//! depends on the triangle alone. The set of split diamonds is the smallest set that is closed under "parents first",
//! so it does not depend on the order of work or of the triangles.

use kilwa_geometry::mesh::corner_sum;
use kilwa_geometry::{DiamondKey, Mesh, Tetra, tetra};
use rustc_hash::{FxHashMap, FxHashSet};
use std::ops::Range;

/// A tetrahedron of the tree.
pub struct TetraNode {
    /// Geometry.
    pub tetra: Tetra,
    /// Index of the diamond that splits (or would split) it.
    pub diamond: u32,
    /// Indices of the two halves, once split.
    pub children: Option<[u32; 2]>,
    /// Index of the diamond whose split made it; `u32::MAX` for a root.
    pub parent_diamond: u32,
    /// Its triangles: a range of [`Partition::order`]; kept for leaves, stale once split.
    pub range: Range<usize>,
}

/// A diamond, split or not.
pub struct DiamondNode {
    /// Name.
    pub key: DiamondKey,
    /// Its tetrahedra, in order of creation.
    pub tetrahedra: Vec<u32>,
    /// Whether its tetrahedra are split.
    pub split: bool,
}

/// The conforming tree.
pub struct Partition {
    /// The root cube.
    pub cube_log2: u32,
    /// All tetrahedra; the first six are the roots.
    pub tetrahedra: Vec<TetraNode>,
    /// All diamonds.
    pub diamonds: Vec<DiamondNode>,
    /// Diamond index by name.
    pub by_key: FxHashMap<DiamondKey, u32>,
    /// Triangle numbers, grouped by leaf.
    pub order: Vec<u32>,
    /// Leaves that hold more than they should because space cannot separate their triangles.
    pub overfull_leaves: u64,
}

struct Splitter<'a> {
    tree: Partition,
    sums: Vec<[i64; 3]>,
    extents: &'a dyn Fn(u32) -> i64,
    leaf_triangles: usize,
    scratch: Vec<u32>,
    /// Diamonds still to be looked at.
    queue: Vec<u32>,
}

/// Partition a mesh whose coordinates lie inside the cube `0..=2^cube_log2`.
pub fn partition(mesh: &Mesh, cube_log2: u32, leaf_triangles: usize) -> Partition {
    let sums: Vec<[i64; 3]> = (0..mesh.triangle_count()).map(|t| corner_sum(mesh.corners(t))).collect();
    let extents = |t: u32| {
        let c = mesh.corners(t as usize);
        (0..3)
            .map(|i| {
                i64::from(c.iter().map(|p| p[i]).max().unwrap_or(0))
                    - i64::from(c.iter().map(|p| p[i]).min().unwrap_or(0))
            })
            .max()
            .unwrap_or(0)
    };
    let tree = Partition {
        cube_log2,
        tetrahedra: Vec::new(),
        diamonds: Vec::new(),
        by_key: FxHashMap::default(),
        order: Vec::with_capacity(sums.len()),
        overfull_leaves: 0,
    };
    let mut s = Splitter { tree, sums, extents: &extents, leaf_triangles, scratch: Vec::new(), queue: Vec::new() };
    s.roots();
    while let Some(d) = s.queue.pop() {
        if !s.tree.diamonds[d as usize].split && s.wants_split(d) {
            let key = s.tree.diamonds[d as usize].key;
            s.split(key);
        }
    }
    let mut tree = s.tree;
    tree.overfull_leaves =
        tree.leaves().filter(|t| tree.tetrahedra[*t as usize].range.len() > leaf_triangles).count() as u64;
    tree
}

impl Partition {
    /// All unsplit tetrahedra.
    pub fn leaves(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.tetrahedra.len() as u32).filter(|t| self.tetrahedra[*t as usize].children.is_none())
    }
}

impl Partition {
    /// The smallest conforming tree in which these diamonds are split. Numbers follow from the tree alone: tetrahedra
    /// in the order of a depth-first walk behind the six roots, diamonds by their first tetrahedron.
    pub fn of_wishes(cube_log2: u32, wishes: impl IntoIterator<Item = DiamondKey>) -> Self {
        let mut tree = Self {
            cube_log2,
            tetrahedra: Vec::new(),
            diamonds: Vec::new(),
            by_key: FxHashMap::default(),
            order: Vec::new(),
            overfull_leaves: 0,
        };
        for tetra in Tetra::roots(cube_log2) {
            tree.add(tetra, u32::MAX);
        }
        for key in wishes {
            tree.split(key);
        }
        tree.renumbered()
    }

    fn add(&mut self, tetra: Tetra, parent_diamond: u32) -> u32 {
        let key = DiamondKey::of(&tetra);
        let next = self.diamonds.len() as u32;
        let diamond = *self.by_key.entry(key).or_insert(next);
        if diamond == next {
            self.diamonds.push(DiamondNode { key, tetrahedra: Vec::new(), split: false });
        }
        let index = self.tetrahedra.len() as u32;
        self.diamonds[diamond as usize].tetrahedra.push(index);
        self.tetrahedra.push(TetraNode { tetra, diamond, children: None, parent_diamond, range: 0..0 });
        index
    }

    /// Split a diamond, its parents first; one that is split stays so.
    fn split(&mut self, key: DiamondKey) {
        if self.by_key.get(&key).is_some_and(|d| self.diamonds[*d as usize].split) {
            return;
        }
        for parent in key.parents(self.cube_log2) {
            self.split(parent);
        }
        // Its parents are split, so all its tetrahedra are there.
        let Some(&d) = self.by_key.get(&key) else { return };
        self.diamonds[d as usize].split = true;
        for t in self.diamonds[d as usize].tetrahedra.clone() {
            let children = self.tetrahedra[t as usize].tetra.children().map(|c| self.add(c, d));
            self.tetrahedra[t as usize].children = Some(children);
        }
    }

    fn renumbered(self) -> Self {
        let mut old_of_new: Vec<u32> = (0..6).collect();
        for root in 0..6 {
            let mut stack = vec![root];
            while let Some(t) = stack.pop() {
                if t >= 6 {
                    old_of_new.push(t);
                }
                if let Some([a, b]) = self.tetrahedra[t as usize].children {
                    stack.extend([b, a]);
                }
            }
        }
        let mut new_of_old = vec![0; old_of_new.len()];
        (0u32..).zip(&old_of_new).for_each(|(new, old)| new_of_old[*old as usize] = new);
        // A parent stands before its children, so its diamond has its number by then.
        let mut diamond_of_old = vec![u32::MAX; self.diamonds.len()];
        let mut tree = Self { tetrahedra: Vec::new(), diamonds: Vec::new(), by_key: FxHashMap::default(), ..self };
        for (new, old) in (0u32..).zip(&old_of_new) {
            let node = &self.tetrahedra[*old as usize];
            let diamond = &mut diamond_of_old[node.diamond as usize];
            if *diamond == u32::MAX {
                *diamond = tree.diamonds.len() as u32;
                let DiamondNode { key, split, .. } = self.diamonds[node.diamond as usize];
                tree.by_key.insert(key, *diamond);
                tree.diamonds.push(DiamondNode { key, tetrahedra: Vec::new(), split });
            }
            let diamond = *diamond;
            tree.diamonds[diamond as usize].tetrahedra.push(new);
            tree.tetrahedra.push(TetraNode {
                tetra: node.tetra,
                diamond,
                children: node.children.map(|c| c.map(|t| new_of_old[t as usize])),
                parent_diamond: diamond_of_old.get(node.parent_diamond as usize).copied().unwrap_or(u32::MAX),
                range: 0..0,
            });
        }
        tree
    }
}

impl Splitter<'_> {
    fn roots(&mut self) {
        let roots = Tetra::roots(self.tree.cube_log2);
        let mut groups: [Vec<u32>; 6] = Default::default();
        for (t, sum) in self.sums.iter().enumerate() {
            groups[root_of(*sum)].push(t as u32);
        }
        for (tetra, group) in roots.into_iter().zip(groups) {
            let start = self.tree.order.len();
            self.tree.order.extend(group);
            let end = self.tree.order.len();
            self.add(tetra, u32::MAX, start..end);
        }
    }

    fn add(&mut self, tetra: Tetra, parent_diamond: u32, range: Range<usize>) -> u32 {
        let key = DiamondKey::of(&tetra);
        let next = self.tree.diamonds.len() as u32;
        let diamond = *self.tree.by_key.entry(key).or_insert(next);
        if diamond == next {
            self.tree.diamonds.push(DiamondNode { key, tetrahedra: Vec::new(), split: false });
        }
        let index = self.tree.tetrahedra.len() as u32;
        if range.len() > self.leaf_triangles {
            self.queue.push(diamond);
        }
        self.tree.diamonds[diamond as usize].tetrahedra.push(index);
        self.tree.tetrahedra.push(TetraNode { tetra, diamond, children: None, parent_diamond, range });
        index
    }

    /// Whether splitting helps: some tetrahedron is overfull, there is room for smaller ones, and its triangles are not
    /// all much larger than itself (a fan round one vertex, coincident triangles), which space cannot separate.
    fn wants_split(&self, diamond: u32) -> bool {
        let d = &self.tree.diamonds[diamond as usize];
        if d.key.level >= tetra::max_level(self.tree.cube_log2) {
            return false;
        }
        d.tetrahedra.iter().any(|t| {
            let node = &self.tree.tetrahedra[*t as usize];
            if node.range.len() <= self.leaf_triangles {
                return false;
            }
            let edge = (0..3).map(|i| i64::from(node.tetra.v[0][i] - node.tetra.v[3][i]).abs()).max().unwrap_or(0);
            let triangles = &self.tree.order[node.range.clone()];
            // Only so many different places as fit a leaf: its triangles coincide, and no plane tells them apart.
            let mut places = FxHashSet::default();
            for t in triangles.iter().filter(|t| (self.extents)(**t) <= 2 * edge) {
                places.insert(self.sums[*t as usize]);
                if places.len() > self.leaf_triangles {
                    break;
                }
            }
            places.len() > self.leaf_triangles
        })
    }

    /// Split a diamond, its parents first.
    fn split(&mut self, key: DiamondKey) {
        for parent in key.parents(self.tree.cube_log2) {
            let done = self.tree.by_key.get(&parent).is_some_and(|d| self.tree.diamonds[*d as usize].split);
            if !done {
                self.split(parent);
            }
        }
        let d = self.tree.by_key[&key];
        self.tree.diamonds[d as usize].split = true;
        for t in self.tree.diamonds[d as usize].tetrahedra.clone() {
            let node = &self.tree.tetrahedra[t as usize];
            let (tetra, range) = (node.tetra, node.range.clone());
            let plane = tetra.split_plane();
            // A stable partition in place: child 0 first.
            self.scratch.clear();
            let mut write = range.start;
            for read in range.clone() {
                let triangle = self.tree.order[read];
                if plane.child_of_sum(self.sums[triangle as usize]) == 0 {
                    self.tree.order[write] = triangle;
                    write += 1;
                } else {
                    self.scratch.push(triangle);
                }
            }
            self.tree.order[write..range.end].copy_from_slice(&self.scratch);
            let [a, b] = tetra.children();
            let children = [self.add(a, d, range.start..write), self.add(b, d, write..range.end)];
            self.tree.tetrahedra[t as usize].children = Some(children);
        }
    }
}

/// Which root tetrahedron holds the point `sum / 3`: the one that walks its axes in falling order of the coordinates.
pub(crate) fn root_of(sum: [i64; 3]) -> usize {
    let mut axes = [0, 1, 2];
    axes.sort_by_key(|&a| std::cmp::Reverse(sum[a]));
    match axes {
        [0, 1, 2] => 0,
        [0, 2, 1] => 1,
        [1, 0, 2] => 2,
        [1, 2, 0] => 3,
        [2, 0, 1] => 4,
        _ => 5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wavy(n: i32) -> Mesh {
        let mut m = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                m.positions.push([100 + x * 7, 100 + y * 7, 400 + ((x * x + 3 * y) % 50)]);
            }
        }
        let w = n as u32 + 1;
        for y in 0..n as u32 {
            for x in 0..n as u32 {
                let i = y * w + x;
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
            }
        }
        m.borders = vec![0; m.triangles.len()];
        m
    }

    #[test]
    fn every_triangle_is_in_exactly_one_leaf_that_holds_its_centroid() {
        let m = wavy(100);
        let p = partition(&m, 10, 300);
        let mut seen = vec![0; m.triangle_count()];
        for t in p.leaves() {
            let node = &p.tetrahedra[t as usize];
            assert!(node.range.len() <= 300);
            for i in node.range.clone() {
                let triangle = p.order[i] as usize;
                seen[triangle] += 1;
                assert!(node.tetra.violation(corner_sum(m.corners(triangle))) < 1e-6);
            }
        }
        assert!(seen.iter().all(|n| *n == 1));
    }

    #[test]
    fn a_split_diamond_has_all_its_parents_split_and_all_its_tetrahedra() {
        let p = partition(&wavy(100), 10, 100);
        for d in p.diamonds.iter().filter(|d| d.split) {
            for parent in d.key.parents(10) {
                assert!(p.diamonds[p.by_key[&parent] as usize].split, "{:?}", d.key);
            }
            if d.key.midpoint.iter().all(|&x| x > 0 && x < 1024) {
                assert_eq!(d.tetrahedra.len(), [6, 4, 8][usize::from(d.key.level) % 3]);
            }
        }
    }

    #[test]
    fn ten_thousand_coincident_triangles_do_not_split_for_ever() {
        let mut m = wavy(4);
        let t = m.triangles[0];
        m.triangles.extend(std::iter::repeat_n(t, 10_000));
        m.borders = vec![0; m.triangles.len()];
        let p = partition(&m, 12, 100);
        assert!(p.tetrahedra.len() < 100, "{}", p.tetrahedra.len());
        assert!(p.overfull_leaves > 0);
    }
}

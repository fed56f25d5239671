//! The tree of tetrahedra, split diamond by diamond until no leaf holds more than a patch. The ingest finds
//! which tetrahedra have to be split.
//!
//! One level of the tree is two bisections: a split tetrahedron has four quarters, and diamonds are those of even
//! levels of bisection. The faces of three levels in a row still lie inside of each other's diamonds (cubes, edges of
//! cubes, faces of cubes, in turn), which is what lets everything be simplified in the end; the levels are half as many,
//! so that less is stored, simplified and certified (docs/decisions/0013-two-bisections-a-fifth.md).
//!
//! A triangle is never cut: it goes whole to the tetrahedron that holds its centroid, by an exact integer rule that
//! depends on the triangle alone. The set of split diamonds is the smallest set that is closed under "parents first",
//! and numbers follow from the tree, so nothing depends on the order of work or of the triangles.

mod nodes;
pub(crate) mod part;
pub mod tree_file;

pub use nodes::Nodes;

use glam::I64Vec3;
use kilwa_geometry::{DiamondKey, Tetra};
use rustc_hash::FxHashMap;

/// Bisections from one level of the tree to the next.
pub const BISECTIONS: u8 = 2;

/// The level of the tree at which diamonds of this level of bisection are.
pub fn tree_level(bisections: u8) -> u8 {
    bisections / BISECTIONS
}

/// A tetrahedron of the tree.
pub struct TetraNode {
    /// Geometry.
    pub tetra: Tetra,
    /// Index of the diamond that splits (or would split) it.
    pub diamond: u32,
    /// Indices of its quarters, once split.
    pub children: Option<[u32; 4]>,
    /// Index of the diamond whose split made it; `u32::MAX` for a root.
    pub parent_diamond: u32,
    /// Triangles of a leaf, once they are counted.
    pub triangles: u64,
}

/// A diamond, split or not.
pub struct DiamondNode {
    /// Name.
    pub key: DiamondKey,
    /// Its tetrahedra, ascending.
    pub tetrahedra: Vec<u32>,
    /// Whether its tetrahedra are split.
    pub split: bool,
}

/// The conforming tree, or a part of it.
pub struct Partition {
    /// The root cube.
    pub cube_log2: u32,
    /// All tetrahedra; the first six are the roots.
    pub tetrahedra: Nodes<TetraNode>,
    /// All diamonds.
    pub diamonds: Nodes<DiamondNode>,
    /// Diamond index by name; empty in a part of a tree.
    pub by_key: FxHashMap<DiamondKey, u32>,
    /// Leaves that hold more than they should because space cannot separate their triangles.
    pub overfull_leaves: u64,
    /// In a part of a tree: the level of bisection of every tetrahedron of the whole tree, if the task needs it.
    pub(crate) levels: Vec<u8>,
}

impl Partition {
    /// All unsplit tetrahedra.
    pub fn leaves(&self) -> impl Iterator<Item = u32> + '_ {
        self.tetrahedra.numbered().filter(|(_, node)| node.children.is_none()).map(|(t, _)| t)
    }

    /// The level of bisection of a tetrahedron of the whole tree; `None` if it is not known.
    pub(crate) fn level_of(&self, tetrahedron: u32) -> Option<u8> {
        let known = self.levels.get(tetrahedron as usize).copied();
        known.or_else(|| self.tetrahedra.get(tetrahedron).map(|node| node.tetra.level))
    }

    /// The leaf that contains the point `sum / 3`.
    pub(crate) fn leaf_at(&self, sum: I64Vec3) -> u32 {
        let mut at = root_of(sum) as u32;
        while let Some([a, b, c, d]) = self.tetrahedra[at as usize].children {
            let tetra = &self.tetrahedra[at as usize].tetra;
            let half = tetra.split_plane().child_of_sum(sum);
            let quarter = tetra.children()[half].split_plane().child_of_sum(sum);
            at = [[a, b], [c, d]][half][quarter];
        }
        at
    }

    /// The smallest conforming tree in which these diamonds are split. Numbers follow from the tree alone: tetrahedra
    /// in the order of a depth-first walk behind the six roots, diamonds by their first tetrahedron.
    pub fn from_split_requests(cube_log2: u32, requests: impl IntoIterator<Item = DiamondKey>) -> Self {
        let mut tree = Self {
            cube_log2,
            tetrahedra: Nodes::default(),
            diamonds: Nodes::default(),
            by_key: FxHashMap::default(),
            overfull_leaves: 0,
            levels: Vec::new(),
        };
        for tetra in Tetra::roots(cube_log2) {
            tree.add(tetra, u32::MAX);
        }
        for key in requests {
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
        self.tetrahedra.push(TetraNode { tetra, diamond, children: None, parent_diamond, triangles: 0 });
        index
    }

    /// Split a diamond, its parents first; one that is split stays so.
    fn split(&mut self, key: DiamondKey) {
        if self.by_key.get(&key).is_some_and(|d| self.diamonds[*d as usize].split) {
            return;
        }
        for parent in key.grandparents(self.cube_log2) {
            self.split(parent);
        }
        // Its parents are split, so all its tetrahedra are there.
        let Some(&d) = self.by_key.get(&key) else { return };
        self.diamonds[d as usize].split = true;
        for t in self.diamonds[d as usize].tetrahedra.clone() {
            let children = self.tetrahedra[t as usize].tetra.quarters().map(|c| self.add(c, d));
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
                if let Some(quarters) = self.tetrahedra[t as usize].children {
                    stack.extend(quarters.into_iter().rev());
                }
            }
        }
        let mut new_of_old = vec![0; old_of_new.len()];
        (0u32..).zip(&old_of_new).for_each(|(new, old)| new_of_old[*old as usize] = new);
        // A parent comes before its children, so its diamond has its number by then.
        let mut diamond_of_old = vec![u32::MAX; self.diamonds.len()];
        let (tetrahedra, diamonds, by_key) = (Nodes::default(), Nodes::default(), FxHashMap::default());
        let mut tree = Self { tetrahedra, diamonds, by_key, levels: Vec::new(), ..self };
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
                triangles: 0,
            });
        }
        tree
    }
}

/// Which root tetrahedron holds the point `sum / 3`: the one that walks its axes in falling order of the coordinates.
pub(crate) fn root_of(sum: I64Vec3) -> usize {
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

    /// Diamonds round some points, ever smaller ones; a wish without its parents each.
    fn requests() -> Vec<DiamondKey> {
        let mut out = Vec::new();
        for sum in [[300, 900, 1500], [2900, 100, 100], [1500, 1501, 1502]].map(I64Vec3::from) {
            let roots = Tetra::roots(10);
            let mut tetra = roots[root_of(sum)];
            for level in 0..14 {
                tetra = tetra.children()[tetra.split_plane().child_of_sum(sum)];
                if level % 4 == 3 {
                    assert_eq!(tetra.level % BISECTIONS, 0);
                    out.push(DiamondKey::of(&tetra));
                }
            }
        }
        out
    }

    #[test]
    fn a_split_diamond_has_all_its_parents_split_and_all_its_tetrahedra() {
        let p = Partition::from_split_requests(10, requests());
        assert!(requests().iter().all(|w| p.diamonds[p.by_key[w] as usize].split));
        for d in p.diamonds.iter().filter(|d| d.split) {
            for parent in d.key.grandparents(10) {
                assert!(p.diamonds[p.by_key[&parent] as usize].split, "{:?}", d.key);
            }
            if d.key.midpoint.to_array().iter().all(|&x| x > 0 && x < 1024) {
                assert_eq!(d.tetrahedra.len(), [6, 4, 8][usize::from(d.key.level) % 3]);
            }
        }
    }

    #[test]
    fn node_numbers_depend_on_the_tree_and_not_on_the_order_of_split_requests() {
        let a = Partition::from_split_requests(10, requests());
        let b = Partition::from_split_requests(10, requests().into_iter().rev());
        assert_eq!(a.tetrahedra.len(), b.tetrahedra.len());
        for (x, y) in a.tetrahedra.iter().zip(b.tetrahedra.iter()) {
            assert_eq!((x.tetra, x.diamond, x.children), (y.tetra, y.diamond, y.children));
            assert_eq!(x.parent_diamond, y.parent_diamond);
        }
        assert!(
            a.diamonds.iter().zip(b.diamonds.iter()).all(|(x, y)| (x.key, &x.tetrahedra) == (y.key, &y.tetrahedra))
        );
        assert!((0..6).all(|i| a.tetrahedra[i].tetra == Tetra::roots(10)[i]));
    }

    #[test]
    fn node_numbers_are_consistent_and_leaves_are_in_traversal_order() {
        let p = Partition::from_split_requests(10, requests());
        for (i, t) in p.tetrahedra.numbered() {
            let d = &p.diamonds[t.diamond as usize];
            assert!(d.key == DiamondKey::of(&t.tetra) && d.tetrahedra.contains(&i) && d.tetrahedra.is_sorted());
            assert_eq!(d.split, t.children.is_some());
            for (c, tetra) in t.children.iter().flatten().zip(t.tetra.quarters()) {
                let child = &p.tetrahedra[*c as usize];
                assert!(child.tetra == tetra && child.parent_diamond == t.diamond);
            }
        }
        let mut walked = Vec::new();
        let mut stack: Vec<u32> = (0..6).rev().collect();
        while let Some(t) = stack.pop() {
            match p.tetrahedra[t as usize].children {
                Some(quarters) => stack.extend(quarters.into_iter().rev()),
                None if t >= 6 => walked.push(t),
                None => {}
            }
        }
        assert!(walked.is_sorted() && walked.len() > 20);
    }
}

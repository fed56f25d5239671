//! A part of the tree: what one task of a divided build needs, so that no task has to read the whole tree.
//!
//! Its bytes are like those of [`super::tree_file`], with the number of each node before the node, and a CRC-32 at the end.

use super::tree_file::{Fields, push_diamond, push_tetrahedron};
use super::{Nodes, Partition};
use crate::ingest::divided::Run;

/// About how many bytes a node takes.
const BYTES: usize = 80;

/// The nodes of a part, by their numbers.
#[derive(Debug)]
pub(crate) struct Part {
    tetrahedra: Vec<u32>,
    diamonds: Vec<u32>,
}

impl Part {
    /// What is needed to coarsen these diamonds: the diamonds, their tetrahedra, the quarters of these, and the diamonds of the quarters.
    pub(crate) fn to_coarsen(tree: &Partition, diamonds: &[u32]) -> Self {
        let mut part = Self::of_diamonds(tree, diamonds.iter().copied());
        let split = |t: &u32| tree.tetrahedra[*t as usize].children;
        let quarters: Vec<u32> = part.tetrahedra.iter().filter_map(split).flatten().collect();
        part.diamonds.extend(quarters.iter().map(|t| tree.tetrahedra[*t as usize].diamond));
        part.tetrahedra.extend(quarters);
        part.sorted()
    }

    /// The same for all diamonds above a level of bisection, with the roots.
    pub(crate) fn above(tree: &Partition, level: u8) -> Self {
        let is_above = tree.diamonds.numbered().filter(|(_, node)| node.split && node.key.level < level);
        let diamonds: Vec<u32> = is_above.map(|(d, _)| d).collect();
        Self::to_coarsen(tree, &diamonds).with_roots(tree)
    }

    /// The diamonds that are split, with their tetrahedra, and the roots: what the assembly of the pack needs.
    pub(crate) fn of_pack(tree: &Partition) -> Self {
        let split = tree.diamonds.numbered().filter(|(_, node)| node.split);
        Self::of_diamonds(tree, split.map(|(d, _)| d)).with_roots(tree)
    }

    /// The tetrahedra of these runs, and everything below them.
    pub(crate) fn below(tree: &Partition, runs: &[Run]) -> Self {
        let mut part = Self { tetrahedra: Vec::new(), diamonds: Vec::new() };
        let mut stack = Vec::new();
        for run in runs {
            part.tetrahedra.push(run.tetrahedron);
            // The other half may contain almost the whole tree.
            match run.half {
                Some(quarters) => stack.extend(quarters),
                None => stack.extend(tree.tetrahedra[run.tetrahedron as usize].children.into_iter().flatten()),
            }
        }
        while let Some(t) = stack.pop() {
            part.tetrahedra.push(t);
            stack.extend(tree.tetrahedra[t as usize].children.into_iter().flatten());
        }
        part.sorted()
    }

    fn of_diamonds(tree: &Partition, diamonds: impl IntoIterator<Item = u32>) -> Self {
        let diamonds: Vec<u32> = diamonds.into_iter().collect();
        let tetrahedra = diamonds.iter().flat_map(|d| tree.diamonds[*d as usize].tetrahedra.iter().copied()).collect();
        Self { tetrahedra, diamonds }.sorted()
    }

    fn with_roots(mut self, tree: &Partition) -> Self {
        self.tetrahedra.extend(0..6);
        self.diamonds.extend((0..6).map(|root| tree.tetrahedra[root].diamond));
        self.sorted()
    }

    fn sorted(mut self) -> Self {
        for numbers in [&mut self.tetrahedra, &mut self.diamonds] {
            numbers.sort_unstable();
            numbers.dedup();
        }
        self
    }

    /// Its bytes.
    pub(crate) fn bytes(&self, tree: &Partition) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(16 + BYTES * (self.tetrahedra.len() + self.diamonds.len()));
        let head = [tree.cube_log2, self.tetrahedra.len() as u32, self.diamonds.len() as u32];
        bytes.extend(head.iter().flat_map(|n| n.to_le_bytes()));
        for t in &self.tetrahedra {
            bytes.extend(t.to_le_bytes());
            push_tetrahedron(&mut bytes, &tree.tetrahedra[*t as usize]);
        }
        for d in &self.diamonds {
            bytes.extend(d.to_le_bytes());
            push_diamond(&mut bytes, &tree.diamonds[*d as usize]);
        }
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes
    }
}

/// The part with these bytes; `None` if they are not what [`Part::bytes`] returned.
pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Partition> {
    let (body, sum) = bytes.split_last_chunk::<4>()?;
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        return None;
    }
    let mut fields = Fields(body);
    let [cube_log2, tetrahedra, diamonds] = [fields.number()?, fields.number()?, fields.number()?];
    let (mut nodes, mut numbers) = (Vec::new(), Vec::new());
    for _ in 0..tetrahedra {
        numbers.push(fields.number()?);
        nodes.push(fields.tetrahedron()?);
    }
    let tetrahedra = Nodes::of_part(nodes, numbers)?;
    let (mut nodes, mut numbers) = (Vec::new(), Vec::new());
    for _ in 0..diamonds {
        numbers.push(fields.number()?);
        nodes.push(fields.diamond()?);
    }
    let diamonds = Nodes::of_part(nodes, numbers)?;
    let (by_key, levels) = (rustc_hash::FxHashMap::default(), Vec::new());
    fields.0.is_empty().then_some(Partition { cube_log2, tetrahedra, diamonds, by_key, overfull_leaves: 0, levels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::{DiamondKey, Tetra};

    /// A tree with a path of ever smaller diamonds.
    fn tree() -> Partition {
        let mut requests = Vec::new();
        let mut tetra = Tetra::roots(10)[2];
        for level in 0..9 {
            requests.push(DiamondKey::of(&tetra));
            tetra = tetra.quarters()[level % 4];
        }
        Partition::from_split_requests(10, requests)
    }

    fn assert_is_part(part: &Partition, tree: &Partition) {
        for (t, a) in part.tetrahedra.numbered() {
            let b = &tree.tetrahedra[t as usize];
            assert_eq!(
                (a.tetra, a.diamond, a.children, a.parent_diamond),
                (b.tetra, b.diamond, b.children, b.parent_diamond)
            );
        }
        for (d, a) in part.diamonds.numbered() {
            let b = &tree.diamonds[d as usize];
            assert_eq!((a.key, &a.tetrahedra, a.split), (b.key, &b.tetrahedra, b.split));
        }
    }

    #[test]
    fn a_part_keeps_the_numbers_and_damage_is_detected() {
        let tree = tree();
        let split: Vec<u32> = tree.diamonds.numbered().filter(|(_, d)| d.split).map(|(d, _)| d).collect();
        let bytes = Part::to_coarsen(&tree, &split[split.len() / 2..]).bytes(&tree);
        let part = from_bytes(&bytes).unwrap();
        assert!(part.tetrahedra.len() > 10 && part.tetrahedra.len() < tree.tetrahedra.len());
        assert_is_part(&part, &tree);
        let absent = (0..tree.tetrahedra.len() as u32).find(|t| part.tetrahedra.get(*t).is_none()).unwrap();
        assert_eq!(part.level_of(absent), None);
        for i in (0..bytes.len()).step_by(7) {
            let mut damaged = bytes.clone();
            damaged[i] ^= 1;
            assert!(from_bytes(&damaged).is_none() && from_bytes(&bytes[..i]).is_none(), "byte {i}");
        }
    }

    #[test]
    fn parts_contain_what_their_tasks_need() {
        let tree = tree();
        for level in 0..9 {
            let part = from_bytes(&Part::above(&tree, 2 * level).bytes(&tree)).unwrap();
            assert_is_part(&part, &tree);
            assert!((0..6).all(|root| part.tetrahedra.get(root).is_some()));
            let mut above = tree.diamonds.numbered().filter(|(_, d)| d.split && d.key.level < 2 * level);
            assert!(above.all(|(d, node)| {
                let quarters = node.tetrahedra.iter().flat_map(|t| tree.tetrahedra[*t as usize].children.unwrap());
                let mut nodes = quarters.map(|t| part.tetrahedra.get(t));
                part.diamonds.get(d).is_some()
                    && nodes.all(|n| n.is_some_and(|n| part.diamonds.get(n.diamond).is_some()))
            }));
        }
        let leaves = |tree: &Partition| tree.leaves().collect::<Vec<_>>();
        let run = |tetrahedron, half| Run { tetrahedron, half, buckets: 0..1 };
        let roots: Vec<Run> = (0..6).map(|root| run(root, None)).collect();
        let all = from_bytes(&Part::below(&tree, &roots).bytes(&tree)).unwrap();
        assert_eq!(leaves(&all), leaves(&tree));
        // The halves of a tetrahedron are separate parts: one has almost all of the tree, the other the rest.
        let [a, b, c, d] = tree.tetrahedra[2].children.unwrap();
        let sizes = [[a, b], [c, d]].map(|half| Part::below(&tree, &[run(2, Some(half))]).tetrahedra.len());
        let both = Part::below(&tree, &[run(2, Some([a, b])), run(2, Some([c, d]))]).tetrahedra.len();
        assert_eq!(both, sizes.iter().sum::<usize>() - 1);
        assert!(sizes.iter().min().unwrap() * 4 < both, "{sizes:?}");
        let pack = from_bytes(&Part::of_pack(&tree).bytes(&tree)).unwrap();
        assert_is_part(&pack, &tree);
        assert!(tree.diamonds.numbered().filter(|(_, d)| d.split).all(|(d, _)| pack.diamonds.get(d).is_some()));
    }
}

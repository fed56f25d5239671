//! The tree in a scratch file, `tree`, for a build that is resumed: tetrahedra and diamonds one after the other, numbers
//! little-endian, a CRC-32 at the end. Numbers of triangles are not kept.

use crate::partition::{DiamondNode, Nodes, Partition, TetraNode};
use crate::scratch::{Appender, Scratch, ScratchError};
use kilwa_geometry::{DiamondKey, LatticePoint, Tetra};

/// Name of the file.
pub const TREE: &str = "tree";

/// Stands for "no children".
const NONE: u32 = u32::MAX;

/// Write the tree and wait until it is on the disk.
///
/// # Errors
/// [`ScratchError`] where it cannot be written.
pub fn write(scratch: &Scratch, tree: &Partition) -> Result<(), ScratchError> {
    let mut file = Appender::new(scratch.create(TREE)?);
    let mut sum = crc32fast::Hasher::new();
    let mut bytes = Vec::new();
    for n in [tree.cube_log2, tree.tetrahedra.len() as u32, tree.diamonds.len() as u32, tree.overfull_leaves as u32] {
        bytes.extend(n.to_le_bytes());
    }
    let mut put = |bytes: &mut Vec<u8>| {
        sum.update(bytes);
        let pushed = file.push(bytes);
        bytes.clear();
        pushed
    };
    for node in tree.tetrahedra.iter() {
        push_tetrahedron(&mut bytes, node);
        put(&mut bytes)?;
    }
    for node in tree.diamonds.iter() {
        push_diamond(&mut bytes, node);
        put(&mut bytes)?;
    }
    put(&mut bytes)?;
    file.push(&sum.finalize().to_le_bytes())?;
    file.finish()?.sync()
}

pub(super) fn push_tetrahedron(bytes: &mut Vec<u8>, node: &TetraNode) {
    bytes.push(node.tetra.level);
    let corners = node.tetra.v.map(|p| p.to_array());
    bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    let [a, b, c, d] = node.children.unwrap_or([NONE; 4]);
    bytes.extend([node.diamond, a, b, c, d, node.parent_diamond].iter().flat_map(|x| x.to_le_bytes()));
}

pub(super) fn push_diamond(bytes: &mut Vec<u8>, node: &DiamondNode) {
    bytes.extend([node.key.level, u8::from(node.split)]);
    bytes.extend(node.key.midpoint.to_array().iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend((node.tetrahedra.len() as u32).to_le_bytes());
    bytes.extend(node.tetrahedra.iter().flat_map(|x| x.to_le_bytes()));
}

/// Read the tree.
///
/// # Errors
/// [`ScratchError::Damaged`] where it is not what was written.
pub fn read(scratch: &Scratch) -> Result<Partition, ScratchError> {
    let file = scratch.existing(TREE)?;
    let bytes = file.read(0, file.len())?;
    from_bytes(&bytes).ok_or_else(|| ScratchError::damaged(file.path(), "it is not the tree that was written"))
}

/// The tree in the bytes of a file, `None` where it is not what was written.
fn from_bytes(bytes: &[u8]) -> Option<Partition> {
    let (body, sum) = bytes.split_last_chunk::<4>()?;
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        return None;
    }
    parse(body)
}

fn parse(body: &[u8]) -> Option<Partition> {
    let mut fields = Fields(body);
    let head = [fields.number()?, fields.number()?, fields.number()?, fields.number()?];
    let mut tree = Partition {
        cube_log2: head[0],
        tetrahedra: Nodes::default(),
        diamonds: Nodes::default(),
        by_key: rustc_hash::FxHashMap::default(),
        overfull_leaves: u64::from(head[3]),
        levels: Vec::new(),
    };
    for _ in 0..head[1] {
        tree.tetrahedra.push(fields.tetrahedron()?);
    }
    for i in 0..head[2] {
        let node = fields.diamond()?;
        tree.by_key.insert(node.key, i);
        tree.diamonds.push(node);
    }
    fields.0.is_empty().then_some(tree)
}

/// Little-endian numbers, one after the other.
pub(super) struct Fields<'a>(pub(super) &'a [u8]);

impl Fields<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(*first)
    }

    pub(super) fn number(&mut self) -> Option<u32> {
        let (head, rest) = self.0.split_first_chunk::<4>()?;
        self.0 = rest;
        Some(u32::from_le_bytes(*head))
    }

    pub(super) fn tetrahedron(&mut self) -> Option<TetraNode> {
        let level = self.byte()?;
        let mut v = [[0; 3]; 4];
        for x in v.as_flattened_mut() {
            *x = self.number()? as i32;
        }
        let diamond = self.number()?;
        let children = [self.number()?, self.number()?, self.number()?, self.number()?];
        Some(TetraNode {
            tetra: Tetra { v: v.map(LatticePoint::from), level },
            diamond,
            children: (children[0] != NONE).then_some(children),
            parent_diamond: self.number()?,
            triangles: 0,
        })
    }

    pub(super) fn diamond(&mut self) -> Option<DiamondNode> {
        let (level, split) = (self.byte()?, self.byte()? != 0);
        let midpoint = LatticePoint::new(self.number()? as i32, self.number()? as i32, self.number()? as i32);
        let count = self.number()?;
        let tetrahedra = (0..count).map(|_| self.number()).collect::<Option<_>>()?;
        Some(DiamondNode { key: DiamondKey { level, midpoint }, tetrahedra, split })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_round_trips_and_damage_is_detected() {
        // A path of ever smaller diamonds.
        let mut requests = Vec::new();
        let mut tetra = Tetra::roots(10)[2];
        for level in 0..9 {
            requests.push(DiamondKey::of(&tetra));
            tetra = tetra.quarters()[level % 4];
        }
        let mut tree = Partition::from_split_requests(10, requests);
        tree.overfull_leaves = 3;
        let scratch = Scratch::temporary().unwrap();
        write(&scratch, &tree).unwrap();
        let back = read(&scratch).unwrap();
        assert_eq!((back.cube_log2, back.overfull_leaves), (10, tree.overfull_leaves));
        assert_eq!(back.tetrahedra.len(), tree.tetrahedra.len());
        for (a, b) in back.tetrahedra.iter().zip(tree.tetrahedra.iter()) {
            assert_eq!(
                (a.tetra, a.diamond, a.children, a.parent_diamond),
                (b.tetra, b.diamond, b.children, b.parent_diamond)
            );
        }
        for (a, b) in back.diamonds.iter().zip(tree.diamonds.iter()) {
            assert_eq!((a.key, &a.tetrahedra, a.split), (b.key, &b.tetrahedra, b.split));
        }
        assert_eq!(back.by_key, tree.by_key);
        let whole = std::fs::read(scratch.path(TREE)).unwrap();
        for i in (0..whole.len()).step_by(61) {
            let mut bytes = whole.clone();
            bytes[i] ^= 1;
            std::fs::write(scratch.path(TREE), bytes).unwrap();
            assert!(read(&scratch).is_err());
        }
    }
}

//! The part of the directory that is known, and what is held of every chunk.

use kilwa_geometry::Sphere;
use kilwa_pack::{DirectoryEntry, ENTRIES_PER_PAGE, PatchRange};
use std::collections::BTreeMap;

/// Life of a chunk: absent → requested → (bytes) → decoding → decoded → resident → absent again by eviction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    Absent,
    Requested(u64),
    Decoding,
    Decoded,
    Resident,
}

#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) entry: DirectoryEntry,
    pub(crate) state: State,
    /// Patches, from decoding until eviction.
    pub(crate) patches: Vec<PatchRange>,
    /// Failures in a row.
    pub(crate) attempts: u32,
    /// Not to be asked for before this time, milliseconds.
    pub(crate) retry_at: f64,
    /// The last failure was one of its bytes, not of the network: it is asked for alone, and a working network helps nothing.
    pub(crate) damaged: bool,
    /// Refined in the cut of the last step; it may be so without being held ([`crate::skip`]).
    pub(crate) refined: bool,
}

/// Children on pages farther apart than this are found through the chunk's own table: most pages in between would belong to other chunks.
const CLOSE_PAGES: u8 = 2;

/// Bytes of one vertex in GPU memory.
pub(crate) const GPU_VERTEX_BYTES: u64 = 20;
/// Bytes of one triangle in GPU memory.
pub(crate) const GPU_TRIANGLE_BYTES: u64 = 12;
/// Bytes of one decoded vertex in main memory: position, colour, normal.
const CPU_VERTEX_BYTES: u64 = 12 + 3 + 4;
/// Bytes of one decoded triangle in main memory: indices and border bits.
const CPU_TRIANGLE_BYTES: u64 = 13;

impl Node {
    fn new(entry: DirectoryEntry) -> Self {
        Self {
            entry,
            state: State::Absent,
            patches: Vec::new(),
            attempts: 0,
            retry_at: 0.0,
            damaged: false,
            refined: false,
        }
    }

    pub(crate) fn gpu_bytes(&self) -> u64 {
        u64::from(self.entry.vertices) * GPU_VERTEX_BYTES + u64::from(self.entry.triangles) * GPU_TRIANGLE_BYTES
    }

    pub(crate) fn cpu_bytes(&self, scalars: u8) -> u64 {
        u64::from(self.entry.vertices) * (CPU_VERTEX_BYTES + 4 * u64::from(scalars))
            + u64::from(self.entry.triangles) * CPU_TRIANGLE_BYTES
    }

    /// First byte of the file behind the chunk.
    pub(crate) fn end(&self) -> u64 {
        self.entry.offset.saturating_add(u64::from(self.entry.encoded_bytes))
    }

    /// Bound of the errors of what refines this chunk further, metres.
    pub(crate) fn error_below(&self) -> f32 {
        self.entry.children.map_or(self.entry.error, |c| c.error(self.entry.error))
    }

    pub(crate) fn is_held(&self) -> bool {
        self.state != State::Absent
    }

    /// A ball round the chunk's own box.
    pub(crate) fn box_sphere(&self) -> Sphere {
        let b = self.entry.bounds;
        if b.is_empty() {
            return Sphere::EMPTY;
        }
        let [low, high] = [b.min, b.max].map(glam::IVec3::as_dvec3);
        Sphere { center: (low + high) * 0.5, radius: ((high - low) * 0.5).length() }
    }
}

/// Known directory pages and the links from parents to children.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nodes {
    pages: BTreeMap<u32, Vec<Node>>,
    children: BTreeMap<u32, Vec<u32>>,
    /// Where the file ends, if it ends before what its header states.
    pub(crate) cut_off: Option<u64>,
}

impl Nodes {
    /// Whether the bytes before this offset are there.
    pub(crate) fn is_there(&self, end: u64) -> bool {
        self.cut_off.is_none_or(|file_end| end <= file_end)
    }

    pub(crate) fn has_page(&self, page: u32) -> bool {
        self.pages.contains_key(&page)
    }

    pub(crate) fn page_count(&self) -> usize {
        self.pages.len()
    }

    /// Number of known entries.
    pub(crate) fn len(&self) -> usize {
        self.pages.values().map(Vec::len).sum()
    }

    pub(crate) fn page_of(index: u32) -> u32 {
        index / ENTRIES_PER_PAGE as u32
    }

    pub(crate) fn add_page(&mut self, page: u32, entries: Vec<DirectoryEntry>) {
        let first = page * ENTRIES_PER_PAGE as u32;
        for (at, entry) in entries.iter().enumerate() {
            let mut seen = [u32::MAX; 4];
            for (slot, parent) in entry.parents().enumerate() {
                if !seen.contains(&parent) {
                    seen[slot] = parent;
                    self.children.entry(parent).or_default().push(first + at as u32);
                }
            }
        }
        self.pages.insert(page, entries.into_iter().map(Node::new).collect());
    }

    pub(crate) fn get(&self, index: u32) -> Option<&Node> {
        self.pages.get(&Self::page_of(index))?.get(index as usize % ENTRIES_PER_PAGE)
    }

    pub(crate) fn get_mut(&mut self, index: u32) -> Option<&mut Node> {
        self.pages.get_mut(&Self::page_of(index))?.get_mut(index as usize % ENTRIES_PER_PAGE)
    }

    /// Known children, each once.
    pub(crate) fn children(&self, index: u32) -> &[u32] {
        self.children.get(&index).map_or(&[], Vec::as_slice)
    }

    /// The children, if the directory states that they replace all of a chunk and every one of them is known.
    pub(crate) fn whole_family(&self, index: u32) -> Option<&[u32]> {
        let listed = self.get(index)?.entry.children.filter(|c| c.is_whole)?;
        let known = self.children(index);
        (known.len() == usize::from(listed.count)).then_some(known)
    }

    /// Whether a child of a chunk may be an entry that is not known.
    pub(crate) fn lacks_children(&self, index: u32) -> bool {
        let listed = self.get(index).and_then(|node| node.entry.children);
        listed.is_none_or(|c| self.children(index).len() < usize::from(c.count))
    }

    /// Unknown pages that contain children of a chunk, if the directory lists few pages for them.
    pub(crate) fn pages_of_children(&self, index: u32) -> impl Iterator<Item = u32> + '_ {
        let listed = self.get(index).and_then(|node| node.entry.children).filter(|c| c.pages <= CLOSE_PAGES);
        let missing = listed.filter(|c| self.children(index).len() < usize::from(c.count));
        missing.into_iter().flat_map(|c| c.pages()).filter(|&page| !self.has_page(page))
    }

    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut Node> {
        self.pages.values_mut().flatten()
    }

    /// All known nodes in order of their index.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, &Node)> {
        self.pages.iter().flat_map(|(page, nodes)| {
            let first = page * ENTRIES_PER_PAGE as u32;
            nodes.iter().enumerate().map(move |(at, node)| (first + at as u32, node))
        })
    }

    /// How many different parents a node has.
    pub(crate) fn parent_count(node: &Node) -> usize {
        let mut seen = [u32::MAX; 4];
        let mut count = 0;
        for parent in node.entry.parents() {
            if !seen.contains(&parent) {
                seen[count] = parent;
                count += 1;
            }
        }
        count
    }
}

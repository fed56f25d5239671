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
    /// Bounding sphere of the chunk's own box.
    pub(crate) box_sphere: Sphere,
    /// How many different parents it has.
    pub(crate) parent_count: u8,
    /// Known children, each once.
    children: Vec<u32>,
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
    fn new(entry: DirectoryEntry, children: Vec<u32>) -> Self {
        Self {
            box_sphere: box_sphere(&entry),
            parent_count: distinct_parents(&entry).count() as u8,
            children,
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
}

fn box_sphere(entry: &DirectoryEntry) -> Sphere {
    let b = entry.bounds;
    if b.is_empty() {
        return Sphere::EMPTY;
    }
    let [low, high] = [b.min, b.max].map(glam::IVec3::as_dvec3);
    Sphere { center: (low + high) * 0.5, radius: ((high - low) * 0.5).length() }
}

/// The parents of an entry, each once.
fn distinct_parents(entry: &DirectoryEntry) -> impl Iterator<Item = u32> + '_ {
    let all: Vec<u32> = entry.parents().collect();
    entry.parents().enumerate().filter(move |(slot, parent)| !all[..*slot].contains(parent)).map(|(_, parent)| parent)
}

/// A directory page that is known.
#[derive(Debug, Clone)]
struct Page {
    number: u32,
    nodes: Vec<Node>,
}

/// Known directory pages and the links from parents to children. Every step looks up thousands of nodes, so lookups use
/// two array accesses instead of a search.
#[derive(Debug, Clone, Default)]
pub(crate) struct Nodes {
    /// Known pages in the order in which they came.
    pages: Vec<Page>,
    /// By page number, as far as pages are known: 1 + the place in `pages`, 0 for an unknown page.
    places: Vec<u32>,
    /// Known children of entries that are not known.
    orphans: BTreeMap<u32, Vec<u32>>,
    /// Where the file ends, if it ends before what its header states.
    pub(crate) cut_off: Option<u64>,
    /// How many are resident.
    pub(crate) resident: u32,
    /// How many are asked for or being decoded.
    pub(crate) on_the_way: u32,
}

impl Nodes {
    /// Whether the bytes before this offset are there.
    pub(crate) fn is_there(&self, end: u64) -> bool {
        self.cut_off.is_none_or(|file_end| end <= file_end)
    }

    pub(crate) fn has_page(&self, page: u32) -> bool {
        self.place(page).is_some()
    }

    pub(crate) fn page_count(&self) -> usize {
        self.pages.len()
    }

    /// Number of known entries.
    pub(crate) fn len(&self) -> usize {
        self.pages.iter().map(|p| p.nodes.len()).sum()
    }

    pub(crate) fn page_of(index: u32) -> u32 {
        index / ENTRIES_PER_PAGE as u32
    }

    pub(crate) fn add_page(&mut self, page: u32, entries: Vec<DirectoryEntry>) {
        if self.has_page(page) {
            return;
        }
        let first = page * ENTRIES_PER_PAGE as u32;
        let nodes = (first..).zip(entries).map(|(index, entry)| {
            let children = self.orphans.remove(&index).unwrap_or_default();
            Node::new(entry, children)
        });
        let nodes: Vec<Node> = nodes.collect();
        if self.places.len() <= page as usize {
            self.places.resize(page as usize + 1, 0);
        }
        self.places[page as usize] = self.pages.len() as u32 + 1;
        let links: Vec<(u32, u32)> = (first..)
            .zip(&nodes)
            .flat_map(|(index, node)| distinct_parents(&node.entry).map(move |parent| (parent, index)))
            .collect();
        self.pages.push(Page { number: page, nodes });
        for (parent, child) in links {
            match self.get_mut(parent) {
                Some(node) => node.children.push(child),
                None => self.orphans.entry(parent).or_default().push(child),
            }
        }
    }

    fn place(&self, page: u32) -> Option<usize> {
        (self.places.get(page as usize)?.checked_sub(1)).map(|place| place as usize)
    }

    /// The index of a known node in a list of length [`Nodes::slots`].
    pub(crate) fn slot(&self, index: u32) -> Option<usize> {
        let place = self.place(Self::page_of(index))?;
        let within = index as usize % ENTRIES_PER_PAGE;
        (within < self.pages.get(place)?.nodes.len()).then_some(place * ENTRIES_PER_PAGE + within)
    }

    /// No known index reaches this.
    fn end(&self) -> usize {
        self.places.len() * ENTRIES_PER_PAGE
    }

    /// The length of a list with one value for every known node.
    pub(crate) fn slots(&self) -> usize {
        self.pages.len() * ENTRIES_PER_PAGE
    }

    pub(crate) fn get(&self, index: u32) -> Option<&Node> {
        self.pages.get(self.place(Self::page_of(index))?)?.nodes.get(index as usize % ENTRIES_PER_PAGE)
    }

    pub(crate) fn get_mut(&mut self, index: u32) -> Option<&mut Node> {
        let place = self.place(Self::page_of(index))?;
        self.pages.get_mut(place)?.nodes.get_mut(index as usize % ENTRIES_PER_PAGE)
    }

    /// Change the state of a known node, and what is counted of it.
    pub(crate) fn set_state(&mut self, index: u32, state: State) {
        let Some(node) = self.get_mut(index) else { return };
        let before = std::mem::replace(&mut node.state, state);
        let is_resident = |s: State| u32::from(s == State::Resident);
        let is_on_the_way = |s: State| u32::from(matches!(s, State::Requested(_) | State::Decoding));
        self.resident = self.resident + is_resident(state) - is_resident(before);
        self.on_the_way = self.on_the_way + is_on_the_way(state) - is_on_the_way(before);
    }

    /// Known children, each once.
    pub(crate) fn children(&self, index: u32) -> &[u32] {
        match self.get(index) {
            Some(node) => &node.children,
            None => self.orphans.get(&index).map_or(&[], Vec::as_slice),
        }
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
        self.pages.iter_mut().flat_map(|p| &mut p.nodes)
    }

    /// All known nodes in order of their index.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, &Node)> {
        let known = self.places.iter().filter_map(|place| self.pages.get(place.checked_sub(1)? as usize));
        known.flat_map(|page| (page.number * ENTRIES_PER_PAGE as u32..).zip(&page.nodes))
    }
}

/// A value for every known node.
#[derive(Debug, Clone, Default)]
pub(crate) struct PerNode<T>(Vec<T>);

impl<T: Copy + Default> PerNode<T> {
    pub(crate) fn new(nodes: &Nodes) -> Self {
        Self(vec![T::default(); nodes.slots()])
    }

    /// The value of a node; the default if the node is unknown, or was when this list was made.
    pub(crate) fn get(&self, nodes: &Nodes, index: u32) -> T {
        nodes.slot(index).and_then(|slot| self.0.get(slot)).copied().unwrap_or_default()
    }

    /// Defaults for all nodes.
    pub(crate) fn clear(&mut self) {
        self.0.fill(T::default());
    }

    /// Values for nodes that were not known before, too.
    pub(crate) fn fit(&mut self, nodes: &Nodes) {
        self.0.resize(nodes.slots(), T::default());
    }

    /// The value of a known node, to change it.
    pub(crate) fn get_mut(&mut self, nodes: &Nodes, index: u32) -> Option<&mut T> {
        self.0.get_mut(nodes.slot(index)?)
    }
}

/// Indices of nodes that are still to be visited, in ascending order: parents before children.
#[derive(Debug)]
pub(crate) struct Open {
    /// A bit for every index.
    words: Vec<u64>,
    at: usize,
}

impl Open {
    /// Only the root.
    pub(crate) fn at_root(nodes: &Nodes) -> Self {
        let mut open = Self { words: vec![0; nodes.end().div_ceil(64)], at: 0 };
        open.extend(&[0]);
        open
    }

    /// The next one.
    pub(crate) fn pop(&mut self) -> Option<u32> {
        loop {
            let word = self.words.get_mut(self.at)?;
            if *word != 0 {
                let bit = word.trailing_zeros();
                *word &= *word - 1;
                return Some(self.at as u32 * 64 + bit);
            }
            self.at += 1;
        }
    }

    /// More, all of them behind those that were visited; unknown ones are left out.
    pub(crate) fn extend(&mut self, indices: &[u32]) {
        for &index in indices {
            if let Some(word) = self.words.get_mut(index as usize / 64) {
                *word |= 1 << (index % 64);
            }
        }
    }
}

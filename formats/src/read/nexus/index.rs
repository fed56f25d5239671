//! The header and the index of a Nexus file: the vertex attributes, the offsets of nodes and textures, and the triangles
//! of each node that belong to the finest level.

use super::MAGIC;
use super::bytes::{Cursor, Fault};
use std::ops::Range;

/// Bytes of the header.
pub(super) const HEADER: usize = 88;
const NODE: u64 = 44;
const PATCH: u64 = 12;
const TEXTURE: u64 = 68;
/// Offsets in the file are multiples of this.
const UNIT: u64 = 256;
/// The version of the format that is read.
pub(super) const VERSION: u32 = 2;
/// The texture index of a patch without a texture.
const NO_TEXTURE: u32 = u32::MAX;

/// Bytes of the types of attributes, by number: none, 8, 8, 16, 16, 32 and 32 bits, float, double.
const TYPE_BYTES: [usize; 9] = [0, 1, 1, 2, 2, 4, 4, 4, 8];
const BYTE: u8 = 1;
const UNSIGNED_BYTE: u8 = 2;
const SHORT: u8 = 3;
const UNSIGNED_SHORT: u8 = 4;
const FLOAT: u8 = 7;

/// The nodes are compressed with MECO.
pub(super) const MECO: u32 = 2;
/// The nodes are compressed with Corto.
pub(super) const CORTO: u32 = 4;
/// Each node is in a separate file.
pub(super) const DEEPZOOM: u32 = 8;
/// All known flags, including 1 for a texture per patch.
pub(super) const FLAGS: u32 = 1 | MECO | CORTO | DEEPZOOM;

/// The type and the number of components of an attribute; 0 if it is absent.
type Attribute = [u8; 2];

/// The contents of the header.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) version: u32,
    /// In all nodes.
    pub(super) triangles: u64,
    pub(super) flags: u32,
    vertex: [Attribute; 8],
    face: [Attribute; 8],
    nodes: u32,
    patches: u32,
    textures: u32,
}

/// The vertex attributes of uncompressed nodes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    pub(super) normals: bool,
    pub(super) colors: bool,
    pub(super) coordinates: bool,
    /// Total bytes per vertex.
    pub(super) vertex_bytes: usize,
}

/// Triangles of a node, and the index of their texture.
pub(super) type Part = (Range<usize>, Option<usize>);

/// A node with triangles of the finest level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Node {
    /// Its number in the file.
    pub(super) number: usize,
    /// Its bytes.
    pub(super) bytes: Range<u64>,
    pub(super) vertices: u32,
    pub(super) triangles: u32,
    /// The triangles that are needed, those with the same picture behind each other.
    pub(super) parts: Vec<Part>,
}

/// The contents of the index.
#[derive(Debug)]
pub(super) struct Index {
    pub(super) nodes: Vec<Node>,
    /// Triangles of all nodes, including coarser ones.
    pub(super) triangles: u64,
    /// The byte ranges of the textures.
    pub(super) textures: Vec<Range<u64>>,
}

impl Header {
    /// From the first [`HEADER`] bytes.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut from = Cursor::new(bytes, 0);
        from.take(MAGIC.len(), "the beginning of a Nexus file")?;
        let version = from.u32("the version")?;
        from.u64("the number of vertices")?;
        let triangles = from.u64("the number of triangles")?;
        let mut element = || -> Result<[Attribute; 8], Fault> {
            let mut attributes = [[0; 2]; 8];
            for attribute in &mut attributes {
                *attribute = [from.u8("the type of an attribute")?, from.u8("the components of an attribute")?];
            }
            Ok(attributes)
        };
        let (vertex, face) = (element()?, element()?);
        let flags = from.u32("the flags")?;
        let nodes = from.u32("the number of nodes")?;
        let patches = from.u32("the number of patches")?;
        let textures = from.u32("the number of textures")?;
        Ok(Self { version, triangles, flags, vertex, face, nodes, patches, textures })
    }

    /// Bytes of the index, which follows the header.
    pub(super) fn index_bytes(&self) -> u64 {
        u64::from(self.nodes) * NODE + u64::from(self.patches) * PATCH + u64::from(self.textures) * TEXTURE
    }

    /// How many parts the index has, for messages.
    pub(super) fn counts(&self) -> String {
        format!("{} nodes, {} patches and {} textures", self.nodes, self.patches, self.textures)
    }

    /// Whether it is a point cloud.
    pub(super) fn has_no_faces(&self) -> bool {
        is_absent(self.face[0])
    }

    /// The layout of uncompressed vertices; the error names an attribute that is not supported.
    pub(super) fn layout(&self) -> Result<Layout, String> {
        let names = ["positions", "normals", "colours", "texture coordinates"];
        let known: [&[Attribute]; 4] = [&[[FLOAT, 3]], &[[SHORT, 3]], &[[BYTE, 4], [UNSIGNED_BYTE, 4]], &[[FLOAT, 2]]];
        for (i, (name, known)) in names.into_iter().zip(known).enumerate() {
            let attribute = self.vertex[i];
            if !known.contains(&attribute) && (i == 0 || !is_absent(attribute)) {
                return Err(format!("{name} of type {} with {} components", attribute[0], attribute[1]));
            }
        }
        if self.face[0] != [UNSIGNED_SHORT, 3] || !self.face[1..].iter().all(|a| is_absent(*a)) {
            return Err("faces that are not three 16-bit indices".to_owned());
        }
        let bytes = |a: &Attribute| Some(TYPE_BYTES.get(usize::from(a[0]))? * usize::from(a[1]));
        let Some(vertex_bytes) = self.vertex.iter().map(bytes).sum() else {
            return Err("attributes of an unknown type".to_owned());
        };
        let has = |i: usize| !is_absent(self.vertex[i]);
        Ok(Layout { normals: has(1), colors: has(2), coordinates: has(3), vertex_bytes })
    }
}

fn is_absent([kind, components]: Attribute) -> bool {
    kind == 0 || components == 0
}

/// A node as it is stored.
struct Entry {
    place: u64,
    vertices: u32,
    triangles: u32,
    first_patch: usize,
    /// Offset of this entry in the file.
    at: u64,
}

impl Index {
    /// From the bytes after the header of a file of `total` bytes.
    pub(super) fn parse(header: &Header, bytes: &[u8], total: u64) -> Result<Self, Fault> {
        let mut from = Cursor::new(bytes, HEADER as u64);
        let mut entries = Vec::new();
        for _ in 0..header.nodes {
            entries.push(Entry::parse(&mut from)?);
        }
        let Some((sink, finer)) = entries.split_last() else {
            return Err(from.fault("no nodes", "at least one; the file is damaged: copy it again"));
        };
        let mut nodes = Vec::new();
        let mut patches = Patches { from: from.clone(), header, read: 0 };
        for (number, entry) in finer.iter().enumerate() {
            let next = finer.get(number + 1).unwrap_or(sink);
            let bytes = entry.bytes(next, total)?;
            let parts = patches.of(entry, next)?;
            if !parts.is_empty() {
                let Entry { vertices, triangles, .. } = *entry;
                nodes.push(Node { number, bytes, vertices, triangles, parts });
            }
        }
        from.take(header.patches as usize * PATCH as usize, "patches")?;
        let textures = textures(&mut from, header.textures, total)?;
        let triangles = entries.iter().map(|entry| u64::from(entry.triangles)).sum();
        Ok(Self { nodes, triangles, textures })
    }
}

impl Entry {
    fn parse(from: &mut Cursor<'_>) -> Result<Self, Fault> {
        let at = from.offset();
        let place = UNIT * u64::from(from.u32("the offset of a node")?);
        let vertices = u32::from(from.u16("the vertices of a node")?);
        let triangles = u32::from(from.u16("the triangles of a node")?);
        // Its error, normal cone and bounding spheres.
        from.take(32, "a node")?;
        let first_patch = from.u32("the first patch of a node")? as usize;
        Ok(Self { place, vertices, triangles, first_patch, at })
    }

    /// The byte range of the node, which ends where `next` begins.
    fn bytes(&self, next: &Self, total: u64) -> Result<Range<u64>, Fault> {
        range(self.place, next.place, total, "a node", self.at)
    }
}

/// The byte range from `start` to `end`; at the end of the file, padding may be missing.
fn range(start: u64, end: u64, total: u64, what: &str, at: u64) -> Result<Range<u64>, Fault> {
    if start > end || start < HEADER as u64 {
        let found = format!("{what} from byte {start} to byte {end}");
        return Err(Fault { at, found, expected: "ascending offsets; the file is damaged".to_owned() });
    }
    if end > total.next_multiple_of(UNIT) || start > total {
        let found = format!("{what} that ends at byte {end}");
        let expected = format!("at most {total}, the length of the file; it is truncated: copy it again");
        return Err(Fault { at, found, expected });
    }
    Ok(start..end.min(total))
}

/// Reads patches in their order.
struct Patches<'h, 'b> {
    from: Cursor<'b>,
    header: &'h Header,
    read: usize,
}

impl Patches<'_, '_> {
    /// The triangles of a node that lead to the sink, the last node, so that nothing finer replaces them.
    fn of(&mut self, entry: &Entry, next: &Entry) -> Result<Vec<Part>, Fault> {
        let damaged = |found: String, expected: &str| {
            let expected = format!("{expected}; the file is damaged: copy it again");
            Fault { at: entry.at, found, expected }
        };
        let (first, end) = (entry.first_patch, next.first_patch);
        if first != self.read || end < first || end > self.header.patches as usize {
            let found = format!("a node with patches {first} to {end}");
            return Err(damaged(found, &format!("patches from {} to at most {}", self.read, self.header.patches)));
        }
        let mut parts: Vec<Part> = Vec::new();
        let mut start = 0;
        for _ in first..end {
            let node = self.from.u32("the node of a patch")?;
            let stop = self.from.u32("the triangles of a patch")? as usize;
            let texture = self.from.u32("the texture of a patch")?;
            if stop < start || stop > entry.triangles as usize || node >= self.header.nodes {
                let found = format!("a patch with triangles {start} to {stop} that leads to node {node}");
                let expected = format!("at most {} triangles and {} nodes", entry.triangles, self.header.nodes);
                return Err(damaged(found, &expected));
            }
            // The last texture entry only marks the end of the one before.
            let is_there = u64::from(texture) + 1 < u64::from(self.header.textures);
            if texture != NO_TEXTURE && self.header.textures > 0 && !is_there {
                let found = format!("a patch with texture {texture}");
                return Err(damaged(found, &format!("a texture below {}", self.header.textures - 1)));
            }
            if node == self.header.nodes - 1 && stop > start {
                parts.push((start..stop, is_there.then_some(texture as usize)));
            }
            start = stop;
        }
        self.read = end;
        if start < entry.triangles as usize {
            let found = format!("patches for {start} triangles of a node");
            return Err(damaged(found, &format!("patches for all {} of them", entry.triangles)));
        }
        parts.sort_by_key(|(_, texture)| *texture);
        Ok(parts)
    }
}

/// The byte ranges of the textures; the last entry only marks the end of the one before.
fn textures(from: &mut Cursor<'_>, count: u32, total: u64) -> Result<Vec<Range<u64>>, Fault> {
    let mut places = Vec::new();
    for _ in 0..count {
        let at = from.offset();
        places.push((UNIT * u64::from(from.u32("the offset of a texture")?), at));
        // A matrix that is not needed here.
        from.take(TEXTURE as usize - 4, "a texture")?;
    }
    places.windows(2).map(|pair| range(pair[0].0, pair[1].0, total, "a texture", pair[0].1)).collect()
}

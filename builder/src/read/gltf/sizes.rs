//! How many vertices and triangles a glTF has, as its JSON says, for what a build will need.

use super::tally::Tally;
use serde::Deserialize;

/// What the JSON of a glTF says of its size, compressed or not; each primitive once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Vertices.
    pub vertices: u64,
    /// Triangles. Strips and fans have one for each corner.
    pub triangles: u64,
    /// Bytes of all buffers.
    pub buffer_bytes: u64,
}

#[derive(Deserialize)]
struct Root {
    accessors: Vec<Accessor>,
    meshes: Vec<Mesh>,
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Accessor {
    count: u64,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<u64>,
    mode: Option<u64>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<u64>,
}

#[derive(Deserialize)]
struct Buffer {
    #[serde(default, rename = "byteLength")]
    bytes: u64,
}

/// Of the JSON of a glTF; `None` where it is damaged, which the reader will say better, or would take more than `most`
/// bytes of memory.
pub fn sizes(json: &[u8], most: u64) -> Option<Sizes> {
    if Tally::of(json).bytes() > most {
        return None;
    }
    let root: Root = serde_json::from_slice(json).ok()?;
    let count = |index: Option<u64>| root.accessors.get(usize::try_from(index?).ok()?).map(|a| a.count);
    let mut sizes = Sizes { vertices: 0, triangles: 0, buffer_bytes: 0 };
    for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let vertices = count(primitive.attributes.position).unwrap_or(0);
        let corners = count(primitive.indices).unwrap_or(vertices);
        sizes.vertices = sizes.vertices.checked_add(vertices)?;
        let triangles = if primitive.mode.unwrap_or(4) == 4 { corners / 3 } else { corners };
        sizes.triangles = sizes.triangles.checked_add(triangles)?;
    }
    sizes.buffer_bytes = root.buffers.iter().fold(0, |sum, b| sum.saturating_add(b.bytes));
    Some(sizes)
}

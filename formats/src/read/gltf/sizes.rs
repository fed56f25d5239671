//! How many vertices and triangles a glTF has, as its JSON says, for what a build will need. Nexus models and tilesets have the same type for theirs.

use super::tally::Tally;
use serde::Deserialize;

/// What a file says of its size, compressed or not; in a glTF each mesh as often as nodes show it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Vertices.
    pub vertices: u64,
    /// Triangles. Strips and fans have one for each corner.
    pub triangles: u64,
}

impl Sizes {
    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            vertices: self.vertices.saturating_add(other.vertices),
            triangles: self.triangles.saturating_add(other.triangles),
        }
    }
}

#[derive(Deserialize)]
struct Root {
    accessors: Vec<Accessor>,
    meshes: Vec<Mesh>,
    #[serde(default)]
    nodes: Vec<Node>,
    buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
struct Accessor {
    count: u64,
}

#[derive(Deserialize)]
struct Node {
    mesh: Option<u64>,
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
pub fn sizes(json: &[u8], max: u64) -> Option<Sizes> {
    if Tally::of(json).bytes() > max {
        return None;
    }
    let root: Root = serde_json::from_slice(json).ok()?;
    // More than the buffers can hold, however compressed, is not believed; the reader explains what is wrong.
    let max = root.buffers.iter().fold(0u64, |sum, b| sum.saturating_add(b.bytes)).saturating_mul(16);
    let count = |index: Option<u64>| {
        let accessor = root.accessors.get(usize::try_from(index?).ok()?);
        accessor.map(|a| a.count.min(max))
    };
    // A node has one parent at most, so that each is shown once at most.
    let mut shown = vec![0u64; root.meshes.len()];
    for mesh in root.nodes.iter().filter_map(|node| node.mesh) {
        if let Some(shown) = usize::try_from(mesh).ok().and_then(|mesh| shown.get_mut(mesh)) {
            *shown += 1;
        }
    }
    if shown.iter().all(|shown| *shown == 0) {
        // Without nodes the meshes themselves are read.
        shown.fill(1);
    }
    let mut sizes = Sizes { vertices: 0, triangles: 0 };
    for (mesh, shown) in root.meshes.iter().zip(shown) {
        for primitive in &mesh.primitives {
            let vertices = count(primitive.attributes.position).unwrap_or(0);
            let corners = count(primitive.indices).unwrap_or(vertices);
            let triangles = if primitive.mode.unwrap_or(4) == 4 { corners / 3 } else { corners };
            sizes.vertices = sizes.vertices.saturating_add(vertices.saturating_mul(shown));
            sizes.triangles = sizes.triangles.saturating_add(triangles.saturating_mul(shown));
        }
    }
    Some(sizes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_counts_once_for_each_node_that_uses_it() {
        let json = |nodes: &str, bytes: u64| {
            format!(
                r#"{{"accessors":[{{"count":300}},{{"count":900}}],"buffers":[{{"byteLength":{bytes}}}],"meshes":[
                {{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}},
                {{"primitives":[{{"attributes":{{"POSITION":0}},"mode":5}}]}}]{nodes}}}"#
            )
        };
        let of = |text: String| sizes(text.as_bytes(), 1 << 20).map(|s| (s.vertices, s.triangles));
        assert_eq!(of(json("", 9000)), Some((600, 600)), "without nodes each once");
        let nodes = ",\"nodes\":[{\"mesh\":0},{\"mesh\":0},{\"mesh\":0},{},{\"mesh\":7}]";
        assert_eq!(of(json(nodes, 9000)), Some((900, 900)), "the first three times, the second not at all");
        assert_eq!(of(json("", 1)), Some((32, 21)), "no more than the buffers can hold");
    }
}

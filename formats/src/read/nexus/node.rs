//! The vertices and triangles of a node, decoded.

use super::bytes::{Cursor, Fault};
use super::index::{Layout, Node};
use glam::{DVec2, DVec3, Vec3};

/// The mesh of a node. Attributes are empty or have one entry for each position.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct NodeMesh {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    /// In the texture, (0, 0) at the bottom left.
    pub(super) coordinates: Vec<DVec2>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl NodeMesh {
    /// From an uncompressed node: one attribute of all vertices after another, then the triangles.
    pub(super) fn plain(from: &mut Cursor<'_>, layout: Layout, node: &Node) -> Result<Self, Fault> {
        let (vertices, triangles) = (node.vertices as usize, node.triangles as usize);
        let mut whole = from.clone();
        let triangles_at = vertices * layout.vertex_bytes;
        whole.take(triangles_at + 6 * triangles, "the vertices and triangles of a node")?;
        let mut piece = Self::default();
        for _ in 0..vertices {
            let mut at = || from.f32("a position").map(f64::from);
            piece.positions.push(DVec3::new(at()?, at()?, at()?));
        }
        for _ in 0..if layout.coordinates { vertices } else { 0 } {
            let mut at = || from.f32("a texture coordinate").map(f64::from);
            piece.coordinates.push(DVec2::new(at()?, at()?));
        }
        for _ in 0..if layout.normals { vertices } else { 0 } {
            let mut at = || from.i16("a normal").map(|v| f32::from(v) / f32::from(i16::MAX));
            piece.normals.push(Vec3::new(at()?, at()?, at()?));
        }
        for _ in 0..if layout.colors { vertices } else { 0 } {
            let color = from.take(4, "a colour")?;
            piece.colors.push([color[0], color[1], color[2]]);
        }
        // Attributes that are not kept may follow.
        let kept = 12
            + if layout.coordinates { 8 } else { 0 }
            + if layout.normals { 6 } else { 0 }
            + if layout.colors { 4 } else { 0 };
        from.take(vertices * (layout.vertex_bytes - kept), "vertices")?;
        for _ in 0..triangles {
            let mut at = || from.u16("a triangle").map(u32::from);
            piece.triangles.push([at()?, at()?, at()?]);
        }
        Ok(piece)
    }

    /// Refuse triangles with vertices that do not exist; `at` is where the node begins in the file.
    pub(super) fn checked(self, node: usize, at: u64) -> Result<Self, Fault> {
        let count = self.positions.len();
        let Some(bad) = self.triangles.iter().flatten().find(|v| **v as usize >= count) else { return Ok(self) };
        let found = format!("vertex {bad} in a triangle of node {node}");
        let expected = format!("vertices below {count}; the file is damaged: copy it again");
        Err(Fault { at, found, expected })
    }
}

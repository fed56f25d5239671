//! The mesh fragment that every stage hands to the next: what a patch, a chunk and a whole small model are made of.

use crate::bounds::Aabb;
use crate::lattice::LatticePoint;
use crate::normal::OctNormal;
use glam::I64Vec3;

/// An indexed triangle mesh on the lattice, one entry per vertex in every attribute that is present.
///
/// A *vertex* is a wedge: a position together with its attributes. Two vertices with the same position and other
/// attributes are two wedges of one geometric point; geometric identity is the position alone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Lattice positions, one per vertex.
    pub positions: Vec<LatticePoint>,
    /// sRGB colours, one per vertex, or empty where the model has none.
    pub colors: Vec<[u8; 3]>,
    /// Octahedral unit normals, one per vertex.
    pub normals: Vec<OctNormal>,
    /// Further scalars per vertex (confidence, quality, intensity …), one `Vec` per channel, named by the pack's metadata.
    pub scalars: Vec<Vec<f32>>,
    /// Vertex indices, three per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// True-border bits, one byte per triangle: bit `k` is set where the edge from corner `k` to corner `(k + 1) % 3`
    /// is a border of the scan itself (used by exactly one triangle of the whole model).
    pub borders: Vec<u8>,
}

impl Mesh {
    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// The three lattice positions of a triangle.
    pub fn corners(&self, triangle: usize) -> [LatticePoint; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Bounding box of the vertices.
    pub fn bounds(&self) -> Aabb {
        Aabb::of(&self.positions)
    }

    /// Append vertex `v` of `other` with all its attributes; the channel counts must agree. Returns its new index.
    pub fn push_vertex_of(&mut self, other: &Self, v: usize) -> u32 {
        let index = self.positions.len() as u32;
        self.positions.push(other.positions[v]);
        if let Some(c) = other.colors.get(v) {
            self.colors.push(*c);
        }
        if let Some(n) = other.normals.get(v) {
            self.normals.push(*n);
        }
        if self.scalars.len() < other.scalars.len() {
            self.scalars.resize(other.scalars.len(), Vec::new());
        }
        for (to, from) in self.scalars.iter_mut().zip(&other.scalars) {
            to.push(from[v]);
        }
        index
    }
}

/// Three times the centroid of a triangle: exact, and what decides the tetrahedron that it goes to.
pub fn corner_sum(corners: [LatticePoint; 3]) -> I64Vec3 {
    corners.iter().map(|c| c.as_i64vec3()).sum()
}

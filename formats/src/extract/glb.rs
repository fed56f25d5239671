//! GLB (Khronos, "glTF 2.0 Specification"): one mesh of one node.
//!
//! Positions are floats relative to a lattice point in the middle; the node moves them there in doubles and turns z up
//! to y up, so that map coordinates survive. Colours are linear light in 16 bits: 8 would show bands in the dark.

use super::format::{Encoder, Target};
use super::gltf::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, LIGHT, UNSIGNED_INT, UNSIGNED_SHORT, begin, document, padded,
};
use super::output::Scratch;
use super::stream::Counts;
use kilwa_geometry::{Aabb, LatticePoint, Mesh, normal};
use serde_json::json;
use std::io::Write;

/// Bytes of position and normal.
const PLAIN: u64 = 24;
/// Bytes of a colour.
const COLOR: u64 = 8;

pub(super) struct Glb {
    target: Target,
    bounds: Aabb,
}

impl Glb {
    pub(super) fn new(target: Target) -> Self {
        Self { target, bounds: Aabb::EMPTY }
    }

    fn stride(&self) -> u64 {
        if self.target.colors { PLAIN + COLOR } else { PLAIN }
    }

    fn json(&self, counts: Counts) -> Vec<u8> {
        let target = &self.target;
        let (vertex_bytes, index_bytes) = (counts.vertices * self.stride(), counts.triangles * 12);
        let mut attributes = json!({"POSITION": 0, "NORMAL": 1});
        let mut accessors = vec![
            json!({"bufferView": 0, "componentType": FLOAT, "count": counts.vertices, "type": "VEC3",
                "min": target.relative(self.bounds.min), "max": target.relative(self.bounds.max)}),
            json!({"bufferView": 0, "byteOffset": 12, "componentType": FLOAT, "count": counts.vertices, "type": "VEC3"}),
            json!({"bufferView": 1, "componentType": UNSIGNED_INT, "count": counts.triangles * 3, "type": "SCALAR"}),
        ];
        if target.colors {
            attributes["COLOR_0"] = json!(3);
            accessors.push(json!({"bufferView": 0, "byteOffset": PLAIN, "componentType": UNSIGNED_SHORT,
                "normalized": true, "count": counts.vertices, "type": "VEC4"}));
        }
        let mut file = document(target, counts);
        file["meshes"][0]["primitives"] = json!([{"attributes": attributes, "indices": 2, "material": 0}]);
        file["accessors"] = json!(accessors);
        file["bufferViews"] = json!([
            {"buffer": 0, "byteLength": vertex_bytes, "byteStride": self.stride(), "target": ARRAY_BUFFER},
            {"buffer": 0, "byteOffset": vertex_bytes, "byteLength": index_bytes, "target": ELEMENT_ARRAY_BUFFER},
        ]);
        file["buffers"] = json!([{"byteLength": vertex_bytes + index_bytes}]);
        padded(&file)
    }
}

impl Encoder for Glb {
    /// The largest index represents "begin again".
    fn max_vertices(&self) -> u32 {
        u32::MAX - 1
    }

    fn vertex(&mut self, out: &mut Vec<u8>, mesh: &Mesh, v: usize) {
        let position = mesh.positions[v];
        self.bounds.add(position);
        let normal = normal::decode(mesh.normals[v]).as_vec3();
        for x in [self.target.relative(position), normal].map(|v| v.to_array()).into_iter().flatten() {
            out.extend(x.to_le_bytes());
        }
        if self.target.colors {
            let color = mesh.colors.get(v).copied().unwrap_or_default();
            for light in color.map(|level| LIGHT[usize::from(level)]).into_iter().chain([u16::MAX]) {
                out.extend(light.to_le_bytes());
            }
        }
    }

    fn triangle(&mut self, out: &mut Vec<u8>, corners: [u32; 3], _: [LatticePoint; 3]) {
        for corner in corners {
            out.extend(corner.to_le_bytes());
        }
    }

    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()> {
        let json = self.json(counts);
        let binary = counts.vertices * self.stride() + counts.triangles * 12;
        begin(out, &json, binary)?;
        scratch.copy_vertices(out)?;
        scratch.copy_triangles(out)
    }
}

//! GLB (Khronos, "glTF 2.0 Specification"): one mesh of one node.
//!
//! Positions are floats relative to a lattice point in the middle; the node moves them there in doubles and turns z up
//! to y up, so that map coordinates survive. Colours are linear light in 16 bits: 8 would show bands in the dark.

use super::format::{Encoder, Target};
use super::output::Scratch;
use super::stream::Counts;
use glam::DVec3;
use kilwa_geometry::color::light_from_srgb;
use kilwa_geometry::{Aabb, LatticePoint, Mesh, normal};
use serde_json::{Value, json};
use std::io::{Error, Write};

/// Codes of OpenGL.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Bytes of position and normal.
const PLAIN: u64 = 24;
/// Bytes of a colour.
const COLOR: u64 = 8;

pub(super) struct Glb {
    target: Target,
    bounds: Aabb,
    /// Light of each level of sRGB, in 16 bits.
    light: [u16; 256],
}

impl Glb {
    pub(super) fn new(target: Target) -> Self {
        let light = std::array::from_fn(|level| (light_from_srgb(level as u8) * 65535.0).round() as u16);
        Self { target, bounds: Aabb::EMPTY, light }
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

/// What the file says beside its data: one node, with one mesh that has no primitives yet.
pub(super) fn document(target: &Target, counts: Counts) -> Value {
    let place = target.lattice.world_from_lattice(target.center);
    let DVec3 { x, y, z } = if target.at_zero { DVec3::ZERO } else { place };
    let mut extras =
        json!({"crs": target.metadata.crs, "world_from_local_m": [place[0] - x, place[1] - y, place[2] - z]});
    match &target.note {
        Some(note) => extras["note"] = json!(note),
        None => extras["certified_error_m"] = json!(counts.error),
    }
    json!({
        "asset": {"version": "2.0", "generator": format!("kilwa {}", env!("CARGO_PKG_VERSION"))},
        "extras": extras,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        // Column by column: x stays, y becomes -z, z becomes y.
        "nodes": [{"name": target.metadata.title, "mesh": 0, "matrix":
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, x, z, -y, 1.0]}],
        "meshes": [{"primitives": []}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
    })
}

/// JSON with the length that a chunk of GLB needs.
pub(super) fn padded(file: &Value) -> Vec<u8> {
    let mut json = file.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    json
}

/// Write what comes before the binary data: the header, the JSON, and the length of the data, `binary` bytes.
///
/// # Errors
/// If the file would be longer than its format allows, or the system refuses.
pub(super) fn begin(out: &mut dyn Write, json: &[u8], binary: u64) -> std::io::Result<()> {
    let total = 12 + 8 + json.len() as u64 + 8 + binary;
    let Ok(total) = u32::try_from(total) else {
        let why =
            format!("the GLB would have {total} bytes, but the format allows 4 GiB: use --max-triangles, or write PLY");
        return Err(Error::other(why));
    };
    out.write_all(b"glTF")?;
    for word in [2, total, json.len() as u32] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(b"JSON")?;
    out.write_all(json)?;
    out.write_all(&(binary as u32).to_le_bytes())?;
    out.write_all(b"BIN\0")
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
            for light in color.map(|level| self.light[usize::from(level)]).into_iter().chain([u16::MAX]) {
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

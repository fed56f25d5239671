//! What all GLB files that are written share (Khronos, "glTF 2.0 Specification"): the codes of types, the JSON of one mesh, the container.

use super::format::Target;
use super::stream::Counts;
use glam::DVec3;
use kilwa_geometry::color::light_from_srgb;
use serde_json::{Value, json};
use std::io::{Error, Write};
use std::sync::LazyLock;

/// Types of components and targets of buffers, by their numbers in OpenGL.
pub(super) const BYTE: u32 = 5120;
pub(super) const UNSIGNED_SHORT: u32 = 5123;
pub(super) const UNSIGNED_INT: u32 = 5125;
pub(super) const FLOAT: u32 = 5126;
pub(super) const ARRAY_BUFFER: u32 = 34962;
pub(super) const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Light of each level of sRGB, in 16 bits.
pub(super) static LIGHT: LazyLock<[u16; 256]> =
    LazyLock::new(|| std::array::from_fn(|level| (light_from_srgb(level as u8) * 65535.0).round() as u16));

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

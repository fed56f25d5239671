//! Buffer views of glTF compressed with `EXT_meshopt_compression` (Khronos, "EXT_meshopt_compression"), for tiles and for GLB files.

use super::gltf::{ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER};
use kilwa_geometry::color::{light_from_srgb, srgb_from_light};
use meshoptimizer_rs::{Error, Workspace, codec};
use serde_json::{Value, json};
use std::io::Write;
use std::sync::LazyLock;

/// The extension of glTF for compressed views, and the one for normals in bytes.
pub(super) const MESHOPT: &str = "EXT_meshopt_compression";
pub(super) const QUANTIZED: &str = "KHR_mesh_quantization";

/// Compressed views while they are written, one after the other, to `out`.
pub(super) struct Views<W> {
    pub(super) out: W,
    /// Bytes written so far.
    bytes: u64,
    /// Bytes of the fallback buffer, which is declared for clients without the extension but has no content.
    plain: u64,
    /// Their descriptions.
    described: Vec<Value>,
    work: Workspace,
}

/// Why a view could not be written.
#[derive(Debug)]
pub(super) enum ViewError {
    Encode(Error),
    Write(std::io::Error),
}

impl<W: Write> Views<W> {
    pub(super) fn new(out: W) -> Self {
        Self { out, bytes: 0, plain: 0, described: Vec::new(), work: Workspace::default() }
    }

    /// Append a view of `count` vertices of `stride` bytes each, which `filter` restores when it is read (`NONE`: they are stored as they are);
    /// returns its number.
    ///
    /// # Errors
    /// If it cannot be compressed or written.
    pub(super) fn vertices(
        &mut self,
        bytes: &[u8],
        count: usize,
        stride: usize,
        filter: &str,
    ) -> Result<usize, ViewError> {
        let version = codec::VertexEncoding::new(0, 0).map_err(ViewError::Encode)?;
        let packed =
            codec::encode_vertex_buffer(bytes, count, stride, version, &mut self.work).map_err(ViewError::Encode)?;
        let mut about = json!({"mode": "ATTRIBUTES"});
        if filter != "NONE" {
            about["filter"] = json!(filter);
        }
        self.add(&packed, count, stride, ARRAY_BUFFER, about)
    }

    /// Append a view of triangles, with indices of two bytes; returns its number.
    ///
    /// # Errors
    /// As [`Self::vertices`].
    pub(super) fn triangles(&mut self, indices: &[u32]) -> Result<usize, ViewError> {
        let packed = codec::encode_index_buffer(indices, codec::IndexEncoding::DEFAULT, &mut self.work)
            .map_err(ViewError::Encode)?;
        self.add(&packed, indices.len(), 2, ELEMENT_ARRAY_BUFFER, json!({"mode": "TRIANGLES"}))
    }

    fn add(
        &mut self,
        packed: &[u8],
        count: usize,
        stride: usize,
        target: u32,
        mut extension: Value,
    ) -> Result<usize, ViewError> {
        for (key, value) in [
            ("buffer", json!(0)),
            ("byteOffset", json!(self.bytes)),
            ("byteLength", json!(packed.len())),
            ("byteStride", json!(stride)),
            ("count", json!(count)),
        ] {
            extension[key] = value;
        }
        let mut view = json!({"buffer": 1, "byteOffset": self.plain, "byteLength": count * stride, "target": target,
            "extensions": {MESHOPT: extension}});
        if target == ARRAY_BUFFER {
            view["byteStride"] = json!(stride);
        }
        self.described.push(view);
        let padding = packed.len().next_multiple_of(4) - packed.len();
        self.out.write_all(packed).and_then(|()| self.out.write_all(&[0; 3][..padding])).map_err(ViewError::Write)?;
        self.bytes += (packed.len() + padding) as u64;
        self.plain += (count * stride).next_multiple_of(4) as u64;
        Ok(self.described.len() - 1)
    }

    /// Bytes written so far.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Name the views and their two buffers in the JSON of the file.
    pub(super) fn describe(&mut self, file: &mut Value) {
        file["bufferViews"] = Value::Array(std::mem::take(&mut self.described));
        file["buffers"] = json!([{"byteLength": self.bytes},
            {"byteLength": self.plain, "extensions": {MESHOPT: {"fallback": true}}}]);
    }
}

/// Vertices in the order in which triangles that lie side by side use them: the indices, and for each vertex its former number.
///
/// # Errors
/// If meshopt fails.
pub(super) fn ordered(triangles: &[u32], vertices: usize) -> Result<(Vec<u32>, Vec<usize>), Error> {
    let mut indices = meshoptimizer_rs::optimize_vertex_cache_strip(triangles, vertices, &mut Workspace::default())?;
    let mut numbers = vec![u32::MAX; vertices];
    let mut order = Vec::with_capacity(vertices);
    for index in &mut indices {
        let number = &mut numbers[*index as usize];
        if *number == u32::MAX {
            *number = order.len() as u32;
            order.push(*index as usize);
        }
        *index = *number;
    }
    Ok((indices, order))
}

/// A coordinate as the exponential filter takes it: 24 bits of mantissa and an exponent of 2.
pub(super) fn exponential(mantissa: i32, exponent: i8) -> [u8; 4] {
    let [a, b, c, _] = mantissa.to_le_bytes();
    [a, b, c, exponent.cast_unsigned()]
}

/// Unit vectors as bytes for the octahedral filter, four to a vector.
///
/// # Errors
/// If meshopt fails.
pub(super) fn octahedral(normals: &[[f32; 3]]) -> Result<Vec<u8>, Error> {
    let four: Vec<f32> = normals.iter().flat_map(|[x, y, z]| [*x, *y, *z, 0.0]).collect();
    codec::encode_filter_oct(normals.len(), 4, 8, &four, &mut Workspace::default())
}

/// Linear light of each sRGB level, in 16 bits. Several values convert back to the same level; the one chosen has, if possible, one of a few low bytes. A
/// byte that seldom changes compresses well; without this, colours would take more space than positions.
pub(super) static LIGHT: LazyLock<[u16; 256]> = LazyLock::new(|| std::array::from_fn(|level| light(level as u8)));

fn light(level: u8) -> u16 {
    let exact = light_from_srgb(level) * 65535.0;
    let is_level = |light: f64| srgb_from_light(light / 65535.0) == level;
    let with_low_byte = |low: f64| ((exact - low) / 256.0).round() * 256.0 + low;
    // With a margin for clients that compute in floats.
    let is_safe = |light: &f64| (0.0..=65535.0).contains(light) && is_level(light - 2.0) && is_level(light + 2.0);
    [128.0, 0.0, 64.0, 192.0].map(with_low_byte).into_iter().find(is_safe).unwrap_or(exact.round()) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_of_srgb_is_restored_and_bright_ones_cost_a_byte() {
        let restored = |level: usize| usize::from(srgb_from_light(f64::from(LIGHT[level]) / 65535.0));
        assert!((0..256).all(|level| restored(level) == level));
        assert!(LIGHT.windows(2).all(|pair| pair[0] < pair[1]));
        assert!((140..256).all(|level| LIGHT[level] % 256 == 128));
        assert!((80..256).all(|level| LIGHT[level].is_multiple_of(128)));
        let off = (0..256).map(|l| (f64::from(LIGHT[l]) - light_from_srgb(l as u8) * 65535.0).abs());
        assert!(off.fold(0.0, f64::max) <= 128.0);
    }
}

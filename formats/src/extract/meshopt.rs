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

/// Exponents of two that are tried for colours.
const COARSENESS: [i8; 3] = [-8, -9, -10];
/// By how much a colour may be off without changing its level, for clients that compute in floats.
const MARGIN: f64 = 2.0 / 65535.0;

/// The light of every level of sRGB, for each of [`COARSENESS`].
static LIGHT: LazyLock<[[(i32, i8); 256]; COARSENESS.len()]> =
    LazyLock::new(|| COARSENESS.map(|coarsest| std::array::from_fn(|level| light(level as u8, coarsest))));

/// The light of a level, 0 to 1, as a mantissa and an exponent of two: `coarsest`, or the first below it with which the level is restored.
fn light(level: u8, coarsest: i8) -> (i32, i8) {
    let exact = light_from_srgb(level);
    let is_safe = |light: f64| [-MARGIN, MARGIN].iter().all(|off| srgb_from_light(light + off) == level);
    let with = |exponent: i8| {
        let steps = libm::scalbn(exact, -i32::from(exponent));
        let near = [steps.round(), steps.floor(), steps.ceil()];
        let restoring = near.into_iter().find(|steps| is_safe(libm::scalbn(*steps, i32::from(exponent))));
        restoring.map(|steps| (steps as i32, exponent))
    };
    // Levels are 20 / 65535 apart where they are closest.
    (-16..=coarsest).rev().find_map(with).unwrap_or((libm::scalbn(exact, 16).round() as i32, -16))
}

/// Colours as linear light, in floats for the exponential filter, twelve bytes to a colour. Every level of sRGB is restored exactly.
///
/// A mantissa of one byte and an exponent that seldom changes, by one, take less space than 16-bit integers, whose low byte changes by much. For
/// each channel, the coarsest exponent is the one that compresses best.
///
/// # Errors
/// If meshopt fails.
pub(super) fn colored(colors: &[[u8; 3]]) -> Result<Vec<u8>, Error> {
    let mut bytes = vec![0; 12 * colors.len()];
    let (mut work, version) = (Workspace::default(), codec::VertexEncoding::new(0, 0)?);
    for channel in 0..3 {
        let mut best: Option<(usize, Vec<u8>)> = None;
        for light in LIGHT.iter() {
            let floats: Vec<u8> = colors
                .iter()
                .flat_map(|color| {
                    let (mantissa, exponent) = light[usize::from(color[channel])];
                    exponential(mantissa, exponent)
                })
                .collect();
            // Channels are compressed independently of each other.
            let packed = codec::encode_vertex_buffer(&floats, colors.len(), 4, version, &mut work)?.len();
            if best.as_ref().is_none_or(|(least, _)| packed < *least) {
                best = Some((packed, floats));
            }
        }
        for (v, float) in best.unwrap_or_default().1.as_chunks::<4>().0.iter().enumerate() {
            bytes[12 * v + 4 * channel..][..4].copy_from_slice(float);
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_of_srgb_is_restored_in_any_coarseness() {
        for (light, coarsest) in LIGHT.iter().zip(COARSENESS) {
            let exact = |(mantissa, exponent): (i32, i8)| libm::scalbn(f64::from(mantissa), exponent.into());
            let restored = light.map(|light| [-MARGIN, 0.0, MARGIN].map(|off| srgb_from_light(exact(light) + off)));
            assert!((0..=255).zip(restored).all(|(level, restored)| restored == [level; 3]));
            assert_eq!((exact(light[0]), exact(light[255])), (0.0, 1.0));
            assert!(light.iter().all(|(_, exponent)| *exponent <= coarsest && *exponent >= -12));
            // Bright colours have the coarsest steps.
            assert!(light[140..].iter().all(|(_, exponent)| *exponent == coarsest));
        }
    }

    #[test]
    fn each_channel_of_a_colour_is_restored_and_has_its_own_coarseness() {
        let colors: Vec<[u8; 3]> =
            (0..3000u32).map(|i| [200 + (i % 3) as u8, (i * i % 256) as u8, 60 + (i * 7 % 30) as u8]).collect();
        let bytes = colored(&colors).unwrap();
        let exponents = [0, 1, 2].map(|k| bytes[3 + 4 * k].cast_signed());
        assert_eq!((exponents[0], exponents[2]), (-8, exponents[2].min(-9)), "{exponents:?}");
        for (color, floats) in colors.iter().zip(bytes.chunks(12)) {
            let level = |k: usize| {
                let mantissa = i32::from_le_bytes([floats[4 * k], floats[4 * k + 1], floats[4 * k + 2], 0]);
                srgb_from_light(libm::scalbn(f64::from(mantissa), floats[4 * k + 3].cast_signed().into()))
            };
            assert_eq!([0, 1, 2].map(level), *color);
        }
        assert_eq!(colored(&[]).unwrap(), Vec::<u8>::new());
    }
}

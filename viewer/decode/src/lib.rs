//! The chunk decoder as a small wasm module for Web Workers: encoded bytes in, vertex and index buffers out, in the
//! layout of [`kilwa_pack::vertex_layout`], ready to be transferred to the page and uploaded.
//!
//! The checksum is compared before anything is decoded, so that a flipped bit or a file replaced between two requests
//! is an error with a sentence, never wrong geometry. No threads, no shared memory: each worker has its own instance.

use kilwa_pack::chunk::Declared;
use kilwa_pack::{Attributes, PackError};
use wasm_bindgen::prelude::wasm_bindgen;

/// A decoded chunk; each part can be taken out once, as a typed array of its own.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Decoded {
    vertices: Vec<u8>,
    indices: Vec<u32>,
    patches: Vec<u32>,
    scalars: Vec<f32>,
}

#[wasm_bindgen]
impl Decoded {
    /// Vertices, 20 bytes each.
    #[wasm_bindgen(js_name = takeVertices)]
    pub fn take_vertices(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.vertices)
    }

    /// Indices, three per triangle.
    #[wasm_bindgen(js_name = takeIndices)]
    pub fn take_indices(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.indices)
    }

    /// Patches: first triangle, number of triangles, diamond; three numbers each.
    #[wasm_bindgen(js_name = takePatches)]
    pub fn take_patches(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.patches)
    }

    /// Scalars of all vertices, one channel behind the other.
    #[wasm_bindgen(js_name = takeScalars)]
    pub fn take_scalars(&mut self) -> Vec<f32> {
        std::mem::take(&mut self.scalars)
    }
}

/// Check and decode one chunk. `vertices`, `triangles` and `checksum` (16 bytes) are what the directory promises;
/// `colors` and `scalars` what the header does.
///
/// # Errors
/// A sentence that says what is wrong with the bytes.
#[wasm_bindgen]
pub fn decode(
    bytes: &[u8],
    vertices: u32,
    triangles: u32,
    colors: bool,
    scalars: u8,
    checksum: &[u8],
) -> Result<Decoded, String> {
    let decoded = checked(bytes, Declared { vertices, triangles }, Attributes { colors, scalars }, checksum);
    decoded.map_err(|e| e.to_string())
}

fn checked(bytes: &[u8], declared: Declared, attributes: Attributes, checksum: &[u8]) -> Result<Decoded, PackError> {
    if kilwa_pack::checksum(bytes) != checksum {
        return Err(PackError::Checksum { what: "chunk".to_owned() });
    }
    let chunk = kilwa_pack::chunk::decode(bytes, declared, attributes)?;
    let gpu = kilwa_pack::interleave(&chunk);
    let patches = gpu.patches.iter().flat_map(|p| [p.first, p.count, p.diamond]).collect();
    Ok(Decoded { vertices: gpu.vertices, indices: gpu.indices, patches, scalars: gpu.scalars })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_pack::{Chunk, NO_DIAMOND, PatchRange, chunk::encode};

    fn one_triangle() -> (Vec<u8>, Attributes) {
        let attributes = Attributes { colors: true, scalars: 0 };
        let mut chunk = Chunk::default();
        chunk.mesh.positions = [[1, 2, 3], [40, 2, 3], [1, 50, 3]].map(Into::into).to_vec();
        chunk.mesh.normals = vec![[0, 0]; 3];
        chunk.mesh.colors = vec![[9, 8, 7]; 3];
        chunk.mesh.triangles = vec![[0, 1, 2]];
        chunk.mesh.borders = vec![7];
        chunk.patches = vec![PatchRange { first: 0, count: 1, diamond: NO_DIAMOND }];
        (encode(&chunk, attributes).unwrap(), attributes)
    }

    #[test]
    fn a_chunk_is_decoded_into_the_layout_of_the_gpu() {
        let (bytes, _) = one_triangle();
        let mut d = decode(&bytes, 3, 1, true, 0, &kilwa_pack::checksum(&bytes)).unwrap();
        assert_eq!(d.take_patches(), [0, 1, NO_DIAMOND]);
        assert_eq!(d.take_indices().len(), 3);
        let vertices = d.take_vertices();
        assert_eq!(vertices.len(), 60);
        assert!(
            vertices.chunks(20).any(|v| v[..12] == [40, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0] && v[12..15] == [9, 8, 7])
        );
        assert!(d.take_vertices().is_empty());
    }

    #[test]
    fn every_flipped_bit_is_detected_before_decoding() {
        let (bytes, _) = one_triangle();
        let sum = kilwa_pack::checksum(&bytes);
        for at in 0..bytes.len() * 8 {
            let mut bad = bytes.clone();
            bad[at / 8] ^= 1 << (at % 8);
            assert!(decode(&bad, 3, 1, true, 0, &sum).unwrap_err().contains("damaged"));
        }
        assert!(decode(&bytes[..bytes.len() - 1], 3, 1, true, 0, &sum).is_err());
        assert!(decode(&bytes, 3, 1, true, 0, &sum[..4]).is_err());
    }
}

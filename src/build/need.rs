//! How much disk space a build needs, estimated before anything is read.
//!
//! From headers where they say how many vertices and triangles there are (PLY, binary STL, glTF, Nexus, and tilesets of glTF), from the length of
//! the file otherwise; an estimate to the safe side. Of an archive, the mesh in it counts, and the bytes that its files inflate to in the scratch folder. What is needed is compared with what is free, and refused with both numbers.

use kilwa_builder::build::machine;
use kilwa_builder::ingest;
use kilwa_files::size::binary;
use kilwa_formats::read::archive::Beginning;
use kilwa_formats::read::gltf::Sizes;
use kilwa_formats::read::{self, ReadOptions, archive, nexus, tiles};
use std::io::Read;
use std::path::Path;

/// Bytes of a pack for each triangle, and what it has in any case. Packs of the synthetic sites take 3.9 to 4.8.
const PACK_BYTES: (u64, u64) = (12, 1 << 16);
/// Bytes for each triangle that the levels need at most beside each other: leaves, two levels, chunks, records: an estimate; whole builds were seen to use 97 to 100 with what reading leaves.
const LEVEL_BYTES: u64 = 80;
/// The longest JSON of a glTF, and index of a Nexus model, that is looked at.
const MAX_HEAD: u64 = 64 << 20;
/// Bytes that are looked at in any case.
const START: u64 = 1 << 16;
/// More vertices or triangles than any mesh has; what a file claims beyond them is not calculated with.
const COUNT_MAX: u64 = 1 << 40;
/// What the tree and the journal take in any case.
const FIXED: u64 = 1 << 16;

/// Vertices and triangles of an input, about.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Count {
    vertices: u64,
    triangles: u64,
    /// Bytes of attributes for each vertex in scratch files.
    attributes: u64,
    /// Bytes that an archive inflates to in scratch files.
    inflated: u64,
}

/// Disk space needed.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub(crate) struct Need {
    /// Bytes in the scratch folder, at most at a time.
    pub(crate) scratch_bytes: u64,
    /// Bytes of the pack.
    pub(crate) pack_bytes: u64,
}

impl Need {
    /// For these inputs together, found within so much memory; `allow_outside` as when they are read.
    pub(crate) fn of<'a>(inputs: impl Iterator<Item = &'a Path>, memory: u64, allow_outside: bool) -> Self {
        let mut all = Count::default();
        for path in inputs {
            let count = count(path, memory, allow_outside).unwrap_or_default();
            all.vertices = all.vertices.saturating_add(count.vertices).min(COUNT_MAX);
            all.triangles = all.triangles.saturating_add(count.triangles).min(COUNT_MAX);
            all.attributes = all.attributes.max(count.attributes);
            // One archive is read after another.
            all.inflated = all.inflated.max(count.inflated);
        }
        let ingest = ingest::scratch_needed(all.vertices, all.triangles, all.attributes);
        Self {
            scratch_bytes: ingest.saturating_add(all.inflated).max(all.triangles * LEVEL_BYTES).saturating_add(FIXED),
            pack_bytes: all.triangles * PACK_BYTES.0 + PACK_BYTES.1,
        }
    }

    /// Fail if there is not that much space; `held` bytes are in the scratch folder already and count towards it.
    pub(crate) fn check(&self, scratch: &Path, output: &Path, held: u64) -> anyhow::Result<()> {
        let needed = self.scratch_bytes.saturating_sub(held);
        if machine::same_disk(scratch, output) {
            return enough(
                output,
                needed.saturating_add(self.pack_bytes),
                &format!("{} for scratch files and {} for the pack", binary(needed), binary(self.pack_bytes)),
            );
        }
        enough(scratch, needed, "for scratch files")?;
        enough(output, self.pack_bytes, "for the pack")
    }
}

fn enough(folder: &Path, needed: u64, for_what: &str) -> anyhow::Result<()> {
    let free = machine::free_space(folder).unwrap_or(u64::MAX);
    if free < needed {
        anyhow::bail!(
            "the disk that holds {} has {} free, and about {} are needed ({for_what}); free space, or give --scratch a folder \
             on another disk",
            folder.display(),
            binary(free),
            binary(needed)
        );
    }
    Ok(())
}

/// Vertices and triangles of the file at `path`; `None` where it cannot be read, which the reader will say better.
fn count(path: &Path, memory: u64, allow_outside: bool) -> Option<Count> {
    if let Ok(scan) = kilwa_scan::spool::Reader::open(path) {
        let points = scan.header().statistics.measured;
        return Some(Count { vertices: points, triangles: 2 * points, attributes: 16, inflated: 0 });
    }
    if archive::is_archive(path) {
        return in_archive(path, memory);
    }
    let (mut file, bytes) = read::open_regular(path).ok()?;
    let mut start = Vec::new();
    file.by_ref().take(START).read_to_end(&mut start).ok()?;
    if tiles::is_tileset(&start, bytes) {
        let options = ReadOptions { document: memory / 4, allow_outside, ..ReadOptions::default() };
        return tiles::sizes(path, &options).map(Count::of);
    }
    if let Some(length) = head_length(&start, bytes).filter(|length| *length <= memory / 4) {
        file.take(length.saturating_sub(START)).read_to_end(&mut start).ok()?;
        if let Some(count) = start.get(..usize::try_from(length).ok()?).and_then(|head| of_head(head, bytes, memory)) {
            return Some(count);
        }
    }
    Some(count_of(&start, bytes))
}

/// Of the mesh in an archive.
fn in_archive(path: &Path, memory: u64) -> Option<Count> {
    let Beginning { start, bytes, room } = archive::beginning(path, START).ok()?;
    let head = head_length(&start, bytes).filter(|length| *length <= memory / 4);
    let stated = head.and_then(|length| of_head(&archive::beginning(path, length).ok()?.start, bytes, memory));
    Some(Count { inflated: room, ..stated.unwrap_or_else(|| count_of(&start, bytes)) })
}

/// Where the JSON of a glTF or GLB, or the index of a Nexus model, of so many bytes ends; `None` where it is none of these, or absurdly long.
fn head_length(start: &[u8], bytes: u64) -> Option<u64> {
    let length = if let Some(length) = nexus::head_bytes(start) {
        length
    } else if start.starts_with(b"glTF") {
        20 + u64::from(u32::from_le_bytes(start.get(12..16)?.try_into().ok()?))
    } else if start.trim_ascii_start().starts_with(b"{") {
        bytes
    } else {
        return None;
    };
    (length <= bytes.min(MAX_HEAD)).then_some(length)
}

/// The sizes that the beginning of a file of so many bytes states, up to where [`head_length`] says, compressed or not.
fn of_head(head: &[u8], bytes: u64, memory: u64) -> Option<Count> {
    if nexus::is_nexus(head) {
        return nexus::sizes(head, bytes).map(Count::of);
    }
    let json = if head.starts_with(b"glTF") { head.get(20..)? } else { head };
    read::gltf::sizes(json, memory / 2).map(Count::of)
}

impl Count {
    /// With colours or normals.
    fn of(Sizes { vertices, triangles }: Sizes) -> Self {
        Self { vertices, triangles, attributes: 8, inflated: 0 }
    }
}

/// From the beginning of a file of so many bytes.
fn count_of(start: &[u8], bytes: u64) -> Count {
    let colored = |vertices: u64, triangles: u64| Count { vertices, triangles, attributes: 8, inflated: 0 };
    if start.starts_with(b"ply") {
        return ply(start, bytes);
    }
    if let Some(n) = start.get(80..84).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes)
        && u64::from(n) * 50 + 84 == bytes
    {
        return colored(u64::from(n) * 3, u64::from(n));
    }
    if start.starts_with(b"glTF") || start.trim_ascii_start().starts_with(b"{") {
        // Plain: indices of 12 bytes, half a vertex of 16. Compressed it may be several times as many.
        return colored(bytes / 16, bytes / 8);
    }
    // Text: a triangle with its half a vertex takes 40 characters and more.
    colored(bytes / 60, bytes / 40)
}

/// From the header of a PLY; what it claims beyond the bytes of the file is not believed.
fn ply(start: &[u8], bytes: u64) -> Count {
    const END: &str = "end_header";
    let text = String::from_utf8_lossy(start);
    let header = text.split(END).next().unwrap_or_default();
    let (mut vertices, mut faces, mut triangles, mut attributes) = (0, 0, 0, 4);
    // Bytes of a vertex, of a face without its corners, and of one of these.
    let (mut vertex, mut face, mut corner) = (0, 0, 0);
    let mut element = "";
    for line in header.lines() {
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["element", name, n] => {
                let n = n.parse().unwrap_or(0u64);
                element = name;
                match name {
                    "vertex" => vertices = n,
                    "face" => (faces, triangles) = (n, n),
                    "tristrips" => triangles = vertices.saturating_mul(2),
                    _ => {}
                }
            }
            ["property", "list", count, index, _] if element == "face" => {
                face += size_of_type(count);
                corner = size_of_type(index);
            }
            ["property", kind, _] if element == "face" => face += size_of_type(kind),
            ["property", kind, name] if element == "vertex" => {
                vertex += size_of_type(kind);
                attributes += match name {
                    "x" | "y" | "z" | "nx" | "ny" | "nz" | "green" | "blue" => 0,
                    _ => 4,
                };
            }
            _ => {}
        }
    }
    // No vertex takes less than 6 bytes, no face less than 4 indices of a byte.
    let (vertices, faces) = (vertices.min(bytes / 6), faces.min(bytes / 4));
    if faces > 0 && corner > 0 {
        // Polygons: as many triangles as their corners make, estimated from the length, or for text from the vertices.
        let max = if header.contains("format ascii") {
            faces.max(vertices.min(faces).saturating_mul(2))
        } else {
            let corners =
                bytes.saturating_sub((header.len() + END.len()) as u64 + vertices * vertex + faces * face) / corner;
            corners.saturating_sub(faces * 2)
        };
        triangles = faces.max(max);
    }
    Count { vertices, triangles: triangles.min(bytes / 4), attributes, inflated: 0 }
}

/// Bytes of a type of PLY.
fn size_of_type(name: &str) -> u64 {
    match name {
        "char" | "uchar" | "int8" | "uint8" => 1,
        "short" | "ushort" | "int16" | "uint16" => 2,
        "double" | "float64" => 8,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_space_needed_is_estimated_from_headers_limited_by_the_file_size() {
        let header = |faces: u64| {
            format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex 500\nproperty float x\nproperty float y\nproperty float \
                 z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face {faces}\nproperty list uchar int \
                 vertex_indices\nend_header\n"
            )
        };
        // 500 vertices of 15 bytes, 1000 triangles of 13 bytes or 1000 quads of 17.
        let bytes = header(1000).len() as u64 + 500 * 15;
        let count = count_of(header(1000).as_bytes(), bytes + 13_000);
        assert_eq!(count, Count { vertices: 500, triangles: 1000, attributes: 8, inflated: 0 });
        assert_eq!(count_of(header(1000).as_bytes(), bytes + 17_000).triangles, 2000);
        let text = header(1000).replace("binary_little_endian", "ascii");
        assert_eq!(count_of(text.as_bytes(), bytes + 17_000).triangles, 1000);
        assert_eq!(count_of(text.replace("vertex 500", "vertex 1000").as_bytes(), bytes + 17_000).triangles, 2000);
        assert_eq!(count_of(header(u64::MAX).as_bytes(), 20_000).triangles, 5000);
        let mut stl = vec![0; 84];
        stl[80..].copy_from_slice(&7u32.to_le_bytes());
        assert_eq!(count_of(&stl, 84 + 350).triangles, 7);
        let json =
            br#"{"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1},{"attributes":{"POSITION":0}}]}],
            "accessors":[{"count":30},{"count":60}],"buffers":[{"byteLength":600}]}"#;
        let bytes = json.len() as u64;
        assert_eq!(
            of_head(json, bytes, 1 << 20),
            Some(Count { vertices: 60, triangles: 30, attributes: 8, inflated: 0 })
        );
        assert_eq!(head_length(json, bytes), Some(bytes));
        let lie = br#"{"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"count":4000000000}],
            "buffers":[{"byteLength":100}]}"#;
        assert_eq!(of_head(lie, lie.len() as u64, 1 << 20).map(|c| c.vertices), Some(1600));
        assert_eq!(count_of(b"# obj\nv 1 2 3\n", 4000).triangles, 100);
    }

    #[test]
    fn compressed_models_and_tilesets_need_what_they_decode_to() {
        let folder = tempfile::tempdir().unwrap();
        let written = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let of = |path: &Path| count(path, 1 << 30, false).unwrap();
        // A Nexus model with a node of 8 KiB, compressed with Corto, and the sink.
        let mut bytes = b" sxN\x02\0\0\0".to_vec();
        bytes.extend([40_000u64, 65_000].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend([7, 3]);
        bytes.resize(40, 0);
        bytes.extend([4, 3]);
        bytes.resize(56, 0);
        bytes.extend([4u32, 2, 1, 0].iter().flat_map(|n| n.to_le_bytes()));
        bytes.resize(88, 0);
        bytes.extend(1u32.to_le_bytes());
        bytes.extend([40_000u16, 65_000].iter().flat_map(|n| n.to_le_bytes()));
        bytes.resize(88 + 44, 0);
        bytes.extend(33u32.to_le_bytes());
        bytes.resize(88 + 84, 0);
        bytes.extend([1u32, 1, 65_000, u32::MAX].iter().flat_map(|n| n.to_le_bytes()));
        bytes.resize(33 * 256, 0);
        let expected = Count { vertices: 40_000, triangles: 65_000, attributes: 8, inflated: 0 };
        assert_eq!(of(&written("a.nxz", &bytes)), expected);
        // A tileset of one small file, whose tile has a thousand times as many bytes when it is decoded.
        let json = br#"{"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],"accessors":[{"count":40000},{"count":195000}],
            "buffers":[{"byteLength":20000}]}"#;
        let glb = [&b"glTF\x02\0\0\0\0\0\0\0"[..], &(json.len() as u32).to_le_bytes(), b"JSON", json].concat();
        written("b.glb", &glb);
        let tileset =
            br#"{"asset":{"version":"1.1"},"geometricError":9,"root":{"geometricError":5,"content":{"uri":"b.glb"}}}"#;
        let path = written("tileset.json", tileset);
        assert_eq!(of(&path), expected);
        let need = Need::of([path.as_path()].into_iter(), 1 << 30, false);
        assert!(need.scratch_bytes >= 65_000 * LEVEL_BYTES && need.pack_bytes >= 65_000 * PACK_BYTES.0);
    }

    #[test]
    fn too_little_disk_space_is_refused_with_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let need = Need { scratch_bytes: 1 << 58, pack_bytes: 1 << 50 };
        let error = need.check(folder.path(), folder.path(), 0).unwrap_err().to_string();
        assert!(error.contains("free") && error.contains("262144 TiB") && error.contains("1024 TiB"), "{error}");
        assert!(Need { scratch_bytes: 1000, pack_bytes: 10 }.check(folder.path(), folder.path(), 0).is_ok());
    }
}

//! What the Nexus reader delivers and refuses, tested on uncompressed files made here.

use super::super::{MemorySink, ReadError, ReadOptions, read_into_with, read_mesh_from};
use super::corto;
use super::{COUNT_MISMATCH, Cursor, head_bytes, sizes};
use crate::RawMesh;
use glam::DVec3;
use proptest::prelude::*;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

fn read(bytes: &[u8]) -> Result<RawMesh, ReadError> {
    read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("a.nxs"), &mut |_, _| {})
}

fn refusal(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

/// A node to write: its vertices, triangles, and patches as destination, end of the triangles, texture.
#[derive(Debug, Clone, Default)]
struct Made {
    positions: Vec<[f32; 3]>,
    coordinates: Vec<[f32; 2]>,
    colors: Vec<[u8; 4]>,
    triangles: Vec<[u16; 3]>,
    patches: Vec<[u32; 3]>,
}

const NO_TEXTURE: u32 = u32::MAX;
/// Offsets in the header and the index.
const FLAGS: usize = 56;
const NODES: usize = 60;
const PATCHES: usize = 64;
const FIRST_NODE: usize = 88;

fn pad(bytes: &mut Vec<u8>) {
    bytes.resize(bytes.len().next_multiple_of(256), 0);
}

/// A file of these nodes, a sink and pictures, with normals that point up.
fn file(nodes: &[Made], textures: &[&[u8]]) -> Vec<u8> {
    let colored = nodes.iter().any(|n| !n.colors.is_empty());
    let textured = nodes.iter().any(|n| !n.coordinates.is_empty());
    let mut body: Vec<u8> = Vec::new();
    let patches: Vec<[u32; 3]> = nodes.iter().flat_map(|n| n.patches.clone()).collect();
    let pictures = if textures.is_empty() { 0 } else { textures.len() + 1 };
    let before = (FIRST_NODE + 44 * (nodes.len() + 1) + 12 * patches.len() + 68 * pictures).next_multiple_of(256);
    let place = |body: &Vec<u8>| ((before + body.len()) / 256) as u32;
    let mut entries: Vec<u8> = Vec::new();
    let mut first = 0u32;
    let mut entry = |place: u32, node: &Made| {
        entries.extend(place.to_le_bytes());
        entries.extend((node.positions.len() as u16).to_le_bytes());
        entries.extend((node.triangles.len() as u16).to_le_bytes());
        entries.extend([0; 32]);
        entries.extend(first.to_le_bytes());
        first += node.patches.len() as u32;
    };
    for node in nodes {
        entry(place(&body), node);
        body.extend(node.positions.iter().flatten().flat_map(|x| x.to_le_bytes()));
        body.extend(node.coordinates.iter().flatten().flat_map(|x| x.to_le_bytes()));
        body.extend(node.positions.iter().flat_map(|_| [0i16, 0, 32767]).flat_map(i16::to_le_bytes));
        body.extend(node.colors.iter().flatten());
        body.extend(node.triangles.iter().flatten().flat_map(|x| x.to_le_bytes()));
        pad(&mut body);
    }
    entry(place(&body), &Made::default());
    let mut places = Vec::new();
    for texture in textures {
        places.push(place(&body));
        body.extend(*texture);
        pad(&mut body);
    }
    places.push(place(&body));
    let mut bytes = b" sxN".to_vec();
    bytes.extend(2u32.to_le_bytes());
    let count = |of: fn(&Made) -> usize| nodes.iter().map(of).sum::<usize>() as u64;
    bytes.extend(count(|n| n.positions.len()).to_le_bytes());
    bytes.extend(count(|n| n.triangles.len()).to_le_bytes());
    bytes.extend([7, 3, 3, 3, u8::from(colored), 4 * u8::from(colored)]);
    bytes.extend(if textured { [7, 2] } else { [0, 0] });
    bytes.extend([0; 8]);
    bytes.extend([4, 3]);
    bytes.extend([0; 14]);
    bytes.extend(0u32.to_le_bytes());
    bytes.extend((nodes.len() as u32 + 1).to_le_bytes());
    bytes.extend((patches.len() as u32).to_le_bytes());
    bytes.extend((pictures as u32).to_le_bytes());
    bytes.extend([0; 16]);
    bytes.extend(entries);
    bytes.extend(patches.iter().flatten().flat_map(|x| x.to_le_bytes()));
    for place in places.iter().take(pictures) {
        bytes.extend(place.to_le_bytes());
        bytes.extend([0; 64]);
    }
    pad(&mut bytes);
    bytes.extend(body);
    bytes
}

/// A square of two triangles at this height.
fn square(z: f32, patches: &[[u32; 3]]) -> Made {
    Made {
        positions: vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]],
        colors: vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        patches: patches.to_vec(),
        ..Made::default()
    }
}

/// A coarse node and two of the finest level.
fn model() -> Vec<u8> {
    let coarse = square(0.0, &[[1, 1, NO_TEXTURE], [2, 2, NO_TEXTURE]]);
    let (one, two) = (square(1.0, &[[3, 2, NO_TEXTURE]]), square(2.0, &[[3, 1, NO_TEXTURE], [3, 2, NO_TEXTURE]]));
    file(&[coarse, one, two], &[])
}

/// The corners of a triangle, as bits, and their colours.
type Corners = ([[u64; 3]; 3], [[u8; 3]; 3]);

/// All triangles, sorted.
fn corners(mesh: &RawMesh) -> Vec<Corners> {
    let color = |v: u32| mesh.colors.get(v as usize).copied().unwrap_or_default();
    let place = |v: u32| mesh.positions[v as usize].to_array().map(f64::to_bits);
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| (t.map(place), t.map(color))).collect();
    all.sort_unstable();
    all
}

#[test]
fn only_the_patches_that_lead_to_the_sink_are_read() {
    let mesh = read(&model()).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (4, 8));
    assert!(mesh.positions.iter().all(|p| p.z > 0.5));
    assert!(mesh.normals.iter().all(|n| *n == glam::Vec3::Z));
    // A node of which one triangle is replaced by a finer node delivers the other, and its three vertices.
    let partly =
        file(&[square(0.0, &[[2, 1, NO_TEXTURE], [1, 2, NO_TEXTURE]]), square(1.0, &[[2, 2, NO_TEXTURE]])], &[]);
    let mesh = read(&partly).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (3, 7));
}

#[test]
fn every_truncation_is_refused() {
    let bytes = model();
    // The last node ends before the padding.
    let end = bytes.len() - 256 + 4 * (12 + 6 + 4) + 2 * 6;
    for length in 1..end {
        let text = refusal(&bytes[..length]);
        assert!(text.contains("a.nxs"), "{length}: {text}");
    }
    assert!(read(&bytes[..end]).is_ok());
}

#[test]
fn unsupported_models_are_refused_with_advice() {
    let with = |at: usize, value: u32| {
        let mut bytes = model();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        refusal(&bytes)
    };
    assert!(with(FLAGS, 2).contains("MECO") && with(FLAGS, 2).contains("export its finest level as PLY"));
    assert!(with(FLAGS, 8).contains("deepzoom"));
    assert!(with(FLAGS, 64).contains("unknown flags (0x40)"));
    assert!(with(FLAGS, 4).contains("Corto"));
    assert!(with(4, 3).contains("version 3"));
    assert!(with(0, 0x4e78_7321).contains("does not know"));
    assert!(with(40, 0).contains("point cloud"));
    let mut bytes = model();
    bytes[..4].copy_from_slice(b"sxN ");
    assert!(refusal(&bytes).contains("a.nxs"));
}

#[test]
fn counts_and_offsets_outside_the_file_are_refused_with_the_offset() {
    let with = |at: usize, value: &[u8]| {
        let mut bytes = model();
        bytes[at..at + value.len()].copy_from_slice(value);
        refusal(&bytes)
    };
    let patch = FIRST_NODE + 4 * 44;
    for (at, value, part) in [
        (NODES, &[0xff; 4][..], "for the header and 4294967295 nodes"),
        (NODES, &[0; 4], "no nodes"),
        (PATCHES, &[0xff; 4], "4294967295 patches"),
        (PATCHES, &[1, 0, 0, 0], "a node with patches"),
        (FIRST_NODE + 44, &[0; 4], "ascending offsets"),
        (FIRST_NODE + 44, &[0xff; 4], "it is truncated"),
        (FIRST_NODE + 3 * 44, &[0xff; 4], "it is truncated"),
        (FIRST_NODE + 44 + 4, &[0xff; 2], "bytes for the vertices and triangles"),
        (FIRST_NODE + 44 + 6, &[9, 0], "patches for all 9 of them"),
        (FIRST_NODE + 44 + 40, &[7, 0, 0, 0], "a node with patches"),
        (patch, &[9, 0, 0, 0], "leads to node 9"),
        (patch + 4, &[9, 0, 0, 0], "triangles 0 to 9"),
    ] {
        let text = with(at, value);
        assert!(text.contains(part) && text.contains("byte "), "expected {part:?}: {text}");
    }
    let mut outside = square(0.0, &[[1, 2, NO_TEXTURE]]);
    outside.triangles[1] = [0, 2, 4];
    assert!(refusal(&file(&[outside], &[])).contains("vertex 4 in a triangle of node 0"));
    let mut lies = model();
    lies[16] = 99;
    assert_eq!(read(&lies).unwrap().diagnostics.count(COUNT_MISMATCH), 1);
}

#[test]
fn a_picture_gives_vertices_their_colours_from_the_bottom_up() {
    let mut png = std::io::Cursor::new(Vec::new());
    let picture = image::RgbImage::from_fn(1, 2, |_, y| image::Rgb(if y == 0 { [200, 0, 0] } else { [0, 0, 100] }));
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let mut node = square(0.0, &[[1, 2, 0]]);
    node.coordinates = vec![[0.5, 0.25], [0.5, 0.25], [0.5, 0.75], [0.5, 0.75]];
    let mesh = read(&file(&[node.clone()], &[png.get_ref()])).unwrap();
    for (p, c) in mesh.positions.iter().zip(&mesh.colors) {
        assert_eq!(*c, if p.y > 0.5 { [200, 0, 0] } else { [0, 0, 100] });
    }
    assert_eq!(mesh.diagnostics.pictures.count, 1);
    // Damaged: the colours of the vertices.
    let mesh = read(&file(&[node.clone()], &[b"no picture"])).unwrap();
    assert!(mesh.colors.contains(&[9, 8, 7]) && mesh.diagnostics.iter().any(|(kind, ..)| kind.contains("pictures")));
    node.patches[0][2] = 1;
    assert!(refusal(&file(&[node], &[png.get_ref()])).contains("texture 1"));
}

fn png(color: [u8; 3]) -> Vec<u8> {
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(1, 1, image::Rgb(color)).write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

#[test]
fn parts_of_a_node_with_the_same_picture_share_their_vertices_in_any_order() {
    let mut node = square(0.0, &[]);
    node.coordinates = vec![[0.5; 2]; 4];
    node.triangles = vec![[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3], [2, 1, 0], [3, 2, 0]];
    node.patches = (0..6).map(|i| [1, i + 1, i % 2]).collect();
    let colors = [[200, 0, 0], [0, 0, 100]];
    let mesh = read(&file(&[node.clone()], &[&png(colors[0]), &png(colors[1])])).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (6, 8));
    let mut expected = RawMesh::default();
    for (i, t) in node.triangles.iter().enumerate() {
        let first = expected.positions.len() as u32;
        expected.triangles.push([first, first + 1, first + 2]);
        expected.positions.extend(t.map(|v| DVec3::from_array(node.positions[usize::from(v)].map(f64::from))));
        expected.colors.extend([colors[i % 2]; 3]);
    }
    assert_eq!(corners(&mesh), corners(&expected));
}

/// Counts the bytes that are read.
struct Counting<'a>(std::io::Cursor<&'a [u8]>, &'a std::cell::Cell<usize>);

impl Read for Counting<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let read = self.0.read(into)?;
        self.1.set(self.1.get() + read);
        Ok(read)
    }
}

impl Seek for Counting<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

/// A model of one node, behind which there are so many bytes that belong to it.
fn padded(padding: usize, flags: u8) -> Vec<u8> {
    let mut bytes = file(&[square(0.0, &[[1, 2, NO_TEXTURE]])], &[]);
    bytes.resize(bytes.len() + padding, 0);
    let end = (bytes.len() / 256) as u32;
    bytes[FIRST_NODE + 44..][..4].copy_from_slice(&end.to_le_bytes());
    bytes[FLAGS] = flags;
    bytes
}

#[test]
fn no_more_of_a_node_is_read_than_it_can_need() {
    let bytes = padded(4 << 20, 0);
    let count = std::cell::Cell::new(0);
    let source = Counting(std::io::Cursor::new(&bytes), &count);
    let mesh = read_mesh_from(source, bytes.len() as u64, Path::new("a.nxs"), &mut |_, _| {}).unwrap();
    assert_eq!(mesh.triangles.len(), 2);
    assert!(count.get() < 1 << 20, "{} bytes", count.get());
    let message = refusal(&padded(64 << 20, 4));
    assert!(message.contains("node 0 has 67109120 bytes"), "{message}");
}

#[test]
fn an_index_beyond_the_memory_is_refused_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.nxs");
    std::fs::write(&path, model()).unwrap();
    let read = |document: u64| {
        let options = ReadOptions { document, ..ReadOptions::default() };
        read_into_with(&path, &options, &mut MemorySink::new(&path), &mut |_, _| {})
    };
    read(10_000).unwrap();
    let message = read(1000).unwrap_err().to_string();
    assert!(message.contains("4 nodes, 5 patches") && message.contains("give a larger --memory"), "{message}");
}

#[test]
fn the_index_says_how_large_the_finest_level_is() {
    let mut bytes = model();
    let (mesh, total) = (read(&bytes).unwrap(), bytes.len() as u64);
    let head = head_bytes(&bytes[..100]).unwrap() as usize;
    assert_eq!(head, FIRST_NODE + 4 * 44 + 5 * 12);
    let found = sizes(&bytes[..head], total).unwrap();
    assert_eq!((found.vertices, found.triangles), (mesh.positions.len() as u64, mesh.triangles.len() as u64));
    assert!(sizes(&bytes[..head - 1], total).is_none() && sizes(&bytes[..head], 300).is_none());
    assert!(head_bytes(&bytes[..FIRST_NODE - 1]).is_none() && head_bytes(&[b'p'; 200]).is_none());
    // More triangles than its 256 bytes can hold are not believed.
    bytes[FIRST_NODE + 44 + 6..][..2].fill(0xff);
    bytes[FIRST_NODE + 4 * 44 + 2 * 12 + 4..][..2].fill(0xff);
    assert_eq!(sizes(&bytes[..head], total).unwrap().triangles, 256 * 16 + 2);
}

/// Numbers for a stream of bits of given lengths, in words.
fn words(numbers: &[(u64, usize)]) -> Vec<u8> {
    let bits: Vec<bool> = numbers.iter().flat_map(|&(v, n)| (0..n).rev().map(move |i| v >> i & 1 == 1)).collect();
    let word = |b: &[bool]| b.iter().enumerate().map(|(i, b)| u32::from(*b) << (31 - i)).sum::<u32>();
    bits.chunks(32).flat_map(|b| word(b).to_le_bytes()).collect()
}

/// A Corto stream without entropy coding: one triangle and one beyond its first edge, positions (0, 0, 0), (4, 0, 0),
/// (4, 4, 0), (8, 4, 0) in steps of a half.
fn stream() -> Vec<u8> {
    let mut bytes = vec![0, 0x63, 0x7a, 0x78, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0];
    bytes.extend([9, 0]);
    bytes.extend(b"position\0");
    bytes.extend([1, 0, 0, 0]);
    bytes.extend(0.5f32.to_le_bytes());
    bytes.extend([3, 6, 3]);
    bytes.extend([4, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0]);
    bytes.extend([9, 0, 0, 0]);
    // A first triangle, then beyond its first edge a new vertex.
    bytes.extend([2, 0, 0, 0, 0, 0]);
    bytes.extend([0; 4]);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    // Differences: none; 8 along x; 8 along y; from 1 + 2 - 0: nothing.
    let bits = words(&[(16 + 8, 5), (16, 5), (16, 5), (16, 5), (16 + 8, 5), (16, 5)]);
    bytes.extend(((bits.len() / 4) as u32).to_le_bytes());
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes.extend(bits);
    bytes.extend([4, 0, 0, 0, 0, 5, 5, 0]);
    bytes
}

#[test]
fn a_stream_without_entropy_coding_is_decoded() {
    let bytes = stream();
    let piece = corto::decode(&mut Cursor::new(&bytes, 0), 4, 2).unwrap();
    assert_eq!(piece.triangles, [[0, 1, 2], [2, 1, 3]]);
    let expected = [[0.0; 3], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [8.0, 4.0, 0.0]];
    assert_eq!(piece.positions, expected.map(DVec3::from_array));
    for length in 0..bytes.len() {
        assert!(corto::decode(&mut Cursor::new(&bytes[..length], 7), 4, 2).is_err(), "{length}");
    }
    assert!(corto::decode(&mut Cursor::new(&bytes, 0), 5, 2).unwrap_err().expected.contains("5 and 2"));
}

proptest! {
    /// Triangles come out as they went in, whatever the nodes are.
    #[test]
    fn what_was_written_without_compression_is_read(
        nodes in proptest::collection::vec(proptest::collection::vec((-1000i16..1000, any::<[u8; 3]>()), 3..40), 1..5),
    ) {
        let sink = nodes.len() as u32;
        let mut expected = RawMesh::default();
        let made: Vec<Made> = nodes.iter().map(|vertices| {
            let mut node = Made::default();
            for (i, (x, color)) in vertices.iter().enumerate() {
                let p = [f32::from(*x), i as f32, sink as f32 + 0.25];
                node.positions.push(p);
                node.colors.push([color[0], color[1], color[2], 255]);
                expected.positions.push(DVec3::from_array(p.map(f64::from)));
                expected.colors.push(*color);
            }
            let first = (expected.positions.len() - vertices.len()) as u32;
            for i in 2..vertices.len() as u16 {
                node.triangles.push([i - 2, i - 1, i]);
                expected.triangles.push([i - 2, i - 1, i].map(|v| first + u32::from(v)));
            }
            node.patches.push([sink, node.triangles.len() as u32, NO_TEXTURE]);
            node
        }).collect();
        let mesh = read(&file(&made, &[])).unwrap();
        prop_assert_eq!(corners(&mesh), corners(&expected));
    }

    /// Damaged bytes give a mesh or an error.
    #[test]
    fn damage_is_read_or_refused(at in 0usize..2000, value: u8, other in 0usize..200, bits: u8) {
        let mut bytes = model();
        let n = bytes.len();
        bytes[at % n] = value;
        let _ = read(&bytes);
        let mut bytes = stream();
        let n = bytes.len();
        bytes[other % n] = bits;
        let _ = corto::decode(&mut Cursor::new(&bytes, 0), 4, 2);
    }
}

//! Thousands of damaged files: for any bytes the reader ends, does not panic, and what it returns is valid and
//! not larger than the file justifies. Seeded, so that a failure can be repeated; `tests/fuzz` goes further.

use super::super::read_mesh_from;
use crate::RawMesh;
use fastrand::Rng;
use std::path::Path;

/// The most bytes of mesh that a byte of file can produce: a vertex of three chars takes 24 and more, a corner of
/// one byte up to a triangle of 12, or with a colour per face three new vertices.
const GROWTH: usize = 100;

fn bytes_of(mesh: &RawMesh) -> usize {
    let scalars: usize = mesh.scalars.iter().map(|(_, v)| v.capacity() * 4).sum();
    mesh.positions.capacity() * 24
        + mesh.colors.capacity() * 3
        + mesh.normals.capacity() * 12
        + mesh.triangles.capacity() * 12
        + scalars
}

fn check(bytes: &[u8]) -> bool {
    let Ok(mesh) =
        read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("fuzz.ply"), &mut |_, _| {})
    else {
        return false;
    };
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().all(|p| p.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    assert!(!mesh.triangles.is_empty());
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
    assert!(mesh.scalars.iter().all(|(_, v)| v.len() == n));
    assert!(bytes_of(&mesh) <= GROWTH * bytes.len(), "{} bytes from {}", bytes_of(&mesh), bytes.len());
    true
}

/// Files to start from: every element, every kind of property, all encodings.
fn seeds() -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment a\nelement vertex 5\nproperty uchar x\nproperty float y\nproperty short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\nproperty list uchar ushort extra\nproperty char nx\nproperty char ny\nproperty char nz\nproperty float quality\nelement edge 2\nproperty int a\nproperty int b\nelement face 3\nproperty list uchar int vertex_indices\nproperty ushort flag\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        )
    };
    let mut ascii = head("ascii").into_bytes();
    for i in 0..5 {
        ascii.extend(format!("{} 0.{i} {} 9 8 7 {} 2 5 6 1 0 -1 0.5\n", i * i, i % 3, 250 + i).bytes());
    }
    ascii.extend(b"0 1\n1 2\n3 0 1 2 7\n4 0 1 2 3 7\n5 4 3 2 1 0 7\n9 0 1 2 3 -1 4 3 2 1\n");
    all.push(ascii);
    for format in ["binary_little_endian", "binary_big_endian"] {
        let mut bytes = head(format).into_bytes();
        let big = format.contains("big");
        let four = |v: i32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let two = |v: i16| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        let float = |v: f32| four(v.to_bits().cast_signed());
        for i in 0..5u8 {
            bytes.push(i * i);
            bytes.extend(float(f32::from(i) * 0.1));
            bytes.extend(two(i16::from(i % 3)));
            bytes.extend([9, 8, 7, 250 + i, 2]);
            bytes.extend([two(5), two(6)].concat());
            bytes.extend([1, 0, 255]);
            bytes.extend(float(0.5));
        }
        bytes.extend([0, 1, 1, 2].map(four).concat());
        for face in [&[0, 1, 2][..], &[0, 1, 2, 3], &[4, 3, 2, 1, 0]] {
            bytes.push(face.len() as u8);
            bytes.extend(face.iter().flat_map(|&i| four(i)));
            bytes.extend(two(7));
        }
        bytes.extend([9, 0, 1, 2, 3, -1, 4, 3, 2, 1].map(four).concat());
        all.push(bytes);
    }
    all.push(b"ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_index\nproperty float red\nproperty float green\nproperty float blue\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\nend_header\n4 0 1 2 3 0.1 0.2 0.3\n3 2 3 4 1 1 1\n0 0 0\n2 1 0\n4 0 0\n2 4 0\n1e1 nan 0\n".to_vec());
    all
}

/// Words that headers and text rows react to.
const WORDS: [&str; 22] = [
    "-1",
    "0",
    "1",
    "255",
    "65536",
    "4294967295",
    "9223372036854775808",
    "1e308",
    "nan",
    "inf",
    "int",
    "double",
    "char",
    "list",
    "vertex",
    "face",
    "tristrips",
    "ascii",
    "binary_big_endian",
    "end_header",
    "\n",
    "comment",
];

/// Damage a few places, half of the time behind the header only.
fn mutate(bytes: &mut Vec<u8>, random: &mut Rng) {
    let body = bytes.windows(11).position(|w| w == b"end_header\n").map_or(0, |at| at + 11);
    let from = if random.usize(..2) == 0 { body } else { 0 };
    for _ in 0..=random.usize(..3) {
        let at = from + random.usize(..(bytes.len().saturating_sub(from)).max(1));
        if at >= bytes.len() {
            return;
        }
        match random.usize(..12) {
            0 => bytes.truncate(at),
            1..=5 => bytes[at] ^= 1 << random.usize(..8),
            6 => bytes[at] = random.u8(..),
            7 => {
                let end = (at + random.usize(..24)).min(bytes.len());
                bytes.drain(at..end);
            }
            8 => {
                let end = (at + random.usize(..40)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                let to = random.usize(..bytes.len().max(1));
                bytes.splice(to..to, copy);
            }
            // Replace a word by another.
            9 => {
                let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map_or(bytes.len(), |n| at + n);
                let start = bytes[..at].iter().rposition(u8::is_ascii_whitespace).map_or(0, |n| n + 1);
                bytes.splice(start..end.max(start), WORDS[random.usize(..WORDS.len())].bytes());
            }
            _ => {
                let end = (at + 4).min(bytes.len());
                bytes[at..end].fill([0, 0xff, 0x7f, 0x80][random.usize(..4)]);
            }
        }
    }
}

#[test]
fn twenty_thousand_damaged_files_cause_no_panic() {
    let seeds = seeds();
    for seed in &seeds {
        assert!(check(seed), "{}", String::from_utf8_lossy(seed));
    }
    let mut random = Rng::with_seed(2);
    let (mut read, mut refused) = (0, 0);
    for i in 0..20_000 {
        let mut bytes = seeds[i % seeds.len()].clone();
        mutate(&mut bytes, &mut random);
        if check(&bytes) {
            read += 1;
        } else {
            refused += 1;
        }
    }
    // Damage that is only ever refused, or never, would test little.
    assert!(read > 1000 && refused > 1000, "{read} read, {refused} refused");
}

#[test]
fn noise_after_a_valid_header_causes_no_panic() {
    let mut random = Rng::with_seed(3);
    for i in 0..3000 {
        let seed = &seeds()[i % 4];
        let body = seed.windows(11).position(|w| w == b"end_header\n").map_or(0, |at| at + 11);
        let mut bytes = seed[..body].to_vec();
        let alphabet = [&b"0123456789 -.\n"[..], &b"\x00\x01\x02\x03\x04\xff\x7f"[..]][i % 2];
        bytes.extend((0..random.usize(..600)).map(|_| alphabet[random.usize(..alphabet.len().max(1))]));
        check(&bytes);
    }
}

//! docs/FORMAT.md is enough to write a reader from: `tests/format/read_pack.py`, written from it in another language,
//! decodes every chunk to the same numbers, and `verify_pack.py` beside it finds every rule of its section 9 kept.

use crate::support::{Input, succeeds, text};
use kilwa_pack::{Chunk, Reader, SliceSource};
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// SHA-256 over a chunk, in the layout of `digest` in read_pack.py.
fn digest(chunk: &Chunk) -> String {
    let mesh = &chunk.mesh;
    let mut hash = Sha256::new();
    for patch in &chunk.patches {
        hash.update(patch.count.to_le_bytes());
        hash.update(patch.diamond.to_le_bytes());
    }
    for (triangle, border) in mesh.triangles.iter().zip(&mesh.borders) {
        hash.update(triangle.map(u32::to_le_bytes).as_flattened());
        hash.update([*border]);
    }
    mesh.positions.iter().flat_map(glam::IVec3::to_array).for_each(|x| hash.update(x.to_le_bytes()));
    hash.update(mesh.colors.as_flattened());
    mesh.normals.as_flattened().iter().for_each(|x| hash.update(x.to_le_bytes()));
    mesh.scalars.iter().flatten().for_each(|x| hash.update(x.to_bits().to_le_bytes()));
    hash.finalize().iter().fold(String::new(), |mut s, byte| {
        let _ = write!(s, "{byte:02x}");
        s
    })
}

/// An open, rough height field with a confidence per vertex.
fn rough_field(n: u32) -> String {
    let mut out = format!("ply\nformat ascii 1.0\nelement vertex {}\n", (n + 1) * (n + 1));
    out += "property float x\nproperty float y\nproperty float z\nproperty float confidence\n";
    let _ = writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", 2 * n * n);
    for j in 0..=n {
        for i in 0..=n {
            let noise = f64::from((i * 7919 + j * 104_729) % 1009) / 1009.0;
            let _ = writeln!(out, "{} {} {} {}", i, j, noise * 3.0, noise - 0.5);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let a = j * (n + 1) + i;
            let _ = writeln!(out, "3 {a} {} {}\n3 {a} {} {}", a + 1, a + n + 2, a + n + 2, a + n + 1);
        }
    }
    out
}

#[test]
fn a_reader_written_from_the_specification_decodes_every_chunk_identically() {
    if Command::new("python3").arg("--version").output().is_err() {
        println!("skipped: python3 is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/format/read_pack.py");
    Input::torus(120, 50, [5.0, 6.0, 7.0]).write(&folder.path().join("torus.ply"));
    std::fs::write(folder.path().join("field.ply"), rough_field(70)).unwrap();
    let fewer_bits: [&[&str]; 2] = [&[], &["--color-bits", "5", "--normal-bits", "7"]];
    for (name, options) in [("torus", 0), ("torus", 1), ("field", 0)].map(|(name, i)| (name, fewer_bits[i])) {
        let (input, pack) = (folder.path().join(format!("{name}.ply")), folder.path().join(format!("{name}.kilwa")));
        succeeds(&[&["build", "--force", text(&input), "-o", text(&pack)], options].concat());
        let output = Command::new("python3").arg(&script).arg(&pack).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let reader = Reader::open(SliceSource(std::fs::read(&pack).unwrap())).unwrap();
        assert_eq!(reader.header().attributes.scalars, u8::from(name == "field"));
        assert_eq!(String::from_utf8_lossy(&output.stdout), digests(&pack), "{name}");
        keeps_every_rule(&pack);
    }
}

#[test]
fn packs_of_points_are_decoded_identically_too() {
    if Command::new("python3").arg("--version").output().is_err() {
        println!("skipped: python3 is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/format/read_pack.py");
    let pack = crate::points::pack_of_levels(folder.path());
    let output = Command::new("python3").arg(&script).arg(&pack).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stdout), digests(&pack));
    keeps_every_rule(&pack);
}

/// Section 9, by the verifier in the other language.
fn keeps_every_rule(pack: &Path) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/format/verify_pack.py");
    let output = Command::new("python3").arg(&script).arg(pack).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// One line per chunk, as read_pack.py prints them.
fn digests(pack: &Path) -> String {
    let reader = Reader::open(SliceSource(std::fs::read(pack).unwrap())).unwrap();
    let mut out = String::new();
    for i in 0..reader.header().entry_count {
        let chunk = reader.chunk(i).unwrap();
        let (vertices, triangles) = (chunk.mesh.vertex_count(), chunk.mesh.triangle_count());
        let _ = writeln!(out, "{i} {vertices} {triangles} {}", digest(&chunk));
    }
    out
}

/// `tests/compat` has a pack of every version of the format since 1.0, made when that version was new, and beside it what
/// its chunks decode to. Neither is ever made again.
#[test]
fn packs_of_every_version_since_1_0_decode_to_what_they_always_did() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compat");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/format/read_pack.py");
    let files = std::fs::read_dir(&folder).unwrap().map(|file| file.unwrap().path());
    let packs: Vec<_> = files.filter(|file| file.extension().is_some_and(|e| e == "kilwa")).collect();
    assert!(!packs.is_empty());
    for pack in packs {
        let wanted = std::fs::read_to_string(pack.with_extension("txt")).unwrap();
        assert_eq!(digests(&pack), wanted, "{}", pack.display());
        succeeds(&["verify", text(&pack)]);
        if let Ok(output) = Command::new("python3").arg(&script).arg(&pack).output() {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            assert_eq!(String::from_utf8_lossy(&output.stdout), wanted, "{}", pack.display());
            keeps_every_rule(&pack);
        }
    }
}

//! `kilwa info` of a mesh: a description without building a pack.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

fn info(args: &[&str]) -> (i32, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_kilwa")).arg("info").args(args).output().unwrap();
    (out.status.code().unwrap_or(-1), String::from_utf8(out.stdout).unwrap())
}

/// Two disjoint squares, one of them with a duplicate triangle.
fn write_mesh(path: &Path) {
    let mut text = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n\
                    element face 5\nproperty list uchar int vertex_indices\nend_header\n"
        .to_owned();
    for x in [0, 1, 3, 4] {
        for y in [0, 1] {
            writeln!(text, "{x} {y} 0").unwrap();
        }
    }
    text += "3 0 2 1\n3 1 2 3\n3 4 6 5\n3 5 6 7\n3 2 1 0\n";
    std::fs::write(path, text).unwrap();
}

#[test]
fn a_mesh_is_described_in_words_and_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("squares.ply");
    write_mesh(&path);
    let name = path.to_str().unwrap();
    let (code, text) = info(&[name, "--units", "cm"]);
    assert_eq!(code, 0);
    assert!(text.contains("5 triangles, 8 vertices") && text.contains("0.040 × 0.010 × 0.000 m"), "{text}");
    assert!(text.contains("2, the largest of 3 triangles") && text.contains("1 duplicate triangle\n"), "{text}");
    let (code, json) = info(&[name, "--json"]);
    assert_eq!(code, 0);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((json["triangles"].as_u64(), json["components"].as_u64()), (Some(5), Some(2)));
    assert_eq!((json["duplicate_triangles"].as_u64(), json["non_manifold_edges"].as_u64()), (Some(1), Some(1)));
}

#[test]
fn a_file_that_is_neither_pack_nor_mesh_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notes.txt");
    std::fs::write(&path, "no mesh").unwrap();
    assert_eq!(info(&[path.to_str().unwrap()]).0, 1);
}

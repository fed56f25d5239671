//! `kilwa info` of a mesh: a description without building a pack.

use crate::support::{json, succeeds, text};
use std::fmt::Write;
use std::path::{Path, PathBuf};
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

/// A square of two triangles, 2048 units wide, that faces +y, with a picture that is missing.
fn doubtful(folder: &Path) -> PathBuf {
    let mesh = folder.join("head.obj");
    let corners = "v 0 0 0\nv 0 0 2048\nv 2048 0 2048\nv 2048 0 0\n";
    let faces = "vt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\nusemtl skin\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    std::fs::write(&mesh, format!("mtllib head.mtl\n{corners}{faces}")).unwrap();
    std::fs::write(folder.join("head.mtl"), "newmtl skin\nKd 1 0 0\nmap_Kd skin.png\n").unwrap();
    mesh
}

#[test]
fn doubtful_units_axes_and_missing_pictures_are_warnings_with_the_option_that_mends_them() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = doubtful(folder.path());
    let pack = folder.path().join("head.kilwa");
    let reports = [succeeds(&["info", text(&mesh)]), succeeds(&["build", text(&mesh), "-o", text(&pack)])];
    for report in &reports {
        assert!(report.contains("units: m (default), up: z (default)"), "{report}");
        let warnings: Vec<&str> =
            report.lines().skip(1).take_while(|l| l.trim_start().starts_with("warning")).collect();
        assert_eq!(warnings.len(), 3, "at the top: {report}");
        assert!(warnings[0].contains("skin.png: it is missing"), "{report}");
        assert!(warnings[1].contains("2048.000 m wide") && warnings[1].contains("--units mm (2.048 m)"), "{report}");
        assert!(warnings[2].contains("--up y"), "{report}");
    }
    let mended = ["--units", "mm", "--up", "y"];
    let report = succeeds(&[&["info", text(&mesh)][..], &mended].concat());
    assert!(report.contains("units: mm, up: y\n") && report.matches("warning").count() == 1, "{report}");
    let found = json(&[&["info", text(&mesh)][..], &mended].concat());
    assert_eq!(found["warnings"].as_array().unwrap().len(), 1);
    assert_eq!(found["read_as"], "units: mm, up: y");
}

#[test]
fn the_line_of_colours_names_the_pictures_and_the_option_that_keeps_their_detail() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = doubtful(folder.path());
    image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([x as u8 * 4, y as u8 * 4, 0]))
        .save(folder.path().join("skin.png"))
        .unwrap();
    let pack = folder.path().join("head.kilwa");
    let built = succeeds(&["build", text(&mesh), "-o", text(&pack)]);
    for report in [built, succeeds(&["info", text(&mesh)])] {
        let line = report.lines().find(|l| l.trim_start().starts_with("colours")).unwrap();
        assert!(line.contains("1 picture of 4,096 texels") && line.contains("about 32 texels apart"), "{line}");
        assert!(line.contains("--texture-detail 8"), "{line}");
    }
    let split = succeeds(&["build", text(&mesh), "-o", text(&pack), "--force", "--texture-detail", "8"]);
    let line = split.lines().find(|l| l.trim_start().starts_with("colours")).unwrap();
    assert!(!line.contains("--texture-detail"), "{line}");
}

#[test]
fn a_mesh_is_drawn_upright_before_anything_is_built() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, picture) = (folder.path().join("tower.obj"), folder.path().join("pictures/tower.png"));
    // A red pyramid that is taller than wide.
    let corners = "v -1 -1 0 1 0 0\nv 1 -1 0 1 0 0\nv 1 1 0 1 0 0\nv -1 1 0 1 0 0\nv 0 0 5 1 0 0\n";
    std::fs::write(&mesh, format!("{corners}f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 4 3 2 1\n")).unwrap();
    let is_red = |p: &image::Rgb<u8>| p[0] > 60 && p[1] < 30;
    let height = |up: &str| {
        succeeds(&["info", text(&mesh), "--up", up, "--picture", text(&picture), "--force"]);
        let drawn = image::open(&picture).unwrap().into_rgb8();
        assert_eq!(drawn.dimensions(), (640, 480));
        let red: Vec<(u32, u32)> =
            drawn.enumerate_pixels().filter(|(.., p)| is_red(p)).map(|(x, y, _)| (x, y)).collect();
        let span = |of: fn(&(u32, u32)) -> u32| red.iter().map(of).max().unwrap() - red.iter().map(of).min().unwrap();
        f64::from(span(|p| p.1)) / f64::from(span(|p| p.0))
    };
    let (upright, lying) = (height("z"), height("y"));
    assert!(upright > 1.2 && lying < upright, "{upright} {lying}");
    let refused = crate::support::fails(&["info", text(&mesh), "--picture", text(&picture)]);
    assert!(refused.contains("--force"), "{refused}");
}

//! Many inputs: files, folders and patterns in any order give the same bytes; each input goes where it belongs.

mod support;

use std::path::Path;
use support::{fails, json, kilwa, succeeds, text};

/// A wall in blocks, in a folder of its own.
fn blocks(folder: &Path) -> Vec<String> {
    let site = folder.join("site");
    std::fs::create_dir(&site).unwrap();
    let wall = site.join("wall.ply");
    succeeds(&["synth", "wall", "--triangles", "20k", "--blocks", "6", "-o", text(&wall)]);
    let mut files: Vec<String> =
        std::fs::read_dir(&site).unwrap().map(|e| e.unwrap().path().display().to_string()).collect();
    files.sort();
    assert!(files.len() >= 6, "{files:?}");
    files
}

#[test]
fn a_site_in_blocks_gives_the_same_bytes_in_any_order_as_a_folder_and_as_a_pattern() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = blocks(folder.path());
    let site = folder.path().join("site");
    let build = |name: &str, inputs: &[&str]| {
        let pack = folder.path().join(name);
        succeeds(&[&["build", "-o", text(&pack), "--title", "wall"], inputs].concat());
        std::fs::read(pack).unwrap()
    };
    let all: Vec<&str> = files.iter().map(String::as_str).collect();
    let given = build("given.kilwa", &all);
    files.reverse();
    let all: Vec<&str> = files.iter().map(String::as_str).collect();
    assert!(build("turned.kilwa", &all) == given, "the order does not matter");
    assert!(build("folder.kilwa", &[text(&site)]) == given, "a folder");
    let pattern = format!("{}/*.ply", site.display());
    assert!(build("pattern.kilwa", &[&pattern]) == given, "a pattern");
    let pack = folder.path().join("given.kilwa");
    let info = json(&["info", text(&pack)]);
    assert!(info.to_string().contains("sha256"), "{info}");
}

#[test]
fn blocks_that_were_moved_apart_close_up_again_by_their_matrices() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Two halves of a square, the second written 100 further on and mirrored.
    std::fs::write(path("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    std::fs::write(path("b.obj"), "v 99 0 0\nv 100 1 0\nv 99 1 0\nf 1 2 3\n").unwrap();
    std::fs::write(path("a.xf"), "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1").unwrap();
    std::fs::write(path("b.xf"), "-1 0 0 100  0 1 0 0  0 0 1 0  0 0 0 1").unwrap();
    let pack = path("a.kilwa");
    let inputs = [path("a.obj"), path("b.obj")];
    let args = ["build", text(&inputs[0]), text(&inputs[1]), "-o", text(&pack), "--transform", "auto"];
    let report = json(&args);
    assert_eq!(report["triangles"], 2);
    assert_eq!(report["vertices"], 4, "welded: {report}");
    assert_eq!(report["border_edges"], 4, "{report}");
    let said = fails(&["build", text(&inputs[0]), "-o", text(&path("c.kilwa")), "--transform", text(&inputs[1])]);
    assert!(said.contains("b.obj"), "{said}");
    std::fs::remove_file(path("b.xf")).unwrap();
    let again = fails(&[&args[..], &["--force"]].concat());
    assert!(again.contains("b.xf is not there"), "{again}");
}

#[test]
fn an_origin_is_added_in_the_units_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (obj, pack) = (folder.path().join("a.obj"), folder.path().join("a.kilwa"));
    std::fs::write(&obj, "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n").unwrap();
    let args = ["build", text(&obj), "-o", text(&pack), "--units", "mm", "--origin", "-500000,9000000,250"];
    succeeds(&args);
    let bounds = json(&["info", text(&pack)])["metadata"]["bounds_min"].clone();
    let near = |i: usize, v: f64| (bounds[i].as_f64().unwrap() - v).abs() < 0.01;
    assert!(near(0, -500.0) && near(1, 9000.0) && near(2, 0.25), "{bounds}");
    let usage = kilwa(&["build", text(&obj), "-o", text(&pack), "--origin", "1,2"]);
    assert_eq!(usage.status.code(), Some(2));
}

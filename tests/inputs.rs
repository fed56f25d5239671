//! Many inputs: files, folders and patterns in any order give the same bytes; each input is placed correctly.

use crate::support::{Input, Ply, fails, json, kilwa, succeeds, text};
use std::path::Path;

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
fn a_site_in_blocks_gives_the_same_bytes_in_any_order_from_a_folder_and_from_a_pattern() {
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

/// Numbers of the report that a seam would change.
const SURFACE: [&str; 9] = [
    "triangles",
    "vertices",
    "border_edges",
    "non_manifold_edges",
    "inconsistent_edges",
    "duplicate_triangles",
    "components",
    "largest_component",
    "stuck_triangles",
];

/// A mesh cut into `across` strips of as many triangles each, and these into `along` blocks: ragged borders, at which every
/// block has the vertices itself.
fn in_blocks(mesh: &Ply, across: usize, along: usize) -> Vec<Input> {
    let centre = |t: &[u32; 3], axis: usize| t.iter().map(|v| mesh.position(*v)[axis]).sum::<f64>();
    let mut triangles = mesh.triangles.clone();
    triangles.sort_by(|a, b| centre(a, 0).total_cmp(&centre(b, 0)));
    let mut blocks = Vec::new();
    for strip in triangles.chunks_mut(mesh.triangles.len().div_ceil(across)) {
        strip.sort_by(|a, b| centre(a, 1).total_cmp(&centre(b, 1)));
        for part in strip.chunks(strip.len().div_ceil(along)) {
            let (mut block, mut number) = (Input::default(), std::collections::HashMap::new());
            for t in part {
                let t = t.map(|v| {
                    *number.entry(v).or_insert_with(|| {
                        block.positions.push(mesh.position(v));
                        block.colors.push(["red", "green", "blue"].map(|c| mesh.get(v, c).unwrap() as u8));
                        block.positions.len() as u32 - 1
                    })
                });
                block.triangles.push(t);
            }
            blocks.push(block);
        }
    }
    blocks
}

/// A site like those in the literature: 96 files at map coordinates, in random order.
#[test]
fn ninety_six_blocks_in_any_order_are_the_whole_mesh_without_a_seam_at_any_level() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    succeeds(&["synth", "fort", "--triangles", "100k", "--utm", "-o", text(&path("whole.ply"))]);
    let build = |name: &str, inputs: &[String], options: &[&str]| {
        let pack = path(name);
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        let report = json(&[&["build", "-o", text(&pack), "--title", "fort"], options, &inputs].concat());
        (report, std::fs::read(pack).unwrap())
    };
    let (whole, whole_bytes) = build("whole.kilwa", &[text(&path("whole.ply")).to_owned()], &[]);

    let mut files: Vec<String> = Vec::new();
    for (b, block) in in_blocks(&Ply::read(&path("whole.ply")), 12, 8).iter().enumerate() {
        files.push(text(&path(&format!("part_{b:03}.ply"))).to_owned());
        block.write(Path::new(&files[b]));
    }
    assert_eq!(files.len(), 96);
    let (report, bytes) = build("given.kilwa", &files, &[]);
    for number in SURFACE {
        assert_eq!(report[number], whole[number], "{number}");
    }
    files.reverse();
    let (_, turned) = build("turned.kilwa", &files, &["--threads", "1"]);
    assert!(turned == bytes, "backwards");
    fastrand::Rng::with_seed(5).shuffle(&mut files);
    let (_, shuffled) = build("shuffled.kilwa", &files, &["--threads", "3", "--memory", "100M"]);
    assert!(shuffled == bytes, "shuffled");

    // Only the metadata about the source files differs from that of the whole mesh's pack; every chunk is the same.
    let chunks = |bytes: Vec<u8>| -> Vec<([u8; 16], f32)> {
        let reader = kilwa_pack::Reader::open(kilwa_pack::reader::SliceSource(bytes)).unwrap();
        reader.entries().iter().map(|e| (e.checksum, e.error)).collect()
    };
    assert!(chunks(bytes) == chunks(whole_bytes), "the same chunks as of the whole mesh, with the same bounds");
}

#[test]
fn blocks_moved_apart_are_rejoined_by_their_matrices() {
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
    let message = fails(&["build", text(&inputs[0]), "-o", text(&path("c.kilwa")), "--transform", text(&inputs[1])]);
    assert!(message.contains("b.obj"), "{message}");
    std::fs::remove_file(path("b.xf")).unwrap();
    let again = fails(&[&args[..], &["--force"]].concat());
    assert!(again.contains("b.xf does not exist"), "{again}");
}

#[test]
fn an_origin_is_added_in_the_units_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (obj, pack) = (folder.path().join("a.obj"), folder.path().join("a.kilwa"));
    std::fs::write(&obj, "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n").unwrap();
    let args = ["build", text(&obj), "-o", text(&pack), "--units", "mm", "--origin", "-500000,9000000,250"];
    let output = succeeds(&args);
    assert!(output.contains("levels 0.0"), "a pack of one chunk has no levels to build: {output}");
    let bounds = json(&["info", text(&pack)])["metadata"]["bounds_min"].clone();
    let near = |i: usize, v: f64| (bounds[i].as_f64().unwrap() - v).abs() < 0.01;
    assert!(near(0, -500.0) && near(1, 9000.0) && near(2, 0.25), "{bounds}");
    let usage = kilwa(&["build", text(&obj), "-o", text(&pack), "--origin", "1,2"]);
    assert_eq!(usage.status.code(), Some(2));
}

/// The build reads the mesh, its matrix, its materials and its picture, so its pack must not replace any of them.
#[test]
fn a_pack_never_replaces_a_file_that_the_build_reads() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let triangle = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(at("a.obj"), triangle).unwrap();
    std::fs::write(at("m.mtl"), "newmtl a\nKd 1 0 0\nmap_Kd p.png\n").unwrap();
    std::fs::write(at("a.xf"), "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1").unwrap();
    std::fs::write(at("p.png"), "a picture that nobody can decode").unwrap();
    for name in ["a.obj", "m.mtl", "a.xf", "p.png"] {
        let before = std::fs::read(at(name)).unwrap();
        let (mesh, output) = (at("a.obj"), at(name));
        let refused = kilwa(&["build", text(&mesh), "--transform", "auto", "-o", text(&output), "--force"]);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{name}: {message}");
        let reasons =
            ["is an input of this command; choose another name", "names end in .kilwa; choose a name such as"];
        assert!(reasons.iter().any(|reason| message.contains(reason)), "{name}: {message}");
        assert!(std::fs::read(at(name)).unwrap() == before, "{name} was replaced");
    }
    let (mesh, pack) = (at("a.obj"), at("a.kilwa"));
    for _ in 0..2 {
        succeeds(&["build", text(&mesh), "--transform", "auto", "-o", text(&pack), "--force"]);
    }
    let document = at("doc.json");
    let measure = |args: &[&str]| kilwa(&[&["measure", text(&pack), "--save", text(&document)], args].concat());
    assert!(measure(&["coordinate", "0", "0", "0", "--name", "precious"]).status.success());
    let before = std::fs::read(&document).unwrap();
    let refused = measure(&["section", "--x", "0.2", "--force", "-o", text(&document)]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(std::fs::read(&document).unwrap() == before, "{}", String::from_utf8_lossy(&refused.stderr));
}

/// Every command that writes a file, with one of its inputs as the output.
#[cfg(unix)]
#[test]
fn no_command_replaces_one_of_its_inputs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    succeeds(&["synth", "phantom", "--triangles", "300", "-o", &at("c.ply")]);
    succeeds(&["build", &at("c.ply"), "-o", &at("c.kilwa")]);
    succeeds(&["measure", &at("c.kilwa"), "distance", "0", "0", "0", "1", "1", "1", "--save", &at("doc.geojson")]);
    succeeds(&["access", "init", &at("accounts.json")]);
    std::fs::create_dir(at("served")).unwrap();
    std::fs::copy(at("c.kilwa"), at("served/c.kilwa")).unwrap();
    // The pack under names with the endings of other formats, and a link to it.
    for name in ["p.ply", "p.json", "p.png", "p.pgw", "q.kilwa"] {
        std::fs::copy(at("c.kilwa"), at(name)).unwrap();
    }
    std::os::unix::fs::symlink(at("q.kilwa"), at("link.png")).unwrap();
    std::fs::write(at("camera.png"), r#"{"target": [0, 0, 1], "distance": 5}"#).unwrap();
    std::fs::write(at("display.png"), "{}").unwrap();
    let of = |args: &[&str]| args.iter().map(|a| (*a).to_owned()).collect::<Vec<String>>();
    let measure = |pack: &str, more: &[&str]| of(&[&["measure", pack], more].concat());
    let calls: Vec<(&str, Vec<String>)> = vec![
        ("p.ply", of(&["extract", &at("p.ply"), "-o", &at("p.ply"), "--force"])),
        ("p.json", measure(&at("p.json"), &["section", "--z", "0.5", "-o", &at("p.json"), "--force"])),
        ("p.json", measure(&at("p.json"), &["area", "--save", &at("p.json")])),
        ("doc.geojson", measure(&at("c.kilwa"), &["again", &at("doc.geojson"), "-o", &at("doc.geojson"), "--force"])),
        ("p.png", of(&["render", &at("p.png"), "-o", &at("p.png"), "--force"])),
        ("q.kilwa", of(&["render", &at("q.kilwa"), "-o", &at("link.png"), "--force"])),
        ("p.pgw", of(&["render", &at("p.pgw"), "-o", &at("p.png"), "--view", "plan", "--scale", "1:100", "--force"])),
        (
            "camera.png",
            of(&["render", &at("c.kilwa"), "--camera", &at("camera.png"), "-o", &at("camera.png"), "--force"]),
        ),
        (
            "display.png",
            of(&["render", &at("c.kilwa"), "--display", &at("display.png"), "-o", &at("display.png"), "--force"]),
        ),
        ("c.kilwa", of(&["verify", &at("c.kilwa"), "--state", &at("c.kilwa")])),
        (
            "accounts.json",
            of(&[
                "serve",
                &at("served"),
                "--listen",
                "127.0.0.1:0",
                "--access",
                &at("accounts.json"),
                "--audit",
                &at("accounts.json"),
            ]),
        ),
    ];
    for (input, call) in calls {
        let before = std::fs::read(at(input)).unwrap();
        let message = fails(&call.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(
            message.contains("an input of this command; choose another name") && message.contains(input),
            "{call:?}: {message}"
        );
        assert!(std::fs::read(at(input)).unwrap() == before, "{call:?}");
    }
}

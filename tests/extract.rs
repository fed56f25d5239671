//! `kilwa extract` in every format: extracts can be read again, no cut has cracks, boxes tile the model, `--max-triangles`
//! is respected, and nothing is overwritten.

use crate::support::{Input, Ply, built_once, fails, json, kilwa, succeeds, text};
use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_formats::read::read_mesh;
use kilwa_geometry::Lattice;
use kilwa_pack::{PackWriter, Reader, SliceSource, Source};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Where the torus lies: coordinates of a map, which a float cannot hold.
const FAR: [f64; 3] = [531_000.0, 9_010_000.0, 12.0];

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("extract");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// The pack of a closed, coloured torus.
fn torus() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let write = |to: &Path| Input::torus(256, 64, FAR).write(to);
    BUILT.get_or_init(|| built_once(&folder(), "torus", write, &["--crs", "EPSG:32737"]))
}

/// The pack of a synthetic site.
fn site(which: &str, triangles: &str) -> PathBuf {
    let write = |to: &Path| drop(succeeds(&["synth", which, "--triangles", triangles, "-o", text(to), "--force"]));
    built_once(&folder(), which, write, &[])
}

fn lattice(pack: &Path) -> Lattice {
    let info = json(&["info", text(pack)]);
    let step = info["lattice_step"].as_f64().unwrap();
    let origin = [0, 1, 2].map(|k| info["lattice_origin"][k].as_f64().unwrap());
    Lattice { origin: origin.into(), step_log2: step.log2().round() as i32 }
}

type Corner = ([i32; 3], Option<[u8; 3]>);

/// Triangles as a sorted multiset of lattice corners with colours, each rotated to its smallest form.
fn multiset(mesh: &RawMesh, lattice: &Lattice, world: impl Fn(DVec3) -> DVec3) -> Vec<[Corner; 3]> {
    let corner = |v: u32| {
        let v = v as usize;
        (lattice.snap(world(mesh.positions[v])).expect("inside the lattice").to_array(), mesh.colors.get(v).copied())
    };
    let rotated = |[a, b, c]: [Corner; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap();
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| rotated(t.map(corner))).collect();
    all.sort_unstable();
    all
}

fn read(path: &Path) -> RawMesh {
    read_mesh(path, &mut |_, _| {}).unwrap_or_else(|e| panic!("{e}"))
}

/// Positions in world coordinates: GLB has y up, an STL may be relative to a point.
fn to_world(report: &serde_json::Value) -> impl Fn(DVec3) -> DVec3 + use<> {
    let y_up = report["format"] == "glb";
    let offset = DVec3::from([0, 1, 2].map(|k| report["offset"][k].as_f64().unwrap_or(0.0)));
    move |p| offset + if y_up { DVec3::new(p.x, -p.z, p.y) } else { p }
}

/// How many triangles use each edge, edges named by the positions of their ends.
fn edge_uses(mesh: &RawMesh) -> BTreeMap<[[u64; 3]; 2], u32> {
    let mut uses = BTreeMap::new();
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            let mut ends = [a, b].map(|v| mesh.positions[v as usize].to_array().map(f64::to_bits));
            ends.sort_unstable();
            *uses.entry(ends).or_default() += 1;
        }
    }
    uses
}

#[test]
fn every_format_contains_the_finest_level_as_far_as_it_can_represent_it() {
    let work = tempfile::tempdir().unwrap();
    let lattice = lattice(torus());
    let whole = work.path().join("whole.ply");
    succeeds(&["extract", text(torus()), "-o", text(&whole)]);
    let whole = read(&whole);
    let wanted = multiset(&whole, &lattice, |p| p);
    let uncoloured: Vec<_> = {
        let plain = RawMesh { colors: Vec::new(), ..whole.clone() };
        multiset(&plain, &lattice, |p| p)
    };
    for (name, ascii, colored) in
        [("a.obj", false, true), ("a.stl", false, false), ("a.glb", false, true), ("b.ply", true, true)]
    {
        let out = work.path().join(name);
        let mut args = vec!["extract", text(torus()), "-o", text(&out)];
        args.extend(ascii.then_some("--ascii"));
        let report = json(&args);
        assert_eq!((report["triangles"].as_u64(), report["max_error"].as_f64()), (Some(32_768), Some(0.0)));
        assert_eq!(report["bytes"], std::fs::metadata(&out).unwrap().len());
        let back = read(&out);
        let found = multiset(&back, &lattice, to_world(&report));
        assert!(found == if colored { wanted.clone() } else { uncoloured.clone() }, "{name}: the same triangles");
        if colored {
            assert_eq!(back.positions.len(), whole.positions.len(), "{name}: vertices are shared");
        }
        let lost = report["left_out"].to_string();
        assert_eq!(lost.contains("colours"), !colored, "{name}: {lost}");
    }
}

#[test]
fn a_compressed_glb_has_the_same_triangles_and_is_valid() {
    let work = tempfile::tempdir().unwrap();
    // Enough vertices for several parts.
    let fort = site("fort", "300000");
    let lattice = lattice(&fort);
    let (plain, packed) = (work.path().join("plain.glb"), work.path().join("packed.glb"));
    let before = json(&["extract", text(&fort), "-o", text(&plain)]);
    let report = json(&["extract", text(&fort), "-o", text(&packed), "--compress"]);
    assert_eq!((&report["triangles"], &report["compressed"]), (&before["triangles"], &true.into()));
    assert_eq!(report["bytes"], std::fs::metadata(&packed).unwrap().len());
    let world = to_world(&report);
    let (expected, found) = (read(&plain), read(&packed));
    assert!(multiset(&found, &lattice, &world) == multiset(&expected, &lattice, &world), "the same triangles");
    let ratio = before["bytes"].as_f64().unwrap() / report["bytes"].as_f64().unwrap();
    assert!(ratio > 2.5, "{ratio:.2} times smaller");
    assert_eq!(gltf_json(&packed)["extensionsRequired"][0], "EXT_meshopt_compression");
    assert!(gltf_json(&packed)["meshes"][0]["primitives"].as_array().unwrap().len() > 1);
    validate(&packed, &["UNSUPPORTED_EXTENSION"]);
    // Other formats have no such form.
    let ply = work.path().join("a.ply");
    let message = fails(&["extract", text(&fort), "-o", text(&ply), "--compress"]);
    assert!(message.contains("--compress works only with GLB; omit it for PLY"), "{message}");
    assert!(!ply.exists());
}

#[test]
fn a_compressed_cut_has_no_cracks() {
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("a.glb");
    for limit in ["0.02", "0"] {
        succeeds(&["extract", text(torus()), "-o", text(&out), "--force", "--compress", "--max-error", limit]);
        assert!(edge_uses(&read(&out)).values().all(|&n| n == 2), "a closed mesh stays closed at {limit} m");
    }
}

#[test]
fn an_extracted_mesh_builds_to_the_same_finest_level() {
    let work = tempfile::tempdir().unwrap();
    let step = json(&["info", text(torus())])["lattice_step"].to_string();
    let whole = work.path().join("whole.ply");
    succeeds(&["extract", text(torus()), "-o", text(&whole)]);
    let lattice = lattice(torus());
    let wanted = multiset(&read(&whole), &lattice, |p| p);
    for (name, up) in [("a.obj", "z"), ("a.glb", "y"), ("a.ply", "z")] {
        let (out, pack, back) = (work.path().join(name), work.path().join("a.kilwa"), work.path().join("back.ply"));
        succeeds(&["extract", text(torus()), "-o", text(&out)]);
        succeeds(&["build", text(&out), "-o", text(&pack), "--up", up, "--step", &step, "--force"]);
        succeeds(&["extract", text(&pack), "-o", text(&back), "--force"]);
        assert!(multiset(&read(&back), &lattice, |p| p) == wanted, "{name}");
    }
}

#[test]
fn no_cut_has_cracks_in_any_format() {
    let work = tempfile::tempdir().unwrap();
    for limit in ["0.1", "0.02", "0.005", "0"] {
        for name in ["a.obj", "a.stl", "a.glb"] {
            let out = work.path().join(name);
            succeeds(&["extract", text(torus()), "-o", text(&out), "--force", "--max-error", limit]);
            assert!(
                edge_uses(&read(&out)).values().all(|&n| n == 2),
                "{name}: a closed mesh stays closed at {limit} m"
            );
        }
    }
}

#[test]
fn boxes_that_tile_the_model_give_every_triangle_exactly_once() {
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("part.ply");
    let [x, y, z] = FAR;
    let cut = x + 0.123_456_789;
    let boxes = [
        format!("{},{},{},{cut},{},{}", x - 9.0, y - 9.0, z - 9.0, y + 9.0, z + 9.0),
        format!("{},{},{},{},{},{}", cut + 1e-9, y - 9.0, z - 9.0, x + 9.0, y + 9.0, z + 9.0),
    ];
    for limit in [&[][..], &["--max-error", "0.02"]] {
        let whole = [&["extract", text(torus()), "-o", text(&out), "--force"], limit].concat();
        let all = json(&whole);
        let mut triangles = 0;
        for region in &boxes {
            let part = json(&[&whole[..], &["--box", region]].concat());
            triangles += part["triangles"].as_u64().unwrap();
            assert!(part["max_error"].as_f64() <= all["max_error"].as_f64());
            assert!(part["vertices"].as_u64() < all["vertices"].as_u64());
        }
        assert_eq!(Some(triangles), all["triangles"].as_u64());
    }
    let large = built_once(&folder(), "large", |to| Input::torus(1280, 128, FAR).write(to), &[]);
    let limit = ["--box", &boxes[0], "--max-triangles", "60000"];
    let part = json(&[&["extract", text(&large), "-o", text(&out), "--force"][..], &limit].concat());
    let found = part["triangles"].as_u64().unwrap();
    assert!((59_999..=60_000).contains(&found), "the count is of what lies in the box: {found}");
    let nowhere = work.path().join("nowhere.ply");
    let message = fails(&["extract", text(torus()), "-o", text(&nowhere), "--box", "0,0,0,1,1,1"]);
    assert!(
        message.contains("no triangle has its centroid in the box 0,0,0,1,1,1; it spans") && !nowhere.exists(),
        "{message}"
    );
    let usage = kilwa(&["extract", text(torus()), "-o", text(&nowhere), "--box", "1,2,3"]);
    assert_eq!(usage.status.code(), Some(2));
}

#[test]
fn max_triangles_is_met_on_three_meshes_or_the_excess_is_explained() {
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("a.stl");
    let mut kept = 0;
    for pack in [torus().to_owned(), site("wall", "40000"), site("fort", "40000")] {
        let all = json(&["info", text(&pack)])["metadata"]["triangles"].as_u64().unwrap();
        for share in [5, 10, 20, 35, 50, 70, 90, 100, 200] {
            let limit = all * share / 100;
            let output = kilwa(&[
                "extract",
                text(&pack),
                "-o",
                text(&out),
                "--force",
                "--json",
                "--max-triangles",
                &limit.to_string(),
            ]);
            let message = String::from_utf8_lossy(&output.stderr).into_owned();
            let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect(&message);
            let found = report["triangles"].as_u64().unwrap();
            // A collapse takes two triangles, and more where more meet at an edge.
            let promise = found <= limit && (found + 8 >= limit || report["max_error"] == 0.0);
            let is_explained = found > limit && message.contains("cannot be simplified further");
            assert!(promise || is_explained, "{}: {found} of {limit}: {message}", pack.display());
            kept += u32::from(promise);
        }
    }
    assert!(kept >= 24, "kept {kept} times of 27");
}

#[test]
fn a_glb_is_valid_and_has_the_position_and_colours_of_the_pack() {
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("a.glb");
    succeeds(&["extract", text(torus()), "-o", text(&out), "--max-error", "0.01"]);
    let file = gltf_json(&out);
    let matrix: Vec<f64> = file["nodes"][0]["matrix"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    assert!((matrix[12] - FAR[0]).abs() < 1.0 && (matrix[14] + FAR[1]).abs() < 1.0, "the node stands at the place");
    assert!(file["accessors"][0]["max"][0].as_f64().unwrap() < 10.0, "positions are relative to it");
    assert_eq!(file["accessors"][3]["componentType"], 5123, "colours of 16 bits");
    validate(&out, &[]);
}

/// The JSON of a GLB.
fn gltf_json(path: &Path) -> serde_json::Value {
    let bytes = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

/// No errors and no warnings by Khronos' validator, where it is installed, except those with these codes.
fn validate(out: &Path, except: &[&str]) {
    let validator = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser/node_modules/gltf-validator/index.js");
    if !validator.is_file() {
        println!("skipped: {} is not here (cargo xtask test installs it)", validator.display());
        return;
    }
    let script = "const v = require(process.argv[1]); const fs = require('fs');
        v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2]))).then(r => console.log(JSON.stringify(r)));";
    let output = Command::new("node").args(["-e", script, text(&validator), text(out)]).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a report");
    let messages = report["issues"]["messages"].as_array().expect("a list");
    let is_serious = |m: &&serde_json::Value| {
        m["severity"].as_u64().is_none_or(|severity| severity < 2) && !except.iter().any(|code| m["code"] == *code)
    };
    let serious: Vec<_> = messages.iter().filter(is_serious).collect();
    assert!(serious.is_empty(), "{serious:#?}");
}

#[test]
fn unwritable_output_is_refused_by_name_before_anything_is_written() {
    let work = tempfile::tempdir().unwrap();
    for (name, part) in [("a.gltf", ".glb"), ("a.nxz", "cannot write .nxz"), ("a", "ends in .ply, .obj")] {
        let out = work.path().join(name);
        assert!(fails(&["extract", text(torus()), "-o", text(&out)]).contains(part), "{name}");
    }
    let stl = work.path().join("a.stl");
    assert!(fails(&["extract", text(torus()), "-o", text(&stl), "--ascii"]).contains("--ascii works only with PLY"));
    assert!(std::fs::read_dir(work.path()).unwrap().next().is_none());

    let pack = work.path().join("pack.ply");
    std::fs::copy(torus(), &pack).unwrap();
    let message = fails(&["extract", text(&pack), "-o", text(&work.path().join("./pack.ply")), "--force"]);
    assert!(message.contains("is an input of this command"), "{message}");
    assert_eq!(std::fs::read(&pack).unwrap(), std::fs::read(torus()).unwrap());

    std::fs::write(&stl, "precious").unwrap();
    assert!(fails(&["extract", text(torus()), "-o", text(&stl)]).contains("--force"));
    assert_eq!(std::fs::read_to_string(&stl).unwrap(), "precious");
    succeeds(&["extract", text(torus()), "-o", text(&stl), "--force"]);
    assert_eq!(read(&stl).triangles.len(), 32_768);
    assert_eq!(std::fs::read_dir(work.path()).unwrap().count(), 2, "no scratch file is left");
}

#[test]
fn the_ply_reader_of_the_tests_agrees_on_the_contents_of_a_box() {
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("part.ply");
    let [x, y, z] = FAR;
    let region = format!("{x},{y},{z},{},{},{}", x + 9.0, y + 9.0, z + 9.0);
    succeeds(&["extract", text(torus()), "-o", text(&out), "--box", &region]);
    let part = Ply::read(&out);
    assert!(!part.triangles.is_empty());
    for t in &part.triangles {
        let corners = t.map(|v| part.position(v));
        let inside = |k: usize| corners.iter().map(|c| c[k]).sum::<f64>() / 3.0 >= FAR[k] - 1e-6;
        assert!((0..3).all(inside), "a centroid lies outside: {corners:?}");
    }
}

/// A copy of a pack with another lattice: the same chunks with another spacing and origin.
fn on_lattice(pack: &Path, lattice: Lattice, to: &Path) {
    let reader = Reader::open(SliceSource(std::fs::read(pack).unwrap())).unwrap();
    let from = reader.header().lattice;
    let ratio = 2f64.powi(lattice.step_log2 - from.step_log2);
    let (mut header, mut metadata) = (reader.header().clone(), reader.metadata().clone());
    header.lattice = lattice;
    metadata.lattice_step = lattice.step();
    metadata.median_edge *= ratio;
    for corner in [&mut metadata.bounds_min, &mut metadata.bounds_max] {
        *corner = lattice.world_from_steps(from.steps_from_world(*corner).round());
    }
    let mut entries = reader.entries().to_vec();
    for entry in entries.iter_mut().filter(|entry| entry.error.is_finite()) {
        entry.error = (f64::from(entry.error) * ratio).min(f64::from(f32::MAX)) as f32;
    }
    let mut writer = PackWriter::begin(Vec::new(), header, &metadata, entries).unwrap();
    for entry in reader.entries() {
        writer.chunk(&reader.source().read_at(entry.offset, entry.encoded_bytes as usize).unwrap()).unwrap();
    }
    std::fs::write(to, writer.finish().unwrap()).unwrap();
}

/// The positions in a file as stored, without the offset.
fn numbers(path: &Path) -> Vec<[f64; 3]> {
    let bytes = std::fs::read(path).unwrap();
    let float = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let floats = |at: usize| [float(at), float(at + 4), float(at + 8)];
    match path.extension().unwrap().to_str().unwrap() {
        "ply" => Ply::read(path).vertices.iter().map(|v| [v[0], v[1], v[2]]).collect(),
        "obj" => {
            let text = String::from_utf8(bytes).unwrap();
            let vertices = text.lines().filter_map(|line| line.strip_prefix("v "));
            let three = |line: &str| {
                let words: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
                [words[0], words[1], words[2]]
            };
            vertices.map(three).collect()
        }
        "stl" => (84..bytes.len()).step_by(50).flat_map(|at| [12, 24, 36].map(|corner| floats(at + corner))).collect(),
        _ => {
            let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
            let file: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
            let limits = ["min", "max"].map(|name| file["accessors"][0][name].as_array().unwrap());
            assert!(limits.iter().all(|three| three.iter().all(serde_json::Value::is_number)), "{limits:?}");
            let (count, stride) = (&file["accessors"][0]["count"], &file["bufferViews"][0]["byteStride"]);
            let stride = stride.as_u64().unwrap() as usize;
            (0..count.as_u64().unwrap() as usize).map(|v| floats(20 + length + 8 + v * stride)).collect()
        }
    }
}

/// FORMAT.md allows a lattice spacing of 2^-1000 to 2^1000 m, and any origin.
#[test]
fn coordinates_that_a_format_cannot_represent_are_refused_and_others_stay_distinct() {
    let work = tempfile::tempdir().unwrap();
    let base = built_once(&folder(), "small", |to| Input::torus(32, 16, [0.0; 3]).write(to), &[]);
    let different = |path: &Path| {
        let all = numbers(path);
        assert!(all.iter().flatten().all(|x| x.is_finite()), "{}", path.display());
        all.iter().map(|p| p.map(f64::to_bits)).collect::<std::collections::BTreeSet<_>>().len()
    };
    let plain = work.path().join("plain.ply");
    succeeds(&["extract", text(&base), "-o", text(&plain)]);
    let wanted = different(&plain);
    let pack = work.path().join("a.kilwa");
    for (step_log2, at, ply, [double, float]) in [
        (-13, 0.0, "float", [true, true]),
        (-13, 9e6, "double", [true, true]),
        (60, 0.0, "float", [true, true]),
        (200, 0.0, "double", [true, false]),
        (900, 0.0, "double", [true, false]),
        (-200, 0.0, "double", [true, false]),
        (-900, 0.0, "double", [true, false]),
        (-40, 5e5, "", [false, true]),
        (-10, 1e15, "", [false, true]),
        (0, 1e300, "", [false, true]),
        (-900, 5e5, "", [false, false]),
    ] {
        on_lattice(&base, Lattice { origin: DVec3::new(at, -at, at), step_log2 }, &pack);
        for (name, ascii, fits) in [
            ("a.ply", false, double),
            ("b.ply", true, double),
            ("a.obj", false, double),
            ("a.stl", false, float),
            ("a.glb", false, float),
        ] {
            let case = format!("{name}, steps of 2^{step_log2} m at {at:?}");
            let out = work.path().join(name);
            let mut args = vec!["extract", text(&pack), "-o", text(&out)];
            args.extend(ascii.then_some("--ascii"));
            if fits {
                let report = json(&args);
                assert_eq!(different(&out), wanted, "{case}");
                if name.ends_with("ply") {
                    assert_eq!(report["coordinates"], ply, "{case}");
                }
                std::fs::remove_file(&out).unwrap();
            } else {
                let message = fails(&args);
                assert!(
                    message.contains("a.kilwa") && message.contains(&format!("2^{step_log2} m")),
                    "{case}: {message}"
                );
                assert!(message.contains("instead") || message.contains("no other format"), "{case}: {message}");
                assert!(!out.exists(), "{case}");
            }
        }
    }
}

#[test]
fn the_header_of_an_stl_contains_the_complete_offset_however_long_its_numbers() {
    let work = tempfile::tempdir().unwrap();
    let base = built_once(&folder(), "small", |to| Input::torus(32, 16, [0.0; 3]).write(to), &[]);
    let (pack, out) = (work.path().join("a.kilwa"), work.path().join("a.stl"));
    on_lattice(&base, Lattice { origin: DVec3::new(1e300, -1e300, 0.1), step_log2: -13 }, &pack);
    let report = json(&["extract", text(&pack), "-o", text(&out)]);
    let header = String::from_utf8(std::fs::read(&out).unwrap()[..80].to_vec()).unwrap();
    let words = header.split(' ').filter_map(|word| word.parse::<f64>().ok());
    assert_eq!(serde_json::json!(words.collect::<Vec<_>>()), report["offset"], "{header}");
}

#[test]
fn tiles_are_placed_on_the_globe_and_say_what_they_assume() {
    let work = tempfile::tempdir().unwrap();
    let at = |name: &str| work.path().join(name);
    let pack = torus();
    let call = |name: &str, more: &[&str]| {
        let out = at(name);
        json(&[&["extract", text(pack), "--to", "tiles", "-o", text(&out)], more].concat())
    };
    let web = call("web", &[]);
    assert_eq!((&web["format"], &web["profile"], &web["crs"]), (&"tiles".into(), &"web".into(), &"EPSG:32737".into()));
    assert_eq!((&web["triangles"], &web["geoid_offset"]), (&(2 * 256 * 64).into(), &0.0.into()));
    assert!(web["notes"][0].as_str().unwrap().contains("--geoid-offset METRES"), "{web}");
    let origin = |name: &str| {
        let file = std::fs::read(at(name).join("tileset.json")).unwrap();
        let tileset: serde_json::Value = serde_json::from_slice(&file).unwrap();
        DVec3::from([12, 13, 14].map(|k| tileset["root"]["transform"][k].as_f64().unwrap()))
    };
    // The value of pyproj for a point near the middle (`kilwa_archive::location::projection`).
    assert!(origin("web").distance(DVec3::new(4_877_142.54, 3_989_337.43, -986_357.82)) < 20.0);
    let plain = call("plain", &["--profile", "plain", "--geoid-offset", "-28.5"]);
    assert_eq!((&plain["profile"], &plain["notes"]), (&"plain".into(), &serde_json::json!([])));
    assert!((origin("plain").distance(origin("web")) - 28.5).abs() < 1e-6);
    let local = call("local", &["--crs", "local"]);
    assert!(local["notes"][0].as_str().unwrap().contains("--crs local was given"), "{local}");
    assert!(origin("local").distance(FAR.into()) < 20.0);
    assert!(succeeds(&["extract", text(pack), "--to", "tiles", "-o", text(&at("text"))]).contains("triangles"));
}

#[test]
fn tiles_that_cannot_be_written_are_refused_with_a_way_out() {
    let work = tempfile::tempdir().unwrap();
    let (there, new) = (work.path().join("there"), work.path().join("new"));
    std::fs::create_dir(&there).unwrap();
    let pack = text(torus());
    let tiles =
        |out: &Path, more: &[&str]| fails(&[&["extract", pack, "--to", "tiles", "-o", text(out)], more].concat());
    assert!(tiles(&there, &[]).contains("already exists; remove it, or choose another name"));
    let unknown = tiles(&new, &["--crs", "EPSG:1999"]);
    assert!(unknown.contains("EPSG:1999") && unknown.contains("--crs local"), "{unknown}");
    assert!(tiles(&new, &["--crs", "nowhere"]).contains("is not a reference system"));
    assert!(tiles(&new, &["--crs", "local", "--geoid-offset", "1"]).contains("--crs EPSG:N"));
    for more in [&["--force"][..], &["--max-error", "1"], &["--box", "0,0,0,1,1,1"]] {
        let output = kilwa(&[&["extract", pack, "--to", "tiles", "-o", text(&new)], more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
    }
    let output = kilwa(&["extract", pack, "-o", text(&work.path().join("a.ply")), "--geoid-offset", "1"]);
    assert_eq!(output.status.code(), Some(2), "only with --to");
    assert!(!new.exists());
}

//! `kilwa colour`: a model gets its colours from simulated photographs.

use crate::interrupted::leaves_nothing_partial;
use crate::scans::box_scan;
use crate::support::{Ply, fails, json, kilwa, made_once, succeeds, text};
use std::path::{Path, PathBuf};

/// Simulate photographs of the fort.
fn photograph(size: &str, out: &Path) {
    succeeds(&["synth", "photos", "--photos", "8", "--panoramas", "1", "--size", size, "-o", text(out)]);
}

/// Simulated photographs of the fort, which several tests read.
fn photographs(size: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("colour").join(size);
    made_once(&path, |out| photograph(size, out)).join("photos")
}

/// The fort as a pack, and as a mesh without colours.
fn fort(folder: &Path, triangles: &str) -> [PathBuf; 2] {
    let [colored, pack, plain] = ["colored.ply", "fort.kilwa", "fort.stl"].map(|name| folder.join(name));
    succeeds(&["synth", "fort", "--triangles", triangles, "-o", text(&colored)]);
    succeeds(&[
        "build",
        text(&colored),
        "--title",
        "The fort",
        "--crs",
        "EPSG:32737",
        "--capture-accuracy",
        "0.005",
        "-o",
        text(&pack),
    ]);
    succeeds(&["extract", text(&pack), "-o", text(&plain)]);
    [pack, plain]
}

/// Mean colour of the vertices that photographs see, and how many do.
fn seen(ply: &Ply) -> ([f64; 3], usize) {
    let seen: Vec<u32> = (0..ply.vertices.len() as u32).filter(|v| ply.get(*v, "photos").unwrap() > 0.0).collect();
    let mean = |name| seen.iter().map(|v| ply.get(*v, name).unwrap()).sum::<f64>() / seen.len().max(1) as f64;
    (["red", "green", "blue"].map(mean), seen.len())
}

#[test]
fn a_mesh_and_a_pack_get_the_same_colours_from_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photos = photographs("160x120");
    let [pack, plain] = fort(folder.path(), "40k");
    let mesh = at("mesh.ply");
    let written = at("report.json");
    let report =
        json(&["colour", text(&plain), "--photos", text(&photos), "-o", text(&mesh), "--report", text(&written)]);
    let (survey, page) = (at("survey"), at("report.html"));
    succeeds(&["scans", "import", text(&box_scan(folder.path())), "-o", text(&survey)]);
    succeeds(&["scans", "report", text(&survey), "--colour", text(&written), "-o", text(&page)]);
    let page = std::fs::read_to_string(&page).unwrap();
    assert!(page.contains("IMG_0008.jpg") && page.contains("panoramas/"), "{page}");
    let written: serde_json::Value = serde_json::from_slice(&std::fs::read(written).unwrap()).unwrap();
    assert_eq!(written["photographs"], report["photographs"]);
    let shares = written["photographs"].as_array().unwrap().iter().map(|photo| photo["share"].as_f64().unwrap());
    assert!(shares.sum::<f64>() > 1000.0, "{written}");
    let ply = Ply::read(&mesh);
    assert_eq!(report["vertices"], ply.vertices.len());
    assert_eq!(report["photographs"].as_array().unwrap().len(), 8, "{report}");
    // A panorama has no pose without a survey.
    assert!(report["left_out"][0]["name"].as_str().unwrap().contains("panoramas"), "{report}");
    let (color, count) = seen(&ply);
    assert!(count > ply.vertices.len() / 10, "{count} of {}", ply.vertices.len());
    // Masonry in the sun: neither the grey of a mesh without colours nor black.
    assert!(color[0] > color[2] + 5.0 && color[0] > 60.0 && color[0] < 230.0, "{color:?}");

    let coloured = at("coloured.kilwa");
    let options = ["--photos", text(&photos), "--threads", "1", "--memory", "200M", "-o", text(&coloured)];
    succeeds(&[&["colour", text(&pack)], options.as_slice()].concat());
    succeeds(&["verify", text(&coloured)]);
    let info = json(&["info", text(&coloured)]);
    assert!(info.to_string().contains("The fort") && info.to_string().contains("IMG_0001.jpg"), "{info}");
    let back = at("back.ply");
    succeeds(&["extract", text(&coloured), "-o", text(&back)]);
    let back = Ply::read(&back);
    // Vertices on the borders of chunks have one colour, so the surface has no more of them than before.
    let before = at("before.ply");
    succeeds(&["extract", text(&pack), "-o", text(&before)]);
    assert_eq!(back.vertices.len(), Ply::read(&before).vertices.len());
    // What was not known of the accuracy is not invented.
    assert_eq!(info["metadata"]["capture_accuracy"], 0.005, "{info}");
    assert!(info["metadata"]["capture_registration"].is_null(), "{info}");
    // Colouring again replaces the channel.
    let again = at("again.kilwa");
    succeeds(&["colour", text(&coloured), "--photos", text(&photos), "-o", text(&again)]);
    let again = json(&["info", text(&again)]);
    let named = |info: &serde_json::Value| info["metadata"]["scalars"].to_string().matches("photos").count();
    assert_eq!((named(&again), named(&info)), (1, 1));
    assert_eq!(again["metadata"]["sources"], info["metadata"]["sources"]);
    // The mesh was rounded to a lattice of its own, and triangles that became degenerate were dropped.
    let (other, same) = seen(&back);
    assert!((same as f64 / count as f64 - 1.0).abs() < 0.02, "{same} {count}");
    assert!(color.iter().zip(other).all(|(a, b)| (a - b).abs() < 3.0), "{color:?} {other:?}");
    // What no photograph sees keeps its own colour, in the tone of the photographs.
    let unseen = (0..back.vertices.len() as u32).filter(|v| back.get(*v, "photos") == Some(0.0));
    let levels: std::collections::HashSet<u64> = unseen.map(|v| back.get(v, "red").unwrap() as u64).collect();
    assert!(levels.len() > 20, "{levels:?}");
}

#[test]
fn triangles_are_split_for_the_detail_of_photographs_in_meshes_and_packs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photos = photographs("160x120");
    let [pack, plain] = fort(folder.path(), "10k");
    let (mesh, fine) = (at("mesh.ply"), at("fine.kilwa"));
    let options = ["--photos", text(&photos), "--texture-detail", "2", "-o"];
    let report = json(&[&["colour", text(&plain)], options.as_slice(), &[text(&mesh)]].concat());
    let split = &report["triangles_split"];
    let count = |name: &str| split[name].as_u64().unwrap();
    assert!(count("after") > 2 * count("before"), "{split}");
    let ply = Ply::read(&mesh);
    assert_eq!(
        (report["triangles"].as_u64().unwrap(), report["vertices"].as_u64().unwrap()),
        (count("after"), ply.vertices.len() as u64)
    );
    let (color, _) = seen(&ply);

    let printed = succeeds(&[&["colour", text(&pack)], options.as_slice(), &[text(&fine)]].concat());
    assert!(printed.contains("triangles of the surface were split into"), "{printed}");
    succeeds(&["verify", text(&fine)]);
    // What the pack stated about itself is not lost, and no temporary file is named.
    let [before, after] = [&pack, &fine].map(|pack| json(&["info", text(pack)])["metadata"].clone());
    for name in ["title", "capture_accuracy", "crs"] {
        assert!(before[name] == after[name] && !after[name].is_null(), "{name}: {before} {after}");
    }
    let sources = after["sources"].to_string();
    assert!(
        sources.contains("colored.ply") && sources.contains("IMG_0001.jpg") && !sources.contains("model"),
        "{sources}"
    );
    let back = at("back.ply");
    succeeds(&["extract", text(&fine), "-o", text(&back)]);
    let back = Ply::read(&back);
    assert!(back.vertices.len() as f64 > 0.95 * ply.vertices.len() as f64);
    let (other, _) = seen(&back);
    assert!(color.iter().zip(other).all(|(a, b)| (a - b).abs() < 3.0), "{color:?} {other:?}");
    // Nor is it lost in a mesh.
    let named = at("named.ply");
    succeeds(&[&["colour", text(&pack)], options.as_slice(), &[text(&named)]].concat());
    let start = std::fs::read(&named).unwrap();
    let header = String::from_utf8_lossy(&start[..start.len().min(1000)]).into_owned();
    assert!(header.contains("The fort") && header.contains("EPSG:32737"), "{header}");
    let none = at("no.ply");
    let output =
        kilwa(&["colour", text(&pack), "--photos", text(&photos), "--texture-detail", "0.5", "-o", text(&none)]);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("expected a number from 1 to 65536"), "{error}");
}

#[test]
fn errors_state_what_to_do_if_a_model_cannot_be_coloured() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    photograph("48x36", &at("session"));
    let photos = at("session/photos");
    let [pack, plain] = fort(folder.path(), "6k");
    let out = at("out.ply");
    let refused = |args: &[&str], expected: &str| {
        let error = fails(&[&["colour"], args].concat());
        assert!(error.contains(expected), "{args:?}: {error}");
        assert!(!out.exists() && !at("out.stl").exists());
    };
    let (photos, pack, out_name) = (text(&photos), text(&pack), text(&out));
    refused(&[pack, "-o", out_name], "no photographs: give their folder with --photos");
    refused(&[pack, "--photos", text(&at("none")), "-o", out_name], "is not a folder");
    refused(&[pack, "--photos", photos, "-o", text(&at("out.stl"))], "STL cannot store colours");
    refused(&[text(&plain), pack, "--photos", photos, "-o", out_name], "is not a survey");
    refused(&[text(&at("none.ply")), "--photos", photos, "-o", out_name], "does not exist");
    refused(&[pack, "--photos", photos, "--force", "-o", pack], "is an input of this command");
    std::fs::create_dir(at("empty")).unwrap();
    refused(&[pack, "--photos", text(&at("empty")), "-o", out_name], "no photographs were found");
    // An existing file is not replaced.
    std::fs::write(at("there.ply"), "mine").unwrap();
    let error = fails(&["colour", pack, "--photos", photos, "-o", text(&at("there.ply"))]);
    assert!(error.contains("--force"), "{error}");
    assert_eq!(std::fs::read(at("there.ply")).unwrap(), b"mine");
    // Photographs whose files are damaged are named; the others are used.
    std::fs::write(at("session/photos/images/IMG_0002.jpg"), b"\xff\xd8 not a picture").unwrap();
    let output = kilwa(&["colour", pack, "--photos", photos, "-o", out_name]);
    let shown = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && shown.contains("IMG_0002.jpg was left out"), "{shown}");
    // Also for a pack, which lists the photographs that were used.
    let pack_of_rest = at("rest.kilwa");
    succeeds(&["colour", pack, "--photos", photos, "-o", text(&pack_of_rest)]);
    let info = json(&["info", text(&pack_of_rest)]).to_string();
    assert!(!info.contains("IMG_0002.jpg") && info.contains("IMG_0001.jpg"), "{info}");
    // No scratch files are left.
    assert!(
        std::fs::read_dir(folder.path()).unwrap().all(|e| !e.unwrap().file_name().to_string_lossy().starts_with('.'))
    );
}

#[test]
fn a_signal_during_colouring_leaves_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photographs("48x36");
    let [pack, _] = fort(folder.path(), "40k");
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    for name in ["a.ply", "a.kilwa"] {
        let out = out.join(name);
        leaves_nothing_partial(&out, &["colour", text(&pack), "--photos", text(&photos), "-o", text(&out)]);
    }
}

/// Simulated photographs in the frame of a reconstruction, with files of control points and of camera positions in the model.
fn reconstructed(folder: &Path) -> [PathBuf; 3] {
    let [known, loose] = ["known", "loose"].map(|name| folder.join(name));
    let options = ["synth", "photos", "--photos", "8", "--panoramas", "0", "--size", "160x120", "-o"];
    succeeds(&[&options, [text(&known)].as_slice()].concat());
    succeeds(&[&options, [text(&loose), "--sfm-frame"].as_slice()].concat());
    let places = |session: &Path| {
        let path = session.join("photos/sparse/points3D.txt");
        let file = std::fs::read_to_string(path).unwrap();
        let lines = file.lines().filter(|line| !line.starts_with('#'));
        lines.step_by(10).map(|line| line.split(' ').take(4).map(str::to_owned).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let pairs = places(&loose).into_iter().zip(places(&known)).take(12);
    let line = |(a, b): (Vec<String>, Vec<String>)| {
        assert_eq!(a[0], b[0]);
        format!("P{}, {}, {}, 0.02\n", a[0], a[1..].join(", "), b[1..].join(", "))
    };
    let points = folder.join("points.csv");
    std::fs::write(&points, pairs.map(line).collect::<String>()).unwrap();
    let listed = json(&["scans", "photos", "list", text(&known.join("photos"))]);
    let position = |photo: &serde_json::Value| {
        let at: Vec<String> = photo["pose"]["position"].as_array().unwrap().iter().map(ToString::to_string).collect();
        format!("{} {}\n", photo["name"].as_str().unwrap(), at.join(" "))
    };
    let cameras = folder.join("cameras.txt");
    std::fs::write(&cameras, listed["photographs"].as_array().unwrap().iter().map(position).collect::<String>())
        .unwrap();
    [loose.join("photos"), points, cameras]
}

#[test]
fn photographs_of_a_reconstruction_are_placed_by_control_points_or_camera_positions() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let [pack, _] = fort(folder.path(), "150k");
    let [photos, points, cameras] = reconstructed(folder.path());
    let expected = at("expected.ply");
    let known_photos = at("known/photos");
    let right = ["colour", text(&pack), "--photos", text(&known_photos), "-o", text(&expected)];
    let shown = succeeds(&right);
    assert!(!shown.contains("Warning"), "{shown}");
    let (color, count) = seen(&Ply::read(&expected));
    for (option, file, known) in [("--control-points", &points, 12), ("--camera-positions", &cameras, 8)] {
        let out = at(&format!("out{option}.ply"));
        let report = json(&["colour", text(&pack), "--photos", text(&photos), option, text(file), "-o", text(&out)]);
        let frame = &report["frame"];
        assert_eq!(frame["residuals"].as_array().unwrap().len(), known, "{frame}");
        assert!(frame["surface"]["share"].as_f64().unwrap() > 0.5, "{frame}");
        let (other, same) = seen(&Ply::read(&out));
        assert!((same as f64 / count as f64 - 1.0).abs() < 0.05, "{same} {count} {frame}");
        assert!(color.iter().zip(other).all(|(a, b)| (a - b).abs() < 3.0), "{color:?} {other:?}");
    }
    // Without them, there is a warning.
    let out = at("out.ply");
    let shown = succeeds(&["colour", text(&pack), "--photos", text(&photos), "-o", text(&out)]);
    assert!(shown.contains("points of the reconstruction are near the model"), "{shown}");
    // A mistake in a file is named with its line.
    let mistaken = at("mistaken.csv");
    std::fs::write(&mistaken, "A 1 2 3 4 5 6\nB 1 2 3\n").unwrap();
    let error = fails(&[&right, ["--force", "--control-points", text(&mistaken)].as_slice()].concat());
    assert!(error.contains("line 2") && error.contains("mistaken.csv"), "{error}");
}

#[test]
fn a_common_shift_of_poses_is_corrected_with_the_points_of_the_reconstruction() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photos = photographs("160x120");
    let (mesh, pack, out) = (at("fort.ply"), at("shifted.kilwa"), at("out.ply"));
    succeeds(&["synth", "fort", "--triangles", "150k", "-o", text(&mesh)]);
    let shift = "1 0 0 0.3 0 1 0 -0.2 0 0 1 0.25 0 0 0 1";
    std::fs::write(at("shift.xf"), shift).unwrap();
    succeeds(&["build", text(&mesh), "--transform", text(&at("shift.xf")), "-o", text(&pack)]);
    let options = ["colour", text(&pack), "--photos", text(&photos), "-o", text(&out), "--approximate-poses"];
    let report = json(&[&options, ["1"].as_slice()].concat());
    let found: Vec<f64> =
        report["frame"]["translation"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let off = found.iter().zip([0.3, -0.2, 0.25]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(off < 0.1, "{off} {}", report["frame"]);
    // Farther away than allowed: the command fails.
    let (elsewhere, far) = (at("elsewhere.kilwa"), at("far.ply"));
    std::fs::write(at("far.xf"), "1 0 0 900 0 1 0 0 0 0 1 0 0 0 0 1").unwrap();
    succeeds(&["build", text(&mesh), "--transform", text(&at("far.xf")), "-o", text(&elsewhere)]);
    let far = ["colour", text(&elsewhere), "--photos", text(&photos), "-o", text(&far), "--approximate-poses"];
    let error = fails(&[&far, ["1"].as_slice()].concat());
    assert!(error.contains("cannot be fitted to the model"), "{error}");
    for (reach, message) in [("0", "0.001 to 100 metres"), ("x", "not a number"), ("1e9", "0.001 to 100 metres")] {
        let output = kilwa(&[&options, [reach].as_slice()].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && error.contains(message), "{error}");
    }
}

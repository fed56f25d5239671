//! `kilwa render`: pictures of the size asked for, cameras, and what is refused.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

fn kilwa(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kilwa")).args(args).stdin(Stdio::null()).output().expect("runs")
}

/// A folder with a pack of a closed sphere of radius 1 round (0, 0, 1), the pack, and a picture to make.
fn sphere() -> (TempDir, String, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let [mesh, pack, out] = ["s.ply", "s.kilwa", "p.png"].map(|name| folder.path().join(name));
    let text = |p: &PathBuf| p.to_str().expect("plain name").to_owned();
    let args = ["synth", "phantom", "--shape", "sphere", "--triangles", "3000", "-o", &text(&mesh)];
    assert!(kilwa(&args).status.success());
    let built = kilwa(&["build", &text(&mesh), "-o", &text(&pack)]);
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    (folder, text(&pack), out)
}

fn render(pack: &str, out: &Path, more: &[&str]) -> Output {
    let mut args = vec!["render", pack, "--software", "--force", "-o", out.to_str().expect("plain name")];
    args.extend(more);
    kilwa(&args)
}

fn code_and_message(output: &Output) -> (Option<i32>, String) {
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn pictures_have_the_requested_size_and_show_the_model_in_the_middle() {
    let (folder, pack, _) = sphere();
    for view in ["plan", "north", "east", "south", "west", "iso"] {
        let out = folder.path().join("p.png");
        let done = render(&pack, &out, &["--view", view, "--size", "90x70", "--background", "transparent"]);
        assert!(done.status.success(), "{:?}", code_and_message(&done));
        let picture = image::open(&out).expect("a PNG").to_rgba8();
        assert_eq!(picture.dimensions(), (90, 70));
        let alpha = |x, y| picture.get_pixel(x, y).0[3];
        assert_eq!((alpha(45, 35), alpha(0, 0), alpha(89, 69)), (255, 0, 0), "{view}");
        if view == "iso" {
            continue; // In perspective the box round the ball is centred, not the ball.
        }
        // Fitted, centred: the ball spans nearly the whole height, and the same above as below.
        let column: Vec<u32> = (0..70).filter(|&y| alpha(45, y) == 255).collect();
        let (top, bottom) = (column[0], 69 - column[column.len() - 1]);
        assert!(top.abs_diff(bottom) <= 1 && (1..9).contains(&top), "{view}: margins {top} and {bottom}");
    }
}

#[test]
fn a_picture_larger_than_a_tile_has_no_seam() {
    let (folder, pack, _) = sphere();
    let camera = folder.path().join("inside.json");
    std::fs::write(&camera, r#"{"target": [0, 0, 1], "distance": 0.2, "field_of_view": 20}"#).expect("written");
    let out = folder.path().join("wide.png");
    let more = ["--size", "4500x40", "--camera", camera.to_str().expect("plain"), "--background", "transparent"];
    let done = render(&pack, &out, &more);
    assert!(done.status.success(), "{:?}", code_and_message(&done));
    let picture = image::open(&out).expect("a PNG").to_rgba8();
    assert_eq!(picture.dimensions(), (4500, 40));
    assert!(picture.pixels().all(|p| p.0[3] == 255), "background inside a closed model");
}

#[test]
fn invalid_options_are_refused_before_anything_is_drawn() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("p.png");
    for more in [
        ["--size", "0x10"],
        ["--size", "100"],
        ["--size", "90000x90000"],
        ["--mode", "sepia"],
        ["--view", "up"],
        ["--pixel-error", "0"],
        ["--pixel-error", "nan"],
        ["--background", "#12345"],
        ["--shading", "2"],
        ["--light", "90"],
        ["--clip", "0,0,1,0,0"],
        ["--range", "low,high"],
    ] {
        let (code, message) = code_and_message(&render("none.kilwa", &out, &more));
        assert_eq!(code, Some(2), "{more:?}: {message}");
        assert!(message.contains(more[0]), "{more:?}: {message}");
    }
    assert!(!out.exists());
}

#[test]
fn invalid_cameras_and_damaged_packs_are_refused_and_leave_no_picture() {
    let (folder, pack, out) = sphere();
    let camera = folder.path().join("bad.json");
    for text in [
        "not json",
        r#"{"target": [0, 0, 0], "distance": -1}"#,
        r#"{"target": [0, 0, 0], "distance": 1, "elevation": 95}"#,
        r#"{"target": [0, 0], "distance": 1}"#,
        r#"{"target": [0, 0, 0], "distance": 1, "azimut": 3}"#,
    ] {
        std::fs::write(&camera, text).expect("written");
        let (code, message) = code_and_message(&render(&pack, &out, &["--camera", camera.to_str().expect("plain")]));
        assert_eq!(code, Some(1), "{text}: {message}");
        assert!(message.contains("bad.json"), "{text}: {message}");
    }
    let mut bytes = std::fs::read(&pack).expect("read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    let damaged = folder.path().join("damaged.kilwa");
    std::fs::write(&damaged, &bytes).expect("written");
    let (code, message) =
        code_and_message(&render(damaged.to_str().expect("plain"), &out, &["--pixel-error", "0.001"]));
    assert_eq!(code, Some(1), "{message}");
    assert!(message.contains("damaged.kilwa"), "{message}");
    assert!(!out.exists());
}

#[test]
fn the_report_states_the_error_of_the_picture() {
    let (_folder, pack, out) = sphere();
    let done = render(&pack, &out, &["--json", "--size", "64x64", "--memory", "16"]);
    assert!(done.status.success(), "{:?}", code_and_message(&done));
    let report: serde_json::Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_eq!(report["size"], serde_json::json!([64, 64]));
    assert!(
        report["worst_pixel_error"].as_f64().is_some_and(|e| e <= 1.0)
            == report["target_reached"].as_bool().expect("a bool")
    );
    assert!(!report["adapter"].as_str().expect("a name").is_empty());
}

fn report_of(done: &Output) -> serde_json::Value {
    assert!(done.status.success(), "{:?}", code_and_message(done));
    serde_json::from_slice(&done.stdout).expect("JSON")
}

#[test]
fn a_legend_explains_the_colours_of_a_mode() {
    let (_folder, pack, out) = sphere();
    let legend = |more: &[&str]| {
        let mut args = vec!["--json", "--size", "48x48"];
        args.extend(more);
        report_of(&render(&pack, &out, &args))["legend"].clone()
    };
    let height = legend(&["--mode", "height"]);
    let near = |value: &serde_json::Value, wanted: f64| value.as_f64().is_some_and(|v| (v - wanted).abs() < 0.01);
    assert!(near(&height["low"], 0.0) && near(&height["high"], 2.0), "{height}");
    assert_eq!((height["unit"].as_str(), height["stops"].as_array().map(Vec::len)), (Some("m"), Some(9)));
    let distance = legend(&["--mode", "distance", "--plane", "0,0,1,2,0,0", "--range", "-0.5,0.5"]);
    assert_eq!(distance["plane"]["normal"], serde_json::json!([1.0, 0.0, 0.0]));
    assert_eq!((distance["low"].as_f64(), distance["high"].as_f64()), (Some(-0.5), Some(0.5)));
    assert!(legend(&["--mode", "raking"]).is_null(), "light is no value");
}

#[test]
fn cuts_remove_one_side() {
    let (_folder, pack, out) = sphere();
    let alphas = |more: &[&str]| {
        let mut args = vec!["--view", "south", "--size", "60x60", "--background", "transparent"];
        args.extend(more);
        let done = render(&pack, &out, &args);
        assert!(done.status.success(), "{:?}", code_and_message(&done));
        let picture = image::open(&out).expect("a PNG").to_rgba8();
        [[30, 12], [30, 48], [12, 30], [48, 30]].map(|[x, y]| picture.get_pixel(x, y).0[3])
    };
    assert_eq!(alphas(&[]), [255; 4]);
    assert_eq!(alphas(&["--clip", "0,0,1,0,0,1"])[..2], [0, 255], "the upper half is gone");
    assert_eq!(alphas(&["--clip", "0,0,1,0,0,-1"])[..2], [255, 0], "the lower half is gone");
    assert_eq!(alphas(&["--clip-box", "-2,-2,-1,0,2,3"])[2..], [255, 0], "the east is outside of the box");
}

#[test]
fn printed_display_settings_give_the_same_picture_and_invalid_ones_are_refused_by_name() {
    let (folder, pack, _) = sphere();
    let [first, second] = ["a.png", "b.png"].map(|n| folder.path().join(n));
    let size = ["--json", "--size", "64x48"];
    let options =
        ["--mode", "raking", "--light", "60,15", "--on-colour", "--clip", "0.2,0,0,1,0,0", "--background", "black"];
    let display = report_of(&render(&pack, &first, &[&size[..], &options].concat()))["display"].to_string();
    assert!(display.contains("raking") && display.contains("clipPlane"), "{display}");
    report_of(&render(&pack, &second, &[&size[..], &["--display", &display]].concat()));
    let pixels = |path: &Path| image::open(path).expect("a PNG").to_rgba8().into_raw();
    assert_eq!(pixels(&first), pixels(&second));
    let file = folder.path().join("display.json");
    std::fs::write(&file, &display).expect("written");
    report_of(&render(&pack, &second, &[&size[..], &["--display", file.to_str().expect("plain")]].concat()));
    assert_eq!(pixels(&first), pixels(&second));
    let (code, message) = code_and_message(&render(&pack, &first, &["--display", r#"{"strength":3}"#]));
    assert_eq!(code, Some(1));
    assert!(message.contains("strength"), "{message}");
}

#[test]
fn an_existing_picture_or_world_file_is_replaced_only_with_force() {
    let (folder, pack, _) = sphere();
    let at = |name: &str| folder.path().join(name);
    let out = at("p.png").to_str().expect("plain name").to_owned();
    let small = ["render", &pack, "--software", "--size", "8x8", "-o", &out];
    let plan = ["render", &pack, "--software", "--view", "plan", "--scale", "1:100", "--dpi", "25", "-o", &out];
    let refused = |args: &[&str], named: &str| {
        let (code, message) = code_and_message(&kilwa(args));
        assert_eq!(code, Some(1), "{message}");
        assert!(message.contains(named) && message.contains("--force"), "{message}");
    };
    std::fs::write(at("p.png"), "mine").expect("written");
    refused(&small, "p.png");
    refused(&plan, "p.png");
    assert_eq!(std::fs::read(at("p.png")).expect("read"), b"mine");
    std::fs::rename(at("p.png"), at("p.pgw")).expect("renamed");
    refused(&plan, "p.pgw");
    assert!(!at("p.png").exists(), "nothing is drawn before all files are checked");
    let elevation = ["render", &pack, "--software", "--view", "south", "--scale", "1:100", "--dpi", "25", "-o", &out];
    for args in [&small[..], &elevation] {
        let done = kilwa(args);
        assert!(done.status.success(), "it has no world file: {:?}", code_and_message(&done));
        std::fs::remove_file(at("p.png")).expect("removed");
    }
    assert_eq!(std::fs::read(at("p.pgw")).expect("read"), b"mine");
    let done = kilwa(&[&plan[..], &["--force"]].concat());
    assert!(done.status.success(), "{:?}", code_and_message(&done));
    assert_ne!(std::fs::read(at("p.pgw")).expect("read"), b"mine");
}

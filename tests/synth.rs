//! `kilwa synth` as a person or a script meets it: files, messages, exit codes.

use crate::support::{fails, json, kilwa, succeeds, text};
use std::path::Path;

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn header(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    String::from_utf8(bytes[..end].to_vec()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_phantom_is_written_with_the_documented_properties_and_counted() {
    let folder = folder();
    let path = folder.path().join("ball.ply");
    let output = succeeds(&["synth", "phantom", "--shape", "sphere", "--triangles", "5k", "-o", text(&path)]);
    let header = header(&path);
    assert!(header.contains("property float x\nproperty float y\nproperty float z\nproperty uchar red"), "{header}");
    assert!(header.contains("property list uchar int vertex_indices"), "{header}");
    let faces = header.lines().find_map(|l| l.strip_prefix("element face ")).unwrap();
    assert!(output.contains(&format!("{faces} triangles")), "{output}");
}

#[test]
fn utm_writes_doubles_and_names_the_reference_system() {
    let folder = folder();
    let path = folder.path().join("far.ply");
    let report = json(&["synth", "wall", "--utm", "--triangles", "3000", "-o", text(&path)]);
    let header = header(&path);
    assert!(header.contains("property double x") && header.contains("EPSG:32737"), "{header}");
    assert_eq!(report["crs"], "EPSG:32737");
    assert_eq!(report["bytes"].as_u64().unwrap(), std::fs::metadata(&path).unwrap().len());
}

#[test]
fn blocks_are_numbered_files_that_together_hold_all_triangles() {
    let folder = folder();
    let report = |extra: &[&str], name: &str| {
        let path = folder.path().join(name);
        json(&[&["synth", "fort", "--triangles", "8000", "-o", text(&path)], extra].concat())
    };
    let cut = report(&["--blocks", "4"], "part.ply");
    let whole = report(&[], "whole.ply");
    assert_eq!(names(folder.path()), ["part_000.ply", "part_001.ply", "part_002.ply", "part_003.ply", "whole.ply"]);
    assert_eq!(cut["triangles"], whole["triangles"]);
    assert!(cut["vertices"].as_u64() > whole["vertices"].as_u64(), "no border vertex is doubled");
}

#[test]
fn an_unwritable_output_is_reported_by_name_and_leaves_no_file() {
    let folder = folder();
    std::fs::write(folder.path().join("file"), "").unwrap();
    let blocked = folder.path().join("file/a.ply");
    let error = fails(&["synth", "wall", "--triangles", "3000", "-o", text(&blocked)]);
    assert!(error.contains("a.ply") && error.contains("is not a folder"), "{error}");
    std::fs::remove_file(folder.path().join("file")).unwrap();
    let error = fails(&["synth", "fort", "--triangles", "10", "-o", text(&folder.path().join("new/a.ply"))]);
    assert!(error.contains("at least 5000"), "{error}");
    assert!(names(folder.path()).is_empty());
}

#[test]
fn an_invalid_count_is_a_usage_error() {
    for count in ["many", "-5", "1.5M", "99999999999G", ""] {
        let output = kilwa(&["synth", "wall", "--triangles", count, "-o", "never.ply"]);
        assert_eq!(output.status.code(), Some(2), "{count:?}");
    }
    assert!(!Path::new("never.ply").exists());
}

#[test]
fn scans_are_written_with_their_truth_and_counted() {
    let folder = folder();
    let out = folder.path().join("scans");
    let report = json(&["synth", "scans", "--stations", "2", "--columns", "32", "-o", text(&out)]);
    assert_eq!(names(&out), ["scan_001.ptx", "scan_002.ptx", "truth"]);
    assert_eq!(names(&out.join("truth")), ["poses.toml", "scan_001.labels", "scan_002.labels"]);
    let first = std::fs::read_to_string(out.join("scan_001.ptx")).unwrap();
    let mut lines = first.lines();
    let mut count = || lines.next().unwrap().parse::<u64>().unwrap();
    let (columns, rows) = (count(), count());
    assert_eq!((columns, first.lines().count() as u64), (32, 10 + columns * rows));
    assert_eq!(report["stations"], 2);
    let samples = report["samples"].as_object().unwrap();
    let points = samples.iter().filter(|(class, _)| !["empty", "dropout"].contains(&class.as_str()));
    assert_eq!(points.map(|(_, n)| n.as_u64().unwrap()).sum::<u64>(), report["points"].as_u64().unwrap());
    let error = fails(&["synth", "scans", "-o", text(&out)]);
    assert!(error.contains("scans") && error.contains("already exists"), "{error}");
    let error = fails(&["synth", "scans", "--stations", "0", "-o", text(&folder.path().join("none"))]);
    assert!(error.contains("ask for 1 to 1000"), "{error}");
    assert_eq!(names(folder.path()), ["scans"]);
}

#[test]
fn photographs_are_written_with_poses_and_ground_truth_and_counted() {
    let folder = folder();
    let out = folder.path().join("photos");
    let call = ["synth", "photos", "--photos", "3", "--panoramas", "1", "--size", "48x36", "--sfm-frame"];
    let report =
        json(&[&call[..], &["--pose-error", "5", "--truth-depth", "--threads", "2", "-o", text(&out)]].concat());
    assert_eq!(names(&out), ["photos", "truth"]);
    let photos = out.join("photos");
    assert_eq!(names(&photos), ["images", "panoramas", "sparse"]);
    assert_eq!(names(&photos.join("images")), ["IMG_0001.jpg", "IMG_0002.jpg", "IMG_0003.jpg"]);
    assert_eq!(names(&photos.join("panoramas")), ["scan_001.jpg"]);
    assert_eq!(names(&photos.join("sparse")), ["cameras.txt", "images.txt", "points3D.txt"]);
    assert_eq!(names(&out.join("truth")), ["people", "photos.toml", "range"]);
    assert_eq!((&report["photos"], &report["panoramas"]), (&3.into(), &1.into()));
    assert_eq!(report["pixels"], 3 * 48 * 36 + 96 * 48);
    assert_eq!(report["files"].as_array().unwrap().len(), 4);
    let truth = std::fs::read_to_string(out.join("truth/photos.toml")).unwrap();
    let errors = truth.lines().filter_map(|line| line.strip_prefix("pose_error_px = "));
    let errors: Vec<f64> = errors.map(|error| error.parse().unwrap()).collect();
    assert!(errors.len() == 3 && errors.iter().all(|error| (error - 5.0).abs() < 0.5), "{errors:?}");
    assert_eq!(truth.matches("[[photo]]").count(), 4);
    let error = fails(&["synth", "photos", "-o", text(&out)]);
    assert!(error.contains("photos") && error.contains("already exists"), "{error}");
    let error = fails(&["synth", "photos", "--hours", "9", "-o", text(&folder.path().join("none"))]);
    assert!(error.contains("the number of hours cannot be 9: give a number from 0 to 6"), "{error}");
    let output = kilwa(&["synth", "photos", "--size", "1600", "-o", text(&folder.path().join("none"))]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(names(folder.path()), ["photos"]);
}

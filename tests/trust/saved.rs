//! Saved measurements come back bit for bit, measure the same again, and open in other programs.

use super::opinions::{EZDXF, python};
use super::oracle::P;
use super::phantoms::{Phantom, measure, phantom};
use crate::support::{fails, json, kilwa, succeeds, text};
use serde_json::Value;
use std::path::Path;

/// Every tool once, saved to one document.
pub(crate) fn save_all(p: &Phantom, to: &Path) -> usize {
    let side: [P; 4] = [[0.2, 0.0, 0.2], [0.8, 0.0, 0.2], [0.8, 0.0, 0.8], [0.2, 0.0, 0.8]];
    let top: [P; 4] = [[0.2, 0.2, 1.0], [0.8, 0.2, 1.0], [0.8, 0.8, 1.0], [0.2, 0.8, 1.0]];
    let six = [side[0], side[1], side[2], top[0], top[1], top[2]];
    let z = |h: f64| format!("--z={:?}", h + p.at[2]);
    let (half, low) = (z(0.5), z(0.25));
    let cases: [(&[&str], &[P]); 15] = [
        (&["coordinate"], &side[..1]),
        (&["distance"], &side[..3]),
        (&["distance", "--closed"], &side),
        (&["distance", "--along"], &[side[3], top[0]]),
        (&["circle"], &side[..3]),
        (&["angle"], &side[..3]),
        (&["angle", "--planes"], &six),
        (&["height"], &[side[0], side[1], side[2], top[0]]),
        (&["area"], &[]),
        (&["area", "--reach", "0.1"], &side),
        (&["volume"], &[]),
        (&["volume", &half, "--reach", "0.7"], &top),
        (&["section", &low], &[]),
        (&["profile"], &[[-0.5, 0.5, 0.0], [1.5, 0.5, 0.0]]),
        (&["contours", "--interval", "0.1"], &[]),
    ];
    for (tool, points) in cases {
        measure(p, &[tool, &["--save", text(to)]].concat(), points);
    }
    measure(p, &["deviation", "--save", text(to), "--name", "bulge, south"], &side);
    cases.len() + 1
}

#[test]
fn concurrently_saved_measurements_are_all_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (file, p) = (folder.path().join("all.json"), phantom("cube", "origin"));
    let save = || {
        std::thread::spawn({
            let (pack, file) = (p.pack.clone(), file.clone());
            move || succeeds(&["measure", text(&pack), "area", "--save", text(&file)])
        })
    };
    for _ in 0..5 {
        let saving: Vec<_> = (0..8).map(|_| save()).collect();
        for one in saving {
            one.join().unwrap();
        }
    }
    let again = json(&["measure", text(&p.pack), "again", text(&file)]);
    assert_eq!(again["measurements"].as_array().unwrap().len(), 40);
}

#[test]
fn saving_in_a_locked_folder_prints_that_it_waits() {
    use kilwa_archive::lock::Lock;
    use std::io::{BufRead as _, BufReader, Read as _};
    let folder = tempfile::tempdir().unwrap();
    let (file, p) = (folder.path().join("all.json"), phantom("cube", "origin"));
    let held = Lock::take(folder.path()).unwrap();
    let mut saving = std::process::Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .args(["measure", text(&p.pack), "area", "--save", text(&file)])
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let (mut stderr, mut line) = (BufReader::new(saving.stderr.take().unwrap()), String::new());
    stderr.read_line(&mut line).unwrap();
    assert!(
        line.contains("another kilwa command is publishing, withdrawing or saving in") && line.contains("10 minutes"),
        "{line}"
    );
    assert!(line.contains(text(folder.path())) && !file.exists(), "{line}");
    drop(held);
    stderr.read_to_string(&mut line).unwrap();
    assert!(saving.wait().unwrap().success() && file.exists(), "{line}");
}

#[test]
fn every_saved_tool_measures_the_same_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("all.json");
    let mut differing = 0;
    for place in ["origin", "utm"] {
        let p = phantom("cube", place);
        let count = save_all(&p, &file);
        let again = json(&["measure", text(&p.pack), "again", text(&file)]);
        let rows = again["measurements"].as_array().unwrap();
        assert_eq!(rows.len(), count);
        differing += rows.iter().filter(|r| r["same"] != true).count();
        assert_eq!(again["same_pack"], true);
        let words = succeeds(&["measure", text(&p.pack), "again", text(&file), "--cite"]);
        assert!(
            words.contains("bulge, south (deviation)") && words.contains("Measured on the finest surface of"),
            "{words}"
        );
        // Another pack: the file is left unchanged, and the message says it belongs to another pack.
        let other = phantom("sphere", place);
        assert!(fails(&["measure", text(&other.pack), "area", "--save", text(&file)]).contains("another pack"));
        let output = kilwa(&["measure", text(&other.pack), "again", text(&file)]);
        assert_eq!(output.status.code(), Some(1));
        assert!(String::from_utf8_lossy(&output.stdout).contains("were made on another pack"));
        std::fs::remove_file(&file).unwrap();
    }
    super::check_none("saved measurements that do not come back and measure the same to the last bit", 30, differing);
}

#[test]
fn exports_open_in_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let p = phantom("cube", "utm");
    let path = |end: &str| folder.path().join(format!("all.{end}"));
    save_all(&p, &path("json"));
    for end in ["csv", "geojson", "dxf"] {
        succeeds(&["measure", text(&p.pack), "again", text(&path("json")), "-o", text(&path(end))]);
    }
    assert!(
        fails(&["measure", text(&p.pack), "again", text(&path("json")), "-o", text(&path("csv"))]).contains("--force")
    );
    #[cfg(unix)]
    for end in ["json", "csv", "geojson", "dxf"] {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(path(end)).unwrap().permissions().mode();
        assert_eq!(mode & 0o044, 0o044, "{end}: others may read it as any new file, mode {mode:o}");
    }
    let map: Value = serde_json::from_slice(&std::fs::read(path("geojson")).unwrap()).unwrap();
    assert!(map["features"].as_array().unwrap().iter().any(|f| f["geometry"]["type"] == "Polygon"));
    let csv = std::fs::read_to_string(path("csv")).unwrap();
    assert!(csv.lines().count() > 20 && csv.contains("\"bulge, south\",deviation,mean,"));
    let Some(read) = python(EZDXF, &[text(&path("dxf"))]) else { return };
    println!("trust | DXF of saved measurements opened by ezdxf: errors and repairs | 0 | {}", &read["errors"]);
    assert_eq!((&read["errors"], &read["fixes"]), (&0.into(), &0.into()));
    assert!(read["lines3"].as_array().unwrap().len() >= 8);
    let saved: Value = serde_json::from_slice(&std::fs::read(path("json")).unwrap()).unwrap();
    let first = saved["measurements"].as_array().unwrap().iter().find(|m| m["tool"] == "distance").unwrap();
    assert_eq!(read["lines3"][0], first["world"], "the same doubles in both");
}

#[test]
fn a_document_of_the_first_release_opens() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/compat/measurements-1.json");
    let bytes = std::fs::read(file).unwrap();
    let document = kilwa_measure::Document::parse(&bytes).unwrap();
    assert_eq!(document.measurements.len(), 15);
    assert!(document.to_json().as_bytes() == bytes, "written again it is the same file");
}

//! `kilwa register`: stations are placed, or listed with the reason.

use crate::support::{fails, json, succeeds, text};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Where the scanner stood, metres.
const PLACES: [[f64; 3]; 2] = [[-1.0, 0.4, -0.2], [0.9, -0.7, 0.3]];

/// A survey of two stations without poses in an empty room, which looks the same after half a turn.
fn survey(folder: &Path) -> PathBuf {
    let room = [3.0, 2.5, 1.5];
    let files = PLACES.iter().enumerate().map(|(k, at)| {
        let mut ptx = "180\n80\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".to_owned();
        for (column, row) in (0..180).flat_map(|column| (0..80).map(move |row| (column, row))) {
            let (azimuth, elevation) = (f64::from(column) * 0.034_906, (f64::from(row) - 39.5) * 0.037);
            let ray: [f64; 3] = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
            let to_wall = |axis: usize| (room[axis] * ray[axis].signum() - at[axis]) / ray[axis];
            let range = (0..3).map(to_wall).fold(f64::INFINITY, f64::min);
            let [x, y, z] = ray.map(|d| d * range);
            writeln!(ptx, "{x:.6} {y:.6} {z:.6} 0.5").unwrap();
        }
        let file = folder.join(format!("s{k}.ptx"));
        std::fs::write(&file, ptx).unwrap();
        file
    });
    let survey = folder.join("survey");
    let files: Vec<PathBuf> = files.collect();
    succeeds(&["scans", "import", text(&files[0]), text(&files[1]), "-o", text(&survey)]);
    survey
}

#[test]
fn ambiguous_stations_are_refused_and_control_points_resolve_the_ambiguity() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    let report = folder.path().join("report.html");
    let refused = fails(&["register", text(&survey), "--dry-run", "--report", text(&report)]);
    assert!(refused.contains("2 stations could not be placed"), "{refused}");
    assert!(!survey.join("registration.json").exists(), "a dry run");
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("None of the 2 stations could be placed."), "{page}");
    assert!(page.contains("<h3><bdi>s1</bdi></h3>") && page.contains("data:image/jpeg;base64,"), "{page}");
    let toml = survey.join("survey.toml");
    let mut entries = std::fs::read_to_string(&toml).unwrap();
    for (name, point) in [("A", [3.0, 1.0, 0.5]), ("B", [-3.0, -1.0, 0.0]), ("C", [0.0, 2.5, -1.0])] {
        for (k, at) in PLACES.iter().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|axis| point[axis] - at[axis]);
            write!(entries, "\n[[control]]\nname = \"{name}\"\nstation = \"s{k}\"\nat = [{x}, {y}, {z}]\n").unwrap();
        }
    }
    std::fs::write(&toml, entries).unwrap();
    let found = json(&["register", text(&survey), "--report", text(&report), "--force"]);
    assert_eq!(found["unplaced"], serde_json::json!([]), "{found}");
    let place = |k: usize| -> Vec<f64> { serde_json::from_value(found["stations"][k]["translation"].clone()).unwrap() };
    for (axis, (first, second)) in PLACES[0].iter().zip(&PLACES[1]).enumerate() {
        let off = place(1)[axis] - place(0)[axis] - (second - first);
        assert!(off.abs() < 0.005, "{off} along axis {axis}");
    }
    assert!(std::fs::read_to_string(&toml).unwrap().contains("translation_sigma"));
    assert!(survey.join("registration.json").exists());
    // If all poses are kept, only the output files are written.
    let residuals = folder.path().join("residuals.ply");
    let said = succeeds(&["register", text(&survey), "--residuals", text(&residuals)]);
    assert!(said.contains("kept its pose") || said.contains("control points"), "{said}");
    let bytes = std::fs::read(&residuals).unwrap();
    assert!(String::from_utf8_lossy(&bytes[..400]).contains("property float residual"));
    let page = std::fs::read_to_string(&report).unwrap();
    assert!(page.contains("All 2 stations are placed.") && page.contains("<svg class=\"plan\""), "{page}");

    // A pose that is edited afterwards is reported without the standard deviations of the registration.
    let all = folder.path().join("all.json");
    let of_survey = || -> serde_json::Value {
        succeeds(&["scans", "report", text(&survey), "-o", text(&all), "--force"]);
        serde_json::from_slice(&std::fs::read(&all).unwrap()).unwrap()
    };
    let unedited = of_survey();
    assert!(unedited["stations"][0]["sigma"][0].as_f64() > Some(0.0), "{unedited}");
    let before = std::fs::read_to_string(&toml).unwrap();
    let first = before.find("name = \"s0\"").unwrap();
    let start = first + before[first..].find("translation = [").unwrap() + "translation = [".len();
    std::fs::write(&toml, format!("{}9.5, 0.0, 0.0] # {}", &before[..start], &before[start..])).unwrap();
    let edited = of_survey();
    assert!(edited["stations"][0]["sigma"].is_null() && !edited["stations"][1]["sigma"].is_null(), "{edited}");
    let page = folder.path().join("all.html");
    succeeds(&["scans", "report", text(&survey), "-o", text(&page)]);
    assert!(std::fs::read_to_string(&page).unwrap().contains("given pose"));
    let registration = survey.join("registration.json");
    let kept = fails(&["scans", "report", text(&survey), "-o", text(&registration), "--force"]);
    assert!(kept.contains("is an input of this command"), "{kept}");
}

#[test]
fn an_unusable_report_path_is_reported_before_registration_starts() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("there.html"), "x").unwrap();
    std::fs::hard_link(survey.join("survey.toml"), at("same.html")).unwrap();
    let before = std::fs::read(survey.join("survey.toml")).unwrap();
    for (report, force, message) in [
        (at("none/report.html"), false, "none does not exist"),
        (at("survey"), false, "is a folder"),
        (at("there.html"), false, "already exists; use --force"),
        (survey.join("survey.toml"), true, "the file extension must be .html"),
        (at("same.html"), true, "an input of this command"),
    ] {
        let mut args = vec!["register", text(&survey), "--report", text(&report)];
        args.extend(force.then_some("--force"));
        let refused = fails(&args);
        assert!(refused.contains(message) && !refused.contains("could not be placed"), "{refused}");
    }
    assert_eq!(std::fs::read(survey.join("survey.toml")).unwrap(), before);
    assert!(!survey.join("registration.json").exists());
}

#[test]
fn a_survey_of_one_station_cannot_be_registered() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    let toml = survey.join("survey.toml");
    let all = std::fs::read_to_string(&toml).unwrap();
    let second = all.rfind("[[station]]").unwrap();
    std::fs::write(&toml, &all[..second]).unwrap();
    let refused = fails(&["register", text(&survey)]);
    assert!(refused.contains("has one station; registration needs two or more"), "{refused}");
}

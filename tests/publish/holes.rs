//! `kilwa publish --holes`: a list of holes becomes part of a version, with its location where it has one.

use super::{Bench, FULL, MINIMAL, json_of, other_pack, pack, run, tree};
use crate::support::{succeeds, text};
use serde_json::{Value, json};
use std::path::PathBuf;

/// The middle of the torus of [`pack`].
const MIDDLE: [f64; 3] = [565_977.25, 9_009_946.5, 31.75];

/// A list as `kilwa merge` writes it: a triangle at each of these places of a pack.
fn list(places: &[[f64; 3]], crs: Option<&str>) -> Value {
    let feature = |(k, [x, y, z]): (usize, &[f64; 3])| {
        json!({
            "type": "Feature", "id": k + 1,
            "geometry": { "type": "Polygon", "coordinates": [[[x, y, z], [x + 0.1, y, z], [x, y + 0.1, z], [x, y, z]]] },
            "properties": { "cause": "unseen", "area_m2": 0.005, "rim_m": 0.341, "center": [x + 0.03, y + 0.03, z],
                "areas_m2": { "unseen": 0.004, "free": 0.001, "dropped": 0.0, "no_return": 0.0 } },
        })
    };
    let features: Vec<Value> = places.iter().enumerate().map(feature).collect();
    json!({ "type": "FeatureCollection", "name": "holes", "axes": "x, y, z in the survey, metres", "crs_of_survey": crs, "features": features })
}

fn file(bench: &Bench, list: &Value) -> PathBuf {
    let path = bench.path("holes.geojson");
    std::fs::write(&path, list.to_string()).unwrap();
    path
}

#[test]
fn a_list_of_holes_becomes_part_of_the_version_and_is_verified() {
    let bench = Bench::new();
    let holes = file(&bench, &list(&[MIDDLE, MIDDLE], Some("EPSG:32737")));
    let report = bench.publish(&pack(), FULL, &["--holes", text(&holes), "--dry-run"]);
    assert!(String::from_utf8(report.stdout).unwrap().contains("\n  holes: 2\n"));
    let object = bench.published(&pack(), FULL, &["--holes", text(&holes)]);
    let published = json_of(&object.join("v1/holes.geojson"));
    assert_eq!(published["features"][1]["geometry"], list(&[MIDDLE], None)["features"][0]["geometry"]);
    assert_eq!(published["crs_of_survey"], "EPSG:32737");
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!(manifest["versions"][0]["holes"]["url"], "v1/holes.geojson");
    let page = std::fs::read_to_string(object.join("index.html")).unwrap();
    assert!(page.contains("data-holes=\"holes.geojson\"") && page.contains("2 holes"), "{page}");
    assert!(std::fs::read_to_string(object.join("v1/README.txt")).unwrap().contains("2 holes of the surface"));
    assert_eq!(json_of(&object.join("v1/metadata/paradata.json"))["holes"]["count"], 2);
    succeeds(&["verify", text(&object)]);
    // Publishing the same again adds nothing; publishing without the list makes a version without one.
    bench.published(&pack(), FULL, &["--holes", text(&holes)]);
    assert!(!object.join("v2").exists());
    bench.published(&pack(), FULL, &["--version-note", "Without holes", "--date", "2026-12-01"]);
    assert!(object.join("v2").exists() && !object.join("v2/holes.geojson").exists());
    // A list that the manifest does not name, or that it names but is missing, is reported.
    let at = object.join("manifest.json");
    let text_of = std::fs::read_to_string(&at).unwrap();
    let mut changed: Value = serde_json::from_str(&text_of).unwrap();
    changed.as_object_mut().unwrap().remove("seal");
    changed["versions"][0].as_object_mut().unwrap().remove("holes");
    std::fs::write(&at, changed.to_string()).unwrap();
    let output = run(&["verify", text(&object)]);
    assert_eq!(output.status.code(), Some(1));
    let printed = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(printed.contains("disagree about the holes"), "{printed}");
}

#[test]
fn holes_of_a_model_without_its_location_are_moved_with_it() {
    let bench = Bench::new();
    let holes = file(&bench, &list(&[MIDDLE], Some("EPSG:32737")));
    let object = bench.published(&pack(), FULL, &["--holes", text(&holes), "--redact-location"]);
    let published = json_of(&object.join("v1/holes.geojson"));
    let place = published["features"][0]["geometry"]["coordinates"][0][0].clone();
    for k in 0..3 {
        // The middle of the model, of which the lowest place is at 0.
        assert!(place[k].as_f64().unwrap().abs() < 1.5, "{place}");
    }
    assert_eq!(published["crs_of_survey"], Value::Null);
    for (path, bytes) in tree(&object) {
        if path.ends_with(".geojson") {
            let text = String::from_utf8(bytes).unwrap();
            assert!(!text.contains("565") && !text.contains("9009") && !text.contains("32737"), "{path}: {text}");
        }
    }
    succeeds(&["verify", text(&object)]);
}

#[test]
fn what_is_not_the_list_of_this_model_is_refused() {
    let bench = Bench::new();
    let refused = |list: &Value| bench.refused(&pack(), FULL, &["--holes", text(&file(&bench, list))]);
    let why = refused(&list(&[MIDDLE, [1.0, 2.0, 3.0]], None));
    assert!(why.contains("hole 2: 1 2 3 is outside of the model") && why.contains("holes.geojson"), "{why}");
    let why = refused(&list(&[MIDDLE], Some("EPSG:32736")));
    assert!(why.contains("the list is in EPSG:32736 and the pack in EPSG:32737"), "{why}");
    let why = refused(&json!({ "type": "FeatureCollection", "features": [] }));
    assert!(why.contains("not a list of holes as written by kilwa merge --holes"), "{why}");
    let missing = bench.path("none.geojson");
    let why = bench.refused(&pack(), FULL, &["--holes", text(&missing)]);
    assert!(why.contains("cannot read the list of holes"), "{why}");
}

#[test]
fn holes_of_a_closed_model_are_only_for_those_who_may_have_it() {
    let bench = Bench::new();
    let holes = file(&bench, &list(&[[1.0, 2.0, 3.0]], None));
    let closed = format!("{MINIMAL}[access]\nstate = \"restricted\"\nreason = \"Rock art\"\n");
    let object = bench.published(&other_pack(), &closed, &["--holes", text(&holes)]);
    assert!(kilwa_archive::layout::is_geometry("v1/holes.geojson"));
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = std::fs::metadata(object.join("v1/holes.geojson")).unwrap().permissions().mode();
        assert_eq!(mode & 0o007, 0, "{mode:o}");
    }
    #[cfg(not(unix))]
    assert!(object.join("v1/holes.geojson").exists());
}

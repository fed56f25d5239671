//! Digits where the accuracy of the survey is unknown: no more than the spacing of the mesh supports, however the points were chosen.

use super::check_none;
use super::phantoms::{measure, phantom};
use super::saved::save_all;
use crate::support::{kilwa, succeeds, text};
use serde_json::{Value, json};
use std::path::Path;

/// Uncertainty of pointing in these tests, metres: far more than that of the lattice.
const POINTING: f64 = 0.05;

/// Tool, name, uncertainty and `resolution` of each reading of a document, measured again.
fn readings(pack: &Path, document: &Path) -> Vec<(String, f64, Option<f64>)> {
    // Exit code 1 if the document holds no readings yet.
    let output = kilwa(&["measure", text(pack), "again", text(document), "--json"]);
    let again: Value = serde_json::from_slice(&output.stdout).unwrap();
    let of = |measured: &Value| {
        let name = |r: &Value| format!("{} of {}", r["name"], measured["tool"]);
        let all = measured["now"].as_array().unwrap_or_else(|| panic!("{measured}"));
        all.iter().map(|r| (name(r), r["uncertainty"].as_f64().unwrap(), r["resolution"].as_f64())).collect::<Vec<_>>()
    };
    again["measurements"].as_array().unwrap().iter().flat_map(of).collect()
}

#[test]
fn pointing_changes_uncertainties_but_never_adds_digits() {
    let folder = tempfile::tempdir().unwrap();
    let (typed, picked) = (folder.path().join("typed.json"), folder.path().join("picked.json"));
    let p = phantom("cube", "origin");
    save_all(&p, &typed);
    let was = readings(&p.pack, &typed);
    let (mut finer, mut coarser, mut without, mut compared) = (Vec::new(), Vec::new(), Vec::new(), 0);
    // All points picked, and only one of them: the others were snapped to vertices.
    for points in [vec![POINTING; 6], vec![0.0, POINTING], vec![POINTING]] {
        let mut document: Value = serde_json::from_slice(&std::fs::read(&typed).unwrap()).unwrap();
        for measured in document["measurements"].as_array_mut().unwrap() {
            let count = measured["local"].as_array().map_or(0, Vec::len).max(2);
            measured["pointing"] = json!(points[..points.len().min(count)]);
        }
        std::fs::write(&picked, document.to_string()).unwrap();
        let now = readings(&p.pack, &picked);
        assert_eq!(was.len(), now.len());
        for ((name, _, before), (_, uncertainty, after)) in was.iter().zip(&now) {
            let what = format!("{name}, pointing {points:?}: {before:?}, {after:?}");
            // A line that was typed is exact.
            let Some((before, after)) = before.zip(*after) else {
                if !(before.is_none() && name.contains("way in plan")) {
                    without.push(what);
                }
                continue;
            };
            compared += 1;
            if after < before * (1.0 - 1e-6) {
                finer.push(what);
            } else if after > before.hypot(*uncertainty) * (1.0 + 1e-6) {
                coarser.push(what);
            }
        }
    }
    println!("{}", [&finer[..], &coarser[..], &without[..]].concat().join("\n"));
    check_none("readings whose digits become finer because points were picked", compared, finer.len());
    check_none("readings that do not state what the mesh supports", compared, without.len());
    check_none("readings that lose more digits than pointing explains", compared, coarser.len());
}

#[test]
fn a_height_above_an_upright_plane_is_as_certain_as_above_a_level_one() {
    let p = phantom("cube", "origin");
    let uncertainty = |points: &[[f64; 3]]| {
        let found = measure(&p, &["height"], points);
        found["readings"][0]["uncertainty"].as_f64().unwrap()
    };
    // Three corners of a face and a place on the opposite one.
    let upright = uncertainty(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.2, 1.0, 0.4]]);
    let level = uncertainty(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, 0.4, 1.0]]);
    super::check_bound(
        "uncertainty of a height above an upright plane over that above a level one",
        1.001,
        upright / level,
    );
}

#[test]
fn the_scatter_of_points_round_a_circle_costs_no_digits_of_its_own() {
    let p = phantom("cube", "origin");
    // On the top of the cube, 0.3 m from its middle, give or take 20 mm.
    let ring: Vec<[f64; 3]> = (0..6)
        .map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_3).sin_cos();
            let radius = if k % 2 == 0 { 0.32 } else { 0.28 };
            [0.5 + radius * cos, 0.5 + radius * sin, 1.0]
        })
        .collect();
    for options in [&["circle"][..], &["circle", "--pointing", "0.01"]] {
        let found = measure(&p, options, &ring);
        let radius = &found["readings"][0];
        let (uncertainty, resolution) =
            (radius["uncertainty"].as_f64().unwrap(), radius["resolution"].as_f64().unwrap());
        // The spacing, 0.0625 m, is larger than the scatter.
        assert!(resolution > uncertainty && resolution < 0.0625, "{options:?}: {radius}");
    }
}

#[test]
fn the_way_of_a_profile_between_picked_points_is_as_uncertain_as_their_distance() {
    let folder = tempfile::tempdir().unwrap();
    let document = folder.path().join("profile.json");
    let p = phantom("cube", "origin");
    let line = ["0.2", "0.5", "1", "0.8", "0.5", "1"];
    succeeds(&[&["measure", text(&p.pack), "profile"], &line[..], &["--save", text(&document)]].concat());
    let mut both: Value = serde_json::from_slice(&std::fs::read(&document).unwrap()).unwrap();
    let mut profile = both["measurements"][0].clone();
    profile["pointing"] = json!([POINTING, POINTING]);
    let mut distance = profile.clone();
    distance["tool"] = json!("distance");
    distance["readings"] = json!([]);
    both["measurements"] = json!([profile, distance]);
    std::fs::write(&document, both.to_string()).unwrap();
    let all = readings(&p.pack, &document);
    let of = |part: &str| all.iter().find(|(name, ..)| name.contains(part)).unwrap();
    let (way, horizontal) = (of("way in plan"), of("horizontal"));
    assert!(way.1 > POINTING, "{way:?}");
    assert_eq!((way.1, way.2), (horizontal.1, horizontal.2));
}

//! `--redact-location`: no file of an object tells where the model was, as text or as a number.

use crate::support::{json, text};
use crate::{Bench, FULL, json_of, notes, pack, run, tree};

/// Numbers that tell the place: corners, middle and lattice of the true pack, east and north.
fn telling() -> Vec<f64> {
    let info = json(&["info", text(&pack())]);
    let at = |key: &str, k: usize| info["metadata"][key][k].as_f64().unwrap();
    let mut all = Vec::new();
    for k in 0..2 {
        let (low, high) = (at("bounds_min", k), at("bounds_max", k));
        all.extend([low, high, f64::midpoint(low, high), low.floor(), high.ceil(), low.round()]);
    }
    all
}

/// Where a file tells one of the numbers: as digits, also grouped, or as binary doubles, floats and integers in both byte orders.
fn tells(bytes: &[u8], numbers: &[f64]) -> Option<String> {
    let digits: Vec<u8> = bytes.iter().copied().filter(|b| !b" ,'_".contains(b)).collect();
    let grouped = String::from_utf8_lossy(bytes).replace(['\u{202f}', '\u{a0}', '\u{2009}'], "").into_bytes();
    for &x in numbers {
        // Six or seven digits before the point.
        let whole = format!("{}", x.trunc());
        for text in [bytes, &digits, &grouped] {
            if text.windows(whole.len()).any(|w| w == whole.as_bytes()) {
                return Some(format!("the digits {whole}"));
            }
        }
        let near = |value: f64| (value - x).abs() < 0.01;
        if bytes.windows(8).any(|w| {
            let w: [u8; 8] = w.try_into().unwrap();
            near(f64::from_le_bytes(w))
                || near(f64::from_be_bytes(w))
                || i64::from_le_bytes(w) == (x * 1000.0).round() as i64
        }) {
            return Some(format!("a double of {x}"));
        }
        let single = (x as f32).to_le_bytes();
        if bytes.windows(4).any(|w| w == single || w == [single[3], single[2], single[1], single[0]]) {
            return Some(format!("a float of {x}"));
        }
        let integer = (x.trunc() as i32).to_le_bytes();
        if bytes.windows(4).any(|w| w == integer) {
            return Some(format!("an integer of {x}"));
        }
    }
    None
}

#[test]
fn no_file_tells_where_it_was() {
    let numbers = telling();
    let original = std::fs::read(pack()).unwrap();
    assert!(tells(&original, &numbers).is_some(), "the search would find it");
    let bench = Bench::new();
    // Notes tell it by their places, by how they are looked at, by where they lead, and by what only looks like a date, a purpose or a name.
    let mut telling = notes::annotations(&pack());
    let (east, north) = (numbers[2].trunc(), numbers[8].trunc());
    for (i, key) in ["created", "modified", "motivation"].into_iter().enumerate() {
        telling["items"][i % 2][key] = format!("{east} {north}").into();
    }
    telling["items"][0]["body"][0]["purpose"] = format!("{north}").into();
    telling["items"][1]["id"] = format!("urn:uuid:{east}-{north}").into();
    let notes = notes::file(&bench, &telling);
    assert!(tells(&std::fs::read(&notes).unwrap(), &numbers).is_some(), "the search would find it in the notes");
    let object = bench.published(&pack(), FULL, &["--redact-location", "--bag", "--site", "--notes", text(&notes)]);
    let all = tree(&bench.path("site"));
    for (path, bytes) in &all {
        if let Some(what) = tells(bytes, &numbers) {
            panic!("{path} has {what}");
        }
        for word in ["8.9577", "39.5228", "32737"] {
            assert!(!bytes.windows(word.len()).any(|w| w == word.as_bytes()), "{path} has {word}");
        }
    }
    assert!(all.len() > 60 && all.contains_key("gereza/v1/annotations.json"));
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!(manifest["versions"][0]["location_redacted"], true);
    assert!(manifest["versions"][0]["figures"]["crs"].is_null());
    let published = object.join(manifest["versions"][0]["pack"]["url"].as_str().unwrap());
    crate::support::succeeds(&["verify", text(&published)]);
    // Areas are what they were.
    let area = |pack: &std::path::Path| {
        let found = json(&["measure", text(pack), "area"]);
        let readings = found["readings"].as_array().unwrap();
        readings.iter().find(|r| r["name"] == "surface").unwrap()["value"].as_f64().unwrap()
    };
    assert!((area(&published) / area(&pack()) - 1.0).abs() < 1e-9);
}

#[test]
fn what_was_published_with_its_place_cannot_be_hidden_by_a_further_version() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &[]);
    let said = bench.refused(&pack(), FULL, &["--redact-location", "--version-note", "hide", "--date", "2026-12-01"]);
    assert!(said.contains("version 1 of") && said.contains("tells the place") && said.contains("--withdraw"), "{said}");
    let said = bench.refused(&pack(), &FULL.replace("\"gereza\"", "\"other\""), &["--redact-location=3"]);
    assert!(said.contains("does not hide a model"), "{said}");
    let usage = run(&["publish", "x", "--to", "y", "--metadata", "z", "--redact-location=far"]);
    assert_eq!(usage.status.code(), Some(2));
}

#[test]
fn a_cell_tells_the_region_and_nothing_finer() {
    let bench = Bench::new();
    let notes = notes::file(&bench, &notes::annotations(&pack()));
    let object = bench.published(&pack(), FULL, &["--redact-location=100000", "--notes", text(&notes)]);
    let numbers = telling();
    for (path, bytes) in tree(&object) {
        assert_eq!(tells(&bytes, &numbers), None, "{path}");
        assert!(!bytes.windows(6).any(|w| w == b"8.9577"), "{path}");
    }
    let figures = &json_of(&object.join("manifest.json"))["versions"][0]["figures"];
    assert_eq!(figures["crs"], "EPSG:32737");
    let middle =
        |k: usize| f64::midpoint(figures["bounds"][0][k].as_f64().unwrap(), figures["bounds"][1][k].as_f64().unwrap());
    assert!(
        (middle(0) - 550_000.0).abs() < 0.1 && (middle(1) - 9_050_000.0).abs() < 0.1,
        "{} {}",
        middle(0),
        middle(1)
    );
}

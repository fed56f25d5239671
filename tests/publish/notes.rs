//! `--notes`: notes are part of a version, of its checksum lists and of its page; invalid ones are refused before anything is written.

use super::{Bench, FULL, MINIMAL, json_of, other_pack, pack, run, tree};
use crate::support::{json, text};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Identity and middle of a pack.
fn of(pack: &Path) -> (String, [f64; 3]) {
    let info = json(&["info", text(pack)]);
    let at = |key: &str, k: usize| info["metadata"][key][k].as_f64().unwrap();
    let middle = [0, 1, 2].map(|k| f64::midpoint(at("bounds_min", k), at("bounds_max", k)));
    let measured = json(&["measure", text(pack), "area"]);
    (measured["pack"]["identity"].as_str().unwrap().to_owned(), middle)
}

/// Id of the first note.
const GATE: &str = "urn:uuid:0b6ff3f0-5c3a-4c1f-9d53-8a5d00c0ffee";

/// Two notes as the page saves them, in the middle of a pack and a metre north of it and half a metre above.
pub(crate) fn annotations(pack: &Path) -> Value {
    let (identity, [x, y, z]) = of(pack);
    let note = |title: &str, place: [f64; 3]| {
        let [x, y, z] = place;
        let id = if title == "Gate" { GATE } else { "urn:uuid:0b6ff3f0-5c3a-4c1f-9d53-8a5d00c0ffef" };
        json!({
            "id": id, "type": "Annotation", "motivation": "describing", "label": title, "created": "2026-11-20T10:00:00Z",
            "body": [{ "type": "TextualBody", "purpose": "describing", "format": "text/plain", "value": "Coral rag & <b>lime</b>." },
                     { "type": "SpecificResource", "purpose": "linking", "source": "https://example.org/?q=-8.9577,39.5228" }],
            "target": { "type": "SpecificResource", "source": "https://museum.example/packs/x.kilwa",
                "selector": { "type": "PointSelector", "x": x, "y": y, "z": z },
                "state": [{ "type": "urn:kilwa:pack", "identity": identity },
                          { "type": "urn:kilwa:view", "camera": [3.9, 0.5, 82, x, y, z, 0], "display": { "section": { "origin": [x, y, z] } } }] }
        })
    };
    json!({ "@context": "http://www.w3.org/ns/anno.jsonld", "type": "AnnotationPage",
        "items": [note("Gate", [x, y, z]), note("Well", [x, y + 0.2, z + 0.1]), { "type": "Annotation", "target": "https://example.org/", "bodyValue": "no place" }] })
}

/// Notes in a file.
pub(crate) fn file(bench: &Bench, notes: &Value) -> PathBuf {
    let path = bench.path("notes.json");
    std::fs::write(&path, notes.to_string()).unwrap();
    path
}

#[test]
fn notes_are_part_of_the_version_its_checksum_lists_and_its_page() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&pack()));
    let object = bench.published(&pack(), FULL, &["--notes", text(&notes)]);
    let version = &json_of(&object.join("manifest.json"))["versions"][0];
    let written = json_of(&object.join("v1/annotations.json"));
    let items = written["items"].as_array().unwrap();
    assert_eq!((items.len(), &items[0]["label"], &items[1]["label"]), (2, &"Gate".into(), &"Well".into()));
    let (identity, middle) = of(&pack());
    let selector = &items[0]["target"]["selector"];
    assert_eq!([&selector["x"], &selector["y"], &selector["z"]].map(|v| v.as_f64().unwrap()), middle);
    assert_eq!(items[0]["target"]["state"][0]["identity"], identity.as_str());
    let pack_name = version["pack"]["url"].as_str().unwrap().trim_start_matches("v1/");
    assert_eq!(items[0]["target"]["source"], pack_name);
    // Named by manifest, checksums, crate and linkset; the page leads the viewer to it.
    let sum = version["annotations"]["sha256"].as_str().unwrap();
    assert_eq!(version["annotations"]["url"], "v1/annotations.json");
    let read = |path: &str| std::fs::read_to_string(object.join(path)).unwrap();
    assert!(read("v1/checksums.sha256").contains(&format!("{sum}  annotations.json\n")));
    let crate_ = json_of(&object.join("v1/ro-crate-metadata.json"));
    let listed = crate_["@graph"].as_array().unwrap().iter().find(|e| e["@id"] == "annotations.json").unwrap();
    assert_eq!((&listed["sha256"], &listed["encodingFormat"]), (&sum.into(), &"application/ld+json".into()));
    assert!(read("v1/linkset.json").contains("gereza/v1/annotations.json"));
    assert!(read("v1/README.txt").contains("annotations.json\n      2 notes"));
    let html = read("index.html");
    assert!(html.contains("data-annotations=\"annotations.json\""), "relative to the pack");
    assert!(
        html.contains("<strong>Gate</strong>") && html.contains("Coral rag &amp; &lt;b&gt;lime&lt;/b&gt;."),
        "as text"
    );
    assert!(html.contains("href=\"https://example.org/?q=-8.9577,39.5228\" rel=\"noopener noreferrer\""));
    crate::support::succeeds(&["verify", text(&object)]);
    let report = bench.publish(&pack(), FULL, &["--notes", text(&notes), "--dry-run", "--version-note", "x"]);
    let output = String::from_utf8(report.stdout).unwrap();
    assert!(
        output.contains("notes: 2") && output.contains("1 annotation of the notes, which names no point"),
        "{output}"
    );
}

#[test]
fn notes_have_the_same_position_in_the_iiif_scene_and_the_preview() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&pack()));
    let object = bench.published(&pack(), FULL, &["--notes", text(&notes)]);
    let manifest = json_of(&object.join("v1/iiif/manifest.json"));
    let scene = &manifest["items"][0];
    let page = &scene["annotations"][0];
    assert_eq!(
        (&page["type"], &page["id"]),
        (&"AnnotationPage".into(), &"https://museum.example/models/gereza/v1/iiif/annotations.json".into())
    );
    let page = json_of(&object.join("v1/iiif/annotations.json"));
    assert_eq!(page["id"], scene["annotations"][0]["id"]);
    // Where the preview's zero is in the pack, and that its matrix turns z up into y up.
    let glb = std::fs::read(object.join("v1/preview.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let gltf: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let number = |v: &Value| v.as_f64().unwrap();
    let origin = [0, 1, 2].map(|k| number(&gltf["extras"]["world_from_local_m"][k]));
    let matrix: Vec<f64> = gltf["nodes"][0]["matrix"].as_array().unwrap().iter().map(number).collect();
    for (i, note) in json_of(&object.join("v1/annotations.json"))["items"].as_array().unwrap().iter().enumerate() {
        let s = &note["target"]["selector"];
        let local = [number(&s["x"]) - origin[0], number(&s["y"]) - origin[1], number(&s["z"]) - origin[2]];
        let expected = [0, 1, 2].map(|row| (0..3).map(|column| matrix[column * 4 + row] * local[column]).sum::<f64>());
        let one = &page["items"][i];
        let selector = &one["target"]["selector"][0];
        assert_eq!((&selector["type"], &one["motivation"][0]), (&"PointSelector".into(), &"commenting".into()));
        for (axis, expected) in ["x", "y", "z"].iter().zip(expected) {
            assert!((number(&selector[axis]) - expected).abs() < 1e-5, "{axis} of {one}");
        }
        assert_eq!(one["target"]["source"]["id"], scene["id"]);
        // One object, also where there are several bodies.
        let body = if one["body"]["type"] == "Independents" { &one["body"]["items"][0] } else { &one["body"] };
        assert_eq!((&body["value"], &body["format"]), (&"Coral rag & <b>lime</b>.".into(), &"text/plain".into()));
        assert!(one["label"]["en"][0].is_string());
    }
}

#[test]
fn invalid_notes_are_refused_with_their_number_and_what_to_do() {
    let bench = Bench::new();
    let refused = |notes: &str, more: &[&str]| {
        let path = bench.path("bad.json");
        std::fs::write(&path, notes).unwrap();
        let message = bench.refused(&pack(), FULL, &[&["--notes", text(&path)], more].concat());
        assert!(!bench.path("site").exists(), "{message}");
        assert!(message.contains("bad.json"), "{message}");
        message
    };
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut notes = annotations(&pack());
        change(&mut notes["items"][1]);
        notes.to_string()
    };
    assert!(refused("{", &[]).contains("not usable JSON"));
    assert!(refused("{\"type\":\"FeatureCollection\"}", &[]).contains("no Web Annotations"));
    assert!(refused(&" ".repeat(16_000_001), &[]).contains("longer than 16000000 bytes"));
    let outside = changed(&|n| n["target"]["selector"]["x"] = 12.0.into());
    let message = refused(&outside, &[]);
    assert!(message.contains("note 2 (\"Well\"): 12 ") && message.contains("outside of the model"), "{message}");
    assert!(
        refused(&changed(&|n| n["body"][1]["source"] = "javascript:alert(1)".into()), &[]).contains("http or https")
    );
    assert!(refused(&changed(&|n| n["body"][0]["format"] = "text/html".into()), &[]).contains("save it again"));
    assert!(refused(&changed(&|n| n["id"] = GATE.into()), &[]).contains("same id"));
    let revealing = changed(&|n| n["body"][0]["value"] = "At 565 977 / 9 009 946".into());
    assert!(refused(&revealing, &["--redact-location"]).contains("\"565 977\" is a map coordinate of the model"));
    // Degrees that nobody gave are those of the pack, through its reference system.
    let degrees = changed(&|n| n["body"][0]["value"] = "8.9562 S".into());
    let path = bench.path("bad.json");
    std::fs::write(&path, &degrees).unwrap();
    let unplaced = FULL.replace("latitude = -8.9577\nlongitude = 39.5228\n", "");
    let message = bench.refused(&pack(), &unplaced, &["--notes", text(&path), "--redact-location"]);
    assert!(message.contains("\"8.9562\" is a latitude or longitude of the model"), "{message}");
    let missing = bench.refused(&pack(), FULL, &["--notes", "/nowhere.json"]);
    assert!(missing.contains("cannot read the notes /nowhere.json"), "{missing}");
    let both = run(&["publish", "x", "--to", "y", "--metadata", "z", "--notes", "n", "--no-notes"]);
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn notes_of_another_pack_are_reported() {
    let bench = Bench::new();
    let mut notes = annotations(&pack());
    notes["items"][0]["target"]["state"][0]["identity"] = "0123456789abcdef0123456789abcdef".into();
    let notes = file(&bench, &notes);
    let output =
        String::from_utf8(bench.publish(&pack(), FULL, &["--notes", text(&notes), "--dry-run"]).stdout).unwrap();
    assert!(output.contains("is this meant? 1 of the notes was made on another pack (0123456789ab…)"), "{output}");
}

#[test]
fn a_further_version_must_state_whether_notes_are_kept() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&pack()));
    let object = bench.published(&pack(), FULL, &["--notes", text(&notes)]);
    let next = ["--version-note", "Better text", "--date", "2026-12-01"];
    let better = FULL.replace("First paragraph", "The first paragraph");
    let message = bench.refused(&pack(), &better, &next);
    assert!(message.contains("version 1 has notes (") && message.contains("--no-notes"), "{message}");
    let kept = object.join("v1/annotations.json");
    assert!(message.contains(text(&kept)), "{message}");
    let again = bench.refused(&pack(), FULL, &[&next[..], &["--notes", text(&kept)]].concat());
    assert!(again.contains("the same pack, metadata, notes, holes, 3D Tiles and colour report"), "{again}");
    bench.published(&pack(), &better, &[&next[..], &["--notes", text(&kept)]].concat());
    assert_eq!(
        std::fs::read(&kept).unwrap(),
        std::fs::read(object.join("v2/annotations.json")).unwrap(),
        "the same pack, the same notes"
    );
    let next = ["--version-note", "Without notes", "--date", "2026-12-02", "--no-notes"];
    bench.published(&pack(), &better, &next);
    let manifest = json_of(&object.join("manifest.json"));
    assert!(manifest["versions"][1]["annotations"].is_object() && manifest["versions"][2]["annotations"].is_null());
    assert!(!object.join("v3/annotations.json").exists() && !object.join("v3/iiif/annotations.json").exists());
    let html = std::fs::read_to_string(object.join("index.html")).unwrap();
    assert!(!html.contains("data-annotations") && !html.contains("Coral rag &amp;"));
    crate::support::succeeds(&["verify", text(&object)]);
}

#[test]
fn notes_of_a_redacted_model_carry_over_to_its_next_version() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&pack()));
    let object = bench.published(&pack(), FULL, &["--notes", text(&notes), "--redact-location"]);
    let first = std::fs::read(object.join("v1/annotations.json")).unwrap();
    // Notes that readers wrote on the published model have its coordinates.
    let mut theirs = json_of(&object.join("v1/annotations.json"));
    theirs["items"][0]["label"] = "The gate".into();
    let theirs = file(&bench, &theirs);
    let next = ["--redact-location", "--version-note", "A name", "--date", "2026-12-01", "--notes", text(&theirs)];
    bench.published(&pack(), FULL, &next);
    let second = String::from_utf8(std::fs::read(object.join("v2/annotations.json")).unwrap()).unwrap();
    assert_eq!(second.replace("The gate", "Gate").into_bytes(), first, "at the same places");
    let other = bench.path("larger.kilwa");
    let input = bench.path("larger.ply");
    let mut mesh = crate::support::Input::torus(60, 30, [565_977.25, 9_009_946.5, 31.75]);
    for p in &mut mesh.positions {
        p[0] += (p[0] - 565_977.25) * 0.2;
    }
    mesh.write(&input);
    crate::support::succeeds(&["build", text(&input), "-o", text(&other), "--crs", "EPSG:32737"]);
    let next = [
        "--redact-location",
        "--same-object",
        "--version-note",
        "Larger",
        "--date",
        "2026-12-02",
        "--notes",
        text(&theirs),
    ];
    let message = bench.refused(&other, FULL, &next);
    assert!(message.contains("has another size now") && message.contains("version 1"), "{message}");
}

#[test]
fn notes_on_a_closed_model_are_not_revealed_by_public_files() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&other_pack()));
    let closed = format!("{MINIMAL}[access]\nstate = \"restricted\"\nreason = \"Rock art\"\n");
    let object = bench.published(&other_pack(), &closed, &["--notes", text(&notes)]);
    for (path, bytes) in tree(&object) {
        let has_text = bytes.windows(9).any(|w| w == b"Coral rag");
        assert_eq!(has_text, path.ends_with("annotations.json"), "{path}");
    }
}

#[test]
fn verify_finds_notes_that_do_not_belong_to_the_version() {
    let bench = Bench::new();
    let notes = file(&bench, &annotations(&other_pack()));
    let object = bench.published(&other_pack(), MINIMAL, &["--notes", text(&notes)]);
    let failed = |what: &str| {
        let output = run(&["verify", text(&object)]);
        assert_eq!(output.status.code(), Some(1));
        let printed = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(printed.contains(what), "{what} in {printed}");
    };
    let manifest = object.join("manifest.json");
    let right = std::fs::read_to_string(&manifest).unwrap();
    let mut without: Value = serde_json::from_str(&right).unwrap();
    without.as_object_mut().unwrap().remove("seal");
    without["versions"][0].as_object_mut().unwrap().remove("annotations");
    std::fs::write(&manifest, without.to_string()).unwrap();
    failed("disagree about the notes");
    std::fs::write(&manifest, &right).unwrap();
    let at = object.join("v1/annotations.json");
    let old = std::fs::read_to_string(&at).unwrap();
    std::fs::write(&at, old.replace("Coral", "coral")).unwrap();
    failed("annotations.json");
}

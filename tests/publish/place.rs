//! `--redact-location`: no file of an object reveals where the model was, as text or as a number, in any form.

use super::traces::Traces;
use super::{Bench, FULL, MINIMAL, json_of, notes, other_pack, pack, run, tree};
use crate::support::{built_once, json, text};
use kilwa_archive::checksums::sha256;
use std::path::{Path, PathBuf};

/// A torus at UTM coordinates as scanners' programs export it: with its coordinates as scalar channels, and one channel of the surface.
fn survey() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("publish");
    let write = |path: &Path| {
        let mesh = crate::support::Input::torus(90, 40, [565_977.25, 9_009_946.5, 31.75]);
        let properties = "property float scalar_X\nproperty float scalar_Y\nproperty float scalar_Elevation\nproperty float intensity\n";
        mesh.write_with(path, properties, |i| {
            let [x, y, z] = mesh.positions[i];
            let intensity = f64::from((i as u32 * 7919) % 1000) / 1000.0;
            format!("{x} {y} {} {intensity}", z / 0.3048)
        });
    };
    built_once(&folder, "survey-kilwa-fort", write, &["--crs", "EPSG:32737", "--title", "Survey at 565977"])
}

/// Everything that reveals the location of a pack: corners, middle and lattice of the true pack; its degrees and those of the metadata; codes; what the pack and its
/// sources are called.
fn traces(pack: &Path) -> Traces {
    let info = json(&["info", text(pack)]);
    let at = |key: &str, k: usize| info["metadata"][key][k].as_f64().unwrap();
    let mut map = Vec::new();
    for k in 0..2 {
        let (low, high) = (at("bounds_min", k), at("bounds_max", k));
        map.extend([low, high, f64::midpoint(low, high), low.floor(), high.ceil(), low.round()]);
    }
    let bytes = std::fs::read(pack).unwrap();
    let identity = json(&["measure", text(pack), "area"])["pack"]["identity"].as_str().unwrap().to_owned();
    let mut words = vec![sha256(&bytes), identity];
    for source in info["metadata"]["sources"].as_array().unwrap() {
        words.push(source["sha256"].as_str().unwrap().to_owned());
        words.push(source["name"].as_str().unwrap().to_lowercase());
    }
    // Geohashes, Plus Codes, grid square and locator of the two sites.
    let codes = ["kykjj1", "kykj53", "6g3x2jv2", "6g3x2grf", "37lel", "ki91tb", "ki91sb", "32737", "geo:"];
    words.extend(codes.map(str::to_owned));
    Traces { map, degrees: vec![-8.9577, 39.5228, -8.956_2, 39.600_1], words }
}

/// Metadata that are published whole but for what is left out.
fn metadata() -> String {
    FULL.replace("[place]\n", "[place]\nuri = \"https://www.geonames.org/157107\"\n")
        .replace("[object]\n", "[object]\nuri = \"https://www.wikidata.org/wiki/Q1\"\n")
}

#[test]
fn the_search_for_traces_finds_known_traces() {
    let traces = traces(&survey());
    for form in [
        "565977",
        "565 977",
        "9,009,946",
        "9.009.946",
        "9'009'946.5",
        " 65977 ",
        "8.9577",
        "-8,9577123",
        "8.9562",
        "39.52281",
        "8%2e9577",
        "8°57",
        "8&deg;57",
        "085727S",
        "8:57:27",
        "kykj5379",
        "6G3X2GRF+W4",
        "37LEL6597",
        "EPSG:32737",
        "geo:1,2",
        "survey-kilwa-fort.ply",
    ] {
        assert!(traces.found("x.txt", format!("before {form} after").as_bytes()).is_some(), "{form}");
    }
    let middle = traces.map[2];
    for bytes in [
        middle.to_le_bytes().to_vec(),
        middle.to_be_bytes().to_vec(),
        (middle as f32).to_le_bytes().to_vec(),
        (middle as f32).to_be_bytes().to_vec(),
        (middle as i32).to_be_bytes().to_vec(),
        (-8.9577f64).to_radians().to_le_bytes().to_vec(),
        (39.5228f64 as f32).to_le_bytes().to_vec(),
        395_228_000i32.to_le_bytes().to_vec(),
    ] {
        assert!(traces.found("x.bin", &[&[7; 3], &bytes[..], &[9; 5]].concat()).is_some(), "{bytes:?}");
    }
    // An object that was published with its place is full of them.
    let bench = Bench::new();
    let object = bench.published(&survey(), &metadata(), &[]);
    let revealing: Vec<String> =
        tree(&object).iter().filter(|(p, b)| traces.found(p, b).is_some()).map(|(p, _)| p.clone()).collect();
    for path in ["manifest.json", "index.html", "v1/preview.glb", "v1/metadata/paradata.json", "v1/drawings/plan.pgw"] {
        assert!(revealing.iter().any(|t| t == path), "{path} of {revealing:?}");
    }
    assert!(revealing.iter().any(|t| t.starts_with("v1/pack.")), "{revealing:?}");
}

#[test]
fn no_file_reveals_the_original_location() {
    let survey = survey();
    let traces = traces(&survey);
    let bench = Bench::new();
    // Notes reveal it by their positions, their views, their links, and by text in fields for dates, purposes and names.
    let mut revealing = notes::annotations(&survey);
    let (east, north) = (traces.map[2].trunc(), traces.map[8].trunc());
    for (i, key) in ["created", "modified", "motivation"].into_iter().enumerate() {
        revealing["items"][i % 2][key] = format!("{east} {north}").into();
    }
    revealing["items"][0]["body"][0]["purpose"] = format!("{north}").into();
    revealing["items"][1]["id"] = format!("urn:uuid:{east}-{north}").into();
    let notes = notes::file(&bench, &revealing);
    assert!(
        traces.found("notes.json", &std::fs::read(&notes).unwrap()).is_some(),
        "the search would find it in the notes"
    );
    let more = ["--redact-location", "--keep-channel", "intensity", "--bag", "--site", "--notes", text(&notes)];
    let object = bench.published(&survey, &metadata(), &more);
    let all = tree(&bench.path("site"));
    let found: Vec<String> =
        all.iter().filter_map(|(path, bytes)| Some(format!("{path} has {}", traces.found(path, bytes)?))).collect();
    assert!(found.is_empty(), "{found:#?}");
    for name in all.keys() {
        assert!(traces.found("name.txt", name.as_bytes()).is_none(), "{name}");
    }
    assert!(all.len() > 60 && all.contains_key("gereza/v1/annotations.json"));
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!(manifest["versions"][0]["location_redacted"], true);
    assert!(manifest["versions"][0]["figures"]["crs"].is_null());
    let published = object.join(manifest["versions"][0]["pack"]["url"].as_str().unwrap());
    crate::support::succeeds(&["verify", text(&published)]);
    let channels = json(&["info", text(&published)])["metadata"]["scalars"].clone();
    let names: Vec<&str> = channels.as_array().unwrap().iter().map(|c| c["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["intensity"], "what was asked for, and nothing else");
    // Areas are unchanged.
    let area = |pack: &std::path::Path| {
        let found = json(&["measure", text(pack), "area"]);
        let readings = found["readings"].as_array().unwrap();
        readings.iter().find(|r| r["name"] == "surface").unwrap()["value"].as_f64().unwrap()
    };
    assert!((area(&published) / area(&survey) - 1.0).abs() < 1e-9);
}

#[test]
fn channels_are_dropped_unless_named_and_free_of_coordinates() {
    let bench = Bench::new();
    let survey = survey();
    let dry = bench.publish(&survey, &metadata(), &["--redact-location", "--dry-run"]);
    let output = String::from_utf8(dry.stdout).unwrap();
    assert!(
        output.contains(
            "left out: the scalar channels scalar_X, scalar_Y, scalar_Elevation, intensity, which may hold coordinates"
        ),
        "{output}"
    );
    for channel in ["scalar_X", "scalar_Y", "scalar_Elevation"] {
        let keep = ["--redact-location", "--keep-channel", "intensity", "--keep-channel", channel];
        let message = bench.refused(&survey, &metadata(), &keep);
        let wanted = format!("--keep-channel {channel}: the channel holds ");
        assert!(message.contains(&wanted), "{message}");
    }
    let message = bench.refused(&survey, &metadata(), &["--redact-location", "--keep-channel", "Intensity"]);
    assert!(message.contains("the pack has the channels scalar_X, scalar_Y, scalar_Elevation, intensity"), "{message}");
    let message = bench.refused(&pack(), FULL, &["--redact-location", "--keep-channel", "x"]);
    assert!(message.contains("no scalar channels"), "{message}");
    let message = bench.refused(&pack(), &FULL.replace("\"gereza\"", "\"other\""), &["--redact-location=1e9"]);
    assert!(message.contains("omit the number"), "{message}");
    let usage = run(&["publish", "x", "--to", "y", "--metadata", "z", "--keep-channel", "x"]);
    assert_eq!(usage.status.code(), Some(2), "only where the location is taken out");
}

#[test]
fn every_text_that_reveals_the_location_is_refused_with_its_line() {
    let bench = Bench::new();
    let hidden = metadata();
    // A text of FULL, what is put in its place, and the field that is named.
    let table: [(&str, &str, &str); 19] = [
        ("Gereza & fort, \\\"Kilwa\\\"", "Fort at 565977 E", "title"),
        ("Ngome <ya> Kilwa", "Fort 8.9577 S", "alternative_titles"),
        ("First paragraph & more.", "It lies at 8°57'27\\\" S", "description"),
        ("Second <b>one</b>.", "see geo:-8.9577,39.5228", "description"),
        ("Swahili coast", "37L EL 65977 09946", "subjects"),
        ("slug = \"gereza\"", "slug = \"fort-565977\"", "slug"),
        ("https://museum.example/models/gereza/", "https://museum.example/@-8.957,39.522/", "url"),
        ("doi:10.1234/abc_d", "doi:10.1234/9009946", "identifier"),
        ("Museum & Sons", "Museum, 6G3X2GRF+W4", "publisher"),
        ("Antiquities Division", "Office at ٥٦٥٩٧٧", "rights.holder"),
        ("Rüther, Heinz", "Rüther, 39,5228", "creators.name"),
        ("University of Cape Town", "Field office 9 009 946", "creators.affiliation"),
        ("Held, Christoph", "Held, kykj5379", "contributors.name"),
        ("Kilwa Kisiwani", "Kilwa (S 8.96 E 39.52)", "place.name"),
        ("coral rag", "coral rag of -8.957/39.523", "object.materials"),
        ("UNESCO 144", "register 565977/9009946", "object.identifiers"),
        ("Inside and outside.", "Control point 565 977.25 / 9 009 946.50", "capture.description"),
        ("\"Registration\"", "\"Registered in EPSG:32737\"", "capture.steps.what"),
        ("10.1145/1015706.1015802", "https://www.openstreetmap.org/#map=17/1/2", "related.uri"),
    ];
    for (old, new, field) in table {
        assert!(hidden.contains(old), "{old}");
        let changed = hidden.replace(old, new);
        let line = changed.lines().position(|l| l.contains(new)).unwrap() + 1;
        let message = bench.refused(&survey(), &changed, &["--redact-location"]);
        assert!(message.contains(&format!("line {line}: {field}: \"")), "{new}: {message}");
        assert!(message.contains("remove it from the text"), "{message}");
        if field != "slug" && field != "title" {
            let dry = bench.publish(&survey(), &changed, &["--dry-run"]);
            assert!(
                dry.status.success(),
                "with its place it is published as it is: {}",
                String::from_utf8_lossy(&dry.stderr)
            );
        }
    }
    let all = table.iter().fold(hidden, |text, (old, new, _)| text.replace(old, new));
    let message = bench.refused(&survey(), &all, &["--redact-location"]);
    assert!(
        message.matches("\n  line ").count() + usize::from(message.contains("  line ")) >= table.len() - 1,
        "all at once: {message}"
    );
    let message = bench.refused(&survey(), &metadata(), &["--redact-location", "--version-note", "Moved to 565977"]);
    assert!(message.contains("--version-note: \"565977\" is a map coordinate of the model"), "{message}");
}

#[test]
fn a_published_location_cannot_be_hidden_by_a_further_version() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &[]);
    let message =
        bench.refused(&pack(), FULL, &["--redact-location", "--version-note", "hide", "--date", "2026-12-01"]);
    assert!(
        message.contains("version 1 of") && message.contains("reveals the location") && message.contains("--withdraw"),
        "{message}"
    );
    let message = bench.refused(&pack(), &FULL.replace("\"gereza\"", "\"other\""), &["--redact-location=3"]);
    assert!(message.contains("does not hide a model"), "{message}");
    let usage = run(&["publish", "x", "--to", "y", "--metadata", "z", "--redact-location=far"]);
    assert_eq!(usage.status.code(), Some(2));
    // Under another name it can, and the operator is warned that the two can be compared.
    let other = MINIMAL.replace("Fort", "Rock shelter");
    let dry = bench.publish(&pack(), &other, &["--redact-location", "--dry-run"]);
    let output = String::from_utf8(dry.stdout).unwrap();
    assert!(output.contains("is this meant? the same model with its location is published as gereza"), "{output}");
    let dry = bench.publish(&other_pack(), &other, &["--redact-location", "--dry-run"]);
    assert!(!String::from_utf8(dry.stdout).unwrap().contains("same model"));
}

#[test]
fn a_cell_reveals_the_region_and_nothing_finer() {
    let bench = Bench::new();
    let survey = survey();
    let notes = notes::file(&bench, &notes::annotations(&survey));
    let object = bench.published(&survey, &metadata(), &["--redact-location=100000", "--notes", text(&notes)]);
    let mut traces = traces(&survey);
    // Only the reference system and the square of 100 km are revealed.
    traces.words.retain(|w| w != "32737" && w != "37lel");
    for (path, bytes) in tree(&object) {
        assert_eq!(traces.found(&path, &bytes), None, "{path}");
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

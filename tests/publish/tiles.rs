//! `kilwa publish --tiles`: all levels of detail as 3D Tiles become part of a version.

use super::{Bench, FULL, MINIMAL, json_of, other_pack, pack, run, tree};
use crate::support::{succeeds, text};
use crate::verify_objects::{Behaviour, server};
use serde_json::Value;
use std::path::Path;
use std::sync::Mutex;

/// Texts under `uri`, with the folder of the file that they are in.
fn uris(root: &Path, tileset: &str) -> Vec<String> {
    fn collect(value: &Value, found: &mut Vec<String>) {
        match value {
            Value::Array(items) => items.iter().for_each(|item| collect(item, found)),
            Value::Object(map) => {
                found.extend(map.get("uri").and_then(Value::as_str).map(str::to_owned));
                map.values().for_each(|value| collect(value, found));
            }
            _ => {}
        }
    }
    let mut found = Vec::new();
    collect(&json_of(&root.join(tileset)), &mut found);
    found
}

#[test]
fn tiles_become_part_of_the_version_and_are_verified() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--tiles", "--geoid-offset", "-28.5"]);
    let named = uris(&object.join("v1/tiles"), "tileset.json");
    assert!(!named.is_empty() && named.iter().all(|uri| object.join("v1/tiles").join(uri).is_file()), "{named:?}");
    let tileset = json_of(&object.join("v1/tiles/tileset.json"));
    assert!(tileset["root"]["transform"].is_array(), "EPSG:32737 has a place on the globe");
    // What was extracted by hand is the same.
    let by_hand = bench.path("by-hand");
    let published = std::fs::read_dir(object.join("v1")).unwrap().flatten();
    let published = published.map(|e| e.path()).find(|p| p.extension().is_some_and(|e| e == "kilwa")).unwrap();
    succeeds(&["extract", text(&published), "--to", "tiles", "-o", text(&by_hand), "--geoid-offset", "-28.5"]);
    assert!(tree(&by_hand) == tree(&object.join("v1/tiles")));
    // Manifest, checksums, records and page name them.
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!(manifest["versions"][0]["tiles"]["url"], "v1/tiles/tileset.json");
    let read = |path: &str| std::fs::read_to_string(object.join(path)).unwrap();
    for uri in &named {
        assert!(read("v1/checksums.sha256").contains(&format!("  tiles/{uri}\n")));
    }
    assert_eq!(json_of(&object.join("v1/metadata/paradata.json"))["tiles"]["geoid_offset_m"], -28.5);
    for record in ["v1/README.txt", "v1/linkset.json", "v1/ro-crate-metadata.json", "index.html"] {
        assert!(read(record).contains("tiles/tileset.json"), "{record}");
    }
    assert!(!read("v1/ro-crate-metadata.json").contains(&named[0]), "a crate does not list every tile");
    let page = read("index.html");
    assert!(page.contains("Cesium3DTileset.fromUrl(") && page.contains("QGIS cannot read compressed tiles"), "{page}");
    succeeds(&["verify", text(&object)]);
    // The same again adds nothing. Another profile is another version, and one without tiles says so.
    bench.published(&pack(), FULL, &["--tiles=web", "--geoid-offset", "-28.5"]);
    assert!(!object.join("v2").exists());
    let plain = ["--tiles=plain", "--geoid-offset", "-28.5", "--version-note", "Plain tiles", "--date", "2026-12-01"];
    bench.published(&pack(), FULL, &plain);
    assert_eq!(json_of(&object.join("v2/tiles/tileset.json"))["asset"]["extras"]["profile"], "plain");
    assert!(read("index.html").contains("New Cesium 3D Tiles Connection"));
    let report = bench.publish(&pack(), FULL, &["--version-note", "Without tiles", "--date", "2026-12-02"]);
    assert!(
        String::from_utf8(report.stdout).unwrap().contains("the previous version has 3D Tiles, and this one has none")
    );
    assert!(!object.join("v3/tiles").exists());
}

#[test]
fn a_damaged_or_missing_tile_is_reported() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--tiles"]);
    let named = uris(&object.join("v1/tiles"), "tileset.json");
    let tile = object.join("v1/tiles").join(&named[0]);
    let bytes = std::fs::read(&tile).unwrap();
    let says = |expected: &str| {
        let output = run(&["verify", text(&object)]);
        assert_eq!(output.status.code(), Some(1));
        let printed = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(printed.contains(&named[0]) && printed.contains(expected), "{printed}");
    };
    let mut damaged = bytes;
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(&tile, &damaged).unwrap();
    says("v1/tiles");
    std::fs::remove_file(&tile).unwrap();
    says("missing");
}

#[test]
fn files_of_a_version_are_requested_once_when_it_is_verified_at_an_address() {
    static ASKED: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--tiles"]);
    let (_, address) = server(&object, |_, path| {
        ASKED.lock().unwrap().push(path.to_owned());
        Behaviour::Good
    });
    succeeds(&["verify", &address]);
    let asked = ASKED.lock().unwrap();
    let files: Vec<String> = tree(&object.join("v1")).into_keys().filter(|path| !path.ends_with('/')).collect();
    assert!(files.iter().any(|path| path == "tiles/tileset.json") && files.len() > 20);
    let is_pack = |path: &str| Path::new(path).extension().is_some_and(|e| e == "kilwa");
    for path in files.iter().filter(|path| !is_pack(path)) {
        let times = asked.iter().filter(|asked| **asked == format!("v1/{path}")).count();
        assert_eq!(times, 1, "{path}");
    }
}

#[test]
fn tiles_of_a_model_without_its_location_are_not_on_the_globe() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--tiles", "--redact-location"]);
    for (path, bytes) in tree(&object.join("v1/tiles")) {
        let text = String::from_utf8_lossy(&bytes);
        assert!(!text.contains("32737") && !text.contains("9009") && !text.contains("5659"), "{path}");
    }
    assert!(std::fs::read_to_string(object.join("index.html")).unwrap().contains("are not placed on the globe"));
    let why = bench.refused(&pack(), FULL, &["--tiles", "--redact-location", "--geoid-offset", "-28.5"]);
    assert!(why.contains("--geoid-offset is for models that are published with their coordinate reference"), "{why}");
    // A coarse location gives no better one by its height.
    let why = bench.refused(&pack(), FULL, &["--tiles", "--redact-location=100000", "--geoid-offset", "-28.5"]);
    assert!(why.contains("--geoid-offset is for"), "{why}");
}

#[test]
fn tiles_of_a_closed_model_are_only_for_those_who_may_have_it() {
    let bench = Bench::new();
    let closed = format!("{MINIMAL}[access]\nstate = \"restricted\"\nreason = \"Rock art\"\n");
    let object = bench.published(&other_pack(), &closed, &["--tiles"]);
    let paths: Vec<String> = tree(&object.join("v1/tiles")).into_keys().filter(|path| !path.ends_with('/')).collect();
    assert!(paths.iter().any(|path| path.ends_with("tileset.json")) && paths.len() > 1);
    for path in paths {
        assert!(kilwa_archive::layout::is_geometry(&format!("v1/tiles/{path}")), "{path}");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            let mode = std::fs::metadata(object.join("v1/tiles").join(&path)).unwrap().permissions().mode();
            assert_eq!(mode & 0o007, 0, "{path}: {mode:o}");
        }
    }
}

//! Downloads of Sketchfab: built in place, and their rights in the metadata file.

use crate::support::zip::{archive, deflated, gltf, license, stored};
use crate::support::{fails, kilwa, succeeds, text};
use std::path::{Path, PathBuf};

const EXTRAS: &str = "{\"author\":\"Amina Juma (https://sketchfab.com/amina)\",\"license\":\"CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)\",\"source\":\"https://sketchfab.com/3d-models/fort-0123\",\"title\":\"Fort\"}";
const BY: &str = "CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)";

/// `fort.zip`, and what is in it as files in `fort/`.
struct Site(tempfile::TempDir);

impl Site {
    fn new(rights: &str, extras: &str) -> Self {
        let site = Self(tempfile::tempdir().unwrap());
        let mut picture = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([x as u8 * 30, y as u8 * 30, 99]))
            .write_to(&mut picture, image::ImageFormat::Png)
            .unwrap();
        let (json, buffer) = gltf(Some("textures/fort_baseColor.png"), extras);
        let parts = [
            ("license.txt", license("Fort", rights).into_bytes()),
            ("scene.bin", buffer),
            ("scene.gltf", json.into_bytes()),
            ("textures/fort_baseColor.png", picture.into_inner()),
        ];
        std::fs::create_dir_all(site.path("fort/textures")).unwrap();
        for (name, data) in &parts {
            std::fs::write(site.path("fort").join(name), data).unwrap();
        }
        let items: Vec<_> = parts.iter().map(|(name, data)| deflated(name, data)).collect();
        std::fs::write(site.path("fort.zip"), archive(&items)).unwrap();
        site
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The mesh of the pack that is built from an input, as a file.
    fn built(&self, input: &str, more: &[&str]) -> Vec<u8> {
        let (pack, mesh) = (self.path("out.kilwa"), self.path("out.ply"));
        succeeds(
            &[&["build", text(&self.path(input)), "-o", text(&pack), "--title", "Fort", "--force"], more].concat(),
        );
        succeeds(&["verify", text(&pack)]);
        succeeds(&["extract", text(&pack), "-o", text(&mesh), "--force"]);
        let bytes = std::fs::read(&mesh).unwrap();
        // A comment names the pack by its content, which includes the name of the source.
        let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        bytes[header..].to_vec()
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_download_gives_the_same_surface_as_its_unpacked_files() {
    let site = Site::new(BY, EXTRAS);
    let unpacked = site.built("fort/scene.gltf", &[]);
    assert_eq!(site.built("fort.zip", &[]), unpacked);
    assert_eq!(
        site.built("fort.zip", &["--texture-detail", "1"]),
        site.built("fort/scene.gltf", &["--texture-detail", "1"])
    );
    // Nothing is left beside it.
    assert_eq!(names(site.0.path()), ["fort", "fort.zip", "out.kilwa", "out.ply"]);
    let info: serde_json::Value =
        serde_json::from_str(&succeeds(&["info", text(&site.path("out.kilwa")), "--json"])).unwrap();
    assert_eq!(info["metadata"]["sources"][0]["name"], "scene.gltf");
    site.built("fort.zip", &["--up", "z"]);
    let info: serde_json::Value =
        serde_json::from_str(&succeeds(&["info", text(&site.path("out.kilwa")), "--json"])).unwrap();
    assert_eq!(info["metadata"]["sources"][0]["name"], "fort.zip");
    let report = succeeds(&["info", text(&site.path("fort.zip"))]);
    assert!(report.contains("2 triangles") && report.contains("up: y"), "{report}");
}

#[test]
fn a_build_says_what_the_download_states_and_how_to_keep_it() {
    let site = Site::new(BY, EXTRAS);
    let pack = site.path("fort.kilwa");
    let output = kilwa(&["build", text(&site.path("fort.zip")), "-o", text(&pack)]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("\"Fort\" by Amina Juma under CC-BY-4.0"), "{said}");
    assert!(said.contains(&format!("--download {}", site.path("fort.zip").display())), "{said}");
    let output = kilwa(&["build", text(&site.path("fort/scene.gltf")), "-o", text(&pack), "--force"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn metadata_init_fills_in_what_the_download_states_and_names_the_source() {
    let site = Site::new(BY, EXTRAS);
    let (pack, file) = (site.path("fort.kilwa"), site.path("fort.toml"));
    succeeds(&["build", text(&site.path("fort.zip")), "-o", text(&pack)]);
    let init = ["metadata", "init", text(&pack), "--download", text(&site.path("fort.zip")), "-o", text(&file)]
        .map(str::to_owned);
    let init: Vec<&str> = init.iter().map(String::as_str).collect();
    succeeds(&init);
    let checked = succeeds(&["metadata", "check", text(&file)]);
    assert!(checked.contains("\"Fort\", https://creativecommons.org/licenses/by/4.0/"), "{checked}");
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.contains("# From license.txt and asset.extras of scene.gltf in fort.zip.\n"), "{written}");
    assert!(written.contains("statement = \"This work is based on \\\"Fort\\\""), "{written}");
    assert!(written.contains("uri = \"https://sketchfab.com/3d-models/fort-0123\"\n"), "{written}");
    assert!(fails(&init).contains("already exists"));
}

#[test]
fn contradictions_unknown_licences_and_archives_without_rights_are_reported() {
    let site = Site::new(
        "Editorial",
        &EXTRAS
            .replace("\"Fort\"", "\"Castle\"")
            .replace("CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)", "Editorial"),
    );
    let init = |zip: &Path| kilwa(&["metadata", "init", "--download", text(zip)]);
    let output = init(&site.path("fort.zip"));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("contradictory statements about the title"), "{said}");
    assert!(
        said.contains("\"Editorial\" is not a known licence") && said.contains("permission of the rights holder"),
        "{said}"
    );
    let written = String::from_utf8_lossy(&output.stdout);
    assert!(written.contains("title = \"\"\n") && written.contains("statement = \"Licence: Editorial\\n"), "{written}");
    let plain = site.path("plain.zip");
    std::fs::write(&plain, archive(&[stored("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")])).unwrap();
    assert!(
        fails(&["metadata", "init", "--download", text(&plain)])
            .contains("does not state its rights: it has no license.txt")
    );
}

#[test]
fn archives_in_folders_are_skipped_and_refused_ones_are_named() {
    let site = Site::new(BY, EXTRAS);
    let (folder, pack) = (site.path("fort"), site.path("out.kilwa"));
    std::fs::copy(site.path("fort.zip"), folder.join("fort.zip")).unwrap();
    let output = kilwa(&["build", text(&folder), "-o", text(&pack), "--force"]);
    assert!(output.status.success() && String::from_utf8_lossy(&output.stderr).contains("skipped"), "{output:?}");
    // The archive as the output of its own build.
    let same = site.path("same.kilwa");
    std::fs::copy(site.path("fort.zip"), &same).unwrap();
    let before = std::fs::read(&same).unwrap();
    fails(&["build", text(&same), "-o", text(&same), "--force"]);
    assert!(std::fs::read(&same).unwrap() == before);
    let bad = site.path("bad.zip");
    std::fs::write(&bad, archive(&[stored("../scene.obj", b"v 0 0 0\n")])).unwrap();
    for args in [
        &["info", text(&bad)][..],
        &["build", text(&bad), "-o", text(&pack), "--force"],
        &["metadata", "init", "--download", text(&bad)],
    ] {
        let message = fails(args);
        assert!(message.contains("bad.zip") && message.contains("leads upwards"), "{args:?}: {message}");
    }
    std::fs::write(&bad, &std::fs::read(site.path("fort.zip")).unwrap()[..900]).unwrap();
    assert!(fails(&["info", text(&bad)]).contains("truncated or damaged"));
}

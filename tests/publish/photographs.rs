//! `kilwa publish --colour-report` and `--photos`: the colour report and the photographs that they come from become part of a version.

use super::{Bench, FULL, MINIMAL, json_of, pack, run, tree};
use crate::support::{json, made_once, succeeds, text};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Metadata that state the rights in the photographs.
const WITH_RIGHTS: &str = "title = \"Fort\"\npublished = 2026-11-21\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n\
    [photographs]\nrights = \"CC BY-NC 4.0\"\ncreators = [\"Juma, Amina\"]\nholder = \"Antiquities Division\"\ncredit = \"Photographs: A. Juma\"\n";

/// A pack that was coloured from three simulated photographs, one of them with a mask.
#[derive(Clone)]
pub(crate) struct Coloured {
    pub(crate) pack: PathBuf,
    pub(crate) report: PathBuf,
    pub(crate) photos: PathBuf,
}

/// Coloured by the first test that asks, and again when the program has changed.
pub(crate) fn coloured() -> Coloured {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("photographs");
    made_once(&folder, colour);
    let at = |name: &str| folder.join(name);
    Coloured { pack: at("coloured.kilwa"), report: at("report.json"), photos: at("session/photos") }
}

fn colour(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let at = |name: &str| folder.join(name);
    let (session, photos) = (at("session"), at("session/photos"));
    succeeds(&["synth", "photos", "--photos", "3", "--panoramas", "1", "--size", "320x240", "-o", text(&session)]);
    let mask = image::GrayImage::from_fn(320, 240, |x, _| image::Luma([if x < 300 { 255 } else { 0 }]));
    mask.save(photos.join("images/IMG_0001.mask.png")).unwrap();
    let [mesh, plain] = ["fort.ply", "fort.kilwa"].map(at);
    succeeds(&["synth", "fort", "--triangles", "6k", "-o", text(&mesh)]);
    succeeds(&["build", text(&mesh), "-o", text(&plain)]);
    let (report, pack) = (at("report.json"), at("coloured.kilwa"));
    let options = ["--photos", text(&photos), "--report", text(&report), "-o", text(&pack)];
    succeeds(&[&["colour", text(&plain)], options.as_slice()].concat());
}

impl Coloured {
    fn options(&self) -> [&str; 4] {
        ["--colour-report", text(&self.report), "--photos", text(&self.photos)]
    }

    /// The same with a report that was changed.
    fn with_report(&self, bench: &Bench, change: impl FnOnce(&mut Value)) -> Self {
        let mut report = json_of(&self.report);
        change(&mut report);
        let path = bench.path("changed.json");
        std::fs::write(&path, report.to_string()).unwrap();
        Self { report: path, ..self.clone() }
    }

    /// The same with copies of the photographs.
    fn with_copies(&self, bench: &Bench) -> Self {
        let to = bench.path("copies");
        for (path, bytes) in tree(&self.photos) {
            let path = to.join(path);
            if path.to_str().unwrap().ends_with('/') {
                std::fs::create_dir_all(path).unwrap();
            } else {
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, bytes).unwrap();
            }
        }
        Self { photos: to, ..self.clone() }
    }
}

#[test]
fn photographs_and_their_report_become_part_of_the_version_and_are_verified() {
    let (bench, made) = (Bench::new(), coloured());
    let dry = bench.publish(&made.pack, WITH_RIGHTS, &[&made.options()[..], &["--dry-run"]].concat());
    let dry = String::from_utf8(dry.stdout).unwrap();
    assert!(dry.contains("\n  photographs: 3 photographs and 1 mask, ") && dry.contains("(CC BY-NC 4.0)"), "{dry}");
    assert!(dry.contains("\n  colour report: 3 photographs, 1 left out\n"), "{dry}");
    assert!(!bench.path("site").exists());
    let output = bench.publish(&made.pack, WITH_RIGHTS, &[&made.options()[..], &["--json"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("also publishes 3 photographs and 1 mask, "), "{said}");
    assert!(said.contains("; 3 smaller copies for the page, "), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["photographs"], &report["masks"]), (&3.into(), &1.into()), "{report}");
    let object = PathBuf::from(report["object"].as_str().unwrap());
    // The same bytes, under the names that they have.
    let mut bytes = 0;
    for (path, name) in [
        ("images/IMG_0001.jpg", "IMG_0001.jpg"),
        ("images/IMG_0002.jpg", "IMG_0002.jpg"),
        ("images/IMG_0003.jpg", "IMG_0003.jpg"),
        ("images/IMG_0001.mask.png", "masks/IMG_0001.mask.png"),
    ] {
        let published = object.join("v1/photographs").join(name);
        let published = std::fs::read(&published).unwrap_or_else(|e| panic!("{name}: {e}: {:?}", tree(&object).keys()));
        assert!(published == std::fs::read(made.photos.join(path)).unwrap(), "{name}");
        bytes += published.len();
    }
    assert_eq!(report["photograph_bytes"], bytes);
    // A smaller copy of each, for lists; as previews, photographs of this size are themselves small enough.
    assert_eq!(report["photograph_copies"], 3);
    for n in 1..=3 {
        let copy = image::open(object.join(format!("v1/photographs/thumbnails/IMG_000{n}.jpg"))).unwrap();
        assert_eq!((copy.width(), copy.height()), (240, 180));
    }
    assert!(!object.join("v1/photographs/previews").exists());
    bytes += usize::try_from(report["photograph_copy_bytes"].as_u64().unwrap()).unwrap();
    // Manifest, checksums, paradata, crate, licence and page name them.
    let version = json_of(&object.join("manifest.json"))["versions"][0].clone();
    assert_eq!(version["colour_report"]["url"], "v1/colour-report.json");
    assert_eq!((&version["photographs"]["files"], &version["photographs"]["bytes"]), (&7.into(), &bytes.into()));
    let read = |path: &str| std::fs::read_to_string(object.join(path)).unwrap();
    assert_eq!(read("v1/checksums.sha256").matches("  photographs/").count(), 7);
    let graph = json_of(&object.join("v1/ro-crate-metadata.json"))["@graph"].clone();
    let licensed = graph.as_array().unwrap().iter().filter(|one| {
        one["license"]["@id"] == "https://creativecommons.org/licenses/by-nc/4.0/" && one["@type"] == "File"
    });
    assert_eq!(licensed.count(), 7, "{graph}");
    assert!(read("v1/LICENSE.txt").contains("Photographers: Juma, Amina"));
    assert!(read("v1/README.txt").contains("3 photographs that the colours come from"));
    let page = read("index.html");
    assert!(page.contains("photographs/IMG_0002.jpg\" download>") && page.contains("A. Juma"), "{page}");
    assert!(
        page.contains("data-photographs=\"colour-report.json\" data-photographs-credit=\"Photographs: A. Juma\""),
        "{page}"
    );
    succeeds(&["verify", text(&object)]);
    // The report states neither folders of this computer nor anything else that is not part of it.
    assert!(!read("v1/colour-report.json").contains(env!("CARGO_TARGET_TMPDIR")));
    // The same again adds nothing.
    bench.published(&made.pack, WITH_RIGHTS, &made.options());
    assert!(!object.join("v2").exists());
}

#[test]
fn paradata_list_every_photograph_with_its_pose_residual_and_share() {
    let (bench, made) = (Bench::new(), coloured());
    // As if the poses had been refined.
    let made = made.with_report(&bench, |report| {
        for photo in report["photographs"].as_array_mut().unwrap() {
            photo["refined"] = serde_json::json!({"moved_px": 1.5, "residual_px": 0.75, "agreement": 0.9});
        }
    });
    // Photographs are not published without being asked for, and their rights are not asked for then.
    let object = bench.published(&made.pack, MINIMAL, &["--colour-report", text(&made.report)]);
    assert!(!object.join("v1/photographs").exists());
    let (colours, report) =
        (json_of(&object.join("v1/metadata/paradata.json"))["colours"].clone(), json_of(&made.report));
    let (listed, expected) = (&colours["photographs"], &report["photographs"]);
    assert_eq!(listed.as_array().unwrap().len(), 3, "{colours}");
    for (photo, expected) in listed.as_array().unwrap().iter().zip(expected.as_array().unwrap()) {
        for key in
            ["name", "bytes", "sha256", "camera", "camera_from_world", "position", "refined", "seen", "share", "gain"]
        {
            assert!(!photo[key].is_null() && photo[key] == expected[key], "{key}: {photo} {expected}");
        }
        assert!(photo["path"].is_null());
    }
    assert_eq!(listed[0]["mask"], "IMG_0001.mask.png");
    assert_eq!(colours["left_out"][0]["name"], report["left_out"][0]["name"]);
    assert_eq!(colours["left_out"][0]["why"], report["left_out"][0]["why"]);
    succeeds(&["verify", text(&object)]);
}

#[test]
fn altered_or_missing_photographs_are_refused_by_name() {
    let (bench, made) = (Bench::new(), coloured());
    let made = made.with_copies(&bench);
    let altered = made.photos.join("images/IMG_0002.jpg");
    let mut bytes = std::fs::read(&altered).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&altered, &bytes).unwrap();
    let why = bench.refused(&made.pack, WITH_RIGHTS, &made.options());
    assert!(why.contains("1 file has changed since the model was coloured") && why.contains("IMG_0002.jpg"), "{why}");
    let dry = bench.refused(&made.pack, WITH_RIGHTS, &[&made.options()[..], &["--dry-run"]].concat());
    assert!(dry.contains("IMG_0002.jpg"), "{dry}");
    // A length that differs is found before anything is read, together with what is missing.
    bytes.push(0);
    std::fs::write(&altered, &bytes).unwrap();
    std::fs::remove_file(made.photos.join("images/IMG_0003.jpg")).unwrap();
    std::fs::remove_file(made.photos.join("images/IMG_0001.mask.png")).unwrap();
    let why = bench.refused(&made.pack, WITH_RIGHTS, &made.options());
    assert!(why.contains("2 files of the colour report are not in the folder"), "{why}");
    assert!(
        why.contains("IMG_0001.mask.png, IMG_0003.jpg")
            && why.contains("changed since the model was coloured: IMG_0002.jpg"),
        "{why}"
    );
}

#[test]
fn photographs_without_a_statement_of_rights_are_refused_with_what_to_write() {
    let (bench, made) = (Bench::new(), coloured());
    let why = bench.refused(&made.pack, MINIMAL, &made.options());
    assert!(
        why.contains("add a line [photographs] and below it rights = \"…\"") && why.contains("metadata.toml"),
        "{why}"
    );
    let unknown = format!("{MINIMAL}[photographs]\nrights = \"CC BY 9.0\"\n");
    let why = bench.refused(&made.pack, &unknown, &made.options());
    assert!(why.contains("line 8: photographs.rights: \"CC BY 9.0\" is not a known licence"), "{why}");
}

#[test]
fn what_is_not_the_colour_report_of_the_pack_is_refused_with_what_differs() {
    let (bench, made) = (Bench::new(), coloured());
    let refused = |made: &Coloured| bench.refused(&made.pack, WITH_RIGHTS, &made.options());
    let other = made.with_report(&bench, |report| report["photographs"][1]["sha256"] = "0".repeat(64).into());
    let why = refused(&other);
    assert!(why.contains("IMG_0002.jpg has the SHA-256 000000000000… in the report and"), "{why}");
    let why = bench.refused(&pack(), FULL, &["--colour-report", text(&made.report)]);
    assert!(
        why.contains("IMG_0001.jpg is not among the source files of the pack") && why.contains("report.json"),
        "{why}"
    );
    let earlier =
        made.with_report(&bench, |report| drop(report.as_object_mut().unwrap().remove("kilwa_colour_report")));
    assert!(refused(&earlier).contains("without the hashes of the photographs"), "{}", refused(&earlier));
    let later = made.with_report(&bench, |report| report["kilwa_colour_report"] = 2.into());
    assert!(refused(&later).contains("format version 2"), "{}", refused(&later));
    let broken =
        made.with_report(&bench, |report| report["photographs"][2]["camera_from_world"]["rotation_wxyz"][0] = 3.into());
    let why = refused(&broken);
    assert!(why.contains("photograph 3 (\"IMG_0003.jpg\"): its rotation"), "{why}");
    std::fs::write(bench.path("changed.json"), "{\n  \"kilwa_colour_report\": 1,\n  photographs\n}").unwrap();
    let why = refused(&later);
    assert!(why.contains("changed.json cannot be used") && why.contains("line 3"), "{why}");
}

#[test]
fn neither_report_nor_photographs_are_published_without_the_location_of_the_model() {
    let (bench, made) = (Bench::new(), coloured());
    for place in ["--redact-location", "--redact-location=10000"] {
        let why = bench.refused(&made.pack, WITH_RIGHTS, &[&made.options()[..], &[place]].concat());
        assert!(why.contains("positions of cameras") && why.contains("omit --colour-report"), "{why}");
        let why = bench.refused(&made.pack, WITH_RIGHTS, &[&made.options()[..2], &[place]].concat());
        assert!(why.contains("positions of cameras"), "{why}");
    }
}

#[test]
fn a_version_can_keep_the_photographs_of_the_last_one_and_one_without_them_says_so() {
    let (bench, made) = (Bench::new(), coloured());
    let object = bench.published(&made.pack, WITH_RIGHTS, &made.options());
    let [report, photos] = ["v1/colour-report.json", "v1/photographs"].map(|path| object.join(path));
    let better = WITH_RIGHTS.replace("\"Fort\"", "\"Fort\"\ndescription = \"Better\"");
    let next =
        ["--version-note", "Text", "--date", "2026-12-01", "--colour-report", text(&report), "--photos", text(&photos)];
    bench.published(&made.pack, &better, &next);
    let of = |version: &str, path: &str| tree(&object.join(version).join(path));
    assert!(!of("v1", "photographs").is_empty() && of("v1", "photographs") == of("v2", "photographs"));
    assert!(std::fs::read(report).unwrap() == std::fs::read(object.join("v2/colour-report.json")).unwrap());
    let next = ["--version-note", "None", "--date", "2026-12-02"];
    let output = bench.publish(&made.pack, &better, &next);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("the previous version has photographs, and this one has none"), "{said}");
    assert!(!object.join("v3/photographs").exists() && !object.join("v3/colour-report.json").exists());
    succeeds(&["verify", text(&object)]);
}

#[test]
fn the_same_inputs_give_the_same_bytes() {
    let made = coloured();
    let one = || {
        let bench = Bench::new();
        let object = bench.published(&made.pack, WITH_RIGHTS, &made.options());
        tree(&object)
    };
    assert!(one() == one());
}

#[test]
fn verify_names_photographs_that_are_damaged_missing_or_not_in_the_report() {
    let (bench, made) = (Bench::new(), coloured());
    let object = bench.published(&made.pack, WITH_RIGHTS, &made.options());
    let failed = |what: &str| {
        let output = run(&["verify", text(&object)]);
        assert_eq!(output.status.code(), Some(1));
        let printed = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(printed.contains(what), "{what} in {printed}");
    };
    let photograph = object.join("v1/photographs/IMG_0002.jpg");
    let right = std::fs::read(&photograph).unwrap();
    let mut damaged = right.clone();
    damaged[100] ^= 1;
    std::fs::write(&photograph, damaged).unwrap();
    failed("v1/photographs/IMG_0002.jpg");
    std::fs::remove_file(&photograph).unwrap();
    failed("missing");
    std::fs::write(&photograph, right).unwrap();
    let manifest = object.join("manifest.json");
    let text_of = std::fs::read_to_string(&manifest).unwrap();
    let without = |names: &[&str]| {
        let mut changed: Value = serde_json::from_str(&text_of).unwrap();
        drop(changed.as_object_mut().unwrap().remove("seal"));
        for name in names {
            drop(changed["versions"][0].as_object_mut().unwrap().remove(*name));
        }
        std::fs::write(&manifest, changed.to_string()).unwrap();
    };
    without(&["colour_report", "photographs"]);
    failed("disagree about the colour report");
    without(&["photographs"]);
    failed("another number or length of photographs");
}

#[test]
fn withdrawal_removes_photographs_and_report() {
    let (bench, made) = (Bench::new(), coloured());
    let object = bench.published(&made.pack, WITH_RIGHTS, &made.options());
    let (site, keep) = (bench.path("site"), bench.path("kept"));
    let www = bench.path("www");
    let args = ["publish", "--withdraw", "fort", "--to", text(&site), "--keep", text(&keep), "--reason", "Asked"];
    succeeds(&[&args[..], &["--www", text(&www), "--date", "2026-12-01"]].concat());
    let left = tree(&object);
    assert!(
        left.keys().all(|path| !path.ends_with("IMG_0001.jpg") && !path.contains("colour-report")),
        "{:?}",
        left.keys()
    );
    assert!(keep.join("fort/v1/photographs/IMG_0001.jpg").is_file());
    assert!(keep.join("fort/v1/colour-report.json").is_file());
    succeeds(&["verify", text(&object)]);
}

#[test]
fn photographs_of_a_closed_model_are_only_for_those_who_may_have_it() {
    let (bench, made) = (Bench::new(), coloured());
    let closed = format!("{WITH_RIGHTS}[access]\nstate = \"restricted\"\nreason = \"Rock art\"\n");
    let object = bench.published(&made.pack, &closed, &made.options());
    for path in ["v1/photographs/IMG_0001.jpg", "v1/photographs/masks/IMG_0001.mask.png", "v1/colour-report.json"] {
        assert!(kilwa_archive::layout::is_geometry(path), "{path}");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            let mode = std::fs::metadata(object.join(path)).unwrap().permissions().mode();
            assert_eq!(mode & 0o007, 0, "{path}: {mode:o}");
        }
    }
    let page = std::fs::read_to_string(object.join("index.html")).unwrap();
    assert!(page.contains("3 photographs") && !page.contains("IMG_0001.jpg\""), "{page}");
}

#[test]
fn the_report_of_kilwa_colour_states_hashes_cameras_and_its_form() {
    let made = coloured();
    let (report, info) = (json_of(&made.report), json(&["info", text(&made.pack)]));
    assert_eq!(report["kilwa_colour_report"], 1);
    let sources = info["metadata"]["sources"].to_string();
    for photo in report["photographs"].as_array().unwrap() {
        assert!(sources.contains(photo["sha256"].as_str().unwrap()), "{photo}");
        assert_eq!(photo["camera"]["size"], serde_json::json!([320, 240]));
        assert!(photo["mask"].is_null() == photo["mask_sha256"].is_null(), "{photo}");
    }
}

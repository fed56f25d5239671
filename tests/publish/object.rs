//! Properties of an object: complete, reproducible, with versions that are added and never changed.

use super::{Bench, FULL, MINIMAL, json_of, other_pack, pack, run, tree};
use crate::support::{json, succeeds, text};
use std::process::Command;

#[test]
fn an_object_is_complete_and_every_file_has_a_checksum() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--site", "--bag"]);
    assert_eq!(object, bench.path("site/gereza"));
    let folder = object.join("v1");
    for path in [
        "README.txt",
        "LICENSE.txt",
        "citation.txt",
        "citation.bib",
        "citation.ris",
        "poster.jpg",
        "poster-600.jpg",
        "poster-300.jpg",
        "preview.glb",
        "drawings/plan.png",
        "drawings/plan.pgw",
        "drawings/north.png",
        "drawings/east.png",
        "drawings/south.png",
        "drawings/west.png",
        "iiif/manifest.json",
        "metadata/dc.xml",
        "metadata/datacite.json",
        "metadata/edm.xml",
        "metadata/paradata.json",
        "metadata/metadata.json",
        "ro-crate-metadata.json",
        "linkset.json",
        "oembed.json",
        "viewer/boot.js",
    ] {
        assert!(folder.join(path).is_file(), "{path} is missing");
    }
    let list = std::fs::read_to_string(folder.join("checksums.sha256")).unwrap();
    let files =
        tree(&folder).into_iter().filter(|(path, _)| !path.ends_with('/') && path != "checksums.sha256").count();
    assert_eq!(list.lines().count(), files);
    if Command::new("sha256sum").arg("--version").output().is_ok() {
        let checked = Command::new("sha256sum")
            .args(["-c", "--strict", "--quiet", "checksums.sha256"])
            .current_dir(&folder)
            .output()
            .unwrap();
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));
    } else {
        println!("skipped: sha256sum is not here");
    }
    // The pack is the one that was given, and its name its hash.
    let manifest = json_of(&object.join("manifest.json"));
    let entry = &manifest["versions"][0]["pack"];
    let published = object.join(entry["url"].as_str().unwrap());
    assert_eq!(std::fs::read(&published).unwrap(), std::fs::read(pack()).unwrap());
    assert!(entry["url"].as_str().unwrap().contains(entry["sha256"].as_str().unwrap()));
    assert_eq!(
        manifest["versions"][0]["figures"]["triangles"],
        json(&["info", text(&pack())])["metadata"]["triangles"]
    );
    assert_eq!(manifest["rights"]["uri"], "https://creativecommons.org/licenses/by/4.0/");
    succeeds(&["verify", text(&published)]);
    // The page of the object leads to files that are there.
    let html = std::fs::read_to_string(object.join("index.html")).unwrap();
    // A list of pictures has a comma between them, and a width behind each.
    for part in html.split(['"', ',']).map(str::trim_start).filter(|p| p.starts_with("../../")) {
        let path = part.trim_start_matches("../../").split(['?', '#', ' ']).next().unwrap();
        assert!(path.is_empty() || path == "../" || object.join(path).exists(), "{part}");
    }
    assert!(html.contains("Gereza &amp; fort") && !html.contains("Second <b>"), "escaped");
    for path in ["index.html", "feed.xml", "models.json", "sitemap.xml", "assets/style.css"] {
        assert!(bench.path("site").join(path).is_file(), "{path}");
    }
}

/// People come for the site, not for its file.
#[test]
fn the_panel_of_an_object_begins_with_the_site_and_its_technical_facts_are_folded_at_the_end() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &["--site"]);
    let html = std::fs::read_to_string(bench.path("site/gereza/index.html")).unwrap();
    let panel = html.split("id=\"about-title\"").nth(1).unwrap().split("</section>").next().unwrap();
    let order = [
        "First paragraph",
        "data-text=\"creators\">Creators</dt><dd dir=\"auto\">Rüther, Heinz; Zamani Project",
        "Kilwa Kisiwani",
        "data-text=\"captureDate\"",
        "data-text=\"drawings\"",
        "loading=\"lazy\"",
        "data-text=\"howToCite\"",
        "<details id=\"technical\"",
        "Triangles",
    ];
    let places: Vec<usize> =
        order.iter().map(|part| panel.find(part).unwrap_or_else(|| panic!("no {part} in {panel}"))).collect();
    assert!(places.is_sorted(), "{places:?} in {panel}");
    let list = std::fs::read_to_string(bench.path("site/index.html")).unwrap();
    assert!(list.contains("Rüther, Heinz; Zamani Project"), "{list}");
}

#[test]
fn the_same_inputs_give_the_same_bytes() {
    let trees = [(); 2].map(|()| {
        let bench = Bench::new();
        bench.published(&pack(), FULL, &["--site", "--bag"]);
        tree(&bench.path("site"))
    });
    let names = |t: &std::collections::BTreeMap<String, Vec<u8>>| t.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&trees[0]), names(&trees[1]));
    for (path, bytes) in &trees[0] {
        assert!(*bytes == trees[1][path], "{path} differs");
    }
}

#[test]
fn the_date_comes_from_the_option_the_metadata_source_date_epoch_or_the_clock_in_this_order() {
    let bench = Bench::new();
    let undated = MINIMAL.replace("published = 2026-11-21\n", "");
    let day = |more: &[&str], text_: &str, epoch: Option<&str>| {
        let mut command = bench.command(&other_pack(), text_, more);
        command.args(["--dry-run", "--json"]);
        match epoch {
            Some(seconds) => command.env("SOURCE_DATE_EPOCH", seconds),
            None => command.env_remove("SOURCE_DATE_EPOCH"),
        };
        let output = command.output().unwrap();
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        (report["published"].as_str().unwrap_or_default().to_owned(), String::from_utf8(output.stderr).unwrap())
    };
    assert_eq!(day(&["--date", "2020-02-02"], MINIMAL, Some("0")).0, "2020-02-02");
    assert_eq!(day(&[], MINIMAL, Some("0")).0, "2026-11-21");
    assert_eq!(day(&[], &undated, Some("86400")).0, "1970-01-02");
    assert_eq!(day(&[], &undated, None).0.len(), 10);
    assert!(day(&[], &undated, Some("noon")).1.contains("SOURCE_DATE_EPOCH"));
}

#[test]
fn a_new_version_adds_only_new_files_and_earlier_versions_are_unchanged() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &[]);
    let first = tree(&object.join("v1"));
    let again = bench.publish(&pack(), FULL, &[]);
    let output = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(again.status.success() && output.contains("version 1 of 2026-11-21 is already published"), "{output}");
    let message = bench.refused(&pack(), &FULL.replace("First paragraph", "Better text"), &["--date", "2026-12-01"]);
    assert!(message.contains("--version-note"), "{message}");
    let message = bench.refused(&pack(), FULL, &["--version-note", "Nothing", "--date", "2026-12-01"]);
    assert!(message.contains("nothing new to publish"), "{message}");
    let message = bench.refused(&pack(), FULL, &["--version-note", "Earlier", "--date", "2026-01-01"]);
    assert!(message.contains("after 2026-01-01"), "{message}");
    let changed = FULL.replace("First paragraph", "Better text");
    bench.published(&pack(), &changed, &["--version-note", "Text corrected", "--date", "2026-12-01"]);
    assert!(tree(&object.join("v1")) == first, "version 1 was changed");
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!((&manifest["current"], manifest["versions"].as_array().unwrap().len()), (&2.into(), 2));
    assert_eq!(
        (&manifest["versions"][1]["note"], &manifest["versions"][1]["published"]),
        (&"Text corrected".into(), &"2026-12-01".into())
    );
    let html = std::fs::read_to_string(object.join("index.html")).unwrap();
    assert!(html.contains("Text corrected") && html.contains("First publication") && html.contains("v1/pack."));
    assert_eq!(std::fs::read_dir(&object).unwrap().count(), 4, "nothing hidden is left");
}

#[test]
fn a_dry_run_shows_every_field_and_writes_nothing() {
    let bench = Bench::new();
    let output = bench.publish(&pack(), FULL, &["--dry-run"]);
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && !bench.path("site").exists());
    for word in [
        "creators[1].orcid",
        "dates (Collected)",
        "edm:rights",
        "geoLocations",
        "Nothing was written",
        "version 1 of 2026-11-21",
    ] {
        assert!(printed.contains(word), "{word} in {printed}");
    }
    assert!(!printed.contains("is this meant?"), "{printed}");
    let hardly = FULL.replace("-8.9577", "8.9577").replace("accuracy = 0.003", "accuracy = 30");
    let hardly = String::from_utf8(bench.publish(&pack(), &hardly, &["--dry-run"]).stdout).unwrap();
    assert!(hardly.contains("is this meant? place.latitude is 8.9577") && hardly.contains("3 mm is 0.003"), "{hardly}");
    // Each value that was given is on a line of its own.
    for value in ["Held, Christoph", "-8.9577", "coral rag", "Registration", "World Monuments Fund", "EPSG:32737"] {
        assert!(printed.contains(value), "{value} in {printed}");
    }
}

#[test]
fn the_reason_for_a_withdrawal_must_not_reveal_a_withheld_location() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &["--redact-location"]);
    let (site, keep) = (bench.path("site"), bench.path("keep"));
    let withdraw = |reason: &str| {
        let to = ["publish", "--withdraw", "gereza", "--to", text(&site), "--keep", text(&keep)];
        run(&[&to[..], &["--date", "2027-01-01", "--reason", reason]].concat())
    };
    let before = tree(&site);
    for reason in ["Looters came to 8.956109, 39.600225", "Looters at EPSG:32737", "At 565977 9009946", "UTM zone 37S"]
    {
        let refused = withdraw(reason);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && message.contains("--reason: \""), "{reason}: {message}");
        assert!(tree(&site) == before && !keep.exists(), "{reason}");
    }
    let done = withdraw("Looters came in 2026");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn a_withdrawn_object_keeps_its_metadata_and_a_page_that_says_why() {
    let bench = Bench::new();
    let object = bench.published(&pack(), FULL, &["--bag", "--site"]);
    let pack_file = json_of(&object.join("manifest.json"))["versions"][0]["pack"]["url"].as_str().unwrap().to_owned();
    let (site, www) = (bench.path("site"), bench.path("www"));
    let inside = site.join("kept");
    let (keep, inside) = (bench.path("keep"), text(&inside).to_owned());
    let withdraw = |keep: &str, reason: &str, more: &[&str]| {
        let args = ["publish", "--withdraw", "gereza", "--to", text(&site), "--keep", keep, "--reason", reason];
        run(&[&args[..], more].concat())
    };
    let more = ["--date", "2027-01-01", "--site", "--www", text(&www)];
    let withdraw_now = |keep: &str| withdraw(keep, "The family asked for it", &more);
    let refused = withdraw_now(&inside);
    assert!(
        String::from_utf8_lossy(&refused.stderr).contains("outside it with --keep") && object.join(&pack_file).exists()
    );
    let (index, theirs) = (site.join("index.html"), "a page of somebody else's");
    let ours = std::fs::read(&index).unwrap();
    std::fs::write(&index, theirs).unwrap();
    let refused = withdraw_now(text(&keep));
    assert!(
        String::from_utf8_lossy(&refused.stderr).contains("was not made by kilwa") && object.join(&pack_file).exists()
    );
    std::fs::write(&index, ours).unwrap();
    let before = tree(&site);
    let would = withdraw(text(&keep), "x", &["--dry-run"]);
    let would = String::from_utf8_lossy(&would.stdout).into_owned();
    assert!(
        would.contains("Would withdraw") && would.contains("and its bag") && would.contains("Nothing was written"),
        "{would}"
    );
    assert!(tree(&site) == before && !keep.exists());
    // The pages of the folder cannot be written; they are all that the same command does then.
    let feed = site.join("feed.xml");
    std::fs::remove_file(&feed).unwrap();
    std::fs::create_dir_all(feed.join("in the way")).unwrap();
    let failed = withdraw_now(text(&keep));
    let message = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(failed.status.code() == Some(1) && message.matches("os error").count() == 1, "{message}");
    assert!(
        message.contains("the object is withdrawn, but the pages") && message.contains("same command again"),
        "{message}"
    );
    assert!(!message.contains("nothing was changed"), "{message}");
    std::fs::remove_dir_all(&feed).unwrap();
    let done = withdraw_now(text(&keep));
    let output = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(output.contains("was already withdrawn on 2027-01-01; the pages of the folder were written"), "{output}");
    assert!(feed.is_file() && !site.join(".kilwa-site").exists());
    assert!(
        !object.join(&pack_file).exists()
            && !object.join("v1/poster.jpg").exists()
            && !site.join("gereza.bag").exists()
    );
    assert!(keep.join("gereza").join(&pack_file).exists());
    assert!(object.join("v1/metadata/dc.xml").exists() && object.join("v1/citation.txt").exists());
    let html = std::fs::read_to_string(object.join("index.html")).unwrap();
    assert!(html.contains("The family asked for it") && html.contains("1 January 2027"));
    let manifest = json_of(&object.join("manifest.json"));
    assert_eq!(manifest["access"]["state"], "withdrawn");
    let reason = ["--reason", "The family asked for it"];
    let again = ["publish", "--withdraw", "gereza", "--to", text(&site), "--keep", text(&keep)];
    let twice = run(&[&again[..], &reason].concat());
    let message = String::from_utf8_lossy(&twice.stderr).into_owned();
    assert!(twice.status.code() == Some(1) && message.contains("was already withdrawn on 2027-01-01"), "{message}");
    assert!(!std::fs::read_to_string(site.join("feed.xml")).unwrap().contains("gereza/"));
    let again = bench.refused(
        &other_pack(),
        &MINIMAL.replace("title =", "slug = \"gereza\"\ntitle ="),
        &["--version-note", "x"],
    );
    assert!(again.contains("was withdrawn on 2027-01-01"), "{again}");
}

#[test]
fn a_file_written_by_init_is_accepted_by_publish_once_the_rights_are_filled_in() {
    let bench = Bench::new();
    let path = bench.path("new.toml");
    succeeds(&["metadata", "init", text(&pack()), "-o", text(&path)]);
    let begun = std::fs::read_to_string(&path).unwrap();
    assert!(
        begun.contains("title = \"torus\"")
            && begun.contains("units = \"m\"")
            && begun.contains("crs = \"EPSG:32737\"")
    );
    let message = bench.refused(&pack(), &begun, &["--dry-run"]);
    assert!(message.contains("rights.uri") && message.matches("line ").count() == 1, "{message}");
    let filled = begun.replacen("uri = \"\"", "uri = \"CC BY 4.0\"", 1);
    // An example whose # was removed, and nothing else.
    let left = filled.replacen("# publisher", "publisher", 1);
    let line = left.lines().position(|l| l.starts_with("publisher")).unwrap() + 1;
    let message = bench.refused(&pack(), &left, &["--dry-run"]);
    assert!(message.contains(&format!("line {line}: publisher: <Museum of …> is still the example")), "{message}");
    assert!(bench.publish(&pack(), &filled, &["--dry-run"]).status.success());
    let plain = succeeds(&["metadata", "init"]);
    assert!(plain.contains("# REQUIRED") && plain.contains("[rights]"));
    let again = run(&["metadata", "init", "-o", text(&path)]);
    assert_eq!(again.status.code(), Some(1));
    assert!(succeeds(&["metadata", "check", text(&bench.metadata(FULL))]).contains("right"));
}

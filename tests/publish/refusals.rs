//! Refusals: before anything is written, with what to do.

use super::{Bench, FULL, MINIMAL, other_pack, pack, run, tree};
use crate::support::text;
use std::process::Command;

#[test]
fn missing_and_wrong_metadata_is_reported_with_line_field_and_what_to_write() {
    let bench = Bench::new();
    for (from, to, expected) in [
        ("title = \"Fort\"\n", "", "title: every model needs a title"),
        ("[rights]\nuri = \"CC0\"\n", "", "add a line [rights]"),
        ("uri = \"CC0\"", "uri = \"\"", "line 4: rights.uri: every model needs a statement of rights"),
        ("units = \"m\"", "", "model.units: the units of the mesh"),
        ("\"CC0\"", "\"CC BY 5.0\"", "did you mean CC BY 4.0?"),
        ("\"CC0\"", "\"all mine\"", "not a known licence or rights statement"),
        ("units = \"m\"", "units = \"mm\"", "the pack was built from a mesh in \"m\""),
        (
            "units = \"m\"",
            "units = \"m\"\ncrs = \"EPSG:32737\"",
            "model.crs says EPSG:32737, and the pack local coordinates",
        ),
        ("units = \"m\"", "units = \"m\"\ncrs = \"EPSG:4326\"", "degrees"),
        ("title", "titel", "did you mean \"title\"?"),
        ("title = \"Fort\"", "title = Fort", "line 1: "),
        ("published = 2026-11-21", "published = 2026-02-30", "line 2"),
    ] {
        assert!(MINIMAL.contains(from));
        let message = bench.refused(&other_pack(), &MINIMAL.replacen(from, to, 1), &[]);
        assert!(message.contains(expected), "{expected} in {message}");
        assert!(!bench.path("site").exists());
    }
    let output =
        run(&["publish", text(&other_pack()), "--to", text(&bench.path("site")), "--metadata", "/nowhere.toml"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere.toml"));
    std::fs::write(bench.path("metadata.toml"), b"title = \"a\"\nb = \"\xff\"").unwrap();
    let metadata = bench.path("metadata.toml");
    let output =
        run(&["publish", text(&other_pack()), "--to", text(&bench.path("site")), "--metadata", text(&metadata)]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("line 2: the file is not UTF-8"));
    std::fs::write(bench.path("metadata.toml"), b"title = \"Ch\xe2teau\"\n").unwrap();
    let output = run(&["metadata", "check", text(&metadata)]);
    let reason = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(reason.contains("line 1") && reason.contains("seems to be Latin-1 (`title = \"Château\"`)"), "{reason}");
}

#[test]
fn a_model_outside_its_reference_system_is_refused() {
    let bench = Bench::new();
    let (input, wrong) = (bench.path("t.ply"), bench.path("wrong.kilwa"));
    crate::support::Input::torus(20, 12, [1.0, 2.0, 3.0]).write(&input);
    crate::support::succeeds(&["build", text(&input), "-o", text(&wrong), "--crs", "EPSG:32737"]);
    let message = bench.refused(&wrong, &MINIMAL.replace("units = \"m\"", "units = \"m\"\ncrs = \"EPSG:32737\""), &[]);
    assert!(message.contains("which is not in EPSG:32737") && message.contains("without --crs"), "{message}");
}

#[test]
fn a_pack_that_fails_verification_is_refused() {
    let bench = Bench::new();
    let mut bytes = std::fs::read(other_pack()).unwrap();
    let damaged = bench.path("damaged.kilwa");
    let middle = bytes.len() * 2 / 3;
    bytes[middle] ^= 0x10;
    std::fs::write(&damaged, &bytes).unwrap();
    let message = bench.refused(&damaged, MINIMAL, &[]);
    assert!(message.contains("checksum does not match") && message.contains("damaged.kilwa"), "{message}");
    bytes.truncate(middle);
    std::fs::write(&damaged, &bytes).unwrap();
    assert!(bench.refused(&damaged, MINIMAL, &[]).contains("truncated"));
    assert!(!bench.path("site").exists());
}

#[test]
fn a_name_used_by_another_model_is_refused_with_what_to_do() {
    let bench = Bench::new();
    let object = bench.published(&other_pack(), MINIMAL, &[]);
    let other = MINIMAL.replace("title = \"Fort\"", "slug = \"fort\"\ntitle = \"A mosque\"");
    let without = MINIMAL.replace("\"Fort\"", "\"FORT!\"");
    // The name may have been left in from another model's file.
    for text in [&without, &other] {
        let message = bench.refused(&other_pack(), text, &["--version-note", "x"]);
        assert!(
            message.contains("is \"Fort\", which seems to be another model") && message.contains("--same-object"),
            "{message}"
        );
    }
    let options = ["--version-note", "It was a mosque", "--date", "2026-12-01", "--same-object"];
    bench.published(&other_pack(), &other, &options);
    std::fs::create_dir_all(bench.path("site/taken")).unwrap();
    let taken = MINIMAL.replace("title =", "slug = \"taken\"\ntitle =");
    assert!(bench.refused(&other_pack(), &taken, &[]).contains("is not an object of kilwa"));
    for bad in ["\"a/b\"", "\"..\"", "\"v1\""] {
        assert!(
            bench
                .refused(&other_pack(), &MINIMAL.replace("title =", &format!("slug = {bad}\ntitle =")), &[])
                .contains("slug"),
            "{bad}"
        );
    }
    let inside = object.join("v1");
    let (metadata, www) = (bench.metadata(MINIMAL), bench.path("www"));
    let output = run(&[
        "publish",
        text(&other_pack()),
        "--to",
        text(&inside),
        "--metadata",
        text(&metadata),
        "--www",
        text(&www),
    ]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("is itself an object"));
}

#[test]
fn another_model_with_the_same_title_is_recognised_by_size_position_and_identifier() {
    let bench = Bench::new();
    let build = |name: &str, scale: f64, origin: [f64; 3], more: &[&str]| {
        let (input, pack) = (bench.path("t.ply"), bench.path(name));
        let mut torus = crate::support::Input::torus(20, 12, [0.0; 3]);
        torus.positions.iter_mut().for_each(|p| *p = [0, 1, 2].map(|k| p[k] * scale + origin[k]));
        torus.write(&input);
        crate::support::succeeds(&[&["build", text(&input), "-o", text(&pack)], more].concat());
        pack
    };
    let utm = ["--crs", "EPSG:32737"];
    let here = [565_977.0, 9_009_946.0, 31.0];
    let first = build("first.kilwa", 1.0, here, &utm);
    let named = MINIMAL.replace("title =", "identifier = \"doi:10.1234/a\"\ntitle =");
    bench.published(&first, &named, &[]);
    let note = ["--version-note", "x", "--date", "2026-12-01"];
    for (pack, metadata, expected) in [
        (build("far.kilwa", 1.0, [566_977.0, 9_009_946.0, 31.0], &utm), named.clone(), "the new version is 99"),
        (build("large.kilwa", 10.0, here, &utm), named.clone(), "across, the new one"),
        (first.clone(), named.replace("1234/a", "1234/b"), "its identifier is https://doi.org/10.1234/a"),
    ] {
        let message = bench.refused(&pack, &metadata, &note);
        assert!(message.contains(expected) && message.contains("--same-object"), "{expected} in {message}");
    }
    // One that overlaps it, with a title that was corrected: its identifier says enough.
    let better = build("better.kilwa", 1.1, here, &utm);
    let corrected = named.replace("\"Fort\"", "\"Fort of Kilwa\"\nslug = \"fort\"");
    assert!(bench.publish(&better, &corrected, &[&note[..], &["--dry-run"]].concat()).status.success());
}

#[test]
fn a_folder_that_is_not_writable_is_reported_before_the_pack_is_read() {
    let bench = Bench::new();
    let (metadata, www) = (bench.metadata(MINIMAL), bench.path("www"));
    for to in ["/proc/kilwa/objects", text(&metadata)] {
        let output =
            run(&["publish", text(&other_pack()), "--to", to, "--metadata", text(&metadata), "--www", text(&www)]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1));
        assert!(
            message.contains("cannot write to") && message.contains("nothing was changed")
                || message.contains("is a file"),
            "{message}"
        );
    }
    let site = bench.path("site");
    let output =
        run(&["publish", text(&other_pack()), "--to", text(&site), "--metadata", text(&metadata), "--www", "/nowhere"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere") && !site.exists());
}

/// On a file system of 4 MB of its own, where the test may make one.
#[test]
fn a_disk_without_space_is_reported_before_anything_is_written() {
    let bench = Bench::new();
    let (disk, metadata, www, pack) = (bench.path("disk"), bench.metadata(MINIMAL), bench.path("www"), other_pack());
    std::fs::create_dir(&disk).unwrap();
    let line = format!(
        "mount -t tmpfs -o size=4m tmpfs {disk} || exit 77; {kilwa} publish {pack} --to {disk}/site --metadata {metadata} --www {www} --software; code=$?; ls -A {disk}; exit $code",
        disk = text(&disk),
        kilwa = env!("CARGO_BIN_EXE_kilwa"),
        pack = text(&pack),
        metadata = text(&metadata),
        www = text(&www)
    );
    let Ok(output) = Command::new("unshare").args(["--user", "--map-root-user", "--mount", "sh", "-c", &line]).output()
    else {
        println!("skipped: unshare is not here, so that there is no small disk to fill");
        return;
    };
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    if output.status.code() != Some(1) || message.contains("unshare:") {
        println!("skipped: no file system of its own may be mounted here: {message}");
        return;
    }
    assert!(
        message.contains("has") && message.contains("are needed") && message.contains("Nothing was changed"),
        "{message}"
    );
    assert!(output.stdout.is_empty(), "left on the disk: {}", String::from_utf8_lossy(&output.stdout));
}

/// A limit on file size simulates a disk that fills while the object is written: the same error at the same calls,
/// without the check of free space before.
#[cfg(unix)]
#[test]
fn a_disk_that_fills_up_half_way_leaves_no_files() {
    let bench = Bench::new();
    bench.published(&pack(), FULL, &[]);
    let before = tree(&bench.path("site"));
    let (metadata, site, www, pack) = (bench.metadata(FULL), bench.path("site"), bench.path("www"), pack());
    for blocks in [4, 40, 200] {
        let line = format!(
            "trap '' XFSZ; ulimit -f {blocks}; exec {} publish {} --to {} --metadata {} --www {} --software --version-note x --date 2026-12-01",
            env!("CARGO_BIN_EXE_kilwa"),
            text(&pack),
            text(&site),
            text(&metadata),
            text(&www)
        );
        let output = Command::new("sh").args(["-c", &line]).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{blocks}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(tree(&site) == before, "{blocks} blocks: something is left");
        // A folder that was created for it is removed too.
        let new = bench.path("new/site");
        let line = line.replace(text(&site), text(&new)).replace(" --version-note x --date 2026-12-01", "");
        let output = Command::new("sh").args(["-c", &line]).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{blocks}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(!bench.path("new").exists(), "{blocks} blocks: a folder is left");
    }
}

//! `kilwa verify --state`: what is skipped, what is checked again, and what is missing since an earlier run.

use crate::eventually::eventually;
use crate::support::{fails, kilwa, succeeds, text};
use crate::verify_objects::{pack, problems, publish, report, withdraw_with, wrap};
use kilwa_archive::manifest::Manifest;
use std::collections::BTreeSet;
use std::fs;

#[test]
fn a_folder_is_checked_unit_by_unit_and_a_stopped_run_resumes() {
    let shelf = tempfile::tempdir().unwrap();
    let state = shelf.path().join("state");
    for slug in ["a", "b", "c"] {
        publish(shelf.path(), slug, 1);
    }
    fs::copy(pack(), shelf.path().join("single.kilwa")).unwrap();
    fs::write(shelf.path().join("index.html"), "the list").unwrap();
    let shelf_name = text(shelf.path()).to_owned();
    let run = |more: &[&str], code| report(&[&[shelf_name.as_str(), "--state", text(&state)], more].concat(), code);
    assert_eq!(run(&[], 0)["objects"], 4);
    let poster = shelf.path().join("b/v1/poster.jpg");
    fs::write(&poster, "other").unwrap();
    let found = run(&[], 1);
    assert_eq!((&found["objects"], &found["sound_objects"]), (&4.into(), &3.into()));
    assert_eq!(problems(&found), BTreeSet::from([("b/v1/poster.jpg".to_owned(), "damaged".to_owned())]));
    // Only what had a problem is due.
    let found = run(&["--older-than", "7"], 1);
    assert_eq!((&found["objects"], &found["skipped"]), (&1.into(), &3.into()));
    fs::write(&poster, "poster.jpg").unwrap();
    assert_eq!(run(&["--older-than", "7"], 0)["objects"], 1);
    // A new version is looked at, however lately the object was.
    publish(shelf.path(), "a", 2);
    assert_eq!(run(&["--older-than", "7"], 0)["objects"], 1);
    // Stopped in the middle of b: a and half of b are not read again.
    run(&[], 0);
    let lines = fs::read_to_string(&state).unwrap();
    let stop = lines.lines().position(|l| l.contains("b/v1/linkset.json")).unwrap();
    let kept: Vec<&str> = lines.lines().take(stop + 1).collect();
    fs::write(&state, kept.join("\n")).unwrap();
    let read = run(&["--resume"], 0);
    assert_eq!((&read["objects"], &read["skipped"]), (&3.into(), &1.into()));
    let whole = run(&[], 0);
    assert!(read["bytes"].as_u64().unwrap() < whole["bytes"].as_u64().unwrap());
    // A version that was there and is gone, or another one under its number.
    fs::remove_dir_all(shelf.path().join("a")).unwrap();
    publish(shelf.path(), "a", 1);
    let found = problems(&run(&[], 1));
    assert_eq!(found, BTreeSet::from([("a/v2".to_owned(), "history".to_owned())]));
    // Without a state file nothing is known of it.
    succeeds(&["verify", &shelf_name]);
}

/// Regardless of the file's time, which can be set back.
#[test]
fn changed_units_are_checked_again_even_if_recently_checked() {
    let folder = tempfile::tempdir().unwrap();
    let (shelf, state) = (folder.path().join("shelf"), folder.path().join("state"));
    let tick = folder.path().join("tick");
    fs::create_dir(&shelf).unwrap();
    let object = publish(&shelf, "fort", 1);
    let single = shelf.join("single.kilwa");
    fs::copy(pack(), &single).unwrap();
    let run = |more: &[&str], code| report(&[&[text(&shelf), "--state", text(&state)], more].concat(), code);
    let manifest = Manifest::parse(&fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let changes: [fn(&mut Vec<u8>); 5] =
        [|bytes| bytes[7] ^= 4, |bytes| bytes.truncate(5), |bytes| bytes.push(b'x'), |bytes| bytes.fill(0), Vec::clear];
    for path in [single, object.join(&manifest.versions[0].pack.url), object.join("v1/poster.jpg")] {
        let good = fs::read(&path).unwrap();
        for (number, change) in changes.iter().enumerate() {
            assert_eq!(run(&[], 0)["sound"], true);
            assert_eq!(run(&["--older-than", "5"], 0)["skipped"], 2);
            let time = fs::metadata(&path).unwrap().modified().unwrap();
            let mut bytes = good.clone();
            change(&mut bytes);
            // File times may advance in steps of a few milliseconds.
            eventually("a later time of files", || {
                fs::write(&tick, "").unwrap();
                (fs::metadata(&tick).unwrap().modified().unwrap() > time).then_some(())
            });
            fs::write(&path, &bytes).unwrap();
            if cfg!(unix) {
                fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
            }
            let found = run(&["--older-than", "5"], 1);
            let counts = (&found["objects"], &found["skipped"], &found["sound"]);
            assert_eq!(counts, (&1.into(), &1.into(), &false.into()), "{} {number}: {found}", path.display());
            fs::write(&path, &good).unwrap();
        }
    }
    // A resumed run does not miss a change either.
    run(&[], 0);
    let lines = fs::read_to_string(&state).unwrap();
    let stop = lines.lines().position(|l| l.contains("v1/poster.jpg")).unwrap();
    fs::write(&state, lines.lines().take(stop + 1).collect::<Vec<_>>().join("\n")).unwrap();
    fs::write(object.join("v1/poster.jpg"), "POSTER.JPG").unwrap();
    let found = problems(&run(&["--resume"], 1));
    assert_eq!(found, BTreeSet::from([("fort/v1/poster.jpg".to_owned(), "damaged".to_owned())]));
}

#[test]
fn a_removed_unit_is_reported_as_missing_until_it_is_forgotten() {
    let folder = tempfile::tempdir().unwrap();
    let (shelf, state) = (folder.path().join("shelf"), folder.path().join("state"));
    let (single, other) = (shelf.join("single.kilwa"), shelf.join("other.kilwa"));
    fs::create_dir(&shelf).unwrap();
    fs::copy(pack(), &single).unwrap();
    fs::copy(pack(), &other).unwrap();
    let run = |more: &[&str], code| report(&[&[text(&shelf), "--state", text(&state)], more].concat(), code);
    let missing = |name: &str| BTreeSet::from([(name.to_owned(), "missing".to_owned())]);
    run(&[], 0);
    fs::remove_file(&single).unwrap();
    let runs: [&[&str]; 3] = [&[], &["--older-than", "5"], &["--resume"]];
    for more in runs {
        assert_eq!(problems(&run(more, 1)), missing("single.kilwa"), "{more:?}");
    }
    let output = kilwa(&["verify", text(&shelf), "--state", text(&state)]);
    let printed = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(
        printed.contains("--forget 'single.kilwa'") && printed.contains("1 problem in 1 of 2 objects"),
        "{printed}"
    );
    // Checking one pack by name reports no others.
    assert_eq!(report(&[text(&other)], 0)["sound"], true);
    let refused = fails(&["verify", text(&shelf), "--state", text(&state), "--forget", "none"]);
    assert!(refused.contains("has no such name"), "{refused}");
    assert_eq!(run(&["--forget", "single.kilwa"], 0)["sound"], true);
    assert_eq!(run(&["--older-than", "5"], 0)["skipped"], 1);
    // Even if nothing is left.
    fs::remove_file(&other).unwrap();
    assert_eq!(problems(&run(&[], 1)), missing("other.kilwa"));
    // The bag of a withdrawn object is removed by the withdrawal.
    publish(&shelf, "fort", 1);
    wrap(&shelf);
    run(&["--forget", "other.kilwa"], 0);
    withdraw_with(&shelf, &folder.path().join("keep"), usize::MAX).unwrap();
    assert!(!shelf.join("fort.bag").exists());
    assert_eq!(run(&[], 0)["sound"], true);
}

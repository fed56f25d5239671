//! A publication or withdrawal that was killed: `kilwa verify` says what happened, and the same command continues.

use super::{Bench, MINIMAL, json_of, other_pack, run, tree};
use crate::support::{kill_seed, text};
use std::path::Path;
use std::process::{Command, Output};

const NEXT: &str = ".kilwa-next";
const FURTHER: [&str; 4] = ["--version-note", "Better", "--date", "2026-12-01"];

fn described() -> String {
    format!("description = \"Better\"\n{MINIMAL}")
}

fn verified(folder: &Path) -> (bool, String) {
    let output = run(&["verify", text(folder)]);
    let printed = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    (output.status.success(), printed)
}

#[test]
fn an_object_interrupted_around_the_manifest_is_valid_and_verify_explains_it() {
    let bench = Bench::new();
    let object = bench.published(&other_pack(), MINIMAL, &[]);
    let old = ["manifest.json", "index.html"].map(|name| (name, std::fs::read(object.join(name)).unwrap()));
    bench.published(&other_pack(), &described(), &FURTHER);
    let whole = tree(&object);
    let next = object.join(NEXT);
    // After the folder of the version: the new manifest and page are beside it, and the object is the old one.
    std::fs::create_dir(&next).unwrap();
    for (name, bytes) in &old {
        std::fs::rename(object.join(name), next.join(name)).unwrap();
        std::fs::write(object.join(name), bytes).unwrap();
    }
    let (is_sound, output) = verified(&object);
    assert!(is_sound && output.contains("v2 is a version whose publication was interrupted"), "{output}");
    assert!(!output.contains("unknown file"), "{output}");
    bench.published(&other_pack(), &described(), &FURTHER);
    assert!(tree(&object) == whole, "the same command comes to the same");
    // After the manifest: the object is the new one, and its page lies beside it.
    std::fs::create_dir(&next).unwrap();
    std::fs::rename(object.join("index.html"), next.join("index.html")).unwrap();
    std::fs::write(object.join("index.html"), &old[1].1).unwrap();
    let (is_sound, output) = verified(&object);
    assert!(is_sound && output.contains("index.html is still the old page") && output.contains("again"), "{output}");
    let again = bench.publish(&other_pack(), &described(), &FURTHER);
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    assert!(tree(&object) == whole);
    // A page that is neither is damage.
    std::fs::write(object.join("index.html"), "another").unwrap();
    let (is_sound, output) = verified(&object);
    assert!(!is_sound && output.contains("it is not what was published"), "{output}");
}

/// Run a command that is killed before its n-th call of a kind; `None` if it finished.
fn killed(args: &[&str], call: &str, nth: u32) -> Option<Output> {
    let inject = format!("inject={call}:signal=KILL:when={nth}");
    let output = Command::new("strace")
        .args([
            "-f",
            "-qq",
            "-o",
            "/dev/null",
            "-e",
            &format!("trace={call}"),
            "-e",
            &inject,
            env!("CARGO_BIN_EXE_kilwa"),
        ])
        .args(args)
        .env_remove("SOURCE_DATE_EPOCH")
        .output()
        .unwrap();
    (!output.status.success()).then_some(output)
}

/// How often a command makes a call.
fn calls(args: &[&str], call: &str, log: &Path) -> u32 {
    let mut command = Command::new("strace");
    command.args(["-f", "-qq", "-o", text(log), "-e", &format!("trace={call}"), env!("CARGO_BIN_EXE_kilwa")]);
    assert!(command.args(args).output().unwrap().status.success());
    std::fs::read_to_string(log).unwrap().matches(&format!("{call}(")).count().try_into().unwrap()
}

#[test]
fn a_kill_before_any_rename_leaves_a_valid_archive_and_a_rerun_finishes() {
    let works = Command::new("strace").args(["-f", "-qq", "-o", "/dev/null", "true"]).status();
    if !works.is_ok_and(|status| status.success()) {
        println!("skipped: killing the program before renames: strace is not installed, or may not trace programs");
        return;
    }
    let seed = kill_seed::seed();
    println!("killed at some of the calls; repeat with KILWA_KILL_SEED={seed}");
    let bench = Bench::new();
    let object = bench.published(&other_pack(), MINIMAL, &[]);
    let (first, kept) = (bench.path("first"), bench.path("keep"));
    let copy = |from: &Path, to: &Path| {
        drop(std::fs::remove_dir_all(to));
        assert!(Command::new("cp").args(["-a", text(from), text(to)]).status().unwrap().success());
    };
    copy(&bench.path("site"), &first);
    let (metadata, site, www, pack) =
        (bench.metadata(&described()), bench.path("site"), bench.path("www"), other_pack());
    let begin = ["publish", text(&pack), "--to", text(&site), "--metadata", text(&metadata), "--www", text(&www)];
    let publish = [&begin[..], &["--software"], &FURTHER].concat();
    let reason = ["--reason", "asked to", "--date", "2026-12-02"];
    let withdraw =
        [&["publish", "--withdraw", "fort", "--to", text(&site), "--keep", text(&kept)][..], &reason].concat();
    let withdraw = [&withdraw[..], &["--site", "--www", text(&www)]].concat();
    assert!(run(&withdraw).status.success());
    let withdrawn = [tree(&site), tree(&kept)];
    copy(&first, &site);
    for (command, call) in
        [(&publish, "rename"), (&withdraw, "rename"), (&withdraw, "unlink"), (&withdraw, "rmdir"), (&withdraw, "mkdir")]
    {
        let mut deaths = 0;
        // Drawing takes long, and is done before the last three.
        let soak = std::env::var_os("KILWA_SOAK").is_some();
        let first_call = if soak || *command == withdraw { 1 } else { calls(command, call, &bench.path("log")) - 2 };
        // Only some of the many calls; each seed chooses others.
        let every = match call {
            _ if soak || *command == publish => 1,
            "unlink" => 5,
            "mkdir" => 3,
            _ => 2,
        };
        for nth in (first_call + seed % every..).step_by(every as usize) {
            copy(&first, &site);
            drop(std::fs::remove_dir_all(&kept));
            if killed(command, call, nth).is_none() {
                break;
            }
            deaths += 1;
            let (is_sound, output) = verified(&object);
            assert!(is_sound, "killed before {call} {nth}: {output}");
            if kept.join("fort").is_dir() {
                let (is_sound, output) = verified(&kept.join("fort"));
                assert!(is_sound, "kept, killed before {call} {nth}: {output}");
            }
            let again = run(command);
            assert!(again.status.success(), "{call} {nth}: {}", String::from_utf8_lossy(&again.stderr));
            let (is_sound, output) = verified(&object);
            assert!(is_sound && !output.contains("cut off"), "{call} {nth}: {output}");
            let manifest = json_of(&object.join("manifest.json"));
            if *command == publish {
                assert_eq!(manifest["current"], 2);
            } else {
                let pack = manifest["versions"][0]["pack"]["url"].as_str().unwrap();
                assert_eq!(manifest["access"]["state"], "withdrawn");
                assert!(!object.join(pack).exists() && kept.join("fort").join(pack).exists());
                assert!([tree(&site), tree(&kept)] == withdrawn, "{call} {nth}: it does not come to the same");
            }
        }
        println!("{call}: killed {deaths} times");
        assert!(deaths > 2, "{deaths}");
    }
}

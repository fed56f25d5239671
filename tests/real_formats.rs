//! Real OBJ, STL and glTF files of `../shared/data`, each by the whole program: it becomes a pack that verifies, or it is
//! refused with exit code 1 and one line that names the file, in plain language, and no file is left. (PLY: `real_input`.)

use crate::support::{fails, json, kilwa, text};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Programmers' jargon that no message may contain.
const JARGON: [&str; 9] = ["usize", "u64", "f64", "struct", "EOF", "None", "Some", "unwrap", "panicked"];

/// All files below a folder with one of the extensions, in order.
fn files(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let is_one = |e: &std::ffi::OsStr| extensions.iter().any(|wanted| e.eq_ignore_ascii_case(wanted));
        if path.is_dir() {
            files(&path, extensions, found);
        } else if path.extension().is_some_and(is_one) {
            found.push(path);
        }
    }
}

/// Build and verify one file; its triangles, `None` where it is refused.
fn one(input: &Path, folder: &Path) -> Option<u64> {
    let pack = folder.join("a.kilwa");
    let output = kilwa(&["build", text(input), "-o", text(&pack), "--json"]);
    if output.status.success() {
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let verified = json(&["verify", text(&pack)]);
        assert_eq!(verified["sound"], true, "{}: {verified}", input.display());
        assert_eq!(verified["triangles"], report["triangles"], "{}", input.display());
        std::fs::remove_file(pack).unwrap();
        assert!(std::fs::read_dir(folder).unwrap().next().is_none(), "{} left something behind", input.display());
        return report["triangles"].as_u64();
    }
    let message = fails(&["build", text(input), "-o", text(&pack)]);
    let name = input.file_name().unwrap().to_str().unwrap();
    assert!(message.contains(name), "the file is named: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "one line says it: {message}");
    // What the file itself says may be quoted.
    let own: String = message.replace(text(input), "").split('"').step_by(2).collect();
    let mut words = own.split(|c: char| !c.is_alphanumeric());
    assert!(!words.any(|word| JARGON.contains(&word)), "in words of people: {message}");
    assert!(std::fs::read_dir(folder).unwrap().next().is_none(), "{name} left something behind");
    None
}

fn every_file_is_built_or_refused(extensions: &[&str], min: (usize, usize)) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if !data.is_dir() {
        println!("skipped: {} is not here", data.display());
        return;
    }
    let mut all = Vec::new();
    files(&data, extensions, &mut all);
    let (waiting, done) = (Mutex::new(all.iter()), Mutex::new((0, 0)));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let folder = tempfile::tempdir().unwrap();
                while let Some(input) = { waiting.lock().unwrap().next() } {
                    let built = one(input, folder.path()).is_some();
                    let mut done = done.lock().unwrap();
                    (done.0, done.1) = (done.0 + usize::from(built), done.1 + usize::from(!built));
                }
            });
        }
    });
    let (built, refused) = done.into_inner().unwrap();
    println!("{built} built, {refused} refused");
    assert!(built >= min.0 && built + refused >= min.1, "{built} built, {refused} refused");
}

#[test]
fn every_real_obj_is_built_and_verified_or_refused_with_a_plain_message() {
    every_file_is_built_or_refused(&["obj"], (70, 85));
}

#[test]
fn every_real_stl_is_built_and_verified_or_refused_with_a_plain_message() {
    every_file_is_built_or_refused(&["stl"], (20, 20));
}

#[test]
fn every_real_gltf_is_built_and_verified_or_refused_with_a_plain_message() {
    every_file_is_built_or_refused(&["gltf", "glb"], (70, 300));
}

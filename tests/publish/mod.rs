//! `kilwa publish` and `kilwa metadata` as programs: the contents of an object, refusals, and independent validators.
//!
//! Each test publishes packs of its own to a folder of its own, with a page of a few small files in place of the built one.

mod cut;
mod holes;
mod notes;
mod object;
mod opinions;
pub(crate) mod photographs;
mod place;
mod refusals;
mod tiles;
mod traces;

use crate::support::{Input, built_once, serving};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Metadata with every field; tests insert more at `@` at the top of the file.
pub(crate) const FULL: &str = r#"
title = "Gereza & fort, \"Kilwa\""
alternative_titles = ["Ngome <ya> Kilwa"]
description = "First paragraph & more.\n\nSecond <b>one</b>."
subjects = ["fort", "Swahili coast"]
slug = "gereza"
url = "https://museum.example/models/gereza/"
identifier = "doi:10.1234/abc_d"
publisher = "Museum & Sons"
published = 2026-11-21
[rights]
uri = "https://creativecommons.org/licenses/by/4.0/deed.fr"
holder = "Antiquities Division"
[photographs]
rights = "InC"
creators = ["Juma, Amina"]
holder = "Antiquities Division"
credit = "Photographs & masks: A. Juma"
[model]
units = "m"
crs = "EPSG:32737"
[[creators]]
name = "Rüther, Heinz"
orcid = "0000-0002-1825-0097"
affiliation = "University of Cape Town"
[[creators]]
name = "Zamani Project"
kind = "organisation"
[[contributors]]
name = "Held, Christoph"
role = "Data Collector"
[place]
name = "Kilwa Kisiwani"
country = "TZ"
latitude = -8.9577
longitude = 39.5228
[object]
kind = "Fort"
materials = ["coral rag"]
identifiers = ["UNESCO 144"]
[capture]
date = "2009-07/2009-08"
accuracy = 0.003
description = "Inside and outside."
[[capture.steps]]
what = "Registration"
[[related]]
relation = "IsDescribedBy"
uri = "10.1145/1015706.1015802"
[[funding]]
funder = "World Monuments Fund"
award = "12"
"#;

/// The minimal metadata that is accepted.
pub(crate) const MINIMAL: &str =
    "title = \"Fort\"\npublished = 2026-11-21\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n";

/// A pack at UTM coordinates with a reference system.
pub(crate) fn pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("publish");
    let write = |path: &Path| Input::torus(90, 40, [565_977.25, 9_009_946.5, 31.75]).write(path);
    built_once(&folder, "torus", write, &["--crs", "EPSG:32737", "--title", "torus"])
}

/// The same shape without one, another pack.
pub(crate) fn other_pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("publish");
    built_once(&folder, "local", |path| Input::torus(80, 30, [1.0, 2.0, 3.0]).write(path), &[])
}

/// A working folder with a page, metadata and objects.
pub(crate) struct Bench {
    pub(crate) folder: tempfile::TempDir,
}

impl Bench {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        serving::page(&folder.path().join("www"));
        Self { folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Write metadata; its path.
    pub(crate) fn metadata(&self, text: &str) -> PathBuf {
        let path = self.path("metadata.toml");
        std::fs::write(&path, text).unwrap();
        path
    }

    /// Run [`Self::command`] with a software renderer and without `SOURCE_DATE_EPOCH`.
    pub(crate) fn publish(&self, pack: &Path, metadata: &str, more: &[&str]) -> Output {
        self.command(pack, metadata, more).arg("--software").env_remove("SOURCE_DATE_EPOCH").output().unwrap()
    }

    /// `kilwa publish PACK --to site` with metadata and more options, not started.
    pub(crate) fn command(&self, pack: &Path, metadata: &str, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        command.arg("publish").arg(pack).arg("--to").arg(self.path("site"));
        command.arg("--metadata").arg(self.metadata(metadata)).arg("--www").arg(self.path("www"));
        command.args(more).stdin(Stdio::null());
        command
    }

    /// As [`Self::publish`], which must succeed; the object's folder.
    pub(crate) fn published(&self, pack: &Path, metadata: &str, more: &[&str]) -> PathBuf {
        let output = self.publish(pack, metadata, &[more, &["--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        PathBuf::from(report["object"].as_str().unwrap())
    }

    /// As [`Self::publish`], which must exit with 1 and change nothing; its message.
    pub(crate) fn refused(&self, pack: &Path, metadata: &str, more: &[&str]) -> String {
        let before = tree(&self.path("site"));
        let output = self.publish(pack, metadata, more);
        assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stdout));
        assert!(tree(&self.path("site")) == before, "something was written");
        String::from_utf8(output.stderr).unwrap()
    }
}

/// Run the program without `SOURCE_DATE_EPOCH`.
pub(crate) fn run(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args(args).env_remove("SOURCE_DATE_EPOCH").stdin(Stdio::null()).output().unwrap()
}

/// Every file below a folder, hidden ones too; empty if there is none.
pub(crate) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let Ok(entries) = std::fs::read_dir(folder) else { return all };
    for entry in entries {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.insert(format!("{name}/"), Vec::new());
            all.extend(tree(&path).into_iter().map(|(p, b)| (format!("{name}/{p}"), b)));
        } else {
            all.insert(name, std::fs::read(&path).unwrap());
        }
    }
    all
}

/// A JSON file.
pub(crate) fn json_of(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).unwrap()
}

//! What was checked when, so that a nightly job continues where it was stopped and reads again only what is due.
//!
//! A text file, one JSON object a line, only ever appended to: a run begins, a file was read, a unit (object, bag or single pack) is done,
//! the run is done, a unit is to be forgotten. A line that a power cut left incomplete is ignored. A new run rewrites the file with the last line of each unit.

use super::place::Place;
use crate::secrets::shown;
use anyhow::{Context, bail};
use kilwa_files::atomic::{Access, AtomicFile};
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::plain_file;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// A larger file is not a state file: each run starts the file again with one line per unit.
const MAX_BYTES: u64 = 1 << 30;

/// One line. Times are seconds since 1970, UTC.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(tag = "kilwa-verify", rename_all = "lowercase")]
enum Line {
    Run {
        target: String,
        at: u64,
    },
    File {
        path: String,
        bytes: u64,
        sha256: String,
        at: u64,
        #[serde(default)]
        stamp: String,
    },
    Unit(Unit),
    Forget {
        name: String,
    },
    Done {
        at: u64,
    },
}

/// What is known of an object, bag or pack that was checked.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Unit {
    /// Its name.
    pub(crate) name: String,
    /// When it was done.
    pub(crate) at: u64,
    /// How much was wrong.
    pub(crate) problems: u64,
    /// SHA-256 of its manifest, of an object.
    #[serde(default)]
    pub(crate) manifest: String,
    /// Number of each version, and the SHA-256 of its list of checksums: these never change.
    #[serde(default)]
    pub(crate) versions: Vec<(u32, String)>,
    /// Names, lengths, times and inodes of all its files as they were before the check, as one checksum; empty if they are unknown
    /// (states of earlier versions, and addresses).
    #[serde(default)]
    pub(crate) stamp: String,
}

/// A file that was found sound.
#[derive(Debug, Clone, PartialEq, Eq)]
struct SoundFile {
    bytes: u64,
    sha256: String,
    stamp: String,
}

/// What is remembered; in memory only without a file.
#[derive(Default)]
pub(crate) struct State {
    file: Option<(PathBuf, File)>,
    units: BTreeMap<String, Unit>,
    /// Files of the unit in progress that were found sound.
    files: BTreeMap<String, SoundFile>,
    /// Units that are done in the run that is resumed.
    resumed: BTreeSet<String>,
    /// Units checked since then, and sound, are left out.
    fresh_since: Option<u64>,
}

/// Now, seconds since 1970.
pub(crate) fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())
}

impl State {
    /// Open a state file, or begin it. With `resume` a run that was stopped is resumed; `days`: what was found sound so many days ago or
    /// later is left out. The units named in `forget` are removed.
    ///
    /// # Errors
    /// If it cannot be read or written, is another kind of file, belongs to another target, or does not contain a name to forget.
    pub(crate) fn open(
        path: &Path,
        target: &str,
        resume: bool,
        days: Option<u64>,
        forget: &[String],
    ) -> anyhow::Result<Self> {
        let mut known = Known::read(path, target)?;
        for name in forget {
            if known.units.remove(name).is_none() {
                bail!(
                    "--forget {name}: the state file {} has no such name; use the name as it was reported",
                    path.display()
                );
            }
            known.done.remove(name);
        }
        let at = now();
        let resumed = known.is_running && resume;
        let mut state = Self {
            file: None,
            units: known.units,
            files: if resumed { known.files } else { BTreeMap::new() },
            resumed: if resumed { known.done } else { BTreeSet::new() },
            fresh_since: days.map(|d| at.saturating_sub(d.saturating_mul(86_400))),
        };
        if !resumed {
            state.begin(path, target, at).with_context(|| format!("cannot write the state {}", path.display()))?;
        }
        let file = OpenOptions::new().append(true).open(path);
        let mut file = file.with_context(|| format!("cannot write the state {}", path.display()))?;
        if known.is_torn && resumed {
            file.write_all(b"\n").with_context(|| format!("cannot write the state {}", path.display()))?;
        }
        state.file = Some((path.to_owned(), file));
        if resumed {
            for name in forget {
                state.write(&Line::Forget { name: name.clone() })?;
            }
        }
        Ok(state)
    }

    /// The file of a new run, with what is known from earlier ones.
    fn begin(&self, path: &Path, target: &str, at: u64) -> anyhow::Result<()> {
        let _folders = MadeFolders::for_file(path)?;
        let mut file = AtomicFile::create(path, Access::Private)?;
        for unit in self.units.values() {
            writeln!(file, "{}", serde_json::to_string(&Line::Unit(unit.clone()))?)?;
        }
        writeln!(file, "{}", serde_json::to_string(&Line::Run { target: target.to_owned(), at })?)?;
        Ok(file.commit(true)?)
    }

    /// What is known of a unit from before.
    pub(crate) fn unit(&self, name: &str) -> Option<&Unit> {
        self.units.get(name)
    }

    /// The names of all units of earlier runs.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.units.keys().map(String::as_str)
    }

    /// The stamp of a file or folder of a place; empty if it is unknown, or there is no state file.
    pub(crate) fn stamp(&self, place: &dyn Place, path: &str) -> String {
        self.file.as_ref().and_then(|_| place.stamp(path)).unwrap_or_default()
    }

    /// Whether a unit can be skipped: it was found sound in the run being resumed, or recently, with this manifest, and its files are
    /// unchanged. If changes cannot be detected, it is skipped only in the same run.
    pub(crate) fn is_done(&self, name: &str, manifest: &str, stamp: &str) -> bool {
        let unit = self.units.get(name).filter(|u| u.problems == 0 && u.manifest == manifest && u.stamp == stamp);
        let is_fresh = |u: &Unit| !stamp.is_empty() && self.fresh_since.is_some_and(|since| u.at >= since);
        unit.is_some_and(|u| self.resumed.contains(name) || is_fresh(u))
    }

    /// Whether a file of the unit in progress was found to have these bytes before the run was stopped, and has not changed since.
    pub(crate) fn has(&self, path: &str, bytes: u64, sha256: &str, stamp: &str) -> bool {
        self.files.get(path).is_some_and(|f| f.bytes == bytes && f.sha256 == sha256 && f.stamp == stamp)
    }

    /// Note that a file was read and is sound; `stamp` is its stamp before it was read.
    ///
    /// # Errors
    /// When it cannot be written down.
    pub(crate) fn file(&mut self, path: &str, bytes: u64, sha256: &str, stamp: &str) -> anyhow::Result<()> {
        let (sha256, stamp) = (sha256.to_owned(), stamp.to_owned());
        let line = Line::File { path: path.to_owned(), bytes, sha256, at: now(), stamp };
        self.write(&line)
    }

    /// A unit is done. If its manifest could not be read, the versions of the last check remain known.
    ///
    /// # Errors
    /// When it cannot be written down.
    pub(crate) fn done(&mut self, mut unit: Unit) -> anyhow::Result<()> {
        if unit.manifest.is_empty()
            && unit.versions.is_empty()
            && let Some(known) = self.units.get(&unit.name)
        {
            unit.versions.clone_from(&known.versions);
        }
        self.files.clear();
        self.write(&Line::Unit(unit.clone()))?;
        self.units.insert(unit.name.clone(), unit);
        Ok(())
    }

    /// All is done.
    ///
    /// # Errors
    /// When it cannot be written down.
    pub(crate) fn finish(&mut self) -> anyhow::Result<()> {
        self.write(&Line::Done { at: now() })?;
        if let Some((path, file)) = &self.file {
            file.sync_all().with_context(|| format!("cannot write the state {}", path.display()))?;
        }
        Ok(())
    }

    fn write(&mut self, line: &Line) -> anyhow::Result<()> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        let mut text = serde_json::to_string(line)?;
        text.push('\n');
        // One write a line: a second process that reads sees whole lines.
        file.write_all(text.as_bytes()).with_context(|| format!("cannot write the state {}", path.display()))
    }
}

/// What a state file says.
#[derive(Default)]
struct Known {
    units: BTreeMap<String, Unit>,
    files: BTreeMap<String, SoundFile>,
    /// Units that are done in the last run.
    done: BTreeSet<String>,
    /// The last run did not end.
    is_running: bool,
    is_torn: bool,
}

impl Known {
    fn read(path: &Path, target: &str) -> anyhow::Result<Self> {
        let text = match plain_file::read_at(path, MAX_BYTES) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Self::default()),
            other => other.with_context(|| format!("cannot read the state {}", path.display()))?,
        };
        let mut known = Self { is_torn: !text.is_empty() && !text.ends_with(b"\n"), ..Self::default() };
        let mut understood = text.is_empty();
        let mut of = None;
        for line in text.split(|&b| b == b'\n').filter(|line| !line.is_empty()) {
            let Ok(line) = serde_json::from_slice::<Line>(line) else { continue };
            understood = true;
            match line {
                Line::Run { target, .. } => {
                    // Earlier versions stored the password of an address.
                    (known.is_running, of) = (true, Some(shown(&target).into_owned()));
                    known.files.clear();
                    known.done.clear();
                }
                Line::File { path, bytes, sha256, stamp, .. } => {
                    known.files.insert(path, SoundFile { bytes, sha256, stamp });
                }
                Line::Forget { name } => {
                    known.units.remove(&name);
                    known.done.remove(&name);
                }
                Line::Unit(unit) => {
                    known.files.clear();
                    known.done.insert(unit.name.clone());
                    known.units.insert(unit.name.clone(), unit);
                }
                Line::Done { .. } => known.is_running = false,
            }
        }
        if !understood {
            bail!("{} is not a state file of kilwa verify; choose another name with --state", path.display());
        }
        if let Some(of) = of.filter(|of| of != target) {
            bail!("{} belongs to {of}, not to {target}; use another state file with --state", path.display());
        }
        Ok(known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn unit(name: &str, at: u64, problems: u64) -> Unit {
        let versions = vec![(1, "s".to_owned())];
        Unit { name: name.to_owned(), at, problems, manifest: "m".to_owned(), versions, stamp: "now".to_owned() }
    }

    /// A folder, a state file in it, and the state of its first run.
    fn begun(resume: bool) -> (tempfile::TempDir, PathBuf, State) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        let state = State::open(&path, "here", resume, None, &[]).unwrap();
        (folder, path, state)
    }

    #[test]
    fn a_stopped_run_is_resumed_and_a_torn_line_is_skipped() {
        let (_folder, path, mut state) = begun(true);
        state.done(unit("a", now(), 0)).unwrap();
        state.done(unit("b", now(), 2)).unwrap();
        state.file("c/x", 5, "55", "now").unwrap();
        drop(state);
        let mut text = fs::read(&path).unwrap();
        text.extend(b"{\"kilwa-verify\":\"fi");
        fs::write(&path, text).unwrap();
        let mut state = State::open(&path, "here", true, None, &[]).unwrap();
        assert!(
            state.is_done("a", "m", "now") && !state.is_done("a", "other", "now") && !state.is_done("b", "m", "now")
        );
        assert!(!state.is_done("a", "m", "then"), "its files have changed");
        assert!(state.has("c/x", 5, "55", "now") && !state.has("c/x", 5, "56", "now"));
        assert!(!state.has("c/x", 5, "55", "then"), "it has changed");
        state.done(unit("c", now(), 0)).unwrap();
        state.finish().unwrap();
        let state = State::open(&path, "here", true, None, &[]).unwrap();
        assert!(!state.is_done("a", "m", "now") && !state.has("c/x", 5, "55", "now"), "a finished run is not resumed");
        assert_eq!(state.unit("c").unwrap().versions, [(1, "s".to_owned())]);
    }

    #[test]
    fn versions_remain_known_while_the_manifest_cannot_be_read() {
        let (_folder, path, mut state) = begun(false);
        state.done(unit("a", now(), 0)).unwrap();
        state.done(Unit { name: "a".to_owned(), at: now(), problems: 1, ..Unit::default() }).unwrap();
        state.finish().unwrap();
        let state = State::open(&path, "here", false, None, &[]).unwrap();
        let known = state.unit("a").unwrap();
        assert_eq!((known.problems, known.versions.as_slice()), (1, [(1, "s".to_owned())].as_slice()));
    }

    #[test]
    fn recently_checked_units_are_skipped() {
        let (_folder, path, mut state) = begun(false);
        state.done(unit("old", now() - 10 * 86_400, 0)).unwrap();
        state.done(unit("new", now() - 86_400, 0)).unwrap();
        state.finish().unwrap();
        let state = State::open(&path, "here", false, Some(7), &[]).unwrap();
        assert!(state.is_done("new", "m", "now") && !state.is_done("old", "m", "now"));
        assert!(!state.is_done("new", "m", "then") && !state.is_done("new", "m", ""), "it may have changed");
    }

    #[test]
    fn state_files_of_earlier_versions_are_read_and_their_units_checked_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        let old = |at: u64| {
            format!(
                "{{\"kilwa-verify\":\"run\",\"target\":\"here\",\"at\":{at}}}\n\
                 {{\"kilwa-verify\":\"unit\",\"name\":\"a\",\"at\":{at},\"problems\":0,\"manifest\":\"m\",\"versions\":[[1,\"s\"]]}}\n\
                 {{\"kilwa-verify\":\"file\",\"path\":\"b/x\",\"bytes\":5,\"sha256\":\"55\",\"at\":{at}}}\n"
            )
        };
        for resume in [false, true] {
            fs::write(&path, old(now())).unwrap();
            let state = State::open(&path, "here", resume, Some(7), &[]).unwrap();
            assert_eq!(state.unit("a").unwrap().versions, [(1, "s".to_owned())]);
            assert!(!state.is_done("a", "m", "now") && !state.has("b/x", 5, "55", "now"));
        }
    }

    #[test]
    fn forgotten_units_stay_forgotten_in_new_and_resumed_runs() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state");
        for resume in [false, true] {
            fs::remove_file(&path).ok();
            let mut state = State::open(&path, "here", false, None, &[]).unwrap();
            state.done(unit("a", now(), 0)).unwrap();
            state.done(unit("b", now(), 0)).unwrap();
            drop(state);
            let forget = ["a".to_owned()];
            let unknown = State::open(&path, "here", resume, None, &["c".to_owned()]).err().unwrap().to_string();
            assert!(unknown.contains("--forget c"), "{unknown}");
            drop(State::open(&path, "here", resume, None, &forget).unwrap());
            let state = State::open(&path, "here", resume, None, &[]).unwrap();
            assert_eq!(state.names().collect::<Vec<_>>(), ["b"], "resume {resume}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_without_blocking() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, device) = (folder.path().join("pipe"), folder.path().join("device"));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::os::unix::fs::symlink("/dev/zero", &device).unwrap();
        for path in [pipe, device] {
            let refused = State::open(&path, "here", true, None, &[]).err().map(|e| format!("{e:#}"));
            assert!(refused.as_ref().is_some_and(|why| why.contains("not a regular file")), "{refused:?}");
        }
    }

    #[test]
    fn foreign_files_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("thesis.txt");
        fs::write(&path, "years of work\n").unwrap();
        assert!(State::open(&path, "here", false, None, &[]).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"years of work\n");
        let path = folder.path().join("state");
        drop(State::open(&path, "here", false, None, &[]).unwrap());
        let other = State::open(&path, "there", false, None, &[]).err().unwrap().to_string();
        assert!(other.contains("belongs to here"), "{other}");
    }
}

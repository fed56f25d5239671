//! The journal of a build: which stages are complete, and what files each left, so that a build that was killed goes on
//! where it was.
//!
//! `journal` in the scratch folder is text: one JSON object per line, followed by its CRC-32. The first line describes the build:
//! version, options, inputs. Every other line is a complete stage: its name, the files that the build needs from then on with
//! their lengths, and what else the next stage must know. A line is written, and made durable, after all its files
//! are. A line that is incomplete, or whose checksum does not match, is ignored. Files that no line needs are removed; those of
//! the last line but one are kept too, so that one damaged file costs one stage.

use crate::build::options::BuildError;
use crate::build::{INGEST, Provenance, READ};
use crate::ingest::is_file_of_ingest;
use crate::scratch::{Scratch, ScratchError, ScratchFile, seal, unseal};
use kilwa_pack::metadata::SourceFile;
use kilwa_pack::plural::counted;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

/// Name of the file.
pub const JOURNAL: &str = "journal";

/// What is being built: a build is resumed only where all of this is the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// The program that wrote the scratch files: another version may write them otherwise.
    pub tool: String,
    /// Everything that shapes the pack, by name.
    pub options: BTreeMap<String, Value>,
    /// The inputs, in order.
    pub inputs: Vec<PlannedInput>,
}

/// Whether the input with this number still has the content that was read. The second argument is the list of inputs in the metadata.
pub type IsUnchanged<'a> = &'a dyn Fn(usize, &[SourceFile]) -> Result<bool, BuildError>;

/// One input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedInput {
    /// Its absolute path, or its address in a store.
    pub path: String,
    /// Its length in bytes.
    pub bytes: u64,
    /// When it was last changed, nanoseconds since 1970, where the system knows.
    pub modified: Option<u64>,
    /// Where its coordinates are placed; any text that differs where the placement does.
    #[serde(default)]
    pub placement: String,
    /// A text that changes when the file is changed or replaced, even if it keeps its length and time. If it differs, contents are
    /// compared, because a disk that was mounted again may have other inodes.
    #[serde(default)]
    pub stamp: String,
    /// The ETag of an object in a store, which changes with its content.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tag: Option<String>,
}

impl PlannedInput {
    /// Whether two are the same except for their stamps.
    fn is_like(&self, other: &Self) -> bool {
        (&self.path, self.bytes, self.modified, &self.placement, &self.tag)
            == (&other.path, other.bytes, other.modified, &other.placement, &other.tag)
    }
}

impl Plan {
    /// Why a build of `self` is not the same as `before`, whose inputs the metadata describes in `sources`. Contents are compared
    /// if necessary.
    ///
    /// # Errors
    /// Those of `is_unchanged`.
    pub fn difference(
        &self,
        before: &Self,
        sources: &[SourceFile],
        is_unchanged: IsUnchanged<'_>,
    ) -> Result<Option<String>, BuildError> {
        if let Some(why) = self.differs_from(before) {
            return Ok(Some(why));
        }
        for (number, (now, then)) in self.inputs.iter().zip(&before.inputs).enumerate() {
            if now.stamp != then.stamp && !is_unchanged(number, sources)? {
                return Ok(Some(format!("{} was changed since", now.path)));
            }
        }
        Ok(None)
    }

    /// Why a build of `self` cannot continue from what `before` left, ignoring stamps.
    fn differs_from(&self, before: &Self) -> Option<String> {
        if self.tool != before.tool {
            return Some(format!("it was started by {}, and this is {}", before.tool, self.tool));
        }
        for name in self.options.keys().chain(before.options.keys()) {
            let (now, then) = (self.options.get(name), before.options.get(name));
            if now != then {
                let say = |v: Option<&Value>| v.map_or_else(|| "nothing".to_owned(), Value::to_string);
                return Some(format!("it was started with {name} {}, and now it is {}", say(then), say(now)));
            }
        }
        if self.inputs.len() != before.inputs.len() {
            let now = if self.inputs.len() == 1 { "is 1".to_owned() } else { format!("are {}", self.inputs.len()) };
            return Some(format!(
                "it was begun with {}, and now there {}",
                counted(before.inputs.len(), "input", "inputs"),
                now
            ));
        }
        let (now, then) = self.inputs.iter().zip(&before.inputs).find(|(now, then)| !now.is_like(then))?;
        Some(if now.path == then.path && now.placement != then.placement {
            format!("{} is placed otherwise: by {}, and before by {}", now.path, now.placement, then.placement)
        } else if now.path == then.path {
            format!("{} was changed since", now.path)
        } else {
            format!("it was started with the input {}, and now it is {}", then.path, now.path)
        })
    }
}

/// A complete stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Its name, for example `level-07`.
    pub stage: String,
    /// Files that the build needs from here on, with their lengths. One that later stages append to may be longer.
    pub files: BTreeMap<String, u64>,
    /// What else the next stage must know.
    pub data: Value,
}

/// The journal of the build in progress.
#[derive(Debug)]
pub struct Journal {
    scratch: Scratch,
    file: ScratchFile,
    plan: Plan,
    stages: Vec<Stage>,
}

impl Journal {
    /// Start over: what was in the folder goes.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn begin(scratch: &Scratch, plan: Plan) -> Result<Self, ScratchError> {
        for (name, _) in scratch.files()? {
            scratch.remove(&name)?;
        }
        let file = scratch.create(JOURNAL)?;
        let journal = Self { scratch: scratch.clone(), file, plan, stages: Vec::new() };
        journal.put(&journal.plan)?;
        Ok(journal)
    }

    /// Go on with the build whose journal is in the folder, after the last stage whose files are all there. Where there is
    /// no journal, or not even its first line, the build starts over. So it does if no stage is complete and an input was changed.
    ///
    /// # Errors
    /// [`BuildError::Resume`] if something else was being built; [`ScratchError`]; those of `is_unchanged`.
    pub fn resume(scratch: &Scratch, plan: Plan, is_unchanged: IsUnchanged<'_>) -> Result<Self, BuildError> {
        let text = match scratch.existing(JOURNAL) {
            Ok(file) => String::from_utf8_lossy(&file.read(0, file.len())?).into_owned(),
            Err(_) => String::new(),
        };
        // The last line is whole only where its end is.
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        let mut lines = whole.lines();
        let Some(before) = lines.next().and_then(|l| serde_json::from_str::<Plan>(unseal(l)?).ok()) else {
            return Ok(Self::begin(scratch, plan)?);
        };
        let stages: Vec<Stage> = lines.map_while(|l| serde_json::from_str(unseal(l)?).ok()).collect();
        let read = stages.iter().find(|s| s.stage == READ).map(|s| s.data.clone()).unwrap_or_default();
        let Provenance { sources, .. } = serde_json::from_value(read).unwrap_or_default();
        // If nothing is complete, all inputs are read from the beginning.
        let is_unread = |_: usize, _: &[SourceFile]| -> Result<bool, BuildError> { Ok(true) };
        let is_unchanged: IsUnchanged<'_> = if stages.is_empty() { &is_unread } else { is_unchanged };
        if let Some(why) = plan.difference(&before, &sources, is_unchanged)? {
            return Err(BuildError::Resume { folder: scratch.folder().to_owned(), why });
        }
        let mut journal = Self { scratch: scratch.clone(), file: scratch.existing(JOURNAL)?, plan, stages };
        journal.go_back(&BTreeSet::new())?;
        Ok(journal)
    }

    /// Drop the last stages until one is left that can be built upon: its files are all there with their lengths, and none
    /// of them is known to be `damaged`. Then remove what nothing needs.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn go_back(&mut self, damaged: &BTreeSet<String>) -> Result<(), ScratchError> {
        let usable = |s: &Stage| {
            let there = |(name, bytes): (&String, &u64)| {
                !damaged.contains(name) && self.scratch.length(name).is_some_and(|now| now >= *bytes)
            };
            s.files.iter().all(there)
        };
        let kept = self.stages.iter().rposition(usable).map_or(0, |last| last + 1);
        if kept < self.stages.len() {
            self.stages.truncate(kept);
        }
        // Rewritten, so that a torn last line does not spoil the next.
        let mut text = line_of(&self.plan);
        self.stages.iter().for_each(|s| text.extend(line_of(s)));
        self.file.truncate(0)?;
        self.file.append(&text)?;
        self.file.sync()?;
        self.remove_unneeded()
    }

    /// The last complete stage.
    pub fn last(&self) -> Option<&Stage> {
        self.stages.last()
    }

    /// The line of a stage.
    pub fn stage(&self, name: &str) -> Option<&Stage> {
        self.stages.iter().find(|s| s.stage == name)
    }

    /// Note that a stage is complete. `files` are those that the build needs from here on; they are on the disk already.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn complete(&mut self, stage: &str, files: &[String], data: Value) -> Result<(), ScratchError> {
        let lengths = files.iter().map(|name| (name.clone(), self.scratch.length(name).unwrap_or(0)));
        let stage = Stage { stage: stage.to_owned(), files: lengths.collect(), data };
        self.scratch.sync()?;
        self.put(&stage)?;
        self.stages.push(stage);
        self.remove_unneeded()
    }

    fn put(&self, line: &impl Serialize) -> Result<(), ScratchError> {
        self.file.append(&line_of(line))?;
        self.file.sync()
    }

    /// Remove the files that neither of the last two lines needs. The ingest looks after its files itself while it is under
    /// way.
    fn remove_unneeded(&self) -> Result<(), ScratchError> {
        let needed: BTreeSet<&String> = self.stages.iter().rev().take(2).flat_map(|s| s.files.keys()).collect();
        let ingesting = self.stage(INGEST).is_none();
        for (name, _) in self.scratch.files()? {
            if name != JOURNAL && !needed.contains(&name) && !(ingesting && is_file_of_ingest(&name)) {
                self.scratch.remove(&name)?;
            }
        }
        self.scratch.recount()
    }
}

fn line_of(line: &impl Serialize) -> Vec<u8> {
    // Maps with text as keys and plain numbers: this cannot fail, and an empty line would be no line.
    seal(&serde_json::to_vec(line).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> Plan {
        let options = BTreeMap::from([("step".to_owned(), Value::from(0.25)), ("title".to_owned(), Value::from("a"))]);
        let (path, stamp) = ("/a.ply".to_owned(), "inode 7".to_owned());
        let input = PlannedInput { path, bytes: 10, modified: Some(5), placement: String::new(), stamp, tag: None };
        Plan { tool: "kilwa 1".into(), options, inputs: vec![input] }
    }

    /// Resume; contents must not be compared.
    fn resume(scratch: &Scratch, plan: Plan) -> Result<Journal, BuildError> {
        Journal::resume(scratch, plan, &|_, _| panic!("contents were compared although nothing differs"))
    }

    fn with_stages(scratch: &Scratch, n: usize) -> Journal {
        let mut journal = Journal::begin(scratch, plan()).unwrap();
        for i in 0..n {
            let name = format!("file-{i}");
            scratch.create(&name).unwrap().append(&vec![7; 100 + i]).unwrap();
            journal.complete(&format!("stage-{i}"), &[name], Value::from(i)).unwrap();
        }
        journal
    }

    #[test]
    fn a_build_resumes_after_its_last_stage_and_removes_old_files() {
        let scratch = Scratch::temporary().unwrap();
        drop(with_stages(&scratch, 4));
        let journal = resume(&scratch, plan()).unwrap();
        assert_eq!(journal.last().map(|s| (s.stage.as_str(), &s.data)), Some(("stage-3", &Value::from(3))));
        let names: Vec<String> = scratch.files().unwrap().into_iter().map(|f| f.0).collect();
        assert_eq!(names, ["file-2", "file-3", "journal"], "those of the last stage and of the one before");
    }

    #[test]
    fn a_short_missing_or_damaged_file_repeats_one_stage() {
        for spoil in 0..3 {
            let scratch = Scratch::temporary().unwrap();
            drop(with_stages(&scratch, 4));
            let path = scratch.path("file-3");
            match spoil {
                0 => std::fs::write(&path, [7; 102]).unwrap(),
                1 => std::fs::remove_file(&path).unwrap(),
                _ => {}
            }
            let mut journal = resume(&scratch, plan()).unwrap();
            if spoil == 2 {
                assert_eq!(journal.last().unwrap().stage, "stage-3");
                journal.go_back(&BTreeSet::from(["file-3".to_owned()])).unwrap();
            }
            assert_eq!(journal.last().unwrap().stage, "stage-2");
            assert!(!path.exists());
            // And from there it continues.
            journal.complete("again", &["file-2".to_owned()], Value::Null).unwrap();
            assert_eq!(resume(&scratch, plan()).unwrap().last().unwrap().stage, "again");
        }
    }

    #[test]
    fn a_journal_cut_anywhere_is_read_up_to_its_last_whole_line() {
        let scratch = Scratch::temporary().unwrap();
        drop(with_stages(&scratch, 2));
        let whole = std::fs::read(scratch.path(JOURNAL)).unwrap();
        let files = [("file-0", vec![7; 100]), ("file-1", vec![7; 101])];
        for cut in 0..=whole.len() {
            for (name, bytes) in &files {
                std::fs::write(scratch.path(name), bytes).unwrap();
            }
            std::fs::write(scratch.path(JOURNAL), &whole[..cut]).unwrap();
            let journal = resume(&scratch, plan()).unwrap();
            let lines = String::from_utf8_lossy(&whole[..cut]).matches('\n').count();
            assert_eq!(journal.stages.len(), lines.saturating_sub(1), "cut at {cut}");
            let text = std::fs::read(scratch.path(JOURNAL)).unwrap();
            assert!(text.ends_with(b"\n"), "cut at {cut}");
        }
    }

    #[test]
    fn a_changed_byte_invalidates_its_line_and_all_later_ones() {
        let scratch = Scratch::temporary().unwrap();
        drop(with_stages(&scratch, 3));
        let whole = std::fs::read(scratch.path(JOURNAL)).unwrap();
        for at in 0..whole.len() {
            for name in ["file-1", "file-2"] {
                std::fs::write(scratch.path(name), vec![7; 102]).unwrap();
            }
            let mut text = whole.clone();
            text[at] ^= 1;
            std::fs::write(scratch.path(JOURNAL), &text).unwrap();
            let line = whole[..at].split(|b| *b == b'\n').count() - 1;
            let journal = resume(&scratch, plan()).unwrap();
            // Only the last two stages still have their files.
            let kept = if line == 3 { 2 } else { 0 };
            assert_eq!(journal.stages.len(), kept, "byte {at}, line {line}");
        }
    }

    #[test]
    fn an_input_with_another_stamp_is_compared_by_its_content() {
        let scratch = Scratch::temporary().unwrap();
        drop(Journal::begin(&scratch, plan()).unwrap());
        let mut other = plan();
        other.inputs[0].stamp = "inode 8".into();
        // Nothing is kept.
        let mut journal = resume(&scratch, other.clone()).unwrap();
        let source = SourceFile { name: "a.ply".into(), bytes: 10, sha256: "aa".into() };
        journal.complete(READ, &[], serde_json::json!({ "sources": [&source] })).unwrap();
        drop(journal);
        let resumed = |plan: Plan, is_same: bool| {
            Journal::resume(&scratch, plan, &|number, sources| {
                assert_eq!((number, sources), (0, &[source.clone()][..]));
                Ok(is_same)
            })
        };
        let refused = resumed(plan(), false).unwrap_err().to_string();
        assert!(refused.contains("/a.ply was changed since"), "{refused}");
        assert!(resume(&scratch, other).is_ok(), "nothing was changed by the refusal");
        assert_eq!(resumed(plan(), true).unwrap().last().unwrap().stage, READ);
        // Its new stamp is recorded now.
        assert!(resume(&scratch, plan()).is_ok());
        let mut later = plan();
        later.inputs[0].modified = Some(6);
        assert!(resumed(later, true).is_err(), "another time is another file");
    }

    #[test]
    fn another_build_is_refused_with_the_difference() {
        let scratch = Scratch::temporary().unwrap();
        drop(with_stages(&scratch, 1));
        let refused = |change: &dyn Fn(&mut Plan), says: &str| {
            let mut other = plan();
            change(&mut other);
            let error = resume(&scratch, other).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(error.contains(says), "{error:?} should say {says:?}");
        };
        refused(&|p| p.tool = "kilwa 2".into(), "kilwa 1");
        refused(&|p| drop(p.options.insert("step".into(), Value::from(0.5))), "step 0.25");
        refused(&|p| drop(p.options.remove("title")), "title \"a\"");
        refused(&|p| p.inputs[0].modified = Some(6), "/a.ply was changed");
        refused(&|p| p.inputs[0].path = "/b.ply".into(), "/a.ply");
        refused(&|p| p.inputs[0].placement = "y up".into(), "placed otherwise");
        refused(&|p| p.inputs.clear(), "1 input,");
        assert!(resume(&scratch, plan()).unwrap().last().is_some(), "refusing changes nothing");
    }
}

//! What was checked and what is wrong: for people as lines, for programs as JSON.

use kilwa_archive::sound::Checked;
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::fmt::Write as _;

/// Problems kept with their words; of more only the number is kept, so that memory is bounded.
const KEPT: usize = 10_000;

/// What kind of problem; machines sort by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Kind {
    /// Other bytes than were written.
    Damaged,
    /// Listed and not there.
    Missing,
    /// There and not listed.
    Extra,
    /// There and cannot be read.
    Unreadable,
    /// Something that an object must have, or two things that do not agree.
    Incomplete,
    /// A link that leads nowhere.
    Link,
    /// A version that was published is gone or another one.
    History,
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Problem {
    /// Where: a path below what was to be checked, or what was to be checked itself.
    pub(crate) file: String,
    /// What kind.
    pub(crate) kind: Kind,
    /// What is wrong, and what to do.
    pub(crate) what: String,
}

/// What was checked: counts, and everything that is wrong.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Report {
    /// What was to be checked.
    pub(crate) target: String,
    /// Objects, bags and single packs looked at.
    pub(crate) objects: u64,
    /// Of them without a problem.
    pub(crate) sound_objects: u64,
    /// Left out because they were checked before (`--resume`, `--older-than`).
    pub(crate) skipped: u64,
    /// Files read to their end.
    pub(crate) files: u64,
    /// Bytes read.
    pub(crate) bytes: u64,
    /// Packs among the files; every chunk of them was decoded.
    pub(crate) packs: u64,
    /// Chunks in them.
    pub(crate) chunks: u64,
    /// Figures of a single pack.
    #[serde(skip)]
    pub(crate) pack: Option<PackFigures>,
    /// While a folder is checked that a withdrawal was filling or removing: the number of missing files, which are not problems there.
    #[serde(skip)]
    pub(crate) lacking: Option<u64>,
    /// What is worth knowing and no problem.
    pub(crate) notes: Vec<String>,
    /// What is wrong.
    pub(crate) problems: Vec<Problem>,
    /// How many more problems there are.
    pub(crate) more_problems: u64,
}

/// Figures of one pack.
#[derive(Debug, Default)]
pub(crate) struct PackFigures {
    pub(crate) bytes: u64,
    pub(crate) chunks: u64,
    pub(crate) triangles: u64,
    pub(crate) stored_triangles: u64,
    pub(crate) border_edges: u64,
    pub(crate) sha256: Option<String>,
}

impl PackFigures {
    /// Of a pack that was checked.
    pub(crate) fn of(checked: &Checked) -> Self {
        let totals = checked.totals.unwrap_or_default();
        Self {
            bytes: checked.bytes,
            chunks: totals.chunks,
            triangles: totals.finest_triangles,
            stored_triangles: totals.stored_triangles,
            border_edges: totals.finest_borders,
            sha256: checked.sha256.clone(),
        }
    }
}

impl PackFigures {
    /// For people.
    pub(crate) fn summary(&self) -> String {
        format!(
            "sound. {}, {}, {} ({} stored) checked.",
            counted(self.bytes, "byte", "bytes"),
            counted(self.chunks, "chunk", "chunks"),
            counted(self.triangles, "triangle", "triangles"),
            self.stored_triangles
        )
    }
}

impl Report {
    /// One more problem.
    pub(crate) fn add(&mut self, file: impl Into<String>, kind: Kind, what: impl Into<String>) {
        if self.problems.len() < KEPT {
            self.problems.push(Problem { file: file.into(), kind, what: what.into() });
        } else {
            self.more_problems += 1;
        }
    }

    /// All problems so far.
    pub(crate) fn count(&self) -> u64 {
        self.problems.len() as u64 + self.more_problems
    }

    /// For machines.
    pub(crate) fn to_json(&self) -> serde_json::Value {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        if let Some(map) = value.as_object_mut() {
            map.insert("sound".to_owned(), (self.count() == 0).into());
        }
        value
    }

    /// For people: the problems from `first` on, one a line.
    pub(crate) fn problems_from(&self, first: u64) -> String {
        let mut text = String::new();
        for p in self.problems.iter().skip(usize::try_from(first).unwrap_or(usize::MAX)) {
            let _ = writeln!(text, "  {}: {}", p.file, p.what);
        }
        text
    }

    /// For people: the last line.
    pub(crate) fn summary(&self) -> String {
        let skipped =
            if self.skipped == 0 { String::new() } else { format!(", {} skipped (checked before)", self.skipped) };
        format!(
            "{} of {} sound{skipped}; {}, {}, {} checked.",
            self.sound_objects,
            counted(self.objects, "object", "objects"),
            counted(self.files, "file", "files"),
            counted(self.bytes, "byte", "bytes"),
            counted(self.chunks, "chunk", "chunks")
        )
    }
}

//! The manifest of a finished task.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// A finished task: `done/TASK.json`. It is created after its files are complete, so it is never there without them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The task.
    pub task: String,
    /// The program that did it.
    pub tool: String,
    /// The file that this task was made from: one from the ingest, or from the task that grows the tree; none for the
    /// ingest itself.
    pub of: Option<String>,
    /// The files that it left, by what they hold.
    pub files: BTreeMap<String, SharedFile>,
    /// What the next tasks must know.
    pub state: Value,
    /// Seconds by the clock.
    pub seconds: f64,
    /// Seconds of processor time, all threads, if the system reports it.
    pub cpu_seconds: Option<f64>,
    /// Bytes read from the store.
    pub bytes_read: u64,
    /// Bytes written to the store.
    pub bytes_written: u64,
}

/// A file in the store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SharedFile {
    /// Its name there.
    pub name: String,
    /// Its length in bytes.
    pub bytes: u64,
}

/// What a task has made in its scratch folder.
#[derive(Debug, Default)]
pub(super) struct TaskOutput {
    /// What each file content, and its name in the scratch folder.
    pub(super) files: Vec<(String, String)>,
    /// See [`Manifest::of`].
    pub(super) of: Option<String>,
    /// What the next tasks must know.
    pub(super) state: Value,
}

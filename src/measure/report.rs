//! What a measurement prints: readings with their uncertainty, for people or as JSON with every digit.

use super::Subject;
use super::sweep::Read;
use kilwa_measure::{Reading, Task};
use serde_json::{Map, Value, json};
use std::io::Write;

/// A measurement.
pub(super) struct Report {
    task: Task,
    readings: Vec<Reading>,
    details: Map<String, Value>,
    /// Sentences below the readings.
    remarks: Vec<String>,
}

impl Report {
    pub(super) fn new(task: Task, readings: Vec<Reading>) -> Self {
        Self { task, readings, details: Map::new(), remarks: Vec::new() }
    }

    /// What was measured.
    pub(super) fn task(&self) -> &Task {
        &self.task
    }

    /// The same, to say more of it.
    pub(super) fn task_mut(&mut self) -> &mut Task {
        &mut self.task
    }

    /// What came out.
    pub(super) fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// A further reading.
    pub(super) fn reading(&mut self, reading: Reading) {
        self.readings.push(reading);
    }

    /// A field of the JSON.
    pub(super) fn add(&mut self, name: &str, value: Value) {
        self.details.insert(name.to_owned(), value);
    }

    /// A sentence for people.
    pub(super) fn remark(&mut self, words: String) {
        self.remarks.push(words);
    }

    /// What was read of the pack.
    pub(super) fn read(&mut self, read: &Read) {
        self.add("read", json!(read));
        let share = 100.0 * read.bytes as f64 / read.of_bytes.max(1) as f64;
        self.remark(format!(
            "read {} of {} chunks, {} bytes ({share:.1} % of the pack)",
            read.chunks,
            read.of_chunks,
            crate::info::grouped(read.bytes)
        ));
    }

    /// Print it.
    pub(super) fn print(mut self, s: &Subject, as_json: bool) -> anyhow::Result<()> {
        let mut out = std::io::stdout().lock();
        if as_json {
            self.add("tool", json!(self.task.tool));
            self.add("readings", json!(self.readings));
            self.add("uncertainty", json!(s.point));
            self.add("pack", json!({ "title": s.pack.metadata().title, "identity": s.pack.identity() }));
            serde_json::to_writer_pretty(&mut out, &Value::Object(self.details))?;
            writeln!(out)?;
            return Ok(());
        }
        let width = self.readings.iter().map(|r| r.name.chars().count()).max().unwrap_or(0);
        for r in &self.readings {
            writeln!(out, "{:width$} {}", r.name, r.text(s.unit))?;
        }
        for words in &self.remarks {
            writeln!(out, "{words}")?;
        }
        let lattice = s.point.lattice;
        match s.point.capture {
            Some(c) => {
                writeln!(out, "standard uncertainty of a coordinate: lattice {lattice:.3e} m and capture {c} m")?;
            }
            None => writeln!(
                out,
                "standard uncertainty of a coordinate: lattice {lattice:.3e} m only; the accuracy of the capture is unknown"
            )?,
        }
        Ok(())
    }
}

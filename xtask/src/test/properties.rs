//! Properties that test suites measure, as one table: lines `SUITE | property | bound | measured` among the output of tests.

use super::tally::Tally;
use anyhow::{Result, bail};
use std::fmt::Write as _;

/// The properties that a suite has printed so far.
pub(crate) struct Properties {
    suite: &'static str,
    rows: Vec<[String; 3]>,
    tally: Tally,
}

impl Properties {
    /// `suite` is the word that its lines begin with.
    pub(crate) fn of(suite: &'static str) -> Self {
        Self { suite, rows: Vec::new(), tally: Tally::default() }
    }

    /// Take in a line of the tests; whether it is anything but a property.
    pub(crate) fn read(&mut self, line: &str) -> bool {
        self.tally.read(line);
        let row = self.row(line);
        let is_property = row.is_some();
        self.rows.extend(row);
        !is_property
    }

    /// A test prints after the `test name ... ` of its harness, so the property may begin anywhere in the line.
    fn row(&self, line: &str) -> Option<[String; 3]> {
        let at = line.find(&format!("{} | ", self.suite))?;
        let mut parts = line[at..].split(" | ").map(|part| part.trim().to_owned()).skip(1);
        let (Some(what), Some(bound), Some(measured), None) = (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return None;
        };
        Some([what, bound, measured])
    }

    /// In the order of their names, not of the tests.
    pub(crate) fn sort(&mut self) {
        self.rows.sort();
    }

    /// The table in Markdown.
    pub(crate) fn table(&self) -> String {
        let width = |k: usize| self.rows.iter().map(|c| c[k].chars().count()).max().unwrap_or(0).max(5);
        let (first, second) = (width(0), width(1));
        let mut text = format!("| {:first$} | {:second$} | measured |\n", "property", "bound");
        let _ = writeln!(text, "|{}|{}|----------|", "-".repeat(first + 2), "-".repeat(second + 2));
        for [what, bound, measured] in &self.rows {
            let _ = writeln!(text, "| {what:first$} | {bound:second$} | {measured:8} |");
        }
        text
    }

    /// Print table and counts. Fails when a test did (`is_success` is false), or when no property was measured.
    pub(crate) fn finish(&self, is_success: bool) -> Result<()> {
        let Tally { passed, failed, .. } = self.tally;
        let skipped = self.tally.skipped();
        println!(
            "\n{}\n{} properties; {passed} passed, {failed} failed, {skipped} skipped",
            self.table(),
            self.rows.len()
        );
        if !is_success || self.rows.is_empty() {
            bail!("a property of the {} suite does not hold, or none was measured; see above", self.suite);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Properties;

    #[test]
    fn only_lines_of_the_suite_are_read_as_measured_properties() {
        let mut properties = Properties::of("trust");
        assert!(!properties.read("test x ... trust | right angle, rad | 9.776e-4 | 0.000e0"));
        assert!(properties.read("trust | two | parts") && properties.read("test trust::x ... ok"));
        assert!(properties.read("soak | of another suite | 0 | 0"));
        assert_eq!(properties.rows, [["right angle, rad", "9.776e-4", "0.000e0"]]);
        assert!(properties.finish(true).is_ok() && properties.finish(false).is_err());
        assert!(Properties::of("trust").finish(true).is_err(), "no property was measured");
    }
}

//! Reads the results that test runners print: cargo test, cargo nextest, node --test (TAP and spec), pytest, and the plain line
//! `N passed, N failed, N skipped`; and collects by name the tests that report themselves as skipped.
//!
//! Input: the output of a run, line by line. Invariant: only a runner's own closing line counts, which begins at the margin (that of nextest
//! excepted, which indents its own and, deeper, what the tests printed, another runner's closing line included), so that nothing is
//! counted twice.

use super::failures::Failures;
use std::collections::BTreeSet;

/// What a test prints, in any case, before the reason when it cannot run here, for example because `../shared/data` does not exist.
const SKIPPED: &str = "skipped: ";

/// Sums over the suites of a run.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(crate) struct Tally {
    /// Tests that ran and held.
    pub(crate) passed: u64,
    /// Tests that ran and did not hold.
    pub(crate) failed: u64,
    /// Tests that a runner left out (ignored, filtered by the author).
    pub(crate) left_out: u64,
    /// What tests report as skipped, sorted, each once; with the test's name if the runner prints it.
    pub(crate) skips: BTreeSet<String>,
    /// What was printed of failed tests.
    pub(crate) failures: Failures,
    /// The test whose output follows (nextest's heading).
    current: String,
}

impl Tally {
    /// Everything skipped, by the runners or by the tests.
    pub(crate) fn skipped(&self) -> u64 {
        self.left_out + self.skips.len() as u64
    }

    /// Nothing but these counts.
    pub(crate) fn of(passed: u64, failed: u64) -> Self {
        Self { passed, failed, ..Self::default() }
    }

    /// Adds another suite's counts.
    pub(crate) fn add_all(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.left_out += other.left_out;
        self.skips.extend(other.skips);
        self.failures.extend(other.failures);
    }

    /// Takes one line of a runner's output into account.
    pub(crate) fn read(&mut self, line: &str) {
        let line = line.trim_end();
        self.failures.read(line);
        if let Some(test) = nextest_heading(line) {
            test.clone_into(&mut self.current);
        }
        // ASCII only, so that places in the lower-case text are places in the line.
        if let Some(at) = line.to_ascii_lowercase().find(SKIPPED) {
            let why = line[at + SKIPPED.len()..].trim();
            let colon = if self.current.is_empty() { "" } else { ": " };
            self.skips.insert(format!("{}{colon}{why}", self.current));
        }
        if let Some(rest) = line.strip_prefix("test result: ") {
            // cargo test: `ok. 5 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.01s`
            self.add_counts(rest.split_once(". ").map_or(rest, |(_, counts)| counts).split(';'));
        } else if let Some(rest) = line.trim_start().strip_prefix("Summary [") {
            // cargo nextest: `[   0.2s] 5 tests run: 4 passed (1 slow), 1 failed, 2 skipped`
            if let Some((_, counts)) = rest.split_once("run: ") {
                self.add_counts(counts.split(','));
            }
        } else if let Some((word, count)) = node_count(line) {
            self.add(word, count);
        } else if let Some(counts) = pytest_counts(line) {
            self.add_counts(counts.split(','));
        } else if !line.starts_with(' ') && is_plain(line) {
            self.add_counts(line.split(','));
        }
    }

    fn add_counts<'a>(&mut self, counts: impl Iterator<Item = &'a str>) {
        for count in counts {
            let count = count.split(" (").next().unwrap_or(count).trim();
            if let Some((number, word)) = count.split_once(' ')
                && let Ok(number) = number.parse()
            {
                self.add(word, number);
            }
        }
    }

    fn add(&mut self, word: &str, count: u64) {
        match word {
            "passed" | "pass" => self.passed += count,
            "failed" | "fail" | "exec failed" | "timed out" | "cancelled" | "error" | "errors" => self.failed += count,
            "ignored" | "skipped" | "todo" => self.left_out += count,
            _ => {}
        }
    }
}

/// The test's name in `        PASS [   0.021s] ( 1/14) kilwa::cli every_verb_explains_itself`.
fn nextest_heading(line: &str) -> Option<&str> {
    let rest = line.trim_start();
    let rest = rest.strip_prefix("PASS [").or_else(|| rest.strip_prefix("FAIL ["))?;
    Some(rest.split_once("] (")?.1.split_once(") ")?.1)
}

/// `# pass 5` (TAP) or `ℹ pass 5` (spec), the closing lines of node --test.
fn node_count(line: &str) -> Option<(&str, u64)> {
    let (word, count) = line.strip_prefix("# ").or_else(|| line.strip_prefix("\u{2139} "))?.split_once(' ')?;
    let is_known = matches!(word, "pass" | "fail" | "cancelled" | "skipped" | "todo");
    Some((word, count.parse().ok()?)).filter(|_| is_known)
}

/// `1 failed, 3 passed, 2 warnings, 1 error` in pytest's summary line: `=== 1 failed, 3 passed in 61.20s (0:01:01) ===`, which has no frame
/// with `--quiet`.
fn pytest_counts(line: &str) -> Option<&str> {
    let is_word = |word: &str| {
        let pytest =
            ["failed", "passed", "skipped", "deselected", "xfailed", "xpassed", "warning", "warnings", "error"];
        pytest.contains(&word) || word == "errors"
    };
    let (counts, took) = line.trim_matches('=').trim_end().split_once(" in ")?;
    let counts = if line.starts_with('=') { counts.trim_start() } else { counts };
    let seconds = took.split(" (").next()?.strip_suffix('s')?;
    let is_counted = counts.split(", ").all(|count| {
        count.split_once(' ').is_some_and(|(number, word)| number.parse::<u64>().is_ok() && is_word(word))
    });
    (is_counted && seconds.parse::<f64>().is_ok()).then_some(counts)
}

/// `3 passed, 0 failed` or `3 passed, 0 failed, 1 skipped`, and nothing else on the line.
fn is_plain(line: &str) -> bool {
    let words: Vec<&str> = line.split([' ', ',']).filter(|word| !word.is_empty()).collect();
    let number = |at: usize| words.get(at).is_some_and(|word| word.parse::<u64>().is_ok());
    let word = |at: usize, expected: &str| words.get(at) == Some(&expected);
    let pairs = number(0) && word(1, "passed") && number(2) && word(3, "failed");
    pairs && (words.len() == 4 || (words.len() == 6 && number(4) && word(5, "skipped")))
}

/// True for what nextest shows of a test without output: its headings and blank lines.
pub(crate) fn is_noise(line: &str) -> bool {
    let text = line.trim();
    let is_heading = text.starts_with("stdout \u{2500}") || text == "running 1 test" || text.is_empty();
    let is_verdict =
        text.starts_with("test result: ok. 1 passed") || (text.starts_with("test ") && text.ends_with(" ... ok"));
    is_heading || (line.starts_with("    ") && is_verdict)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(lines: &[&str]) -> (u64, u64, u64) {
        let mut tally = Tally::default();
        for line in lines {
            tally.read(line);
        }
        (tally.passed, tally.failed, tally.skipped())
    }

    #[test]
    fn cargo_test_sums_over_binaries() {
        let counts = read(&[
            "test lattice::snaps ... ok",
            "test result: ok. 5 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.01s",
            "test result: FAILED. 2 passed; 3 failed; 0 ignored; 0 measured; 7 filtered out; finished in 1.00s",
        ]);
        assert_eq!(counts, (7, 3, 1));
    }

    #[test]
    fn nextest_counts_slow_once_and_timeouts_as_failures() {
        assert_eq!(read(&["     Summary [   0.200s] 5 tests run: 5 passed (1 slow), 0 skipped"]), (5, 0, 0));
        let counts = read(&[
            "Summary [ 9.1s] 8/9 tests run: 5 passed (1 flaky), 1 failed, 1 timed out, 1 exec failed, 2 skipped",
        ]);
        assert_eq!(counts, (5, 3, 2));
    }

    #[test]
    fn output_printed_by_a_test_under_nextest_is_not_counted_again() {
        let counts = read(&[
            "        PASS [   0.021s] ( 1/14) kilwa-pack tests::reads",
            "  stdout \u{2500}\u{2500}\u{2500}",
            "    running 1 test",
            "    test result: ok. 1 passed; 0 failed; 0 ignored; 0 measured; 13 filtered out; finished in 0.01s",
            "    7 passed, 1 failed",
            "     Summary [   0.099s] 1 test run: 1 passed, 0 skipped",
        ]);
        assert_eq!(counts, (1, 0, 0));
    }

    #[test]
    fn both_output_forms_of_node_are_parsed() {
        assert_eq!(
            read(&["# tests 4", "# pass 2", "# fail 1", "# cancelled 1", "# skipped 0", "# duration_ms 12.5"]),
            (2, 2, 0)
        );
        assert_eq!(read(&["\u{2139} pass 3", "\u{2139} fail 0", "\u{2139} skipped 1"]), (3, 0, 1));
    }

    #[test]
    fn pytest_summaries_are_read_with_or_without_a_frame() {
        assert_eq!(read(&["31 passed, 1 skipped in 110.58s (0:01:50)"]), (31, 0, 1));
        assert_eq!(read(&["===== 1 failed, 3 passed, 2 warnings, 1 error in 1.20s ====="]), (3, 2, 0));
        assert_eq!(read(&["2 errors in 0.30s", "no tests ran in 0.01s"]), (0, 2, 0));
        assert_eq!(
            read(&["  3 passed in 1.20s", "3 passed in time", "3 passed in 2 of 4 runs", "4 meshes in 1.20s"]),
            (0, 0, 0)
        );
    }

    #[test]
    fn result_lines_count_and_other_sentences_with_numbers_do_not() {
        assert_eq!(read(&["12 passed, 1 failed, 2 skipped", "3 passed, 0 failed"]), (15, 1, 2));
        assert_eq!(
            read(&["3 passed the gate, 0 failed", "# pass the salt", "Summary of 3 passed, 1 failed"]),
            (0, 0, 0)
        );
    }

    #[test]
    fn a_skipped_test_is_recorded_once_by_name() {
        let mut tally = Tally::default();
        tally.read("test reads_horse ... SKIPPED: reads_horse: ../shared/data is not there");
        tally.read("    SKIPPED: reads_horse: ../shared/data is not there");
        tally.read("SKIPPED: lucy");
        tally.read("        PASS [   0.021s] ( 1/14) kilwa::real input_builds");
        tally.read("    skipped: no data");
        let skips: Vec<_> = tally.skips.iter().map(String::as_str).collect();
        assert_eq!(skips, ["kilwa::real input_builds: no data", "lucy", "reads_horse: ../shared/data is not there"]);
        assert_eq!(tally.skipped(), 3);
    }
}

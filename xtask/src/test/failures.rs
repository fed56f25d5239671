//! Collects what runners print of failed tests, so that a run can repeat it at its end: whoever has only the last lines of a log finds the cause there.
//!
//! Input: the output of a run, line by line. Reads cargo nextest (headings `FAIL [`), node --test (TAP) and pytest (`FAILED` in its short summary).

/// Longest excerpt of a failed test, in lines, and longest line, in characters.
const LINES: usize = 30;
const CHARACTERS: usize = 400;
/// Failures that are kept: after these, the log itself is the better source.
const FAILURES: usize = 10;

/// One failed test: its name, and the first lines of what was printed of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Failure {
    pub(crate) name: String,
    pub(crate) lines: Vec<String>,
}

/// Failed tests, in the order in which they were reported, each once.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(crate) struct Failures {
    all: Vec<Failure>,
    /// The runner whose output of the last failure follows.
    open: Option<Runner>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Runner {
    Nextest,
    Node,
}

impl Failures {
    /// A stage that failed as a whole, and why.
    pub(crate) fn of(why: String) -> Self {
        Self { all: vec![Failure { name: why, lines: Vec::new() }], open: None }
    }

    pub(crate) fn all(&self) -> &[Failure] {
        &self.all
    }

    pub(crate) fn extend(&mut self, other: Self) {
        self.all.extend(other.all);
        self.all.truncate(FAILURES);
    }

    /// Takes one line of a runner's output into account.
    pub(crate) fn read(&mut self, line: &str) {
        let line = line.trim_end();
        if let Some(name) = nextest_failure(line) {
            self.open(name, Runner::Nextest);
        } else if let Some(name) = node_failure(line) {
            self.open(name, Runner::Node);
        } else if let Some(rest) = line.strip_prefix("FAILED ").filter(|rest| rest.contains("::")) {
            // pytest: `FAILED tests/test_a.py::test_b - AssertionError: …`
            let (name, why) = rest.split_once(" - ").unwrap_or((rest, ""));
            self.open(name, Runner::Node);
            self.add(why);
            self.open = None;
        } else {
            match self.open {
                Some(Runner::Nextest) if is_end_of_nextest(line) => self.open = None,
                Some(Runner::Node) if line.trim() == "..." => self.open = None,
                Some(_) => self.add(line),
                None => {}
            }
        }
    }

    fn open(&mut self, name: &str, runner: Runner) {
        // Nextest names its failures once more in the end.
        let is_new = self.all.iter().all(|failure| failure.name != name) && self.all.len() < FAILURES;
        self.open = is_new.then_some(runner);
        if is_new {
            self.all.push(Failure { name: name.to_owned(), lines: Vec::new() });
        }
    }

    fn add(&mut self, line: &str) {
        if let Some(failure) = self.all.last_mut()
            && failure.lines.len() < LINES
            && !is_of_backtrace(line)
        {
            failure.lines.push(line.chars().take(CHARACTERS).collect());
        }
    }
}

/// The test's name in `        FAIL [   0.021s] ( 1/14) kilwa::cli every_verb_explains_itself`.
fn nextest_failure(line: &str) -> Option<&str> {
    let rest = line.trim_start().strip_prefix("FAIL [")?;
    Some(rest.split_once("] (")?.1.split_once(") ")?.1)
}

/// The heading of another test, or the rule before the summary.
fn is_end_of_nextest(line: &str) -> bool {
    let text = line.trim_start();
    ["PASS [", "SLOW [", "TERMINATING [", "Summary [", "\u{2500}\u{2500}\u{2500}\u{2500}"]
        .iter()
        .any(|start| text.starts_with(start))
}

/// The test's name in `not ok 12 - draws a section # time=3`.
fn node_failure(line: &str) -> Option<&str> {
    let (number, name) = line.trim_start().strip_prefix("not ok ")?.split_once(" - ")?;
    (number.parse::<u64>().is_ok() && !name.contains("# TODO")).then_some(name)
}

/// Blank lines, and the frames of a backtrace, which say little of a failed property and fill the excerpt.
fn is_of_backtrace(line: &str) -> bool {
    let text = line.trim_start();
    let is_frame = text.split_once(": ").is_some_and(|(number, _)| number.parse::<u32>().is_ok());
    text.is_empty() || is_frame || text.starts_with("at ") || text == "stack backtrace:"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(lines: &[&str]) -> Vec<(String, String)> {
        let mut failures = Failures::default();
        for line in lines {
            failures.read(line);
        }
        failures.all().iter().map(|failure| (failure.name.clone(), failure.lines.join("|"))).collect()
    }

    fn one(name: &str, lines: &str) -> (String, String) {
        (name.to_owned(), lines.to_owned())
    }

    #[test]
    fn a_failed_rust_test_is_repeated_without_its_backtrace_and_once() {
        let log = [
            "        PASS [   0.019s] (1/3) kilwa-server metadata::a_link_stays",
            "        FAIL [   0.323s] (2/3) kilwa::whole trust::digits::one",
            "  stderr ───",
            "",
            "    thread 'trust::digits::one' panicked at tests/trust/digits.rs:85:5:",
            "    3 is more than 2",
            "    stack backtrace:",
            "       0: __rustc::rust_begin_unwind",
            "                 at /rustc/59/library/std/src/panicking.rs:689:5",
            "        PASS [   0.019s] (3/3) kilwa-server metadata::another",
            "  stderr ───",
            "    of another test",
            "────────────",
            "     Summary [   0.747s] 3 tests run: 2 passed, 1 failed, 0 skipped",
            "        FAIL [   0.323s] (2/3) kilwa::whole trust::digits::one",
            "error: test run failed",
        ];
        let why =
            "  stderr ───|    thread 'trust::digits::one' panicked at tests/trust/digits.rs:85:5:|    3 is more than 2";
        assert_eq!(read(&log), [one("kilwa::whole trust::digits::one", why)]);
    }

    #[test]
    fn a_failed_test_of_node_is_repeated_with_its_error() {
        let log = [
            "ok 1 - opens",
            "  ---",
            "  duration_ms: 3",
            "  ...",
            "# Subtest: draws",
            "not ok 2 - draws",
            "  ---",
            "  error: '63 pixels of lines'",
            "  ...",
            "ok 3 - closes",
        ];
        assert_eq!(read(&log), [one("draws", "  ---|  error: '63 pixels of lines'")]);
    }

    #[test]
    fn a_failed_test_of_pytest_is_repeated_with_its_message() {
        let log = ["FAILED tests/test_a.py::test_b - AssertionError: no", "1 failed in 0.2s", "FAILED: the demo"];
        assert_eq!(read(&log), [one("tests/test_a.py::test_b", "AssertionError: no")]);
    }

    #[test]
    fn excerpts_are_bounded() {
        let mut log = Vec::new();
        for k in 0..20 {
            log.push(format!("not ok {k} - test {k}"));
            log.extend((0..100).map(|_| "x".repeat(1000)));
        }
        let found = read(&log.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(found.len(), FAILURES);
        assert!(found.iter().all(|(_, lines)| lines.len() <= LINES * (CHARACTERS + 1)));
    }
}

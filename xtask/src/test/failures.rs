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
    /// Within a backtrace, whose frames say little of a failed property.
    is_backtrace: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Runner {
    Nextest,
    Node,
}

impl Failures {
    /// A stage that failed as a whole, and why.
    pub(crate) fn of(why: String) -> Self {
        Self { all: vec![Failure { name: why, lines: Vec::new() }], ..Self::default() }
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
                Some(Runner::Node) if line == "  ..." => self.open = None,
                Some(_) => self.add(line),
                None => {}
            }
        }
    }

    fn open(&mut self, name: &str, runner: Runner) {
        // Nextest names its failures once more in the end.
        let is_new = self.all.iter().all(|failure| failure.name != name) && self.all.len() < FAILURES;
        self.open = is_new.then_some(runner);
        self.is_backtrace = false;
        if is_new {
            self.all.push(Failure { name: name.to_owned(), lines: Vec::new() });
        }
    }

    fn add(&mut self, line: &str) {
        let text = line.trim_start();
        self.is_backtrace = text == "stack backtrace:" || (self.is_backtrace && !text.starts_with("note: "));
        let Some(failure) = self.all.last_mut().filter(|_| self.open.is_some() && !self.is_backtrace) else { return };
        // What the test printed before comes first, and may be long.
        if text.starts_with("thread '") && text.contains("panicked at") {
            failure.lines.clear();
        }
        if failure.lines.len() < LINES && !text.is_empty() {
            failure.lines.push(line.chars().take(CHARACTERS).collect());
        }
    }
}

/// How a test ended and its name in `        FAIL [   0.021s] ( 1/14) kilwa::cli every_verb_explains_itself`; others are `TIMEOUT`, `SIGABRT` and so on.
fn nextest_heading(line: &str) -> Option<(&str, &str)> {
    let (status, rest) = line.trim_start().split_once(" [")?;
    let is_status = !status.is_empty() && status.chars().all(|c| c.is_ascii_uppercase() || " +".contains(c));
    let name = rest.split_once("] (")?.1.split_once(") ")?.1;
    is_status.then_some((status, name))
}

fn nextest_failure(line: &str) -> Option<&str> {
    let (status, name) = nextest_heading(line)?;
    (!["PASS", "SLOW", "LEAK", "TERMINATING"].contains(&status)).then_some(name)
}

/// The heading of another test, or the rule before the summary.
fn is_end_of_nextest(line: &str) -> bool {
    nextest_heading(line).is_some() || line.trim_start().starts_with("\u{2500}\u{2500}\u{2500}\u{2500}")
}

/// The test's name in `not ok 12 - draws a section # time=3`.
fn node_failure(line: &str) -> Option<&str> {
    let (number, name) = line.trim_start().strip_prefix("not ok ")?.split_once(" - ")?;
    (number.parse::<u64>().is_ok() && !name.contains("# TODO")).then_some(name)
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
            "    printed before",
            "  stderr ───",
            "",
            "    thread 'trust::digits::one' panicked at tests/trust/digits.rs:85:5:",
            "    at 3: more than 2",
            "    stack backtrace:",
            "       0: __rustc::rust_begin_unwind",
            "                 at /rustc/59/library/std/src/panicking.rs:689:5",
            "        PASS [   0.019s] (3/3) kilwa-server metadata::another",
            "  stderr ───",
            "    of another test",
            "     TIMEOUT [ 600.000s] (3/3) kilwa-server metadata::waits",
            "────────────",
            "     Summary [   0.747s] 3 tests run: 2 passed, 1 failed, 0 skipped",
            "        FAIL [   0.323s] (2/3) kilwa::whole trust::digits::one",
            "error: test run failed",
        ];
        let why = "    thread 'trust::digits::one' panicked at tests/trust/digits.rs:85:5:|    at 3: more than 2";
        assert_eq!(read(&log), [one("kilwa::whole trust::digits::one", why), one("kilwa-server metadata::waits", "")]);
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

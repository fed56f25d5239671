//! `cargo xtask test soak`: the server under load, its claims as one table, archived.
//!
//! The tests of tests/http with their full numbers (`KILWA_SOAK`), one at a time: each prints a line `soak | claim | bound | measured`, and fails
//! where that does not hold. The table goes to docs/bench with the day, the commit and the machine. Fails when a test does, or when none ran.
//! Takes a few minutes; a machine that does other things at the same time spoils the times.

use crate::bench::archive;
use crate::process::{cargo, root, watch};
use crate::tally::Tally;
use anyhow::{Result, bail};
use std::fmt::Write as _;

/// One row of the table.
type Row = [String; 3];

pub(crate) fn run() -> Result<()> {
    let mut claims: Vec<Row> = Vec::new();
    let mut remarks = Vec::new();
    let mut tally = Tally::default();
    let mut test = cargo(&["test", "--locked", "--package", "kilwa", "--test", "http", "--no-fail-fast"])?;
    test.args(["--", "--nocapture", "--test-threads", "1"]).env("KILWA_SOAK", "1");
    let is_success = watch(&mut test, |line| {
        tally.read(line);
        let claim = line.find("soak | ").and_then(|at| row(&line[at..]));
        let is_claim = claim.is_some();
        if !is_claim && (line.contains(" ms") || line.contains("transfers were")) {
            remarks.push(line.trim().to_owned());
        }
        claims.extend(claim);
        !is_claim
    })?;
    let table = table(&claims);
    println!(
        "\n{table}\n{} claims; {} passed, {} failed, {} skipped",
        claims.len(),
        tally.passed,
        tally.failed,
        tally.skipped()
    );
    if !is_success || claims.is_empty() {
        bail!("a claim about the server does not hold, or none was tested; see above");
    }
    let remarks = remarks.iter().fold(String::new(), |all, line| all + "* " + line + "\n");
    archive(&root()?, "soak", &format!("{table}\n{remarks}"), "dev")
}

fn table(claims: &[Row]) -> String {
    let width = |k: usize, least: usize| claims.iter().map(|c| c[k].chars().count()).max().unwrap_or(0).max(least);
    let (first, second) = (width(0, 5), width(1, 5));
    let mut text = format!("| {:first$} | {:second$} | measured |\n", "claim", "bound");
    let _ = writeln!(text, "|{}|{}|----------|", "-".repeat(first + 2), "-".repeat(second + 2));
    for [what, bound, measured] in claims {
        let _ = writeln!(text, "| {what:first$} | {bound:second$} | {measured:8} |");
    }
    text
}

/// Claim, bound and measured value of a line of the suite.
fn row(line: &str) -> Option<Row> {
    let mut parts = line.split(" | ").map(|part| part.trim().to_owned());
    let (Some("soak"), Some(what), Some(bound), Some(measured), None) =
        (parts.next().as_deref(), parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return None;
    };
    Some([what, bound, measured])
}

#[cfg(test)]
mod tests {
    use super::row;

    #[test]
    fn a_claim_is_read_from_its_line_and_nothing_else_is_one() {
        let line = "soak | range table: answers that are not exact | 0 of 76 | 0";
        assert_eq!(row(line).unwrap(), ["range table: answers that are not exact", "0 of 76", "0"]);
        assert!(row("soak | two | parts").is_none() && row("test stop::x ... ok").is_none());
    }
}

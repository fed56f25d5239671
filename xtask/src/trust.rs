//! `cargo xtask test trust`: the trust suite of measuring, its claims as one table.
//!
//! The tests (tests/trust, and tests/browser/measure.test.mjs and sheet.test.mjs for the page in a browser) print a line `trust | claim | bound | measured` for each claim
//! and fail where it does not hold. Fails when a test does, or when none ran. Where the page is not built (`cargo xtask web`) its part is skipped, and says so.

use crate::process::{cargo, command, root, run as run_command, watch};
use crate::setup;
use crate::tally::Tally;
use anyhow::{Result, bail};

/// Python packages that second opinions come from.
pub(crate) const PACKAGES: &str = "tests/trust/requirements.txt";
/// Where the tests look for them.
pub(crate) const VARIABLE: &str = "KILWA_PYTHON";

pub(crate) fn run() -> Result<()> {
    let packages = setup::python_packages(PACKAGES)?;
    let mut claims = Vec::new();
    let mut tally = Tally::default();
    let mut test = cargo(&["test", "--locked", "--package", "kilwa", "--test", "trust", "--no-fail-fast"])?;
    test.args(["--", "--nocapture", "--test-threads", "1"]).env(VARIABLE, packages);
    let is_success = watch(&mut test, |line| {
        tally.read(line);
        let claim = line.find("trust | ").and_then(|at| row(&line[at..]));
        let is_claim = claim.is_some();
        claims.extend(claim);
        !is_claim
    })?;
    let is_success = is_success & in_browser(&mut tally, &mut claims)?;
    claims.sort();
    let width = |k: usize| claims.iter().map(|c: &[String; 3]| c[k].chars().count()).max().unwrap_or(0);
    let (first, second) = (width(0).max(5), width(1).max(5));
    println!("\n| {:first$} | {:second$} | measured |", "claim", "bound");
    println!("|{}|{}|----------|", "-".repeat(first + 2), "-".repeat(second + 2));
    for [what, bound, measured] in &claims {
        println!("| {what:first$} | {bound:second$} | {measured:8} |");
    }
    println!(
        "\n{} claims; {} passed, {} failed, {} skipped",
        claims.len(),
        tally.passed,
        tally.failed,
        tally.skipped()
    );
    if !is_success || claims.is_empty() {
        bail!("a claim of the trust suite does not hold, or none was tested; see above");
    }
    Ok(())
}

/// The claims about the page; true where all of them hold.
fn in_browser(tally: &mut Tally, claims: &mut Vec<[String; 3]>) -> Result<bool> {
    if !root()?.join("www/dist/measure_bg.wasm").is_file() {
        let line = "skipped: the page in a browser: www/dist is not there, run `cargo xtask web`";
        println!("{line}");
        tally.read(line);
        return Ok(true);
    }
    run_command(&mut cargo(&["build", "--locked", "--package", "kilwa"])?)?;
    let folder = setup::npm_packages("tests/browser")?;
    let mut node = command("node", &["--test", "--test-concurrency=1", "measure.test.mjs", "sheet.test.mjs"])?;
    node.current_dir(folder).env("CHROMIUM", setup::chromium()?);
    watch(&mut node, |line| {
        tally.read(line);
        let claim = line.find("trust | ").and_then(|at| row(&line[at..]));
        let is_claim = claim.is_some();
        claims.extend(claim);
        !is_claim
    })
}

/// Claim, bound and measured value of a line of the suite.
fn row(line: &str) -> Option<[String; 3]> {
    let mut parts = line.split(" | ").map(|part| part.trim().to_owned());
    let (Some("trust"), Some(what), Some(bound), Some(measured), None) =
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
        let line = "trust | right angle, rad | 9.776e-4 | 0.000e0";
        assert_eq!(row(line).unwrap(), ["right angle, rad", "9.776e-4", "0.000e0"]);
        assert!(row("trust | two | parts").is_none() && row("test trust::x ... ok").is_none());
    }
}

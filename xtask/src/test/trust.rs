//! `cargo xtask test trust`: the trust suite of measuring, its properties as one table.
//!
//! The tests (tests/trust, and tests/browser/measure.test.mjs and sheet.test.mjs for the page in a browser) print a line `trust | property | bound | measured` for each property
//! and fail where it does not hold. Fails when a test does, or when none ran. Where the page is not built (`cargo xtask web`) its part is skipped, and says so.

use super::SUITE_LIMIT;
use super::properties::Properties;
use crate::process::{Ended, cargo, command, root, run as run_command, watch};
use crate::setup;
use anyhow::Result;

/// Python packages that second opinions come from.
pub(crate) const PACKAGES: &str = "tests/trust/requirements.txt";
/// Where the tests look for them.
pub(crate) const VARIABLE: &str = "KILWA_PYTHON";

pub(crate) fn run() -> Result<()> {
    let packages = setup::python_packages(PACKAGES)?;
    let mut properties = Properties::of("trust");
    let mut test = cargo(&["test", "--locked", "--package", "kilwa", "--test", "whole", "--no-fail-fast", "trust::"])?;
    test.args(["--", "--nocapture", "--test-threads", "1"]).env(VARIABLE, packages);
    let is_success =
        (watch(&mut test, SUITE_LIMIT, |line| properties.read(line))? == Ended::Well) & in_browser(&mut properties)?;
    properties.sort();
    properties.finish(is_success)
}

/// The properties of the page; true where all of them hold.
fn in_browser(properties: &mut Properties) -> Result<bool> {
    if !root()?.join("www/dist/measure_bg.wasm").is_file() {
        let line = "skipped: the page in a browser: www/dist is not there, run `cargo xtask web`";
        println!("{line}");
        properties.read(line);
        return Ok(true);
    }
    run_command(&mut cargo(&["build", "--locked", "--package", "kilwa"])?)?;
    let folder = setup::npm_packages("tests/browser")?;
    let mut node = command("node", &["--test", "--test-concurrency=1", "measure.test.mjs", "sheet.test.mjs"])?;
    node.current_dir(folder).env("CHROMIUM", setup::headless_chromium()?);
    Ok(watch(&mut node, SUITE_LIMIT, |line| properties.read(line))? == Ended::Well)
}

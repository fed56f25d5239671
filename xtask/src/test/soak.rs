//! `cargo xtask test soak`: the server under load, its properties as one table, archived.
//!
//! The tests of tests/http with their full numbers (`KILWA_SOAK`), one at a time: each prints a line `soak | property | bound | measured`, and fails
//! where that does not hold. The table goes to docs/bench with the day, the commit and the machine. Fails when a test does, or when none ran.
//! Takes a few minutes; a machine that does other things at the same time spoils the times.

use super::properties::Properties;
use crate::bench::archive;
use crate::process::{Ended, cargo, root, watch};
use crate::test::{LONG_VARIABLE, SUITE_LIMIT};
use anyhow::Result;
use std::fmt::Write as _;

pub(crate) fn run() -> Result<()> {
    let mut properties = Properties::of("soak");
    let mut remarks = String::new();
    let mut test = cargo(&["test", "--locked", "--package", "kilwa", "--test", "whole", "--no-fail-fast", "http::"])?;
    test.args(["--", "--nocapture", "--test-threads", "1"]).env(LONG_VARIABLE, "1");
    let ended = watch(&mut test, SUITE_LIMIT, |line| {
        let is_other = properties.read(line);
        if is_other && (line.contains(" ms") || line.contains("transfers were")) {
            let _ = writeln!(remarks, "* {}", line.trim());
        }
        is_other
    })?;
    properties.finish(ended == Ended::Well)?;
    archive(&root()?, "soak", &format!("{}\n{remarks}", properties.table()), "dev")
}

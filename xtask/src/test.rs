//! `cargo xtask test`: everything that has to hold before a change is taken, in the order that shares compile work.
//!
//! Stages: format, lints natively and for wasm32, the page, its code, the workspace's tests, its documentation's examples, fuzzing, the
//! demo, the browser, the Python packages.
//! All in the profile dev (the page in its own). Invariants: a failing stage does not stop the later ones, so that one run shows all
//! failures; the last line is `N passed, N failed, N skipped` over all suites, where a stage that is not a suite counts only when it
//! fails; a suite that ran no test has failed. The exit code is 1 when anything failed.
//!
//! The short form has to end in 25 minutes on two cores, so that a change is judged while its author still thinks of it. `--long` gives every
//! suite its full numbers: it finds what is rare, and is run before a release.

mod failures;
mod processors;
mod properties;
mod soak;
pub(crate) mod tally;
mod trust;

use crate::process::{Ended, cargo, command, kilwa, on_path, output, root, run as run_command, shown, watch};
use crate::{demo, fuzz, setup, web};
use anyhow::{Result, bail};
use failures::{Failure, Failures};
use processors::Ticks;
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};
use tally::{Tally, is_noise};

/// Run all checks and tests: format, lints, the page, Rust, the browser.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// One suite with a report of its own
    suite: Option<Suite>,
    /// Run only the stages whose name contains this text
    #[arg(long, value_name = "TEXT", conflicts_with = "suite")]
    only: Option<String>,
    /// The long form: races, kills and hostile inputs in their full numbers, every reader fuzzed for two minutes
    #[arg(long, conflicts_with = "suite")]
    long: bool,
}

/// Suites with a report of their own.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Suite {
    /// Measuring: each property with its bound and the error measured
    Trust,
    /// Serving: thousands of slow and hundreds of busy clients, each property with its bound and the measured value
    Soak,
}

/// A store in Python, for the tests of the server, and where they look for it.
const STORE_PACKAGES: &str = "server/tests/store/requirements.txt";
const STORE_VARIABLE: &str = "KILWA_MOTO";
/// Another store, a real program, for the tests of divided builds.
const SEAWEED_PACKAGES: &str = "tests/divided/requirements.txt";
const SEAWEED_VARIABLE: &str = "KILWA_SEAWEED";
/// The Python packages, and the requirements of each and its checks.
const DASK: &str = "python/kilwa-dask";
const DASK_PACKAGES: &str = "python/kilwa-dask/tests/requirements.txt";
/// 200 MB to install, so that only the long form tests it.
const INVENIO: &str = "python/kilwa-invenio";
const INVENIO_PACKAGES: &str = "python/kilwa-invenio/tests/requirements.txt";
/// Crates that have to build for wasm32: the page's own and every pure crate below them.
const WASM_PACKAGES: [&str; 9] = [
    "kilwa-viewer",
    "kilwa-decode",
    "kilwa-stream",
    "kilwa-pack",
    "kilwa-geometry",
    "kilwa-simplify",
    "kilwa-measure",
    "kilwa-scan-core",
    "kilwa-measure-web",
];

/// How much each suite tries.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Length {
    Short,
    Long,
}

impl Length {
    /// Seconds that each reader is fuzzed.
    fn fuzz_seconds(self) -> u64 {
        match self {
            Self::Short => 5,
            Self::Long => 120,
        }
    }

    /// A suite that takes longer hangs.
    fn suite_limit(self) -> Duration {
        match self {
            Self::Short => SUITE_LIMIT,
            Self::Long => Duration::from_secs(3 * 60 * 60),
        }
    }

    /// Tests with a long form look for [`LONG_VARIABLE`].
    fn apply_to(self, command: &mut Command) -> &mut Command {
        match self {
            Self::Short => command,
            Self::Long => command.env(LONG_VARIABLE, "1"),
        }
    }
}

/// Set for the long form of tests that have one.
pub(crate) const LONG_VARIABLE: &str = "KILWA_SOAK";

/// A suite that takes longer hangs, and is stopped, so that the others run and the counts are printed. The longest took 18 minutes on a busy
/// machine with two cores, compiling 8.
pub(crate) const SUITE_LIMIT: Duration = Duration::from_secs(40 * 60);

/// Triangles of the fort that the demo's check uses.
const DEMO_TRIANGLES: u64 = 50_000;

/// One row of the closing table.
struct Row {
    name: &'static str,
    took: Duration,
    /// Percent of the time in which the processors were busy.
    busy: Option<u64>,
    /// A stage that is no suite counts one failure or nothing.
    counts: Tally,
}

type Stage = (&'static str, fn(Length) -> Result<Tally>);

const STAGES: [Stage; 12] = [
    ("set up", set_up),
    ("format", format),
    ("lints", lints),
    ("lints wasm32", lints_wasm),
    ("page", page),
    ("page code", page_code),
    ("rust tests", rust_tests),
    ("doc examples", doc_examples),
    ("fuzz", fuzzing),
    ("demo", demo),
    ("browser", browser),
    ("python", python),
];

pub(crate) fn run(args: &Args) -> Result<()> {
    match args.suite {
        Some(Suite::Trust) => return trust::run(),
        Some(Suite::Soak) => return soak::run(),
        None => {}
    }
    let length = if args.long { Length::Long } else { Length::Short };
    let wanted = |name: &str| args.only.as_deref().is_none_or(|text| name.contains(text));
    let mut rows = Vec::new();
    for (name, stage) in STAGES.into_iter().filter(|(name, _)| wanted(name)) {
        println!("\n== {name}");
        let (started, ticks) = (Instant::now(), Ticks::now());
        let counts = stage(length).unwrap_or_else(|error| failure(&error));
        let busy = ticks.and_then(|ticks| Ticks::now()?.percent_busy_since(ticks));
        rows.push(Row { name, took: started.elapsed(), busy, counts });
    }
    if rows.is_empty() {
        let names: Vec<_> = STAGES.iter().map(|(name, _)| *name).collect();
        bail!("no stage is called like that; there are: {}", names.join(", "));
    }
    report(&rows)
}

/// Prints the table, the skips, what failed and the closing line; an error when anything failed.
fn report(rows: &[Row]) -> Result<()> {
    println!("\n{:<14} {:>8} {:>7} {:>7} {:>7} {:>8}  ", "stage", "seconds", "busy", "passed", "failed", "skipped");
    let mut total = Tally::default();
    for row in rows {
        let counts = &row.counts;
        println!(
            "{:<14} {:>8.1} {:>7} {:>7} {:>7} {:>8}  {}",
            row.name,
            row.took.as_secs_f64(),
            row.busy.map_or_else(|| "-".to_owned(), |percent| format!("{percent} %")),
            counts.passed,
            counts.failed,
            counts.skipped(),
            if counts.failed == 0 { "" } else { "FAILED" }
        );
        total.add_all(counts.clone());
    }
    for skip in &total.skips {
        println!("skipped: {skip}");
    }
    for Failure { name, lines } in total.failures.all() {
        println!("\nfailed: {name}");
        for line in lines {
            println!("{line}");
        }
    }
    let seconds: f64 = rows.iter().map(|row| row.took.as_secs_f64()).sum();
    println!("\nall stages took {:.0} min {:.0} s", (seconds / 60.0).floor(), seconds % 60.0);
    println!("{} passed, {} failed, {} skipped", total.passed, total.failed, total.skipped());
    if total.failed > 0 { Err(Failed.into()) } else { Ok(()) }
}

/// Something failed and everything has been printed: the line of counts stays the last one.
#[derive(Debug)]
pub(crate) struct Failed;

impl std::fmt::Display for Failed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("tests failed; see above")
    }
}

impl std::error::Error for Failed {}

/// The long form tests the page in the whole Chromium, the short form without its windows.
fn chromium(length: Length) -> Result<PathBuf> {
    match length {
        Length::Short => setup::headless_chromium(),
        Length::Long => setup::chromium(),
    }
}

fn set_up(length: Length) -> Result<Tally> {
    setup::wasm_target()?;
    setup::npm_packages("xtask/npm")?;
    setup::npm_packages("tests/browser")?;
    setup::vulkan()?;
    println!("second opinions: {}", setup::python_packages(trust::PACKAGES)?.display());
    println!("a store to test with: {}", setup::python_packages(STORE_PACKAGES)?.display());
    println!("Dask: {}", setup::python_packages(DASK_PACKAGES)?.display());
    println!("browser: {}", chromium(length)?.display());
    if let Err(why) = setup::other_browsers() {
        println!("tests in browsers that are not installed will be skipped: {why:#}");
    }
    match setup::strace() {
        Ok(program) => println!("tests that kill programs before system calls use {}", program.display()),
        // Not every machine allows it to be installed or used; each such test prints that it was skipped.
        Err(why) => println!("tests that kill programs before system calls are skipped: {why:#}"),
    }
    Ok(Tally::default())
}

fn format(_: Length) -> Result<Tally> {
    check(&mut cargo(&["fmt", "--all", "--check"])?)
}

fn lints(_: Length) -> Result<Tally> {
    check(&mut cargo(&["clippy", "--locked", "--workspace", "--all-targets", "--keep-going", "--", "-D", "warnings"])?)
}

fn lints_wasm(_: Length) -> Result<Tally> {
    let mut clippy = cargo(&["clippy", "--locked", "--keep-going", "--target", setup::WASM])?;
    for package in WASM_PACKAGES {
        clippy.args(["--package", package]);
    }
    let mut tally = check(clippy.args(["--", "-D", "warnings"]))?;
    // The other build of the viewer, for browsers without WebGPU.
    let mut webgl = cargo(&["clippy", "--locked", "--target", setup::WASM, "--package", "kilwa-viewer"])?;
    tally.add_all(check(webgl.args(["--no-default-features", "--features", "webgl", "--", "-D", "warnings"]))?);
    Ok(tally)
}

fn page(_: Length) -> Result<Tally> {
    web::run(&web::Args::default())?;
    let mut tally = Tally::default();
    match web::same_with_trunk()? {
        Some(files) => println!("trunk builds the same {files} files"),
        None => {
            tally.skips.insert("trunk builds the same page: trunk is not installed (cargo install trunk)".to_owned());
        }
    }
    Ok(tally)
}

/// The page's code: its types (www/tsconfig.json), then how it is written (biome.jsonc), with the browser tests and the tools in JavaScript.
fn page_code(_: Length) -> Result<Tally> {
    let tools = setup::npm_packages("xtask/npm")?;
    let web = root()?.join("target/web");
    let declared = web.join("bindgen/viewer/viewer.d.ts");
    if !declared.is_file() {
        bail!(
            "{} is missing, which the page's code is checked against; `cargo xtask web` writes it",
            declared.display()
        );
    }
    let mut ids = command("node", &[])?;
    let ids = output(ids.arg(tools.join("ids.mjs")).arg("www/index.html"))?;
    fs::create_dir_all(web.join("types"))?;
    fs::write(web.join("types/ids.d.ts"), ids + "\n")?;
    let tool = |script: &str, args: &[&str]| {
        let mut node = command("node", &[])?;
        check(node.arg(tools.join("node_modules").join(script)).args(args))
    };
    let types = tool("typescript/bin/tsc", &["--project", "www/tsconfig.json"]);
    let style = tool("@biomejs/biome/bin/biome", &["ci", "--error-on-warnings"]);
    types.and(style)
}

/// Arguments that choose what is tested. Every cargo call of these stages uses the same ones, because another choice of packages unifies
/// features otherwise and compiles much of the tree again; and xtask stays out, for what it runs as is compiled already.
pub(crate) const TESTED: [&str; 4] = ["--locked", "--workspace", "--exclude", "xtask"];

/// nextest where it is installed (it shows time per test and ends one that hangs), cargo test elsewhere; both print what tests print.
fn rust_tests(length: Length) -> Result<Tally> {
    let has_nextest = on_path(&["cargo-nextest", "cargo-nextest.exe"]).is_some();
    let mut tally = Tally::default();
    for packages in [&["--locked", "--package", "xtask"][..], &TESTED] {
        let mut runner = if has_nextest {
            let options = ["--no-fail-fast", "--config-file", "xtask/nextest.toml", "--success-output", "immediate"];
            let mut nextest = cargo(&["nextest", "run"])?;
            nextest.args(packages).args(options);
            nextest
        } else {
            let mut test = cargo(&["test", "--no-fail-fast"])?;
            test.args(packages).args(["--all-targets", "--", "--nocapture"]);
            test
        };
        // Without these packages the tests that need them print that they are skipped.
        runner.env(trust::VARIABLE, setup::python_packages(trust::PACKAGES)?);
        runner.env(STORE_VARIABLE, setup::python_packages(STORE_PACKAGES)?);
        runner.env(SEAWEED_VARIABLE, setup::python_packages(SEAWEED_PACKAGES)?);
        let counts = suite(length.apply_to(&mut runner), length);
        tally.add_all(counts.unwrap_or_else(|error| failure(&error)));
    }
    Ok(tally)
}

/// The examples in documentation comments, which nextest does not run. There may be none, so an empty run is no failure.
fn doc_examples(_: Length) -> Result<Tally> {
    counted(cargo(&["test", "--doc", "--no-fail-fast"])?.args(TESTED), SUITE_LIMIT)
}

/// Every reader on damaged files for a while; the tests before have run a few thousand of them each.
fn fuzzing(length: Length) -> Result<Tally> {
    fuzz::stage(length.fuzz_seconds(), |test| suite(test, length))
}

/// `kilwa` as the tests above use it; nothing to do after them.
fn tested_kilwa() -> Result<PathBuf> {
    run_command(cargo(&["test", "--no-run", "--quiet"])?.args(TESTED))?;
    kilwa("dev")
}

/// The README's first command, with a small fort and the program of the tests: made, verified, served and fetched.
fn demo(_: Length) -> Result<Tally> {
    demo::check_small(&tested_kilwa()?, DEMO_TRIANGLES)?;
    Ok(Tally::of(1, 0))
}

/// The page in a real browser against the real server: `npm test` in tests/browser, with the programs to use in its environment.
fn browser(length: Length) -> Result<Tally> {
    let chromium = chromium(length)?;
    let folder = setup::npm_packages("tests/browser")?;
    let kilwa = tested_kilwa()?;
    let mut npm = command("npm", &["test", "--silent"])?;
    npm.current_dir(&folder).env("CHROMIUM", chromium).env("KILWA", kilwa);
    suite(length.apply_to(&mut npm), length)
}

/// The Python packages, with the same `kilwa` as the tests above. The short form leaves out the previewer of InvenioRDM.
fn python(length: Length) -> Result<Tally> {
    // Its tests mostly wait for workers to start, so two processes are almost twice as fast as one.
    let mut tally = python_package(DASK, DASK_PACKAGES, &["--numprocesses", "auto", "--dist", "loadfile"], length)?;
    if length == Length::Long {
        tally.add_all(python_package(INVENIO, INVENIO_PACKAGES, &[], length).unwrap_or_else(|error| failure(&error)));
    } else {
        tally.skips.insert("the previewer of InvenioRDM (python/kilwa-invenio): only in the long form".to_owned());
    }
    Ok(tally)
}

/// A Python package in `folder`: ruff, mypy, then its tests, with more options for pytest.
fn python_package(folder: &str, packages: &str, options: &[&str], length: Length) -> Result<Tally> {
    let packages = setup::python_packages(packages)?;
    let folder = root()?.join(folder);
    let module = |args: &[&str]| {
        let mut python = command("python3", &["-m"])?;
        python.args(args).current_dir(&folder).env("PYTHONPATH", &packages);
        Ok::<Command, anyhow::Error>(python)
    };
    let mut tally = Tally::default();
    for args in [&["ruff", "check"][..], &["ruff", "format", "--check"], &["mypy"]] {
        tally.add_all(check(&mut module(args)?).unwrap_or_else(|error| failure(&error)));
    }
    let kilwa = tested_kilwa()?;
    let mut pytest = module(&["pytest", "--quiet"])?;
    pytest.args(options).env("KILWA", kilwa).env(SEAWEED_VARIABLE, setup::python_packages(SEAWEED_PACKAGES)?);
    let counts = suite(length.apply_to(&mut pytest), length);
    tally.add_all(counts.unwrap_or_else(|error| failure(&error)));
    Ok(tally)
}

/// An error as a count, after it was shown.
fn failure(error: &anyhow::Error) -> Tally {
    println!("FAILED: {error:#}");
    let mut tally = Tally::of(0, 1);
    tally.failures = Failures::of(format!("{error:#}"));
    tally
}

/// A stage that is not a suite: it holds or it does not.
fn check(command: &mut Command) -> Result<Tally> {
    run_command(command)?;
    Ok(Tally::default())
}

/// Runs a test runner and reads its counts. A runner that fails without a failed test (it did not compile, it crashed) is an error.
fn counted(command: &mut Command, limit: Duration) -> Result<Tally> {
    let mut tally = Tally::default();
    let ended = watch(command, limit, |line| {
        tally.read(line);
        !is_noise(line)
    })?;
    match ended {
        Ended::Late => {
            tally.failed += 1;
            tally.failures.extend(Failures::of(format!("`{}` took too long", shown(command))));
        }
        Ended::Badly if tally.failed == 0 => bail!("the runner failed before or after its tests; see above"),
        Ended::Badly | Ended::Well => {}
    }
    Ok(tally)
}

/// As [`counted`], and a run without a test is an error: green on nothing is a defect.
fn suite(command: &mut Command, length: Length) -> Result<Tally> {
    let tally = counted(command, length.suite_limit())?;
    if tally.passed + tally.failed == 0 {
        bail!("not one test ran");
    }
    Ok(tally)
}

//! `cargo xtask fuzz`: any bytes at every reader. The bodies are those of `tests/fuzz/bodies.rs`, the seeds those of
//! `tests/fuzzing`.
//!
//! With cargo-fuzz and a nightly compiler the inputs follow the coverage of the code, under a sanitizer that sees memory errors in what
//! dependencies do with unsafe code. Compiling that takes eight minutes of processor time, so CI (`cargo xtask test`, stage "fuzz")
//! runs `tests/fuzzing`, which is compiled with the other tests and needs no nightly. Either keeps an input that fails and says where.

use crate::process::{command, on_path, output, root, run as run_command, shown};
use crate::test::TESTED;
use crate::test::tally::Tally;
use anyhow::{Context, Result, bail};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;

/// Run every reader on mutated files, by coverage where cargo-fuzz and a nightly compiler are installed.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Seconds for each target
    #[arg(long, value_name = "N", default_value_t = 600)]
    seconds: u64,
    /// Only this target: `ply`, `obj`, `stl`, `gltf`, `nexus`, `tiles`, `zip`, `photos`, `open_pack`, `decode_chunk`, `metadata`, `manifest`, `notes`,
    /// `ptx`, `points`, `e57`, `las`, `range_grid`, `survey`, `spool`, `mask` or `point_list`
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// The stable compiler's runner also where cargo-fuzz is installed
    #[arg(long)]
    stable: bool,
}

/// Targets, and the tests of `tests/fuzzing` that run their bodies.
const TARGETS: [(&str, &str); 22] = [
    ("ply", "any_bytes_are_read_as_ply_or_refused"),
    ("obj", "any_bytes_are_read_as_obj_or_refused"),
    ("stl", "any_bytes_are_read_as_stl_or_refused"),
    ("gltf", "any_bytes_are_read_as_gltf_or_refused"),
    ("nexus", "any_bytes_are_read_as_a_nexus_model_or_refused"),
    ("tiles", "any_bytes_are_read_as_3d_tiles_or_refused"),
    ("zip", "any_bytes_are_read_as_a_zip_archive_or_refused"),
    ("photos", "any_bytes_are_read_as_poses_of_photographs_or_refused"),
    ("open_pack", "any_bytes_are_read_as_a_pack_or_refused"),
    ("decode_chunk", "any_bytes_are_read_as_a_chunk_or_refused"),
    ("metadata", "any_bytes_are_read_as_metadata_or_refused"),
    ("manifest", "any_bytes_are_read_as_a_manifest_or_refused"),
    ("notes", "any_bytes_are_read_as_notes_or_refused"),
    ("ptx", "any_bytes_are_read_as_ptx_or_refused"),
    ("points", "any_bytes_are_read_as_points_or_refused"),
    ("e57", "any_bytes_are_read_as_e57_or_refused"),
    ("las", "any_bytes_are_read_as_las_or_refused"),
    ("range_grid", "any_bytes_are_read_as_a_range_grid_or_refused"),
    ("survey", "any_bytes_are_read_as_a_survey_or_refused"),
    ("spool", "any_bytes_are_read_as_a_spool_or_refused"),
    ("mask", "any_bytes_are_read_as_a_mask_or_refused"),
    ("point_list", "any_bytes_are_read_as_a_point_list_or_refused"),
];

/// Targets that run at a time.
const AT_ONCE: usize = 2;
/// Most memory of one input, MiB.
const MEMORY: u32 = 2048;
/// Longest time of one input, seconds.
const SLOWEST: u32 = 20;

pub(crate) fn run(args: &Args) -> Result<()> {
    let chosen = |name: &str| args.only.as_deref().is_none_or(|only| only == name);
    let targets: Vec<_> = TARGETS.into_iter().filter(|(name, _)| chosen(name)).collect();
    if targets.is_empty() {
        bail!("no target is called like that; there are: {}", TARGETS.map(|(name, _)| name).join(", "));
    }
    if args.stable || !is_nightly_there() {
        println!("the stable runner: {} s for each target", args.seconds);
        let mut test = fuzzing()?;
        test.args(["--", "--nocapture", "--exact", "--test-threads", &AT_ONCE.to_string()]);
        test.args(targets.iter().map(|(_, test)| test)).env("KILWA_FUZZ_SECONDS", args.seconds.to_string());
        return run_command(&mut test);
    }
    by_coverage(&targets.into_iter().map(|(name, _)| name).collect::<Vec<_>>(), args.seconds)
}

/// `cargo test` of `tests/fuzzing`, with the packages of all other tests, so that nothing is compiled again.
fn fuzzing() -> Result<Command> {
    let mut test = crate::process::cargo(&["test", "--no-fail-fast"])?;
    test.args(TESTED).args(["--test", "fuzzing"]);
    Ok(test)
}

/// Targets that read files of scanners. Many programs write these, so they get more time.
const SCANS: [&str; 5] = ["ptx", "points", "e57", "las", "range_grid"];

/// The stage of `cargo xtask test`: every target of `tests/fuzzing` for so many seconds (those of scans three times as long), two at a time, compiled as the tests were.
///
/// # Errors
/// As `suite`.
pub(crate) fn stage(seconds: u64, suite: impl FnOnce(&mut Command) -> Result<Tally>) -> Result<Tally> {
    let mut test = fuzzing()?;
    test.args(["--", "--nocapture", "--test-threads", &AT_ONCE.to_string()]);
    let of_scans = SCANS.iter().map(|target| format!("{target}={}", 3 * seconds));
    let times: Vec<String> = std::iter::once(seconds.to_string()).chain(of_scans).collect();
    suite(test.env("KILWA_FUZZ_SECONDS", times.join(",")))
}

/// cargo of the nightly toolchain. The variables that the stable one sets for its children would lead it astray.
fn nightly(args: &[&str]) -> Result<Command> {
    let mut cargo = command("cargo", &[&["+nightly"], args].concat())?;
    for name in ["CARGO", "RUSTUP_TOOLCHAIN", "RUSTC", "RUSTDOC"] {
        cargo.env_remove(name);
    }
    Ok(cargo)
}

fn is_nightly_there() -> bool {
    let is_there = on_path(&["cargo-fuzz", "cargo-fuzz.exe"]).is_some();
    is_there && nightly(&["fuzz", "--version"]).and_then(|mut c| output(&mut c)).is_ok()
}

/// Seeds, instrumented programs, and then the targets, [`AT_ONCE`] at a time.
fn by_coverage(targets: &[&'static str], seconds: u64) -> Result<()> {
    let root = root()?;
    let corpus = root.join("tests/fuzz/corpus");
    let mut seeds = fuzzing()?;
    run_command(seeds.env("KILWA_FUZZ_CORPUS", &corpus))?;
    run_command(&mut nightly(&["fuzz", "build", "--fuzz-dir", "tests/fuzz"])?)?;
    let waiting = Mutex::new(targets.to_vec());
    let failed = Mutex::new(Vec::new());
    let next = || waiting.lock().ok().and_then(|mut targets| targets.pop());
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while let Some(name) = next() {
                    if let (Err(error), Ok(mut failed)) = (one(&root, &corpus, name, seconds), failed.lock()) {
                        failed.push(format!("{name}: {error:#}"));
                    }
                }
            });
        }
    });
    let failed = failed.into_inner().unwrap_or_default();
    if failed.is_empty() { Ok(()) } else { bail!("{}", failed.join("\n")) }
}

/// One target; its output goes to a file, and the report of a failure and its last figures are shown.
fn one(root: &Path, corpus: &Path, name: &'static str, seconds: u64) -> Result<()> {
    let artifacts = root.join("tests/fuzz/artifacts").join(name);
    std::fs::create_dir_all(&artifacts).with_context(|| format!("cannot make {}", artifacts.display()))?;
    let log: PathBuf = artifacts.join("log");
    let file = std::fs::File::create(&log).with_context(|| format!("cannot write {}", log.display()))?;
    let mut fuzz = nightly(&["fuzz", "run", "--fuzz-dir", "tests/fuzz", name])?;
    fuzz.arg(corpus.join(name)).arg("--");
    fuzz.args([format!("-max_total_time={seconds}"), format!("-rss_limit_mb={MEMORY}"), format!("-timeout={SLOWEST}")]);
    let both = file.try_clone().context("the log cannot be shared")?;
    let status = fuzz.stdin(Stdio::null()).stdout(both).stderr(file).status();
    let status = status.with_context(|| format!("cannot start `{}`", shown(&fuzz)))?;
    let log_text = std::fs::read(&log).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
    let last = log_text.lines().rev().find(|line| line.starts_with("Done ")).unwrap_or("no figures");
    if status.success() {
        println!("{name}: {last}");
        return Ok(());
    }
    let kept = log_text.lines().find(|line| line.contains("Test unit written to")).unwrap_or("no input was kept");
    bail!("{kept}; its full output is in {}", log.display())
}

//! `cargo xtask bench stations`: meshes of simulated stations against the true surface: how much of them is false, and how much of what a station sees is present.
//! What is measured, and how, is in `scan/tests/stations.rs`, which runs here on a larger survey.

use super::archive;
use crate::process::{cargo, command, compile_kilwa, output, root, run as run_command};
use crate::test::TESTED;
use anyhow::{Result, ensure};
use std::fs;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Stations of the survey
    #[arg(long, value_name = "N", default_value_t = 6)]
    stations: u32,
    /// Columns of a scan of the dense instrument
    #[arg(long, value_name = "N", default_value_t = 1550)]
    columns: u32,
    /// Seed of the fort and of everything random
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Triangles of the true surface
    #[arg(long, value_name = "N", default_value_t = 6_000_000)]
    truth: u64,
    /// Other limits of edges and incidence: factor, metres, degrees
    #[arg(long, value_name = "K,METRES,DEGREES")]
    limits: Option<String>,
    /// Cargo profile of the program that makes the scans
    #[arg(long, value_name = "NAME", default_value = "dev")]
    profile: String,
    /// Use the scans that an earlier run with the same options made
    #[arg(long)]
    again: bool,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

/// The test that measures.
const TEST: &str = "meshes_of_simulated_stations_lie_on_the_true_surface_and_cover_what_is_seen";

pub(super) fn run(args: &Args) -> Result<()> {
    let kilwa = compile_kilwa(&args.profile)?;
    let root = root()?;
    let Args { stations, columns, seed, truth, .. } = args;
    let scans = root.join(format!("target/bench/stations-{stations}-{columns}-{seed}-{truth}"));
    if !(args.again && scans.is_dir()) {
        drop(fs::remove_dir_all(&scans));
        fs::create_dir_all(root.join("target/bench"))?;
        let numbers = [u64::from(*stations), u64::from(*columns), *seed, *truth].map(|n| n.to_string());
        let mut synth = command(&kilwa.to_string_lossy(), &["synth", "scans"])?;
        for (option, number) in ["--stations", "--columns", "--seed", "--truth-mesh"].iter().zip(&numbers) {
            synth.args([option, number.as_str()]);
        }
        // What stood there for a while is not part of the true surface.
        run_command(synth.args(["--without", "walkers,grass,scaffolding", "-o"]).arg(&scans))?;
    }
    let mut test = cargo(&["test"])?;
    test.args(TESTED).args(["--test", "tests", TEST, "--", "--nocapture"]).env("KILWA_STATIONS", &scans);
    if let Some(limits) = &args.limits {
        test.env("KILWA_MESH", limits);
    }
    let printed = output(&mut test)?;
    let table: String = printed
        .lines()
        .filter(|line| line.starts_with("| ") || line.starts_with("|-"))
        .flat_map(|line| [line, "\n"])
        .collect();
    ensure!(!table.is_empty(), "the test printed no table:\n{printed}");
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "stations", &table, &args.profile) }
}

//! `cargo xtask bench merge --flags`: compares the causes of holes with the simulator's ground truth (example `hole_flags` of the crate kilwa-scan).

use super::{Args, Place, simulate};
use crate::bench::archive;
use crate::process::{cargo, command, compile_kilwa, output, root, run as run_command};
use anyhow::Result;

/// Numbers of test points in holes and of lines through the site.
const SAMPLES: [&str; 2] = ["100000", "20000"];

pub(super) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let Args { stations, columns, seed, truth, .. } = args;
    let folder = root.join(format!("target/bench/merge-{stations}-{columns}-{seed}-{truth}"));
    let place = Place { folder, kilwa: compile_kilwa(&args.profile)? };
    if !(args.again && place.at("survey").is_dir()) {
        simulate(args, &place)?;
    }
    let build = ["build", "--locked", "--package", "kilwa-scan", "--example", "hole_flags", "--profile", &args.profile];
    run_command(&mut cargo(&build)?)?;
    let example = place.kilwa.with_file_name("examples").join("hole_flags");
    let numbers = [seed.to_string(), stations.to_string(), columns.to_string(), args.voxel.to_string()];
    let mut compare = command(&example.to_string_lossy(), &[])?;
    let table = output(compare.arg(place.at("survey")).args(numbers).args(SAMPLES))?;
    println!("\n{table}");
    let about = format!("{stations} stations of {columns} columns, seed {seed}, voxel {} m.\n\n{table}\n", args.voxel);
    if args.dry { Ok(()) } else { archive(&root, "merge-flags", &about, &args.profile) }
}

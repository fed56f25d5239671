//! `cargo xtask bench points`: building a pack from the points of a synthetic scan: CPU time, memory, size, and what the first request brings.

use super::scans::{ROWS, write_ptx};
use super::{archive, number_of, run_measured};
use crate::process::{compile_kilwa, root};
use anyhow::{Context, Result};
use std::fmt::Write as _;
use std::fs;
use std::io::Read;
use std::path::Path;

#[derive(clap::Args)]
pub(super) struct Args {
    /// Points of the scan
    #[arg(long, value_name = "N", default_value_t = 10_000_000, value_parser = clap::value_parser!(u64).range(10_000..))]
    points: u64,
    /// Cargo profile of the program; figures of `dev` are upper bounds
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

/// Bytes of a reader's first request.
const HEAD_BYTES: u64 = 131_072;

pub(super) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let kilwa = compile_kilwa(&args.profile)?;
    let scratch = root.join("target/bench/points");
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let (file, survey, pack) = (scratch.join("scan.ptx"), scratch.join("survey"), scratch.join("points.kilwa"));
    drop(fs::remove_dir_all(&survey));
    write_ptx(&file, args.points)?;
    let text = |path: &Path| path.display().to_string();
    let import = ["scans".to_owned(), "import".to_owned(), text(&file), "-o".to_owned(), text(&survey)];
    run_measured(&kilwa, &import, &scratch.join("import"))?;
    fs::remove_file(&file).with_context(|| format!("cannot remove {}", file.display()))?;
    let build = ["build", &text(&survey), "--points", "--force", "--json", "-o", &text(&pack)].map(str::to_owned);
    let used = run_measured(&kilwa, &build, &scratch.join("build"))?;
    let report = fs::read_to_string(scratch.join("build.json"))?;
    let (in_head, first) = in_head(&pack)?;
    let points = args.points / ROWS * ROWS;
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let mut table = String::from(
        "| points | wall s | CPU s | µs / point | peak MiB | scratch bytes / point | pack bytes / point | chunks in the first request | points in the first picture |\n|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    writeln!(
        table,
        "| {points} | {:.1} | {:.1} | {:.2} | {:.0} | {:.0} | {:.2} | {in_head} | {first} |",
        used.wall_s,
        used.cpu_s,
        used.cpu_s / points as f64 * 1e6,
        mib(used.peak_bytes),
        number_of(&report, "\"scratch_peak_bytes\"").unwrap_or(f64::NAN) / points as f64,
        fs::metadata(&pack)?.len() as f64 / points as f64,
    )?;
    drop(fs::remove_dir_all(&survey));
    fs::remove_file(&pack).with_context(|| format!("cannot remove {}", pack.display()))?;
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "points", &table, &args.profile) }
}

/// How many chunks lie in the first bytes of a pack, and how many points the first of them, the coarsest form, has (docs/FORMAT.md, sections 3 and 4).
fn in_head(pack: &Path) -> Result<(usize, u32)> {
    let mut bytes = Vec::new();
    fs::File::open(pack)?.take(HEAD_BYTES).read_to_end(&mut bytes)?;
    let short = || format!("{} is shorter than its head", pack.display());
    let u64_at = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?));
    let u32_at = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let page = usize::try_from(u64_at(104).with_context(short)?)?;
    let count = u32_at(page + 8).with_context(short)? as usize;
    let entry = |k: usize| page + 128 + 128 * k;
    let ends_in_head = |k: &usize| {
        let end = u64_at(entry(*k)).zip(u32_at(entry(*k) + 8)).map(|(offset, bytes)| offset + u64::from(bytes));
        end.is_some_and(|end| end <= HEAD_BYTES)
    };
    let whole = (0..count).take_while(ends_in_head).count();
    Ok((whole, u32_at(entry(0) + 16).with_context(short)? / 2))
}

//! `cargo xtask bench gpu`: makes an archive for measuring a GPU on a machine without a toolchain, and measures this
//! machine.
//!
//! The archive is `target/gpu-bench.tar.gz`: `kilwa`, `gpu_bench` (viewer/examples), and `run.sh` and `README.md` of `xtask/gpu`. It is unpacked into a
//! scratch folder and run as on any other machine; its tables are added to `docs/bench/DATE-gpu.md`. Figures of another machine are added by
//! hand, from the `gpu.md` that `run.sh` writes there.

use super::archive;
use crate::process::{cargo, command, compile_kilwa, root, run as run_command};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::{Path, PathBuf};

/// Largest archive, bytes: it is copied to other machines.
const MAX_BYTES: u64 = 60_000_000;

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Triangles of each model
    #[arg(long, value_name = "N", default_value_t = 16_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    triangles: u64,
    /// Models to make
    #[arg(long, value_name = "NAME", default_values_t = ["wall".to_owned(), "fort".to_owned()])]
    model: Vec<String>,
    /// A pack to put into the archive and to draw
    #[arg(long, value_name = "FILE")]
    pack: Vec<PathBuf>,
    /// Make the archive and do not run it here
    #[arg(long)]
    no_run: bool,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
    /// Options of `gpu_bench`, such as --sizes 1920x1080 --pixels 1 --seconds 3
    #[arg(last = true, value_name = "OPTIONS")]
    options: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let kilwa = compile_kilwa("release")?;
    run_command(&mut cargo(&[
        "build",
        "--release",
        "--locked",
        "--package",
        "kilwa-viewer",
        "--example",
        "gpu_bench",
    ])?)?;
    let bench = kilwa.with_file_name("examples").join("gpu_bench");
    let target = root.join("target");
    let folder = target.join("gpu-bench");
    if folder.exists() {
        fs::remove_dir_all(&folder).with_context(|| format!("cannot empty {}", folder.display()))?;
    }
    let models = folder.join("models");
    fs::create_dir_all(&models).with_context(|| format!("cannot create {}", models.display()))?;
    let own = ["run.sh", "README.md"].map(|name| root.join("xtask/gpu").join(name));
    for (file, into) in
        [&kilwa, &bench].into_iter().chain(&own).map(|f| (f, &folder)).chain(args.pack.iter().map(|p| (p, &models)))
    {
        copy(file, into)?;
    }
    let file = target.join("gpu-bench.tar.gz");
    run_command(command("tar", &["-czf"])?.arg(&file).arg("-C").arg(&target).arg("gpu-bench"))?;
    let bytes = fs::metadata(&file).with_context(|| format!("cannot read {}", file.display()))?.len();
    println!("{}: {:.1} MB", file.display(), bytes as f64 / 1e6);
    if bytes > MAX_BYTES {
        bail!("the archive is larger than {} MB; pass smaller packs with --pack", MAX_BYTES / 1_000_000);
    }
    if args.no_run {
        return Ok(());
    }
    let mut script = command(&folder.join("run.sh").display().to_string(), &[])?;
    script.env("TRIANGLES", args.triangles.to_string()).env("MODELS", args.model.join(" ")).env("OUT", &folder);
    run_command(script.args(&args.options))?;
    let table = fs::read_to_string(folder.join("gpu.md")).context("run.sh wrote no gpu.md")?;
    if args.dry { Ok(()) } else { archive(&root, "gpu", &table, "release") }
}

/// Copy a file into a folder.
fn copy(file: &Path, folder: &Path) -> Result<()> {
    let name = file.file_name().with_context(|| format!("{} is not a file", file.display()))?;
    fs::copy(file, folder.join(name)).with_context(|| format!("cannot copy {}", file.display()))?;
    Ok(())
}

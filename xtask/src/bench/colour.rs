//! `cargo xtask bench colour`: colours the true surface of the simulated fort from simulated photographs, and compares the colours with the ground truth (example
//! `colour_truth` of the crate kilwa-scan); with `--python`, pymeshlab's projection of the same photographs beside it.

use super::{archive, run_measured};
use crate::process::{cargo, command, compile_kilwa, output, root, run as run_command};
use anyhow::{Context, Result, ensure};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Photographs
    #[arg(long, value_name = "N", default_value_t = 60)]
    photos: u32,
    /// Panoramas of stations
    #[arg(long, value_name = "N", default_value_t = 4)]
    panoramas: u32,
    /// Size of a photograph in pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1600x1200")]
    size: String,
    /// Photographs that `kilwa synth photos` made earlier with the same options, instead of simulating them (16 microseconds of a core per pixel)
    #[arg(long, value_name = "DIR")]
    session: Option<PathBuf>,
    /// Triangles of the surface, such as 1M
    #[arg(long, value_name = "N", default_value = "1M")]
    triangles: String,
    /// Vertices that are compared with the truth
    #[arg(long, value_name = "N", default_value_t = 40_000)]
    vertices: u32,
    /// Seed of the fort and of everything random
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Also run pymeshlab, with this Python (xtask/peers/requirements.txt); needs xvfb-run and a Qt 5 platform plugin
    #[arg(long, value_name = "PYTHON")]
    python: Option<PathBuf>,
    /// Cargo profile of the program; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let (root, kilwa) = (root()?, compile_kilwa(&args.profile)?);
    let folder = root.join(format!("target/bench/colour-{}-{}-{}", args.photos, args.size, args.seed));
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let session = simulate(args, &kilwa, &folder)?;
    let (surface, survey) = (folder.join("scans/truth/surface.ply"), folder.join("survey"));
    let coloured = folder.join("coloured.ply");
    let text = |path: &Path| path.display().to_string();
    let call =
        ["colour".to_owned(), text(&survey), text(&surface), "--photos".to_owned(), text(&session.join("photos"))];
    let poses = ["--poses".to_owned(), text(&session.join("photos/sparse")), "--force".to_owned()];
    let out = ["-o".to_owned(), text(&coloured)];
    let used = run_measured(&kilwa, &[call.as_slice(), &poses, &out].concat(), &folder.join("usage"))?;
    let peak = used.peak_bytes as f64 / f64::from(1 << 20);
    let mut table = String::from("| program | wall s | CPU s | peak MiB |\n|---|---:|---:|---:|\n");
    writeln!(table, "| kilwa colour | {:.1} | {:.1} | {peak:.0} |", used.wall_s, used.cpu_s)?;
    let mut files = vec![coloured];
    if let Some(python) = &args.python {
        let file = folder.join("pymeshlab.ply");
        writeln!(table, "| pymeshlab | {} |", peer(python, &root, &session, &surface, &folder, &file)?)?;
        files.push(file);
    }
    write!(table, "\n{}", compared(args, &kilwa, &files)?)?;
    println!("\n{table}");
    let about = format!(
        "{} photographs of {}, {} panoramas, seed {}, {} triangles, {} vertices compared.\n\n{table}",
        args.photos, args.size, args.panoramas, args.seed, args.triangles, args.vertices
    );
    if args.dry { Ok(()) } else { archive(&root, "colour", &about, &args.profile) }
}

/// The photographs, the surface, and a survey with the stations of the panoramas; the folder of the photographs.
fn simulate(args: &Args, kilwa: &Path, folder: &Path) -> Result<PathBuf> {
    let program = kilwa.to_string_lossy().into_owned();
    let seed = args.seed.to_string();
    let (scans, survey) = (folder.join("scans"), folder.join("survey"));
    drop((fs::remove_dir_all(&scans), fs::remove_dir_all(&survey)));
    let stations = args.panoramas.max(1).to_string();
    let options = ["synth", "scans", "--columns", "60", "--seed", &seed, "--stations", &stations];
    run_command(command(&program, &options)?.args(["--truth-mesh", &args.triangles, "-o"]).arg(&scans))?;
    let import = command(&program, &["scans", "import"])?.arg(&scans).arg("-o").arg(&survey).status()?;
    ensure!(import.success(), "the import failed");
    if let Some(session) = &args.session {
        ensure!(session.join("photos").is_dir(), "{} has no folder photos", session.display());
        return Ok(session.clone());
    }
    let session = folder.join("session");
    if !session.is_dir() {
        let [photos, panoramas] = [args.photos, args.panoramas].map(|n| n.to_string());
        let options = ["synth", "photos", "--photos", &photos, "--panoramas", &panoramas, "--size", &args.size];
        run_command(command(&program, &options)?.args(["--seed", &seed, "-o"]).arg(&session))?;
    }
    Ok(session)
}

/// Run pymeshlab; returns its time and memory as cells of a table.
fn peer(python: &Path, root: &Path, session: &Path, surface: &Path, folder: &Path, file: &Path) -> Result<String> {
    let mut call = command("xvfb-run", &["-a", "-s", "-screen 0 1280x1024x24 +extension GLX"])?;
    call.arg(python).arg(root.join("xtask/peers/colour_peers.py")).arg(session.join("photos")).arg(surface).arg(file);
    call.arg("--work").arg(folder.join("undistorted")).arg("--truth").arg(session.join("truth/photos.toml"));
    let printed = output(&mut call)?;
    let line = printed.lines().find(|line| line.starts_with('{')).context("pymeshlab printed no costs")?;
    let cost: serde_json::Value = serde_json::from_str(line)?;
    Ok(format!("{} | {} | {}", cost["wall_s"], cost["cpu_s"], cost["peak_MB"]))
}

/// How close colours are to the true light.
fn compared(args: &Args, kilwa: &Path, files: &[PathBuf]) -> Result<String> {
    let build =
        ["build", "--locked", "--package", "kilwa-scan", "--example", "colour_truth", "--profile", &args.profile];
    run_command(&mut cargo(&build)?)?;
    let example = kilwa.with_file_name("examples").join("colour_truth");
    let numbers = [args.seed.to_string(), args.photos.to_string(), args.panoramas.to_string(), args.size.clone()];
    let mut compare = command(&example.to_string_lossy(), &[])?;
    let printed = output(compare.args(numbers).arg(args.vertices.to_string()).args(files))?;
    let mut table = String::from(
        "| colours | PSNR dB | PSNR, mean light | PSNR, steady light only | median error | 90th percentile | visible, not coloured % | hidden, but coloured % |\n|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for line in printed.lines().filter(|line| line.starts_with('{')) {
        let found: serde_json::Value = serde_json::from_str(line)?;
        let name = Path::new(found["file"].as_str().unwrap_or_default()).file_stem().unwrap_or_default();
        let percent = |key: &str| 100.0 * found[key].as_f64().unwrap_or(0.0);
        writeln!(
            table,
            "| {} | {} | {} | {} | {} | {} | {:.2} | {:.2} |",
            name.display(),
            found["psnr"],
            found["psnr_mean"],
            found["steady_psnr"],
            found["median"],
            found["p90"],
            percent("visible_but_uncoloured"),
            percent("hidden_but_coloured")
        )?;
    }
    Ok(table)
}

//! `cargo xtask bench merge`: simulated stations merged into one surface, by `kilwa merge` and by other programs, compared with the true surface.
//!
//! The yardstick (`xtask/peers/evaluate_merge.py`) and the other programs are Python packages (`xtask/peers/requirements.txt`), which `--python` names the
//! interpreter of; without it, only time, memory and triangles of Kilwa are measured.

mod flags;
mod kill;

use super::place::Place;
use super::scans::{ROWS, write_ptx};
use super::{Usage, archive, number_of, run_measured};
use crate::process::{command, compile_kilwa, root, run as run_command};
use anyhow::{Context, Result};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(super) struct Args {
    /// Stations of the survey
    #[arg(long, value_name = "N", default_value_t = 12)]
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
    /// Merge N points in total, from stations in one synthetic room instead of the fort, to measure time and memory only
    #[arg(long, value_name = "N", conflicts_with_all = ["python", "peers", "again"])]
    points: Option<u64>,
    /// Compare the causes of holes with the simulator's ground truth instead
    #[arg(long, conflicts_with_all = ["python", "peers", "points"])]
    flags: bool,
    /// Kill a merge into a pack N times at random moments instead, resume it each time, and compare the pack with that of an uninterrupted merge
    #[arg(long, value_name = "N", conflicts_with_all = ["python", "peers", "points", "flags"])]
    kill: Option<u32>,
    /// Edge of a voxel, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.02)]
    voxel: f64,
    /// Threads of `kilwa merge`
    #[arg(long, value_name = "N", default_value_t = 1)]
    threads: u32,
    /// A Python interpreter with the packages of xtask/peers/requirements.txt
    #[arg(long, value_name = "FILE")]
    python: Option<PathBuf>,
    /// Also merge with PlyMC (the VCG filter of pymeshlab), which needs about a gigabyte of memory for a million triangles
    #[arg(long, requires = "python")]
    peers: bool,
    /// Cargo profile of the program
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Use the scans that an earlier run with the same options made
    #[arg(long)]
    again: bool,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    if let Some(points) = args.points {
        return load(args, &root, points);
    }
    if let Some(kills) = args.kill {
        return kill::run(args, kills);
    }
    if args.flags {
        return flags::run(args);
    }
    let Args { stations, columns, seed, truth, .. } = args;
    let folder = root.join(format!("target/bench/merge-{stations}-{columns}-{seed}-{truth}"));
    let place = Place { folder, kilwa: compile_kilwa(&args.profile)? };
    if !(args.again && place.at("survey").is_dir()) {
        simulate(args, &place)?;
    }
    let mut table = String::from(
        "| program | CPU s | wall s | peak MiB | triangles | precision % | recall % | F % | facing recall % | false % | edges of more than two triangles | rims m |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let mesh = place.at("kilwa.ply");
    let text = |path: &Path| path.display().to_string();
    let used = merged(args, &place, &mesh)?;
    row(&mut table, args, &root, &place, "kilwa merge", &mesh, &used)?;
    if args.peers {
        let meshes = station_meshes(&place)?;
        for (name, setting) in [("PlyMC, default", None), ("PlyMC, widenum=1", Some("widenum=1"))] {
            let mesh = place.at("peer.ply");
            let script = root.join("xtask/peers/merge_peers.py");
            let mut peer =
                vec![text(&script), "vcg".to_owned(), text(&mesh), "--voxel".to_owned(), args.voxel.to_string()];
            peer.extend(setting.into_iter().flat_map(|setting| ["--set".to_owned(), setting.to_owned()]));
            peer.extend(meshes.iter().map(|mesh| text(mesh)));
            let python = args.python.as_deref().context("--peers needs --python")?;
            let used = run_measured(python, &peer, &place.at("peer"))?;
            row(&mut table, args, &root, &place, name, &mesh, &used)?;
        }
    }
    println!("\n{table}");
    let about = format!(
        "{stations} stations of {columns} columns, seed {seed}, true surface of about {truth} triangles, voxel {} m, threshold 10 mm.\n\n{table}",
        args.voxel
    );
    if args.dry { Ok(()) } else { archive(&root, "merge", &about, &args.profile) }
}

fn simulate(args: &Args, place: &Place) -> Result<()> {
    drop(fs::remove_dir_all(&place.folder));
    fs::create_dir_all(&place.folder).with_context(|| format!("cannot create {}", place.folder.display()))?;
    let numbers = [u64::from(args.stations), u64::from(args.columns), args.seed, args.truth].map(|n| n.to_string());
    let mut synth = vec!["synth", "scans"];
    for (option, number) in ["--stations", "--columns", "--seed", "--truth-mesh"].iter().zip(&numbers) {
        synth.extend([option, number.as_str()]);
    }
    // What stood there for a while is not part of the true surface.
    synth.extend(["--without", "walkers,grass,scaffolding", "-o"]);
    place.kilwa(&synth, &[&place.at("scans")])?;
    place.kilwa(&["scans", "import", "-o"], &[&place.at("survey"), &place.at("scans")])
}

/// Time and memory of merging so many points.
fn load(args: &Args, root: &Path, points: u64) -> Result<()> {
    let place = Place { folder: root.join("target/bench/merge-load"), kilwa: compile_kilwa(&args.profile)? };
    drop(fs::remove_dir_all(&place.folder));
    fs::create_dir_all(&place.folder).with_context(|| format!("cannot create {}", place.folder.display()))?;
    let mut all = 0;
    for number in 1..=args.stations {
        let scan = place.at(&format!("scan_{number:03}.ptx"));
        // A column more each, because the same scan would be imported only once.
        let columns = points / u64::from(args.stations) / ROWS + u64::from(number);
        write_ptx(&scan, columns * ROWS)?;
        all += columns * ROWS;
        place.kilwa(&["scans", "import", "-o"], &[&place.at("survey"), &scan])?;
        fs::remove_file(&scan).with_context(|| format!("cannot remove {}", scan.display()))?;
    }
    let used = merged(args, &place, &place.at("kilwa.ply"))?;
    let report = fs::read_to_string(place.at("kilwa.json"))?;
    let number = |key: &str| number_of(&report, &format!("\"{key}\"")).unwrap_or(f64::NAN);
    let all = all as f64;
    let mut table = String::from(
        "| points | stations | voxel m | CPU s | wall s | µs / point | peak MiB | triangles of stations | pieces | scratch bytes / point | triangles |\n|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    writeln!(
        table,
        "| {all} | {} | {} | {:.1} | {:.1} | {:.2} | {:.0} | {} | {} | {:.1} | {} |",
        args.stations,
        args.voxel,
        used.cpu_s,
        used.wall_s,
        used.cpu_s / all * 1e6,
        used.peak_bytes as f64 / f64::from(1 << 20),
        number("station_triangles"),
        number("pieces"),
        number("scratch_bytes") / all,
        number("triangles"),
    )?;
    fs::remove_dir_all(&place.folder).with_context(|| format!("cannot remove {}", place.folder.display()))?;
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(root, "merge", &table, &args.profile) }
}

/// Merge the survey; what that used. The report is `kilwa.json`.
fn merged(args: &Args, place: &Place, mesh: &Path) -> Result<Usage> {
    let text = |path: &Path| path.display().to_string();
    let (voxel, threads) = (args.voxel.to_string(), args.threads.to_string());
    let survey = text(&place.at("survey"));
    let merge = [
        "merge",
        &survey,
        "--voxel",
        &voxel,
        "--threads",
        &threads,
        "--memory",
        "1G",
        "--force",
        "--json",
        "-o",
        &text(mesh),
    ];
    run_measured(&place.kilwa, &merge.map(str::to_owned), &place.at("kilwa"))
}

/// The mesh of each station, as other programs need them.
fn station_meshes(place: &Place) -> Result<Vec<PathBuf>> {
    let folder = place.at("meshes");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let stations = fs::read_dir(place.at("survey/stations"))?;
    let mut names: Vec<String> =
        stations.filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_string_lossy().into_owned())).collect();
    names.sort();
    let mut meshes = Vec::new();
    for name in names {
        let mesh = folder.join(format!("{name}.ply"));
        place
            .kilwa(&["scans", "export", "--mesh", "--force", "-o"], &[&mesh, &place.at("survey"), Path::new(&name)])?;
        meshes.push(mesh);
    }
    Ok(meshes)
}

/// Measure a mesh against the true surface, and add its row.
fn row(
    table: &mut String,
    args: &Args,
    root: &Path,
    place: &Place,
    name: &str,
    mesh: &Path,
    used: &Usage,
) -> Result<()> {
    write!(
        table,
        "| {name} | {:.1} | {:.1} | {:.0} |",
        used.cpu_s,
        used.wall_s,
        used.peak_bytes as f64 / f64::from(1 << 20)
    )?;
    let Some(python) = &args.python else {
        let report = fs::read_to_string(place.at("kilwa.json"))?;
        writeln!(table, " {} | | | | | | | |", number_of(&report, "\"triangles\"").unwrap_or(f64::NAN))?;
        return Ok(());
    };
    let figures = place.at("figures.json");
    let mut evaluate = command(&python.to_string_lossy(), &[])?;
    evaluate.arg(root.join("xtask/peers/evaluate_merge.py")).arg(mesh);
    evaluate.arg("--truth").arg(place.at("scans/truth/surface.ply"));
    evaluate.arg("--stations").arg(place.at("scans/truth/poses.toml"));
    evaluate.arg("--voxel").arg(args.voxel.to_string()).arg("--json").arg(&figures);
    run_command(&mut evaluate)?;
    let figures = fs::read_to_string(&figures)?;
    let number = |key: &str| number_of(&figures, &format!("\"{key}\"")).unwrap_or(f64::NAN);
    writeln!(
        table,
        " {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {} | {:.0} |",
        number("triangles"),
        number("precision_percent"),
        number("recall_percent"),
        number("F_percent"),
        number("facing_recall_percent"),
        number("false_percent"),
        number("nonmanifold_edges"),
        number("border_length_m")
    )?;
    Ok(())
}

//! `cargo xtask bench masks`: masks of simulated scans against the truth of the simulator: how many mixed pixels and transients they find, and how many good points
//! they lose. The truth is read by code of its own, from the files that `kilwa synth scans` writes.

use super::{archive, run_measured};
use crate::process::{command, compile_kilwa, root, run as run_command};
use anyhow::{Context, Result, ensure};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Stations of the survey
    #[arg(long, value_name = "N", default_value_t = 8)]
    stations: u32,
    /// Columns of a scan of the dense instrument
    #[arg(long, value_name = "N", default_value_t = 1550)]
    columns: u32,
    /// Seed of the fort and of everything random
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Cargo profile of the program; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Use the scans that an earlier run with the same options made
    #[arg(long)]
    again: bool,
    /// Print the tables without adding them to docs/bench
    #[arg(long)]
    dry: bool,
}

/// Classes of the truth, by their numbers.
const CLASSES: [&str; 7] = ["empty", "surface", "mixed", "walker", "grass", "scaffolding", "dropout"];
const SURFACE: usize = 1;
const MIXED: usize = 2;
const WALKER: usize = 3;
/// A ray passed through a place if it went this much farther, metres.
const FARTHER: f64 = 0.1;
/// Elevation of the lowest row.
const LOWEST: f64 = -60.0;

/// One station: its samples in the order of the PTX, and the truth.
struct Station {
    name: String,
    columns: usize,
    rows: usize,
    points: Vec<[f32; 3]>,
    labels: Vec<u8>,
    /// Columns of the matrix that takes the scan to the site, and the position.
    pose: [[f64; 3]; 4],
}

pub(super) fn run(args: &Args) -> Result<()> {
    let kilwa = compile_kilwa(&args.profile)?;
    let root = root()?;
    let scratch = root.join(format!("target/bench/masks-{}-{}-{}", args.stations, args.columns, args.seed));
    let (scans, survey) = (scratch.join("scans"), scratch.join("survey"));
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let program = kilwa.to_string_lossy().into_owned();
    if !(args.again && scans.is_dir()) {
        drop(fs::remove_dir_all(&scans));
        let [stations, columns, seed] = [args.stations, args.columns, args.seed as u32].map(|n| n.to_string());
        let options = ["synth", "scans", "--stations", &stations, "--columns", &columns, "--seed", &seed, "-o"];
        run_command(command(&program, &options)?.arg(&scans))?;
    }
    drop(fs::remove_dir_all(&survey));
    let import = command(&program, &["scans", "import"])?.arg(&scans).arg("-o").arg(&survey).status()?;
    ensure!(import.success(), "the import failed");
    let mut table = String::from("| mask | wall s | CPU s | peak MiB |\n|---|---:|---:|---:|\n");
    for kind in ["--mixed", "--isolated", "--grazing", "--seen-through"] {
        let call = ["scans", "mask", &survey.display().to_string(), kind].map(str::to_owned);
        let used = run_measured(&kilwa, &call, &scratch.join("usage"))?;
        let peak = used.peak_bytes as f64 / f64::from(1 << 20);
        writeln!(table, "| {} | {:.1} | {:.1} | {peak:.0} |", &kind[2..], used.wall_s, used.cpu_s)?;
    }
    let stations = stations(&scans)?;
    let by_mask: Vec<(&str, Vec<Vec<bool>>)> = ["mixed", "isolated", "grazing", "seen-through"]
        .into_iter()
        .map(|name| {
            let masks = stations.iter().map(|station| mask(&survey, &station.name, name)).collect::<Result<_>>()?;
            Ok((name, masks))
        })
        .collect::<Result<_>>()?;
    table.push_str(&classes(&stations, &by_mask));
    table.push_str(&by_station(&stations, &by_mask));
    let (_, through) = by_mask.last().context("there are masks")?;
    table.push_str(&transients(&stations, through));
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "masks", &table, &args.profile) }
}

fn percent(part: u64, of: u64) -> f64 {
    100.0 * part as f64 / of.max(1) as f64
}

/// Share of each class that each mask masks.
fn classes(stations: &[Station], masks: &[(&str, Vec<Vec<bool>>)]) -> String {
    let mut table = String::from("\n| class | points |");
    for (name, _) in masks {
        write!(table, " {name} % |").unwrap_or(());
    }
    table.push_str("\n|---|---:|");
    table.push_str(&"---:|".repeat(masks.len()));
    for (class, name) in CLASSES.iter().enumerate().take(CLASSES.len() - 1).skip(1) {
        let of = |station: &Station| station.labels.iter().filter(|label| usize::from(**label) == class).count() as u64;
        let points: u64 = stations.iter().map(of).sum();
        write!(table, "\n| {name} | {points} |").unwrap_or(());
        for (_, masks) in masks {
            let masked = |(station, mask): (&Station, &Vec<bool>)| {
                station.labels.iter().zip(mask).filter(|(label, is)| usize::from(**label) == class && **is).count()
                    as u64
            };
            let masked: u64 = stations.iter().zip(masks).map(masked).sum();
            write!(table, " {:.2} |", percent(masked, points)).unwrap_or(());
        }
    }
    table.push('\n');
    table
}

/// Mixed pixels found and good points lost, station by station.
fn by_station(stations: &[Station], masks: &[(&str, Vec<Vec<bool>>)]) -> String {
    let mut table = String::from(
        "\n| station | mixed pixels | found % | good points | lost to mixed % | lost to seen-through % |\n|---|---:|---:|---:|---:|---:|\n",
    );
    for (number, station) in stations.iter().enumerate() {
        let count = |class: usize, name: &str| {
            let mask = masks.iter().find(|(own, _)| *own == name).and_then(|(_, all)| all.get(number));
            let of = station.labels.iter().enumerate().filter(|(_, label)| usize::from(**label) == class);
            let (mut all, mut masked) = (0, 0);
            for (cell, _) in of {
                all += 1;
                masked += u64::from(mask.is_some_and(|mask| mask[cell]));
            }
            (all, percent(masked, all))
        };
        let ((mixed, found), (good, lost)) = (count(MIXED, "mixed"), count(SURFACE, "mixed"));
        let (_, through) = count(SURFACE, "seen-through");
        writeln!(table, "| {} | {mixed} | {found:.1} | {good} | {lost:.2} | {through:.3} |", station.name)
            .unwrap_or(());
    }
    table
}

/// Transients whose place rays of two other stations passed, by the ray that is nearest to it, and how many of them are masked.
fn transients(stations: &[Station], masks: &[Vec<bool>]) -> String {
    let mut table = String::from(
        "\n| transients | points | passed by rays of two others | of these masked % |\n|---|---:|---:|---:|\n",
    );
    for (class, name) in CLASSES.iter().enumerate().skip(WALKER).take(3) {
        let (mut all, mut passed, mut masked) = (0, 0, 0);
        for (number, (station, mask)) in stations.iter().zip(masks).enumerate() {
            for (cell, _) in station.labels.iter().enumerate().filter(|(_, label)| usize::from(**label) == class) {
                all += 1;
                let place = site(&station.pose, station.points[cell]);
                let others = stations.iter().enumerate().filter(|(other, _)| *other != number);
                let witnesses = others.filter(|(_, other)| passes(other, place)).take(2).count();
                if witnesses == 2 {
                    passed += 1;
                    masked += u64::from(mask[cell]);
                }
            }
        }
        writeln!(table, "| {name} | {all} | {passed} | {:.1} |", percent(masked, passed)).unwrap_or(());
    }
    table
}

/// From the scan to the site.
fn site(pose: &[[f64; 3]; 4], p: [f32; 3]) -> [f64; 3] {
    let [x, y, z] = p.map(f64::from);
    std::array::from_fn(|k| pose[0][k] * x + pose[1][k] * y + pose[2][k] * z + pose[3][k])
}

/// Whether the ray of a station that is nearest to a place went farther.
fn passes(station: &Station, place: [f64; 3]) -> bool {
    let d: [f64; 3] = std::array::from_fn(|k| place[k] - station.pose[3][k]);
    let [x, y, z] = std::array::from_fn(|axis| (0..3).map(|k| station.pose[axis][k] * d[k]).sum::<f64>());
    let range = (x * x + y * y + z * z).sqrt();
    let turn = y.atan2(x).rem_euclid(TAU) / TAU * station.columns as f64;
    let step = (90.0 - LOWEST) / (station.rows - 1) as f64;
    let row = (((z / range).asin().to_degrees() - LOWEST) / step).round();
    if row < 0.0 {
        return false;
    }
    let cell = turn.round() as usize % station.columns * station.rows + (row as usize).min(station.rows - 1);
    let [a, b, c] = station.points[cell].map(f64::from);
    (a * a + b * b + c * c).sqrt() > range + FARTHER
}

/// The scans in a folder, in the order of their names.
fn stations(folder: &Path) -> Result<Vec<Station>> {
    let entries = fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
    let mut files: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|end| end == "ptx"));
    files.sort();
    files.iter().map(|file| station(file)).collect()
}

fn station(file: &Path) -> Result<Station> {
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut lines = BufReader::with_capacity(1 << 20, File::open(file)?).lines();
    let mut numbers = || -> Result<Vec<f64>> {
        let line = lines.next().context("the scan ends early")??;
        line.split(' ').map(|word| word.parse().context("no number")).collect()
    };
    let columns = numbers()?[0] as usize;
    let rows = numbers()?[0] as usize;
    for _ in 0..4 {
        numbers()?;
    }
    let mut pose = [[0.0; 3]; 4];
    for column in &mut pose {
        column.copy_from_slice(&numbers()?[..3]);
    }
    let mut points = Vec::with_capacity(columns * rows);
    for _ in 0..columns * rows {
        let sample = numbers()?;
        points.push([sample[0] as f32, sample[1] as f32, sample[2] as f32]);
    }
    let truth = file.with_file_name("truth").join(format!("{name}.labels"));
    let labels = fs::read(&truth).with_context(|| format!("cannot read {}", truth.display()))?.split_off(16);
    ensure!(labels.len() == points.len(), "{name} has other labels than points");
    Ok(Station { name, columns, rows, points, labels, pose })
}

/// The bits of a mask: see `scan/src/mask/file.rs`.
fn mask(survey: &Path, station: &str, name: &str) -> Result<Vec<bool>> {
    let start = format!("{station}.{name}.");
    let entries = fs::read_dir(survey.join("stations"))?.collect::<Result<Vec<_>, _>>()?;
    let file = entries.into_iter().find(|entry| {
        let is_mask = entry.path().extension().is_some_and(|end| end == "mask");
        is_mask && entry.file_name().to_string_lossy().starts_with(&start)
    });
    let bytes = fs::read(file.with_context(|| format!("{station} has no mask {name}"))?.path())?;
    let cells = u64::from_le_bytes(bytes[16..24].try_into()?) as usize;
    Ok((0..cells).map(|cell| bytes[128 + cell / 8] >> (cell % 8) & 1 == 1).collect())
}

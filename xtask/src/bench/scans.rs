//! `cargo xtask bench scans`: importing PTX and E57 of a made-up scan: points per CPU second, peak memory, size of the spool.

use super::{archive, run_measured};
use crate::process::{cargo, compile_kilwa, root, run as run_command};
use anyhow::{Context, Result};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Points of the scan
    #[arg(long, value_name = "N", default_value_t = 10_000_000, value_parser = clap::value_parser!(u64).range(10_000..))]
    points: u64,
    /// Cargo profile of the program; figures of `dev` are for trying out only
    #[arg(long, value_name = "NAME", default_value = "release")]
    profile: String,
    /// Measure the library alone (`scan/examples/import.rs`), which compiles in a fraction of the time
    #[arg(long)]
    library: bool,
    /// Print the table without adding it to docs/bench
    #[arg(long)]
    dry: bool,
}

/// Rows of the scan.
pub(super) const ROWS: u64 = 2000;

pub(super) fn run(args: &Args) -> Result<()> {
    let root = root()?;
    let kilwa = if args.library { library(&args.profile)? } else { compile_kilwa(&args.profile)? };
    let scratch = root.join("target/bench/scans");
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let mut table = String::from(
        "| format | points | input MiB | wall s | CPU s | points / CPU s | peak MiB | spool bytes / point |\n|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for format in ["ptx", "e57"] {
        let file = scratch.join(format!("scan.{format}"));
        if format == "ptx" {
            write_ptx(&file, args.points)?;
        } else {
            write_e57(&file, args.points)?;
        }
        let survey = scratch.join(format!("survey-{format}"));
        drop(fs::remove_dir_all(&survey));
        let text = |path: &Path| path.display().to_string();
        let call = if args.library {
            vec![text(&survey), text(&file)]
        } else {
            vec!["scans".to_owned(), "import".to_owned(), text(&file), "-o".to_owned(), text(&survey)]
        };
        let used = run_measured(&kilwa, &call, &scratch.join("usage"))?;
        let points = args.points / ROWS * ROWS;
        let spool = fs::metadata(survey.join("stations/scan.scan"))?.len();
        let bytes = fs::metadata(&file)?.len();
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        writeln!(
            table,
            "| {format} | {points} | {:.0} | {:.1} | {:.1} | {:.2} M | {:.0} | {:.2} |",
            mib(bytes),
            used.wall_s,
            used.cpu_s,
            points as f64 / used.cpu_s / 1e6,
            mib(used.peak_bytes),
            spool as f64 / points as f64
        )?;
        // A scan of 200 million points takes gigabytes.
        drop(fs::remove_dir_all(&survey));
        fs::remove_file(&file).with_context(|| format!("cannot remove {}", file.display()))?;
    }
    println!("\n{table}");
    if args.dry { Ok(()) } else { archive(&root, "scans", &table, &args.profile) }
}

/// The program that only imports.
fn library(profile: &str) -> Result<PathBuf> {
    run_command(&mut cargo(&[
        "build",
        "--locked",
        "--package",
        "kilwa-scan",
        "--example",
        "import",
        "--profile",
        profile,
    ])?)?;
    let folder = if profile == "dev" { "debug" } else { profile };
    Ok(root()?.join("target").join(folder).join(format!("examples/import{}", std::env::consts::EXE_SUFFIX)))
}

/// The point in a cell: walls of a room, with millimetres of noise that are the same each time.
fn point(column: u64, row: u64, columns: u64) -> ([f64; 3], f64, [u8; 3]) {
    let noise = (column.wrapping_mul(7919).wrapping_add(row.wrapping_mul(104_729)) % 1000) as f64 * 4e-6;
    let (azimuth, elevation) = (column as f64 / columns as f64 * TAU, (row as f64 / ROWS as f64 - 0.5) * 2.6);
    let ray = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
    let range =
        ray.iter().zip([12.0, 9.0, 4.0]).map(|(d, half): (&f64, f64)| half / d.abs()).fold(f64::INFINITY, f64::min);
    let color = [(column % 256) as u8, (row % 256) as u8, 128];
    (ray.map(|d| d * (range + noise)), 1.0 / range, color)
}

pub(super) fn write_ptx(file: &Path, points: u64) -> Result<()> {
    let columns = points / ROWS;
    let mut out = BufWriter::with_capacity(1 << 20, File::create(file)?);
    write!(out, "{columns}\n{ROWS}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")?;
    for column in 0..columns {
        for row in 0..ROWS {
            let ([x, y, z], intensity, [r, g, b]) = point(column, row, columns);
            writeln!(out, "{x:.6} {y:.6} {z:.6} {intensity:.6} {r} {g} {b}")?;
        }
    }
    out.flush().context("cannot write the scan")
}

fn write_e57(file: &Path, points: u64) -> Result<()> {
    use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let columns = points / ROWS;
    let index = |name, max: u64| Record { name, data_type: RecordDataType::Integer { min: 0, max: max as i64 - 1 } };
    let prototype = vec![
        Record::CARTESIAN_X_F32,
        Record::CARTESIAN_Y_F32,
        Record::CARTESIAN_Z_F32,
        Record::INTENSITY_UNIT_F32,
        Record::COLOR_RED_U8,
        Record::COLOR_GREEN_U8,
        Record::COLOR_BLUE_U8,
        index(RecordName::RowIndex, ROWS),
        index(RecordName::ColumnIndex, columns),
    ];
    let mut writer = E57Writer::from_file(file, "bench")?;
    let mut cloud = writer.add_pointcloud("scan", prototype)?;
    for column in 0..columns {
        for row in 0..ROWS {
            let (position, intensity, color) = point(column, row, columns);
            let mut values: Vec<RecordValue> = position.map(|v| RecordValue::Single(v as f32)).to_vec();
            values.push(RecordValue::Single(intensity as f32));
            values.extend(color.map(|v| RecordValue::Integer(i64::from(v))));
            values.extend([row, column].map(|v| RecordValue::Integer(v as i64)));
            cloud.add_point(values)?;
        }
    }
    cloud.finalize()?;
    writer.finalize().context("cannot write the scan")
}

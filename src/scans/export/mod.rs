//! `kilwa scans export`.

mod mesh;

use crate::new_file::{NewFile, check_output};
use crate::progress::Bar;
use anyhow::{bail, ensure};
use glam::DVec3;
use kilwa_builder::Progress as _;
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::export::{Exported, Output, Report, Request, e57, ptx_file};
use kilwa_scan::mask;
use kilwa_scan::survey::{Station, Survey};
use serde_json::{Value, json};
use std::io::{BufWriter, Write as _};
use std::path::PathBuf;

/// Write a station as a mesh, or stations as E57 or PTX for other programs.
///
/// The mesh joins neighbouring cells of the scanner's grid. It is in survey coordinates; a station without a pose stays in scanner coordinates.
/// E57 and PTX keep the samples in scanner coordinates, with the pose, in one file for all of the named stations.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("format").required(true)))]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// The stations: one with --mesh, any number with --e57 and --ptx (default: all); `kilwa scans list` shows their names.
    #[arg(value_name = "STATION")]
    stations: Vec<String>,
    /// The file to write: .ply, .obj, .stl or .glb with --mesh, .e57 with --e57, .ptx with --ptx.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Write a mesh.
    #[arg(long, group = "format")]
    mesh: bool,
    /// Write an E57 file with grids, poses and photographs.
    #[arg(long, group = "format")]
    e57: bool,
    /// Write a PTX file with grids and poses.
    #[arg(long, group = "format")]
    ptx: bool,
    /// Divide the mesh into files of at most N triangles (FILE-001.ply and so on) with bit-identical vertices where they meet; `kilwa build` joins them.
    #[arg(long, value_name = "N", requires = "mesh", value_parser = clap::value_parser!(u32).range(1000..))]
    split: Option<u32>,
    /// Use every N-th row and column (default: the value in survey.toml, or 1).
    #[arg(long, value_name = "N", requires = "mesh", value_parser = clap::value_parser!(u32).range(1..=64))]
    subsample: Option<u32>,
    /// Longest edge in metres (default: limited only by --edge-factor).
    #[arg(long, value_name = "METRES", requires = "mesh", value_parser = positive)]
    max_edge: Option<f64>,
    /// Longest edge as a multiple of the point spacing expected from range, angular step and incidence angle (default: 3).
    #[arg(long, value_name = "FACTOR", requires = "mesh", value_parser = positive)]
    edge_factor: Option<f64>,
    /// Drop triangles whose incidence angle is larger than this, in degrees (default: 87).
    #[arg(long, value_name = "DEGREES", requires = "mesh", value_parser = angle)]
    grazing: Option<f64>,
    /// Keep only triangles whose centroid lies in this box, in survey coordinates (metres).
    #[arg(long = "box", value_name = "X0,Y0,Z0,X1,Y1,Z1", requires = "mesh", value_parser = crate::build::crop, allow_hyphen_values = true)]
    bounds: Option<[DVec3; 2]>,
    /// Also write masked samples.
    #[arg(long)]
    unmasked: bool,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|v: &f64| *v > 0.0 && v.is_finite())
        .ok_or_else(|| "expected a number greater than 0".to_owned())
}

pub(super) fn angle(text: &str) -> Result<f64, String> {
    let angle = text.parse().ok().filter(|v: &f64| *v > 0.0 && *v < 90.0);
    angle.ok_or_else(|| "expected an angle between 0 and 90 degrees".to_owned())
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    let stations = chosen(args, &survey)?;
    for station in &stations {
        if !args.unmasked {
            super::mask::warn_of_outdated(&survey, station);
        }
        if station.pose.is_none() {
            crate::terminal::say!(
                "kilwa: station {} has no pose in survey.toml; it is written in scanner coordinates",
                station.name
            );
        }
    }
    let bar = Bar::new();
    let done = match stations.as_slice() {
        [station] if args.mesh => mask::open(&args.survey, station, args.unmasked)
            .map_err(anyhow::Error::from)
            .and_then(|mut reader| mesh::export(args, &survey, station, &mut reader, &bar)),
        _ => export_points(args, &survey, stations, &bar),
    };
    bar.clear();
    done
}

/// The stations that are named, or all of them.
fn chosen<'s>(args: &Args, survey: &'s Survey) -> anyhow::Result<Vec<&'s Station>> {
    let mut stations: Vec<&Station> = Vec::new();
    for name in &args.stations {
        ensure!(stations.iter().all(|station| station.name != *name), "station {name} is given twice");
        stations.push(survey.station(name)?);
    }
    if args.stations.is_empty() {
        stations.extend(&survey.stations);
    }
    if stations.is_empty() {
        bail!("the survey {} has no stations; use `kilwa scans import`", args.survey.display());
    }
    if args.mesh && stations.len() > 1 {
        bail!("--mesh writes one station; name one of the {} stations (`kilwa scans list` shows them)", stations.len());
    }
    Ok(stations)
}

fn export_points(args: &Args, survey: &Survey, stations: Vec<&Station>, bar: &Bar) -> anyhow::Result<()> {
    let wanted = if args.e57 { "e57" } else { "ptx" };
    let has_ending = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    let format = wanted.to_uppercase();
    ensure!(has_ending, "{}: the file extension of the {format} file must be .{wanted}", args.output.display());
    let scans: Vec<PathBuf> = stations.iter().map(|station| args.survey.join(&station.scan)).collect();
    check_output(&args.output, args.force, scans.iter().map(PathBuf::as_path))?;
    let request = Request { folder: &args.survey, survey, stations, unmasked: args.unmasked };
    let cannot = |source| ScanError::Write { path: args.output.clone(), source };
    let mut file = NewFile::create(&args.output)?;
    let mut progress = |done, total| {
        show(bar, "writing", done, total);
        Ok(())
    };
    let mut output = Output { cannot: &cannot, progress: &mut progress };
    let report = if args.e57 {
        e57(&request, file.file(), &mut output)?
    } else {
        let mut out = BufWriter::with_capacity(1 << 20, file.file());
        let report = ptx_file(&request, &mut out, &mut output)?;
        out.flush().map_err(cannot)?;
        report
    };
    file.commit(args.force)?;
    bar.clear();
    print(args, &report)
}

fn print(args: &Args, report: &Report) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let shown = args.output.display().to_string();
    if args.json {
        let station = |done: &Exported| {
            json!({
                "station": done.station,
                "columns": done.grid.map(|grid| grid.columns),
                "rows": done.grid.map(|grid| grid.rows),
                "points": done.points,
                "masked": done.masked,
            })
        };
        let json = json!({
            "file": shown,
            "points": report.stations.iter().map(|done| done.points).sum::<u64>(),
            "masked": report.stations.iter().map(|done| done.masked).sum::<u64>(),
            "photographs": report.photographs,
            "scaled_intensity": report.scaled,
            "stations": report.stations.iter().map(station).collect::<Vec<Value>>(),
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(out, "{shown}: {}", counted(report.stations.len() as u64, "station", "stations"))?;
    for done in &report.stations {
        let grid = done.grid.map_or_else(String::new, |grid| format!("{} × {} cells, ", grid.columns, grid.rows));
        let points = counted(done.points, "point", "points");
        writeln!(out, "  {}: {grid}{points}{}", done.station, without(done.masked))?;
    }
    if report.photographs > 0 {
        writeln!(out, "  {}", counted(report.photographs, "photograph", "photographs"))?;
    }
    if let Some([min, max]) = report.scaled {
        writeln!(out, "  intensities from {min} to {max} scaled to 0 to 1, as PTX requires")?;
    }
    Ok(())
}

/// How many points are left out, if some are.
fn without(masked: u64) -> String {
    if masked == 0 { String::new() } else { format!(" ({masked} masked)") }
}

fn show(bar: &Bar, stage: &'static str, done: u64, total: u64) {
    bar.update(stage, done, total);
    bar.whole(done as f64 / total.max(1) as f64);
}

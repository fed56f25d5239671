//! `kilwa register`: automatic registration of the stations of a survey.

pub(crate) mod report;

use crate::new_file::{NewFile, check_output};
use crate::progress::Bar;
use anyhow::ensure;
use kilwa_builder::Progress as _;
use kilwa_pack::plural::counted;
use kilwa_scan::register::{FILE, Options, Placement, Registration, apply, register, residuals, write_residuals};
use kilwa_scan::survey::{self, Survey};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Register the stations of a survey without targets, and estimate the uncertainty of each pose.
///
/// A station is placed if enough of its surface agrees with other stations, if hardly any rays of one pass through what another saw, and if no other pose is nearly as good. A station whose pose is not unique is not
/// placed; the report gives the reason and a remedy. Poses and standard deviations are written to survey.toml, everything else to registration.json.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// Also register stations that are already registered (default: they keep their poses).
    #[arg(long)]
    again: bool,
    /// Ignore the poses stored with the scans (default: use them as initial estimates).
    #[arg(long)]
    ignore_poses: bool,
    /// Keep the pose of this station; may be given several times. Stations with `fixed = true` in survey.toml also keep theirs.
    #[arg(long, value_name = "NAME")]
    fixed: Vec<String>,
    /// Write nothing to the survey.
    #[arg(long)]
    dry_run: bool,
    /// Worker threads (default: one per core). The number does not affect the result.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = crate::build::parse_threads)]
    threads: usize,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Also write the report as an HTML page: plan, links, standard deviations, and a picture of each station that could not be placed.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Also write evenly spread samples of the registered stations as a point cloud, coloured by their distance from the surfaces that the other stations saw.
    #[arg(long, value_name = "FILE.ply")]
    residuals: Option<PathBuf>,
    /// Replace an existing report and residuals.
    #[arg(long)]
    force: bool,
}

/// The part of the progress bar that each stage fills.
const SHARES: [(&str, f64, f64); 4] = [
    ("reading stations", 0.0, 0.1),
    ("comparing stations", 0.1, 0.7),
    ("joining groups", 0.7, 0.9),
    ("adjusting all poses", 0.9, 1.0),
];

struct Shown<'b>(&'b Bar);

impl kilwa_scan::import::Progress for Shown<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.0.update(stage, done, total);
        if let Some((_, from, to)) = SHARES.iter().find(|share| share.0 == stage) {
            self.0.whole(from + (to - from) * (done as f64 / total.max(1) as f64).min(1.0));
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    for (file, extension) in [(&args.report, "html"), (&args.residuals, "ply")] {
        if let Some(file) = file {
            check_new(file, extension, args, &survey)?;
        }
    }
    ensure!(args.report.is_some() || args.residuals.is_some() || !args.force, "--force needs --report or --residuals");
    let options = Options {
        again: args.again,
        ignore_poses: args.ignore_poses,
        fixed: args.fixed.clone(),
        threads: args.threads,
    };
    let bar = Bar::new();
    let found = register(&args.survey, &survey, &options, &Shown(&bar));
    bar.clear();
    let found = found?;
    // A closed pipe or a locked survey must not lose the other outputs: a run can take an hour.
    let printed = print_result(args, &found);
    let applied = if args.dry_run { Ok(Vec::new()) } else { apply(&args.survey, &survey, &found) };
    for sentence in applied.as_ref().into_iter().flatten() {
        crate::terminal::say!("note: {sentence}");
    }
    let reported = args.report.as_ref().map_or(Ok(()), |file| write_report(file, args, &survey, &found));
    let colored = args.residuals.as_ref().map_or(Ok(()), |file| write_colored(file, args, &survey, &found));
    applied?;
    reported?;
    colored?;
    printed?;
    ensure!(
        found.unplaced.is_empty(),
        "{} could not be placed{}",
        counted(found.unplaced.len() as u64, "station", "stations"),
        if found.stations.is_empty() || args.dry_run {
            ""
        } else {
            "; the poses of the others were written to survey.toml"
        }
    );
    Ok(())
}

/// Checks, before registration starts, that a file can be written and would not replace a file of the survey.
fn check_new(file: &Path, extension: &str, args: &Args, survey: &Survey) -> anyhow::Result<()> {
    let shown = file.display();
    let is_named = file.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    ensure!(is_named || file.is_dir(), "{shown}: the file extension must be .{extension}");
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.exists()) {
        anyhow::bail!("{shown}: the folder {} does not exist; create it, or choose another folder", folder.display());
    }
    let stations = survey.stations.iter();
    let scans = stations.flat_map(|s| std::iter::once(&s.scan).chain(s.masks.iter().map(|mask| &mask.file)));
    let own = scans.map(String::as_str).chain([survey::FILE, FILE]);
    let own: Vec<PathBuf> = own.map(|file| args.survey.join(file)).collect();
    check_output(file, args.force, own.iter().map(PathBuf::as_path))
}

fn write_report(file: &Path, args: &Args, survey: &Survey, found: &Registration) -> anyhow::Result<()> {
    NewFile::write(file, report::html(&args.survey, survey, found)?.as_bytes(), args.force)?;
    crate::terminal::say!("report: {}", file.display());
    Ok(())
}

/// Writes the residuals of all registered stations and prints what the colours mean.
fn write_colored(file: &Path, args: &Args, survey: &Survey, found: &Registration) -> anyhow::Result<()> {
    let bar = Bar::new();
    let all = residuals(&args.survey, survey, found, args.threads, &Shown(&bar));
    bar.clear();
    let mut bytes = Vec::new();
    let most = write_residuals(&mut bytes, &all?)?;
    NewFile::write(file, &bytes, args.force)?;
    let millimetres = 1e3 * most;
    crate::terminal::say!(
        "residuals: {}; strongest blue: {millimetres:.1} mm or more behind what other stations saw; strongest red: as far in front of it",
        file.display()
    );
    Ok(())
}

fn print_result(args: &Args, found: &Registration) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_line(&serde_json::to_value(found)?)?)?;
        return Ok(());
    }
    print(&mut out, found)
}

fn print(out: &mut impl std::io::Write, found: &Registration) -> anyhow::Result<()> {
    for station in &found.stations {
        let [metres, radians] = station.sigma();
        let how = match station.placement {
            Placement::Anchor => "anchor; its pose defines the coordinate system of the survey".to_owned(),
            Placement::Fixed => "kept its pose".to_owned(),
            Placement::Control => format!("by control points, {}", sigma(metres, radians)),
            Placement::Surface => sigma(metres, radians),
        };
        writeln!(out, "{}: {how}", station.name)?;
    }
    for station in &found.unplaced {
        writeln!(out, "{}: NOT PLACED: {}. Remedy: {}.", station.name, station.reason, station.remedy)?;
    }
    if let Some(worst) = found.links.iter().max_by(|a, b| a.residual.total_cmp(&b.residual)) {
        let [a, b] = &worst.stations;
        let links = counted(found.links.len() as u64, "link", "links");
        writeln!(out, "{links}; the largest residual is {:.1} mm, between {a} and {b}", 1e3 * worst.residual)?;
    }
    for note in &found.notes {
        writeln!(out, "note: {note}")?;
    }
    if found.weakest_chain.len() > 1 {
        writeln!(out, "weakest chain: {}", found.weakest_chain.join(" – "))?;
    }
    Ok(())
}

fn sigma(metres: f64, radians: f64) -> String {
    format!("standard deviations {:.1} mm and {:.4}°", 1e3 * metres, radians.to_degrees())
}

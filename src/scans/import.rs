//! `kilwa scans import`.

use crate::inputs;
use crate::named_files::{Wanted, named};
use crate::progress::Bar;
use glam::DVec3;
use kilwa_builder::Progress as _;
use kilwa_geometry::LengthUnit;
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::import::{Imported, Options, Progress, Report, import};
use kilwa_scan::read::{self, ReadOptions};
use kilwa_scan::survey::Survey;
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Import scan files into a survey.
///
/// Reads PTX, PTS, E57, LAS, LAZ, PLY (range grids and clouds) and XYZ text. Grids, poses, intensities and colours are kept; photographs
/// inside E57 files are extracted. Use --resume to continue an interrupted import.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// Scan files, folders of them, or quoted patterns such as 'scans/*.ptx'.
    #[arg(required = true, value_name = "FILES")]
    files: Vec<PathBuf>,
    /// The survey folder; new stations are added to an existing survey.
    #[arg(short, long, value_name = "SURVEY")]
    output: PathBuf,
    /// Skip stations that are already in the survey, for example after an interrupted import.
    #[arg(long)]
    resume: bool,
    /// Scanner position in the coordinates of the files, for point clouds that do not include one.
    #[arg(long, value_name = "X,Y,Z", value_parser = inputs::origin, allow_hyphen_values = true)]
    station: Option<DVec3>,
    /// Use --station also for scans that state a scanner position, because their points are not relative to the scanner.
    #[arg(long, requires = "station")]
    override_position: bool,
    /// Units of the files: m, dm, cm, mm, km, ft, us-ft, in; E57 is always in metres.
    #[arg(long, default_value = "m", value_parser = inputs::units)]
    units: LengthUnit,
    /// Import truncated scans, which have fewer points than their header states.
    #[arg(long)]
    keep_incomplete: bool,
    /// Also read files outside an input folder that symbolic links in it point to.
    #[arg(long)]
    allow_outside: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

const SCANS: Wanted = Wanted {
    what: "scan",
    formats: "PTX, PTS, E57, LAS, LAZ, PLY, XYZ",
    is_named: read::is_named_as_scan,
    recognise: |path| Ok(read::recognise(path).map(drop)?),
};

struct Shown(Bar);

impl Progress for Shown {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.0.update(stage, done, total);
        self.0.whole(done as f64 / total.max(1) as f64);
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (files, passed_over) = named(&args.files, args.allow_outside, &SCANS)?;
    if let Some(first) = passed_over.first() {
        let count = passed_over.len();
        crate::terminal::say!(
            "kilwa: skipped files that are not scans ({count}), the first of them {}",
            first.display()
        );
    }
    let read = ReadOptions {
        station: args.station,
        override_position: args.override_position,
        units: args.units,
        keep_incomplete: args.keep_incomplete,
    };
    let bar = Shown(Bar::new());
    let before = stations(&args.output);
    let done = import(&args.output, &files, &Options { read, resume: args.resume }, &bar);
    bar.0.clear();
    let report = done.map_err(|e| explained(e, stations(&args.output) > before))?;
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_line(&as_json(&report))?)?;
        return Ok(());
    }
    for Imported { station, header } in &report.stations {
        let grid = if header.is_grid {
            format!("{} × {}", header.grid.columns, header.grid.rows)
        } else {
            "no grid".to_owned()
        };
        let points = counted(header.statistics.measured, "point", "points");
        writeln!(out, "{}: {points}, {grid}, from {} ({})", station.name, station.source.file, station.source.number)?;
    }
    if !report.skipped.is_empty() {
        writeln!(
            out,
            "{} already in the survey; skipped",
            counted(report.skipped.len() as u64, "station is", "stations are")
        )?;
    }
    if report.photographs > 0 {
        writeln!(out, "{} extracted from the files", counted(report.photographs as u64, "photograph", "photographs"))?;
    }
    for (file, diagnostics) in &report.diagnostics {
        for (kind, count, places) in diagnostics.iter() {
            let first = places.first().map_or_else(String::new, |place| format!(" (first: {place})"));
            writeln!(out, "{}: {kind}: {count}{first}", file.display())?;
        }
    }
    Ok(())
}

/// An error with what the user can do about an import that stopped in the middle; `has_more` stations than before are in the survey.
fn explained(e: ScanError, has_more: bool) -> anyhow::Error {
    let e = anyhow::Error::from(e);
    if has_more {
        e.context("the stations before this one were imported; run the same command with --resume to continue")
    } else {
        e
    }
}

/// How many stations the survey has, as far as it can be read.
fn stations(survey: &Path) -> usize {
    Survey::open(survey).map_or(0, |survey| survey.stations.len())
}

fn as_json(report: &Report) -> serde_json::Value {
    let stations: Vec<_> = report.stations.iter().map(|s| super::list::as_json(&s.station, Some(&s.header))).collect();
    let diagnostics: Vec<_> = report
        .diagnostics
        .iter()
        .flat_map(|(file, all)| {
            all.iter().map(move |(kind, count, places)| {
                json!({"file": file.display().to_string(), "what": kind, "count": count, "places": places})
            })
        })
        .collect();
    json!({
        "stations": stations,
        "skipped": report.skipped,
        "photographs": report.photographs,
        "diagnostics": diagnostics,
    })
}

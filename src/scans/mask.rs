//! `kilwa scans mask`.

use crate::progress::Bar;
use glam::DVec3;
use kilwa_builder::Progress as _;
use kilwa_pack::plural::counted;
use kilwa_scan::import::Progress;
use kilwa_scan::mask::{self, MaskReader, Numbering, Recipe, Report, Request};
use kilwa_scan::survey::Survey;
use kilwa_scan_core::mask::mixed;
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Mask samples that are not part of the site.
///
/// Scans are never changed: a mask is a file beside the scan, which can be turned off or removed. Masks that are on are left out by `kilwa scans export` and
/// `kilwa build`. A new mask replaces an earlier one of the same name. Several kinds can be given at once.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("task").required(true).multiple(true)))]
#[command(group(clap::ArgGroup::new("kind").multiple(true)))]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// Mixed pixels: samples between a surface and the one behind it. Values above 1 mask more, values below 1 mask less.
    #[arg(long, group = "task", group = "kind", value_name = "STRICTNESS", num_args = 0..=1, require_equals = true, default_missing_value = "1", value_parser = positive)]
    mixed: Option<f64>,
    /// Connected components of fewer than N samples.
    #[arg(long, group = "task", group = "kind", value_name = "N", num_args = 0..=1, require_equals = true, default_missing_value = "30", value_parser = clap::value_parser!(u32).range(2..))]
    isolated: Option<u32>,
    /// Samples with an incidence angle larger than this, in degrees.
    #[arg(long, group = "task", group = "kind", value_name = "DEGREES", num_args = 0..=1, require_equals = true, default_missing_value = "85", value_parser = super::export::angle)]
    grazing: Option<f64>,
    /// Samples in this box of the survey, in metres.
    #[arg(long, group = "task", group = "kind", value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = crate::build::crop, allow_hyphen_values = true)]
    inside: Option<[DVec3; 2]>,
    /// Samples that are not in this box of the survey, in metres.
    #[arg(long, group = "task", group = "kind", value_name = "X0,Y0,Z0,X1,Y1,Z1", value_parser = crate::build::crop, allow_hyphen_values = true)]
    outside: Option<[DVec3; 2]>,
    /// Samples whose intensity, in the units of the imported file, is below MIN or above MAX.
    #[arg(long, group = "task", group = "kind", value_name = "MIN,MAX", value_parser = limits, allow_hyphen_values = true)]
    intensity: Option<[f32; 2]>,
    /// Samples listed in a file by another program: the index of each in the scan, counted from 0, one per line.
    #[arg(long, group = "task", group = "kind", value_name = "FILE")]
    points: Option<PathBuf>,
    /// Samples that rays of other stations pass through: people and moved objects. Needs poses.
    #[arg(long, group = "task", group = "kind")]
    seen_through: bool,
    /// The column of the index in the list, from 1.
    #[arg(long, value_name = "N", requires = "points", value_parser = column)]
    column: Option<usize>,
    /// What indices count: every cell of the grid (default for PTX), or measured points only (default for other formats).
    #[arg(long, value_enum, value_name = "WHAT", requires = "points")]
    numbering: Option<NumberingArg>,
    /// How many other stations must have seen through a sample.
    #[arg(long, value_name = "N", requires = "seen_through", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=15))]
    witnesses: u8,
    /// How far beyond the sample the rays of those stations must reach, in metres.
    #[arg(long, value_name = "METRES", requires = "seen_through", default_value_t = 0.1, value_parser = positive)]
    margin: f64,
    /// The name of the mask (default: its kind).
    #[arg(long, value_name = "NAME", requires = "kind")]
    name: Option<String>,
    /// Only this station; can be given several times.
    #[arg(long, value_name = "STATION")]
    station: Vec<String>,
    /// List the masks of each station.
    #[arg(long, group = "task", conflicts_with = "kind")]
    list: bool,
    /// Turn a mask on.
    #[arg(long, group = "task", value_name = "NAME", conflicts_with_all = ["kind", "list"])]
    on: Option<String>,
    /// Turn a mask off.
    #[arg(long, group = "task", value_name = "NAME", conflicts_with_all = ["kind", "list", "on"])]
    off: Option<String>,
    /// Remove a mask with its files.
    #[arg(long, group = "task", value_name = "NAME", conflicts_with_all = ["kind", "list", "on", "off"])]
    remove: Option<String>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum NumberingArg {
    /// Every cell of the grid.
    Cells,
    /// Measured points only.
    Points,
}

fn positive(text: &str) -> Result<f64, String> {
    super::export::positive(text)
}

fn column(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|n| *n > 0).ok_or_else(|| "expected a column number of 1 or more".to_owned())
}

fn limits(text: &str) -> Result<[f32; 2], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some([min, max]) if min < max => Ok([*min, *max]),
        Some([_, _]) => Err("the first limit must be below the second".to_owned()),
        _ => Err("expected two numbers, MIN,MAX".to_owned()),
    }
}

struct Shown(Bar);

impl Progress for Shown {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.0.update(stage, done, total);
        self.0.whole(done as f64 / total.max(1) as f64);
    }
}

impl Args {
    fn recipes(&self) -> Vec<Recipe> {
        let numbering = self.numbering.map(|numbering| match numbering {
            NumberingArg::Cells => Numbering::Cells,
            NumberingArg::Points => Numbering::Points,
        });
        let points = |list: &PathBuf| Recipe::Points { list: list.clone(), column: self.column, numbering };
        let through = Recipe::SeenThrough { witnesses: self.witnesses, margin: self.margin };
        let all = [
            self.mixed.map(|strictness| Recipe::Mixed(mixed::Options { strictness })),
            self.isolated.map(|min| Recipe::Isolated { min }),
            self.grazing.map(|limit| Recipe::Grazing { limit }),
            self.inside.map(Recipe::Inside),
            self.outside.map(Recipe::Outside),
            self.intensity.map(Recipe::Intensity),
            self.points.as_ref().map(points),
            self.seen_through.then_some(through),
        ];
        all.into_iter().flatten().collect()
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = &args.survey;
    if args.list {
        return list(args);
    }
    if let Some(name) = &args.remove {
        let stations = mask::remove(folder, name, &args.station)?;
        return switched(args, name, "removed", &stations);
    }
    for (name, is_on) in [(&args.on, true), (&args.off, false)] {
        if let Some(name) = name {
            let stations = mask::switch(folder, name, &args.station, is_on)?;
            return switched(args, name, if is_on { "on" } else { "off" }, &stations);
        }
    }
    let recipes = args.recipes();
    anyhow::ensure!(
        args.name.is_none() || recipes.len() == 1,
        "--name applies to one mask; make the masks one after the other, each with its own --name"
    );
    let mut made = Vec::new();
    for recipe in recipes {
        let name = args.name.clone().unwrap_or_else(|| recipe.kind().to_owned());
        let bar = Shown(Bar::new());
        let request = Request { name, recipe, stations: args.station.clone() };
        let report = mask::make(folder, &request, &bar);
        bar.0.clear();
        let report = report?;
        if !args.json {
            print(folder, &request, &report)?;
        }
        made.push((request, report));
    }
    if args.json {
        let masks: Vec<_> = made.iter().map(|(request, report)| as_json(request, report)).collect();
        writeln!(crate::terminal::out(), "{}", crate::terminal::json_line(&json!({ "masks": masks }))?)?;
    }
    Ok(())
}

fn percent(part: u64, of: u64) -> f64 {
    100.0 * part as f64 / of.max(1) as f64
}

fn print(folder: &Path, request: &Request, report: &Report) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if !report.without_pose.is_empty() {
        let names = report.without_pose.join(", ");
        crate::terminal::say!("kilwa: stations without a pose were not used for the check: {names}");
    }
    for made in &report.stations {
        let points = counted(made.measured, "point", "points");
        let share = percent(made.masked, made.measured);
        writeln!(out, "{}: {} masks {} of {points} ({share:.2} %)", made.station, request.name, made.masked)?;
    }
    let (masked, measured) = sums(report);
    if report.stations.len() > 1 {
        let stations = report.stations.len();
        writeln!(
            out,
            "{}: {masked} of {measured} points ({:.2} %) at {stations} stations",
            request.name,
            percent(masked, measured)
        )?;
    }
    let first = report.stations.first().map_or("STATION", |made| made.station.as_str());
    let survey = folder.display();
    writeln!(
        out,
        "to view it: kilwa scans view {survey} {first} --show mask -o mask.png; to turn it off: kilwa scans mask {survey} --off {}",
        request.name
    )?;
    Ok(())
}

fn sums(report: &Report) -> (u64, u64) {
    report.stations.iter().fold((0, 0), |(a, b), made| (a + made.masked, b + made.measured))
}

fn as_json(request: &Request, report: &Report) -> serde_json::Value {
    let stations: Vec<_> = report
        .stations
        .iter()
        .map(|made| json!({"name": made.station, "points": made.measured, "masked": made.masked}))
        .collect();
    let (masked, points) = sums(report);
    json!({
        "name": request.name,
        "made": request.recipe.made(),
        "points": points,
        "masked": masked,
        "stations": stations,
        "stations_without_pose": report.without_pose,
    })
}

fn switched(args: &Args, name: &str, what: &str, stations: &[String]) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        let json = json!({"name": name, "state": what, "stations": stations});
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
    } else {
        let count = counted(stations.len() as u64, "station", "stations");
        let is = if what == "removed" {
            "removed from"
        } else if what == "on" {
            "on at"
        } else {
            "off at"
        };
        writeln!(out, "{name}: {is} {count}")?;
    }
    Ok(())
}

/// A mask of a station as lists show it.
pub(super) struct Listed {
    pub(super) name: String,
    pub(super) made: String,
    pub(super) file: String,
    pub(super) is_on: bool,
    pub(super) is_outdated: bool,
    /// Points that it masks, or why that is unknown.
    pub(super) masked: Result<u64, String>,
}

impl Listed {
    pub(super) fn as_json(&self) -> serde_json::Value {
        json!({
            "name": self.name,
            "made": self.made,
            "file": self.file,
            "on": self.is_on,
            "outdated": self.is_outdated,
            "masked": self.masked.as_ref().ok(),
            "error": self.masked.as_ref().err(),
        })
    }

    /// Remarks behind its count.
    fn remarks(&self) -> String {
        let mut remarks = String::new();
        if !self.is_on {
            remarks.push_str(" (off)");
        }
        if self.is_outdated {
            remarks.push_str(" (made with different poses; make it again)");
        }
        remarks
    }
}

/// The masks of a station.
pub(super) fn of(folder: &Path, survey: &Survey, station: &kilwa_scan::survey::Station) -> Vec<Listed> {
    let listed = |mask: &kilwa_scan::survey::Mask| {
        let reader = MaskReader::open(&folder.join(&mask.file), &mask.name);
        Listed {
            name: mask.name.clone(),
            made: mask.made.clone(),
            file: mask.file.clone(),
            is_on: mask.is_on,
            is_outdated: mask::is_outdated(mask, station, survey),
            masked: reader.map(|reader| reader.header().masked).map_err(|e| format!("{:#}", anyhow::Error::from(e))),
        }
    };
    station.masks.iter().map(listed).collect()
}

fn list(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    for name in &args.station {
        survey.station(name)?;
    }
    let is_chosen = |name: &str| args.station.is_empty() || args.station.iter().any(|station| station == name);
    let stations: Vec<_> = survey
        .stations
        .iter()
        .filter(|station| is_chosen(&station.name))
        .map(|station| (station, of(&args.survey, &survey, station)))
        .collect();
    let mut out = crate::terminal::out();
    if args.json {
        let stations: Vec<_> = stations
            .iter()
            .map(|(station, masks)| {
                json!({"name": station.name, "masks": masks.iter().map(Listed::as_json).collect::<Vec<_>>()})
            })
            .collect();
        writeln!(out, "{}", crate::terminal::json_line(&json!({ "stations": stations }))?)?;
    } else {
        for (station, masks) in &stations {
            if masks.is_empty() {
                writeln!(out, "{}: no masks", station.name)?;
            }
            for mask in masks {
                match &mask.masked {
                    Ok(masked) => writeln!(
                        out,
                        "{}: {} masks {}, made with {}{}",
                        station.name,
                        mask.name,
                        counted(*masked, "point", "points"),
                        mask.made,
                        mask.remarks()
                    )?,
                    Err(error) => writeln!(out, "{}: {} cannot be read: {error}", station.name, mask.name)?,
                }
            }
        }
    }
    let damaged = stations.iter().flat_map(|(_, masks)| masks).filter(|mask| mask.masked.is_err()).count();
    anyhow::ensure!(damaged == 0, "{} cannot be read", counted(damaged as u64, "mask", "masks"));
    Ok(())
}

/// Say on stderr which masks of a station were made with other poses.
pub(crate) fn warn_of_outdated(survey: &Survey, station: &kilwa_scan::survey::Station) {
    for mask in station.masks.iter().filter(|mask| mask.is_on && mask::is_outdated(mask, station, survey)) {
        crate::terminal::say!(
            "kilwa: the mask {} of {} was made with poses that differ from those in survey.toml; make it again with `kilwa scans mask`",
            mask.name,
            station.name
        );
    }
}

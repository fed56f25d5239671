//! `kilwa scans report`: one report of a survey, from its stations to the colours of the model.

use super::list::as_json;
use super::mask::{self, Listed};
use crate::info::grouped;
use crate::new_file::{NewFile, check_output};
use crate::register::report::{STYLE, coordinate, degrees, millimetres, percent, placement};
use anyhow::{Context as _, bail};
use askama::Template;
use kilwa_archive::html::render;
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use kilwa_scan::register::{FILE, Registration};
use kilwa_scan::spool::{Header, Reader};
use kilwa_scan::survey::{Station, Survey};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Reports of other commands are not larger than this, bytes.
const REPORT_MAX: u64 = 64 << 20;

/// Write one report of a survey: its stations with poses and masks, the merged surface with its open and filled holes, and the photographs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// The report to write: a page to read (.html), or all data for programs (.json).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The report of the merge, written by `kilwa merge --json`.
    #[arg(long, value_name = "FILE.json")]
    merge: Option<PathBuf>,
    /// The colour report, written by `kilwa colour --report`.
    #[arg(long, value_name = "FILE.json")]
    colour: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    force: bool,
}

/// The part of the output of `kilwa merge --json` that describes the surface.
#[derive(Deserialize)]
struct Merge {
    voxel: f64,
    stations: u64,
    holes: Holes,
    filled: Option<Filled>,
}

/// Number and areas (m²) of the holes, by cause.
#[derive(Deserialize)]
struct Holes {
    count: u64,
    unseen_m2: f64,
    free_m2: f64,
    dropped_m2: f64,
    no_return_m2: f64,
}

#[derive(Deserialize)]
struct Filled {
    holes: u64,
    area_m2: f64,
    triangles: u64,
}

/// The report of `kilwa colour --report`.
#[derive(Deserialize)]
struct Colour {
    vertices: u64,
    coloured_share: f64,
    photographs: Vec<Photograph>,
    left_out: Vec<LeftOut>,
}

#[derive(Deserialize)]
struct Photograph {
    name: String,
    /// Metres.
    position: [f64; 3],
    mask: Option<String>,
    refined: Option<Refined>,
    /// Number of vertices that it sees.
    seen: u64,
    /// Its share of the colours, in vertices.
    share: f64,
    /// Number of vertices for which it was dropped.
    dropped: u64,
    /// For each channel.
    gain: [f64; 3],
}

#[derive(Deserialize)]
struct Refined {
    moved_px: f64,
    residual_px: f64,
}

#[derive(Deserialize)]
struct LeftOut {
    name: String,
    why: String,
    /// The picture that shows why.
    overlay: Option<String>,
}

#[derive(Template)]
#[template(path = "survey.html")]
struct Page<'a> {
    style: &'static str,
    title: &'a str,
    summary: String,
    crs: Option<&'a str>,
    /// Further messages of the registration.
    notes: &'a [String],
    stations: Vec<StationRow<'a>>,
    unplaced: Vec<[&'a str; 3]>,
    surface: Vec<[String; 2]>,
    colours: Option<String>,
    photographs: Vec<PhotographRow<'a>>,
    left_out: &'a [LeftOut],
}

struct StationRow<'a> {
    name: &'a str,
    file: &'a str,
    placement: &'static str,
    /// Position, standard deviations, points.
    numbers: [String; 6],
    masks: String,
}

struct PhotographRow<'a> {
    name: &'a str,
    /// Position, refinement, vertices seen, share, vertices for which it was dropped, gain.
    numbers: [String; 9],
    has_mask: bool,
}

/// A station with the contents of its files.
struct Scanned<'a> {
    station: &'a Station,
    header: Header,
    masks: Vec<Listed>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let own = ["survey.toml", FILE].map(|name| args.survey.join(name));
    let inputs = [&args.merge, &args.colour].into_iter().flatten().chain(&own).map(PathBuf::as_path);
    let is_page = match args.output.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("html" | "htm") => true,
        Some("json") => false,
        _ => bail!("{}: the name of the report must end in .html or .json", args.output.display()),
    };
    check_output(&args.output, args.force, inputs)?;
    let survey = Survey::open(&args.survey)?;
    let registration = Registration::open(&args.survey)?.map(|found| found.with_current_names(&survey));
    let merge = args.merge.as_deref().map(|path| open(path, "kilwa merge --json")).transpose()?;
    // The report for a pack contains that of the merge.
    let merge = merge.map(|mut report| match report.get_mut("merge").map(Value::take) {
        Some(merge) => merge,
        None => report,
    });
    let colour = args.colour.as_deref().map(|path| open(path, "kilwa colour --report FILE.json")).transpose()?;
    let stations: Vec<Scanned<'_>> =
        survey.stations.iter().map(|station| scanned(&args.survey, &survey, station)).collect::<Result<_, _>>()?;
    let text = if is_page {
        let merge = merge.map(|v| typed::<Merge>(v, args.merge.as_deref(), "kilwa merge --json")).transpose()?;
        let wanted = "kilwa colour --report FILE.json";
        let colour = colour.map(|v| typed::<Colour>(v, args.colour.as_deref(), wanted)).transpose()?;
        page(&survey, registration.as_ref(), &stations, merge.as_ref(), colour.as_ref())
    } else {
        let list = stations.iter().map(|one| {
            let mut json = as_json(one.station, Some(&one.header));
            json["sigma"] =
                json!(Registration::known_sigma(registration.as_ref(), one.station).map(|s| s.deviations()));
            json["masks"] = one.masks.iter().map(Listed::as_json).collect();
            json
        });
        crate::terminal::json_text(&json!({
            "title": survey.title,
            "crs": survey.crs,
            "stations": list.collect::<Vec<_>>(),
            "registration": registration,
            "merge": merge,
            "colour": colour,
        }))?
    };
    NewFile::write(&args.output, text.as_bytes(), args.force)?;
    let mut out = crate::terminal::out();
    writeln!(out, "{}: {}", args.output.display(), counted(stations.len() as u64, "station", "stations"))?;
    Ok(())
}

/// A report of another command.
fn open(path: &Path, command: &str) -> anyhow::Result<Value> {
    let shown = path.display();
    let text = plain_file::read_at(path, REPORT_MAX).with_context(|| format!("cannot read {shown}"))?;
    serde_json::from_slice(&text).with_context(|| format!("{shown} is not JSON; give the report of `{command}`"))
}

fn typed<T: DeserializeOwned>(report: Value, path: Option<&Path>, command: &str) -> anyhow::Result<T> {
    let shown = path.unwrap_or_else(|| Path::new("")).display();
    serde_json::from_value(report).with_context(|| format!("{shown} is not the report of `{command}`"))
}

fn scanned<'a>(folder: &Path, survey: &Survey, station: &'a Station) -> anyhow::Result<Scanned<'a>> {
    let header = *Reader::open(&folder.join(&station.scan))
        .with_context(|| format!("station {} cannot be read", station.name))?
        .header();
    Ok(Scanned { station, header, masks: mask::of(folder, survey, station) })
}

fn page(
    survey: &Survey,
    registration: Option<&Registration>,
    stations: &[Scanned<'_>],
    merge: Option<&Merge>,
    colour: Option<&Colour>,
) -> String {
    let unplaced = registration.map_or(&[][..], |found| &found.unplaced);
    render(&Page {
        style: STYLE,
        title: survey.title.as_deref().filter(|title| !title.trim().is_empty()).unwrap_or("a survey"),
        summary: summary(stations, colour),
        crs: survey.crs.as_deref(),
        notes: registration.map_or(&[], |found| &found.notes),
        stations: stations.iter().map(|one| station_row(one, registration)).collect(),
        unplaced: unplaced.iter().map(|one| [one.name.as_str(), one.reason.as_str(), one.remedy.as_str()]).collect(),
        surface: merge.map(surface).unwrap_or_default(),
        colours: colour.map(|colour| {
            format!(
                "{} of {} vertices have the colours of {}.",
                percent(colour.coloured_share),
                grouped(colour.vertices),
                counted(colour.photographs.len() as u64, "photograph", "photographs")
            )
        }),
        photographs: colour.map_or(&[][..], |colour| &colour.photographs).iter().map(photograph_row).collect(),
        left_out: colour.map_or(&[], |colour| &colour.left_out),
    })
}

fn summary(stations: &[Scanned<'_>], colour: Option<&Colour>) -> String {
    let points: u64 = stations.iter().map(|one| one.header.statistics.measured).sum();
    let photographs = colour.map(|colour| {
        let used = counted(colour.photographs.len() as u64, "photograph", "photographs");
        format!("; {used} used, {} left out", colour.left_out.len())
    });
    let stations = counted(stations.len() as u64, "station", "stations");
    format!("{stations} with {} points{}.", grouped(points), photographs.unwrap_or_default())
}

fn station_row<'a>(one: &Scanned<'a>, registration: Option<&Registration>) -> StationRow<'a> {
    let none = || "–".to_owned();
    let station = one.station;
    let [x, y, z] =
        station.pose.map_or_else(|| [none(), none(), none()], |pose| pose.translation.to_array().map(coordinate));
    // A pose that was changed after the registration is no longer a registered one.
    let placed = registration.and_then(|found| found.of(station));
    let sigma = Registration::known_sigma(registration, station).map(|sigma| sigma.deviations());
    let [metres, radians] = sigma.map_or_else(|| [none(), none()], |[m, r]| [millimetres(m), degrees(r)]);
    let measured = one.header.statistics.measured;
    let masks = one.masks.iter().map(|mask| {
        let share = match &mask.masked {
            Ok(points) => percent(*points as f64 / measured.max(1) as f64),
            Err(why) => format!("cannot be read ({why})"),
        };
        let off = if mask.is_on { "" } else { ", off" };
        let outdated = if mask.is_outdated { ", made with different poses" } else { "" };
        format!("{} {share}{off}{outdated}", mask.name)
    });
    StationRow {
        name: &station.name,
        file: &station.source.file,
        placement: match (placed, station.pose) {
            (Some(placed), _) => placement(placed),
            (None, Some(_)) => "given pose",
            (None, None) => "not placed",
        },
        numbers: [x, y, z, metres, radians, grouped(measured)],
        masks: masks.collect::<Vec<_>>().join("; "),
    }
}

/// Names and values that describe the surface and its holes.
fn surface(merge: &Merge) -> Vec<[String; 2]> {
    let area = |m2: f64| format!("{m2:.2} m²");
    let row = |name: &str, value: String| [name.to_owned(), value];
    let holes = &merge.holes;
    let mut rows = vec![
        row("Stations merged", grouped(merge.stations)),
        row("Voxel size", format!("{} mm", millimetres(merge.voxel))),
        row("Number of holes", grouped(holes.count)),
        row("Holes seen by no station", area(holes.unseen_m2)),
        row("Holes seen through (openings)", area(holes.free_m2)),
        row("Holes measured but dropped", area(holes.dropped_m2)),
        row("Holes with no return", area(holes.no_return_m2)),
    ];
    if let Some(filled) = &merge.filled {
        rows.push(row(
            "Filled",
            format!(
                "{}, {}, {}",
                counted(filled.holes, "hole", "holes"),
                area(filled.area_m2),
                counted(filled.triangles, "triangle", "triangles")
            ),
        ));
    }
    rows
}

fn photograph_row(photo: &Photograph) -> PhotographRow<'_> {
    let [x, y, z] = photo.position.map(coordinate);
    let refined = |pixels: fn(&Refined) -> f64| {
        photo.refined.as_ref().map_or_else(|| "–".to_owned(), |refined| format!("{:.2}", pixels(refined)))
    };
    let mean = photo.gain.iter().sum::<f64>() / 3.0;
    PhotographRow {
        name: &photo.name,
        numbers: [
            x,
            y,
            z,
            refined(|r| r.moved_px),
            refined(|r| r.residual_px),
            grouped(photo.seen),
            grouped(photo.share.round().max(0.0) as u64),
            grouped(photo.dropped),
            format!("{mean:.2}"),
        ],
        has_mask: photo.mask.is_some(),
    }
}

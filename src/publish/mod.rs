//! `kilwa publish`: a pack and its metadata become an archive object.
//!
//! `plan` reads and checks everything and changes nothing; `progress` shows one bar for all stages; `pictures` draws; `write` puts the object on disk through
//! `kilwa_archive::draft`; `remote` sends it to a server by `send`, `store` to an S3-compatible store; `mapping` shows where each field goes; `notes` puts notes on the model into it, `holes` the list of the holes of its surface, `tiles` 3D Tiles, `photographs` the colour report and the photographs; `withdraw` leaves a tombstone.

mod copies;
mod holes;
mod mapping;
mod notes;
mod photographs;
mod pictures;
mod plan;
mod progress;
mod remote;
mod send;
mod store;
mod tiles;
mod withdraw;
mod write;

use crate::tiles::{ProfileArg, parse_geoid_offset};
use anyhow::{Context, ensure};
use kilwa_archive::date::{day_of, is_day};
use kilwa_pack::plural::counted;
pub(crate) use plan::read_metadata;
use progress::Progress;
use serde::Serialize;
use std::io::Write as _;
use std::path::PathBuf;

/// Publish a pack as an archive object: a folder with the viewer, metadata, pictures, citations and checksums.
///
/// Creates DIR/NAME/, or adds a version to it. Nothing is written before everything has been checked; published files never
/// change. `kilwa metadata init` writes the metadata file to begin with.
#[derive(clap::Args, Clone)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The pack.
    #[arg(required_unless_present = "withdraw")]
    pack: Option<PathBuf>,
    /// The folder of the objects, created if missing; the address of a server that takes uploads; or `s3://bucket/prefix`.
    #[arg(long, value_name = "DIR|URL")]
    to: PathBuf,
    /// What is known about the model, a TOML file.
    #[arg(long, value_name = "FILE", required_unless_present = "withdraw")]
    metadata: Option<PathBuf>,
    /// What is new in this version; needed for every version after the first.
    #[arg(long, value_name = "TEXT")]
    version_note: Option<String>,
    /// Notes on the model, as the viewer saves them (Web Annotations): they become part of the version, and its page shows them.
    #[arg(long, value_name = "FILE")]
    notes: Option<PathBuf>,
    /// Publish without notes, although the previous version has some.
    #[arg(long, conflicts_with = "notes")]
    no_notes: bool,
    /// The list of holes that `kilwa merge --holes` wrote for this surface. It becomes part of the version, and the model's page can show the holes.
    #[arg(long, value_name = "FILE")]
    holes: Option<PathBuf>,
    /// Also publish all levels of detail as 3D Tiles, for CesiumJS and other viewers: compressed for browsers (web, the default), or without extensions for
    /// QGIS, Unreal and Blender (plain). Not for uploads.
    #[arg(long, value_name = "PROFILE", num_args = 0..=1, require_equals = true, default_missing_value = "web")]
    tiles: Option<ProfileArg>,
    /// With --tiles: height of the geoid above the ellipsoid at the site, in metres. It is added to all heights, because the globe needs ellipsoidal heights.
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, requires = "tiles", value_parser = parse_geoid_offset)]
    geoid_offset: Option<f64>,
    /// The report that `kilwa colour --report` wrote with this pack. It becomes part of the version, and its paradata list every photograph.
    #[arg(long, value_name = "FILE")]
    colour_report: Option<PathBuf>,
    /// Also publish the photographs that the colours come from, and their masks: the folder that contains them. The metadata must state their rights in
    /// [photographs].
    #[arg(long, value_name = "DIR", requires = "colour_report")]
    photos: Option<PathBuf>,
    /// Publish as a new version of the object with this name, however different it looks.
    #[arg(long)]
    same_object: bool,
    /// Give more people access to the object than before, including its earlier versions. Not for uploads.
    #[arg(long)]
    open_access: bool,
    /// Date of publication (default: that of the metadata, of SOURCE_DATE_EPOCH, or today).
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = parse_day)]
    date: Option<String>,
    /// Also wrap the object as a BagIt bag, DIR/NAME.bag, for deposit.
    #[arg(long)]
    bag: bool,
    /// Remove the location from everything that is written; with a number, keep the cell of a grid with this spacing in metres.
    #[arg(long, value_name = "METRES", num_args = 0..=1, require_equals = true, default_missing_value = "nowhere", value_parser = parse_place)]
    redact_location: Option<crate::redact::Place>,
    /// With --redact-location, keep this scalar channel; others are dropped, because scans may store coordinates as channels. Repeat for
    /// several. A channel whose values are coordinates or heights is refused.
    #[arg(long, value_name = "NAME", requires = "redact_location")]
    keep_channel: Vec<String>,
    /// Check everything and show which field goes where; write nothing.
    #[arg(long)]
    dry_run: bool,
    /// Also write the pages of the whole folder: catalogue, feeds, sitemap. Pages that list the model already are updated without this, too.
    #[arg(long)]
    site: bool,
    /// Withdraw an object instead: its files are moved to --keep, a page that says so remains, and pages of the folder that list it are updated.
    #[arg(long, value_name = "NAME", requires = "reason", requires = "keep", conflicts_with_all = ["pack", "metadata", "version_note", "notes", "no_notes", "holes", "tiles", "colour_report", "photos", "bag", "redact_location", "keep_channel"])]
    withdraw: Option<String>,
    /// The reason for the withdrawal, which is public.
    #[arg(long, value_name = "TEXT", requires = "withdraw")]
    reason: Option<String>,
    /// Where to move the files of a withdrawn object: a folder outside DIR.
    #[arg(long, value_name = "FOLDER", requires = "withdraw")]
    keep: Option<PathBuf>,
    /// A file with the token for the server (default: the environment variable KILWA_TOKEN).
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Address of a store that is not Amazon's, for --to s3://… (default: AWS_ENDPOINT_URL); keys come from AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY.
    #[arg(long, value_name = "URL")]
    s3_endpoint: Option<String>,
    /// Send the token over http even to other computers, where everybody on the way can read it.
    #[arg(long)]
    allow_http: bool,
    /// Use the viewer page of this folder (a built www/dist) instead of the one in this program.
    #[arg(long, value_name = "DIR")]
    www: Option<PathBuf>,
    /// Draw with a software renderer even if there is a graphics card.
    #[arg(long)]
    software: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

fn parse_day(text: &str) -> Result<String, String> {
    if is_day(text) { Ok(text.to_owned()) } else { Err("expected a date such as 2026-11-21".to_owned()) }
}

fn parse_place(text: &str) -> Result<crate::redact::Place, String> {
    if text == "nowhere" {
        return Ok(crate::redact::Place::Nowhere);
    }
    match text.parse::<f64>() {
        Ok(cell) if cell.is_finite() && cell > 0.0 => Ok(crate::redact::Place::Cell(cell)),
        _ => Err("expected metres, for example --redact-location=10000, or no value".to_owned()),
    }
}

/// What `--json` prints.
#[expect(clippy::struct_excessive_bools, reason = "each is an independent fact, printed under its name")]
#[derive(Serialize)]
struct Report {
    object: String,
    slug: String,
    version: u32,
    published: String,
    /// It was there before, from an earlier run; nothing was added.
    already: bool,
    /// Its geometry can be read by its owner and the group of the folder alone.
    closed: bool,
    /// For a closed model: whether only its owner can read it, because the owner is not in that group.
    #[serde(skip)]
    owner_only: bool,
    files: usize,
    bytes: u64,
    pack: kilwa_archive::PackEntry,
    /// How many notes it has.
    notes: usize,
    /// How many holes its list has.
    holes: usize,
    /// How many 3D Tiles it has.
    tiles: u64,
    #[serde(flatten)]
    colour_files: photographs::ColourFiles,
    #[serde(skip_serializing_if = "Option::is_none")]
    bag: Option<String>,
    /// Whether the pages of the folder were written.
    pages: bool,
    /// What could not be made, and why.
    left_out: Vec<String>,
    /// What is hardly meant.
    warnings: Vec<String>,
    /// What would make the object better.
    advice: Vec<String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(address) = remote::address(args) {
        return remote::run(args, address);
    }
    if let Some(address) = store::address(args) {
        return store::run(args, address);
    }
    ensure!(
        args.token_file.is_none() && !args.allow_http && args.s3_endpoint.is_none(),
        "--token-file and --allow-http are for servers, --s3-endpoint for stores; --to {} is a folder",
        args.to.display()
    );
    if let Some(slug) = &args.withdraw {
        return withdraw::run(args, slug);
    }
    let mut plan = plan::Plan::for_folder(args)?;
    if args.dry_run {
        plan.given.prepare_photographs()?;
        return mapping::print(args, &plan);
    }
    let progress = Progress::new(&write::stages(args, &plan), plan.given.lengths());
    let report = write::run(args, &mut plan, &progress)?;
    progress.end();
    say(args, &report)
}

/// Print what was done.
fn say(args: &Args, report: &Report) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(&report)?)?;
        return Ok(());
    }
    let Report { object, version, files, .. } = report;
    if report.already {
        let around =
            [(report.bag.is_some(), "its bag was made"), (report.pages, "the pages of the folder were written")];
        let around: Vec<&str> = around.into_iter().filter(|(is, _)| *is).flat_map(|(_, what)| ["; ", what]).collect();
        let around = around.concat();
        let day = &report.published;
        writeln!(out, "{object}: version {version} of {day} is already published; nothing was added{around}")?;
        return Ok(());
    }
    writeln!(
        out,
        "{object}: version {version} published, {}, {}",
        counted(*files, "file", "files"),
        kilwa_files::size::text(report.bytes)
    )?;
    if report.closed {
        let whom = if report.owner_only {
            "you".to_owned()
        } else {
            format!("you and the group of {}; the server must be in that group", args.to.display())
        };
        writeln!(out, "  not public: the pack and preview can be read only by {whom}")?;
    }
    if report.notes > 0 {
        writeln!(out, "  with {}", counted(report.notes, "note", "notes"))?;
    }
    if report.holes > 0 {
        writeln!(out, "  with a list of {}", counted(report.holes, "hole", "holes"))?;
    }
    if report.tiles > 0 {
        writeln!(out, "  with {}", counted(report.tiles, "3D tile", "3D tiles"))?;
    }
    report.colour_files.print(&mut out)?;
    for line in &report.left_out {
        writeln!(out, "  left out: {line}")?;
    }
    for line in &report.warnings {
        writeln!(out, "  is this meant? {line}")?;
    }
    for line in &report.advice {
        writeln!(out, "  better with: {line}")?;
    }
    Ok(())
}

/// Today in UTC, or the day of SOURCE_DATE_EPOCH where that is set: the same inputs give the same bytes then.
fn today() -> anyhow::Result<String> {
    if let Some(text) = std::env::var_os("SOURCE_DATE_EPOCH") {
        let seconds = text.to_str().and_then(|t| t.parse::<u64>().ok());
        return Ok(day_of(
            seconds.context("SOURCE_DATE_EPOCH is set but is not a number of seconds; correct it or unset it")?,
        ));
    }
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    Ok(day_of(now.context("the clock of this computer is before 1970; set it, or use --date")?.as_secs()))
}

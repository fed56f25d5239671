//! `kilwa scans list`.

use super::mask::Listed;
use kilwa_scan::ScanError;
use kilwa_scan::mask;
use kilwa_scan::spool::{Header, Reader};
use kilwa_scan::survey::{Station, Survey};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// List the stations of a survey.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The folder of the survey.
    survey: PathBuf,
    /// Print the list as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let survey = Survey::open(&args.survey)?;
    let headers: Vec<Result<Header, String>> = survey
        .stations
        .iter()
        .map(|station| {
            let reader = Reader::open(&args.survey.join(&station.scan));
            reader.map(|reader| *reader.header()).map_err(|e| format!("{:#}", anyhow::Error::from(e)))
        })
        .collect();
    let mut out = crate::terminal::out();
    if args.json {
        let stations: Vec<_> = survey
            .stations
            .iter()
            .zip(&headers)
            .map(|(station, header)| {
                let mut json = as_json(station, header.as_ref().ok());
                let masks = super::mask::of(&args.survey, &survey, station);
                json["masks"] = masks.iter().map(Listed::as_json).collect();
                json["masked"] = json!(masked(&args.survey, station).ok());
                if let Err(error) = header {
                    json["error"] = json!(error);
                }
                json
            })
            .collect();
        let json = json!({
            "title": survey.title,
            "crs": survey.crs,
            "stations": stations,
            "controls": survey.controls.len(),
            "photographs": survey.photographs.len(),
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
    } else {
        table(args, &survey, &headers, &mut out)?;
    }
    let damaged = headers.iter().filter(|header| header.is_err()).count();
    anyhow::ensure!(damaged == 0, "{damaged} of {} stations cannot be read", survey.stations.len());
    for station in &survey.stations {
        let masks = super::mask::of(&args.survey, &survey, station);
        if let Some(error) = masks.into_iter().find_map(|mask| mask.masked.err()) {
            anyhow::bail!("a mask of station {} cannot be read: {error}", station.name);
        }
    }
    Ok(())
}

/// How many points the masks that are on mask together.
fn masked(folder: &Path, station: &Station) -> Result<u64, ScanError> {
    if station.masks.iter().all(|mask| !mask.is_on) {
        return Ok(0);
    }
    mask::count(&mut mask::open(folder, station, false)?)
}

fn table(
    args: &Args,
    survey: &Survey,
    headers: &[Result<Header, String>],
    out: &mut impl std::io::Write,
) -> anyhow::Result<()> {
    let widest = survey.stations.iter().map(|s| s.name.chars().count()).max().unwrap_or(0).max(7);
    writeln!(
        out,
        "{:widest$}  {:>12}  {:>11}  {:>13}  {:>8}  {:9}  position",
        "station", "points", "masked", "grid", "range", "has"
    )?;
    let (mut by_mask, mut all_masked) = (BTreeMap::new(), 0);
    for (station, header) in survey.stations.iter().zip(headers) {
        let position = station.pose.map_or_else(
            || "unknown".to_owned(),
            |pose| {
                let [x, y, z] = pose.translation.to_array();
                format!("{x:.3} {y:.3} {z:.3}{}", if station.is_fixed { " (fixed)" } else { "" })
            },
        );
        match header {
            Ok(header) => {
                let grid = if header.is_grid {
                    format!("{} × {}", header.grid.columns, header.grid.rows)
                } else {
                    "none".to_owned()
                };
                let s = &header.statistics;
                let has = match (s.with_intensity > 0, s.colored > 0) {
                    (true, true) => "int, rgb",
                    (true, false) => "int",
                    (false, true) => "rgb",
                    (false, false) => "",
                };
                let range = format!("{:.1} m", s.max_range);
                let masks = super::mask::of(&args.survey, survey, station);
                let masked = masked(&args.survey, station);
                all_masked += masked.as_ref().copied().unwrap_or(0);
                add(masks, &mut by_mask);
                let masked = match masked {
                    Ok(0) if station.masks.is_empty() => String::new(),
                    Ok(masked) => masked.to_string(),
                    Err(_) => "damaged".to_owned(),
                };
                writeln!(
                    out,
                    "{:widest$}  {:>12}  {masked:>11}  {grid:>13}  {range:>8}  {has:9}  {position}",
                    station.name, s.measured
                )?;
            }
            Err(error) => writeln!(out, "{:widest$}  cannot be read: {error}", station.name)?,
        }
    }
    let points: u64 = headers.iter().flatten().map(|header| header.statistics.measured).sum();
    let (stations, photographs) = (survey.stations.len() as u64, survey.photographs.len() as u64);
    let counted = kilwa_pack::plural::counted::<u64>;
    for (name, sum) in &by_mask {
        writeln!(out, "{}", sum.line(name))?;
    }
    let masked = if by_mask.is_empty() { String::new() } else { format!(" ({all_masked} masked)") };
    writeln!(
        out,
        "{}, {}{masked}, {}",
        counted(stations, "station", "stations"),
        counted(points, "point", "points"),
        counted(photographs, "photograph", "photographs")
    )?;
    Ok(())
}

/// One mask over all stations.
#[derive(Default)]
struct Sum {
    points: u64,
    stations: u64,
    off: u64,
    outdated: u64,
    errors: Vec<String>,
}

impl Sum {
    fn line(&self, name: &str) -> String {
        use std::fmt::Write as _;
        let counted = kilwa_pack::plural::counted::<u64>;
        let (points, stations) =
            (counted(self.points, "point", "points"), counted(self.stations, "station", "stations"));
        let mut line = format!("mask {name}: {points} at {stations}");
        if self.off > 0 {
            let _ = write!(line, ", off at {}", self.off);
        }
        if self.outdated > 0 {
            let _ = write!(line, ", outdated at {} (poses changed): make it again", self.outdated);
        }
        for error in &self.errors {
            let _ = write!(line, "\n  {error}");
        }
        line
    }
}

fn add(masks: Vec<Listed>, sums: &mut BTreeMap<String, Sum>) {
    for mask in masks {
        let sum = sums.entry(mask.name).or_default();
        sum.stations += 1;
        sum.off += u64::from(!mask.is_on);
        sum.outdated += u64::from(mask.is_outdated);
        match mask.masked {
            Ok(points) => sum.points += points,
            Err(error) => sum.errors.push(error),
        }
    }
}

/// One station for programs.
pub(super) fn as_json(station: &Station, header: Option<&Header>) -> serde_json::Value {
    let pose = station.pose.map(|pose| {
        let q = pose.rotation;
        json!({"rotation_wxyz": [q.w, q.x, q.y, q.z], "translation_m": pose.translation.to_array()})
    });
    let scan = header.map(|header| {
        let s = &header.statistics;
        json!({
            "columns": header.is_grid.then_some(header.grid.columns),
            "rows": header.is_grid.then_some(header.grid.rows),
            "points": s.measured,
            "no_return": s.no_return,
            "with_intensity": s.with_intensity,
            "with_color": s.colored,
            "max_range_m": s.max_range,
            "bounds_min_m": s.bounds[0].to_array(),
            "bounds_max_m": s.bounds[1].to_array(),
        })
    });
    json!({
        "name": station.name,
        "pose": pose,
        "fixed": station.is_fixed,
        "instrument": station.instrument,
        "scan": scan,
        "source": {
            "file": station.source.file,
            "bytes": station.source.bytes,
            "blake3": station.source.blake3,
            "number": station.source.number,
        },
    })
}

//! The page of a survey: its plan, and the list of its stations.

use super::control_page;
use super::plan::{Drawing, Known, Plan, heading};
use super::registered::{self, CandidateMark, Certainty, Found, Line, LinkRow, Refused};
use crate::portal::frame::{Reader, Top};
use crate::portal::language::Language;
use askama::Template;
use kilwa_archive::html::render;
use kilwa_scan::plan::LONGER;
use kilwa_scan::register::Registration;
use kilwa_scan::survey::Survey;
use kilwa_scan_core::Pose;
use std::collections::HashMap;

/// What is at the head of a page of a survey.
pub(crate) fn title<'a>(survey: &'a Survey, l: &'static Language) -> &'a str {
    survey.title.as_deref().filter(|title| !title.trim().is_empty()).unwrap_or(l.t("survey"))
}

/// The address of a station's page.
pub(crate) fn address(name: &str, reader: &Reader<'_>) -> String {
    reader.to(&format!("/stations/{name}/"))
}

/// A place in the survey, metres.
pub(crate) fn coordinates(pose: Pose, l: &'static Language) -> String {
    let numbers = pose.translation.to_array().map(|number| l.decimals(&format!("{number:.3}").replace('-', "−")));
    format!("{} m", numbers.join("; "))
}

/// Where a scanner faces.
pub(crate) fn facing(pose: Pose, l: &'static Language) -> String {
    degrees(heading(pose), l)
}

/// An azimuth, degrees from 0 to 360.
pub(crate) fn degrees(azimuth: f64, l: &'static Language) -> String {
    // What rounds to a whole turn is north.
    let degrees = format!("{azimuth:.1}");
    l.decimals(if degrees == "360.0" { "0.0" } else { &degrees }) + "°"
}

/// A length as people say it.
fn metres(length: f64, l: &'static Language) -> String {
    let digits = if length >= 1.0 { 0 } else { (-length.log10()).ceil() as usize };
    format!("{} m", l.decimals(&format!("{length:.digits$}")))
}

#[derive(Template)]
#[template(path = "survey.html")]
struct Page<'a> {
    top: Top,
    title: &'a str,
    crs: Option<&'a str>,
    stations: String,
    samples: String,
    plan: Option<Shown<'a>>,
    /// A warning about stations that lie on top of each other.
    same: Option<String>,
    /// Why `registration.json` cannot be read.
    unreadable: Option<&'a str>,
    /// Stations that could not be placed, with their addresses.
    refused: Vec<(String, Refused<'a>)>,
    /// Address of the page where control points are marked; none if there are no two stations.
    control: Option<String>,
    /// Addresses and names of other stations that are not on the plan.
    unknown: Vec<(String, &'a str)>,
    rows: Vec<Row<'a>>,
    links: Vec<LinkRow<'a>>,
    link_count: String,
    has_instruments: bool,
    is_registered: bool,
}

/// The plan, and what is shown below it.
struct Shown<'a> {
    width: String,
    height: String,
    /// Address of the background.
    background: String,
    drawing: Drawing<'a>,
    bar: Bar,
    /// Ends of the links of the weakest chain.
    chain: Vec<[String; 4]>,
    /// Stations of the weakest chain.
    chain_names: &'a [String],
    links: Vec<Line>,
    /// Poses that stations that could not be placed may have.
    candidates: Vec<CandidateMark>,
    /// Grades of residuals and their bounds.
    legend: Vec<(usize, String)>,
    /// Whether up is north.
    has_north: bool,
}

/// The scale bar in the drawing.
struct Bar {
    end: String,
    y: String,
    text: String,
}

struct Row<'a> {
    name: &'a str,
    address: String,
    file: &'a str,
    /// Of a file with several scans.
    number: Option<String>,
    grid: String,
    samples: String,
    masked: Result<String, &'a str>,
    /// Place and heading.
    pose: Option<(String, String)>,
    is_fixed: bool,
    certainty: Option<Certainty>,
    instrument: Option<&'a str>,
    trouble: Option<&'a str>,
}

/// The page.
pub(crate) fn page(
    survey: &Survey,
    stations: &[Known<'_>],
    plan: Option<&Plan>,
    registration: &Found,
    reader: &Reader<'_>,
) -> String {
    let found = registration.as_ref().ok().and_then(Option::as_deref);
    let l = reader.language;
    let samples = stations.iter().filter_map(|(_, facts)| facts.header.as_ref().ok());
    let samples: u64 = samples.map(|header| header.statistics.measured).sum();
    let refused = found.map(|found| registered::refused(found, survey, stations, reader)).unwrap_or_default();
    let is_refused = |name: &str| refused.iter().any(|one| one.name == name);
    let unknown = survey.stations.iter().filter(|station| station.pose.is_none() && !is_refused(&station.name));
    let unknown = unknown.map(|station| (address(&station.name, reader), station.name.as_str())).collect();
    let links = found.map(|found| registered::link_rows(found, survey, l)).unwrap_or_default();
    render(&Page {
        top: reader.top(&|code| format!("/?lang={code}")),
        title: title(survey, l),
        crs: survey.crs.as_deref(),
        stations: l.with("surveyStations", &[("count", survey.stations.len())]),
        samples: l.with("surveySamples", &[("count", samples)]),
        plan: plan.map(|plan| shown(plan, survey, found, l)),
        same: Some(same_poses(survey)).filter(|same| *same > 0).map(|same| l.with("surveySame", &[("count", same)])),
        unreadable: registration.as_ref().err().map(AsRef::as_ref),
        refused: refused.into_iter().map(|one| (address(one.name, reader), one)).collect(),
        control: (survey.stations.len() > 1).then(|| control_page::link(&[], reader)),
        unknown,
        rows: stations.iter().map(|known| row(*known, found, reader)).collect(),
        link_count: l.count(links.len() as u64),
        links,
        has_instruments: survey.stations.iter().any(|station| station.instrument.is_some()),
        is_registered: found.is_some(),
    })
}

/// Stations whose pose is exactly that of another, as scans that are not registered have it.
fn same_poses(survey: &Survey) -> usize {
    let mut counts: HashMap<[u64; 7], usize> = HashMap::new();
    for pose in survey.stations.iter().filter_map(|station| station.pose) {
        let numbers = pose.rotation.to_array().into_iter().chain(pose.translation.to_array());
        let mut key = [0; 7];
        for (key, number) in key.iter_mut().zip(numbers) {
            // -0 is 0.
            *key = (number + 0.0).to_bits();
        }
        *counts.entry(key).or_default() += 1;
    }
    counts.into_values().filter(|count| *count > 1).sum()
}

fn shown<'a>(plan: &Plan, survey: &'a Survey, found: Option<&'a Registration>, l: &'static Language) -> Shown<'a> {
    let drawing = plan.drawing(survey);
    let [width, height] = drawing.size;
    let bar = &drawing.bar;
    let bar = Bar {
        end: format!("{:.1}", 16.0 + bar.length),
        y: format!("{:.1}", height - 16.0),
        text: metres(bar.metres, l),
    };
    let (links, legend) = found.map(|found| registered::links(found, plan, survey, l)).unwrap_or_default();
    let chain = found.map(|found| registered::chain(found, plan, survey)).unwrap_or_default();
    Shown {
        width: format!("{:.1}", width.min(LONGER)),
        height: format!("{:.1}", height.min(LONGER)),
        background: format!("/plan.png?state={}", &plan.key[..12]),
        bar,
        chain_names: found.filter(|_| !chain.is_empty()).map(|found| &*found.weakest_chain).unwrap_or_default(),
        chain,
        links,
        candidates: found.map(|found| registered::candidates(found, plan, survey, l)).unwrap_or_default(),
        legend,
        drawing,
        has_north: survey.crs.is_some(),
    }
}

fn row<'a>((station, facts): Known<'a>, found: Option<&Registration>, reader: &Reader<'_>) -> Row<'a> {
    let l = reader.language;
    let header = facts.header.as_ref().ok();
    let grid = header.map(|header| {
        if header.is_grid {
            format!("{} × {}", l.count(header.grid.columns.into()), l.count(header.grid.rows.into()))
        } else {
            l.t("surveyGridNone").to_owned()
        }
    });
    let number = station.source.number;
    Row {
        name: &station.name,
        address: address(&station.name, reader),
        file: &station.source.file,
        number: (number > 1).then(|| l.with("surveyScan", &[("number", number)])),
        grid: grid.unwrap_or_default(),
        samples: header.map(|header| l.count(header.statistics.measured)).unwrap_or_default(),
        masked: facts.masked.as_ref().map(|masked| l.count(*masked)).map_err(String::as_str),
        pose: station.pose.map(|pose| (coordinates(pose, l), facing(pose, l))),
        is_fixed: station.is_fixed,
        certainty: found.and_then(|found| registered::certainty(found, station, l)),
        instrument: station.instrument.as_deref(),
        trouble: facts.trouble(),
    }
}

#[derive(Template)]
#[template(path = "survey-message.html")]
struct Message<'a> {
    top: Top,
    heading: &'static str,
    text: &'static str,
    /// What was found, as the program says it.
    detail: &'a str,
    /// Whether there is a list to go back to.
    has_list: bool,
}

/// The page while `survey.toml` has mistakes.
pub(crate) fn mistakes(what: &str, reader: &Reader<'_>) -> String {
    let (heading, text) = (reader.language.t("surveyWrong"), reader.language.t("surveyWrongNext"));
    let top = reader.top(&|code| format!("/?lang={code}"));
    render(&Message { top, heading, text, detail: what, has_list: false })
}

/// The page for an address that leads nowhere.
pub(crate) fn lost(reader: &Reader<'_>) -> String {
    let (heading, text) = (reader.language.t("surveyLost"), reader.language.t("surveyLostNext"));
    let top = reader.top(&|code| format!("/?lang={code}"));
    render(&Message { top, heading, text, detail: "", has_list: true })
}

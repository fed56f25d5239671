//! The report of a registration: one HTML page without scripts, for people to read, print and keep with the survey.

use crate::info::grouped;
use anyhow::Context as _;
use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec2, DVec3};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use kilwa_archive::html::render;
use kilwa_pack::plural::counted;
use kilwa_scan::mask;
use kilwa_scan::panorama::{self, Show};
use kilwa_scan::plan::{LONGER, Label, around, bar, labels, text};
use kilwa_scan::register::{Candidate, Grades, Link, Placed, Placement, Registration, Unplaced};
use kilwa_scan::survey::Survey;
use std::collections::HashMap;
use std::path::Path;

pub(crate) const STYLE: &str = include_str!("report.css");
/// Width and height of pictures, pixels at most.
const PICTURE: u32 = 800;
/// Quality of their JPEG, of 100.
const QUALITY: u8 = 82;
/// The number of standard deviations within which 95 % of a two-dimensional normal distribution lies: the square root of the 95 % quantile of χ² with two degrees of freedom.
const WITHIN_95: f64 = 2.447_746_830_680_816;
/// Maximum semi-axis of an ellipse, as a fraction of the longer side of the plan.
const LARGEST: f64 = 0.06;

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    style: &'static str,
    title: &'a str,
    summary: String,
    /// Further messages for the user.
    notes: &'a [String],
    plan: Option<Plan<'a>>,
    chain: Option<String>,
    unplaced: Vec<Refused<'a>>,
    stations: Vec<StationRow<'a>>,
    links: Vec<LinkRow<'a>>,
}

/// The plan; units as in [`kilwa_scan::plan`].
struct Plan<'a> {
    width: String,
    height: String,
    /// Ends of the links of the weakest chain.
    chain: Vec<[String; 4]>,
    lines: Vec<Line>,
    marks: Vec<Mark>,
    names: Vec<(&'a str, Label)>,
    /// Whether some names have no room.
    has_spare: bool,
    bar: String,
    bar_end: String,
    bar_y: String,
    /// The label of the upward direction: north in a known coordinate reference system, otherwise the y axis.
    up: &'static str,
    /// What the ellipses are.
    ellipses: String,
    /// Grades of residuals and their bounds.
    legend: Vec<(usize, String)>,
}

struct Line {
    ends: [String; 4],
    grade: usize,
    samples: usize,
    what: String,
}

struct Mark {
    x: String,
    y: String,
    /// Semi-axes, and the angle of the first one, clockwise, degrees.
    ellipse: Option<[String; 3]>,
    class: &'static str,
    what: String,
}

struct StationRow<'a> {
    name: &'a str,
    placement: &'static str,
    numbers: [String; 5],
}

struct LinkRow<'a> {
    names: [&'a str; 2],
    /// As in [`Grades`].
    grade: usize,
    numbers: [String; 6],
}

/// A station that was not placed.
struct Refused<'a> {
    name: &'a str,
    reason: &'a str,
    remedy: &'a str,
    picture: Result<Picture, String>,
    candidates: Vec<CandidateRow<'a>>,
}

struct Picture {
    /// A JPEG in base 64.
    data: String,
    width: u32,
    height: u32,
    /// The ranges at both ends of the ramp.
    ends: String,
}

struct CandidateRow<'a> {
    matched_with: &'a str,
    numbers: [String; 8],
}

/// The registration report of the survey in `folder`. If a station cannot be read, the reason replaces its picture.
///
/// # Errors
/// Pictures that cannot be encoded.
pub(crate) fn html(folder: &Path, survey: &Survey, found: &Registration) -> anyhow::Result<String> {
    let mut links: Vec<&Link> = found.links.iter().collect();
    links.sort_by(|a, b| b.residual.total_cmp(&a.residual).then_with(|| a.stations.cmp(&b.stations)));
    let rows = Grades::of(&found.links).map(|grades| links.into_iter().map(|link| link_row(link, grades)).collect());
    let unplaced = found.unplaced.iter().map(|one| refused(folder, survey, one));
    let chain = (found.weakest_chain.len() > 1).then(|| {
        format!("Weakest chain, from a given pose to the least certain station: {}.", found.weakest_chain.join(" → "))
    });
    Ok(render(&Page {
        style: STYLE,
        title: survey.title.as_deref().filter(|title| !title.trim().is_empty()).unwrap_or("a survey"),
        summary: summary(found),
        notes: &found.notes,
        plan: plan(survey, found),
        chain,
        unplaced: unplaced.collect::<anyhow::Result<_>>()?,
        stations: found.stations.iter().map(station_row).collect(),
        links: rows.unwrap_or_default(),
    }))
}

/// How many stations were placed, and how well.
fn summary(found: &Registration) -> String {
    let (placed, refused) = (found.stations.len(), found.unplaced.len());
    let all = counted((placed + refused) as u64, "station", "stations");
    let verb = |count: usize| if count == 1 { "is" } else { "are" };
    let mut text = match (placed, refused) {
        (0, 0) => return "The survey has no stations.".to_owned(),
        (0, _) => format!("None of the {all} could be placed."),
        (1, 0) => "The only station has a pose.".to_owned(),
        (_, 0) => format!("All {all} are placed."),
        _ => format!("{placed} of {all} {} placed, {refused} {} not.", verb(placed), verb(refused)),
    };
    if let Some(weakest) = weakest(found) {
        let [metres, radians] = weakest.sigma();
        let deviations = format!(
            " The least certain is {}, with standard deviations of {}\u{a0}mm (position) and {}° (rotation).",
            weakest.name,
            millimetres(metres),
            degrees(radians)
        );
        text.push_str(&deviations);
    }
    text
}

/// Whether a station's pose was given.
fn is_given(placed: &Placed) -> bool {
    matches!(placed.placement, Placement::Anchor | Placement::Fixed)
}

/// The station whose position is least certain of those whose pose was not given.
fn weakest(found: &Registration) -> Option<&Placed> {
    let found = found.stations.iter().filter(|placed| !is_given(placed));
    found.max_by(|a, b| a.sigma()[0].total_cmp(&b.sigma()[0]))
}

pub(crate) fn placement(placed: &Placed) -> &'static str {
    match placed.placement {
        Placement::Anchor => "anchor",
        Placement::Fixed => "fixed pose",
        Placement::Control => "control points",
        Placement::Surface => "surface",
    }
}

fn station_row(placed: &Placed) -> StationRow<'_> {
    let [x, y, z] = placed.translation.map(coordinate);
    let [metres, radians] = placed.sigma();
    StationRow {
        name: &placed.name,
        placement: placement(placed),
        numbers: [x, y, z, millimetres(metres), degrees(radians)],
    }
}

fn link_row(link: &Link, grades: Grades) -> LinkRow<'_> {
    let none = || "–".to_owned();
    let [metres, radians] = link.sigma.map_or_else(|| [none(), none()], |[m, r]| [millimetres(m), degrees(r)]);
    LinkRow {
        names: [&link.stations[0], &link.stations[1]],
        grade: grades.residual(link),
        numbers: [
            millimetres(link.residual),
            grouped(link.samples),
            percent(link.overlap),
            percent(link.contradicted),
            metres,
            radians,
        ],
    }
}

fn refused<'a>(folder: &Path, survey: &Survey, one: &'a Unplaced) -> anyhow::Result<Refused<'a>> {
    Ok(Refused {
        name: &one.name,
        reason: &one.reason,
        remedy: &one.remedy,
        picture: picture(folder, survey, &one.name)?,
        candidates: one.candidates.iter().map(candidate_row).collect(),
    })
}

fn candidate_row(candidate: &Candidate) -> CandidateRow<'_> {
    let [x, y, z] = candidate.translation.map(coordinate);
    let [w, i, j, k] = candidate.rotation;
    let ahead = glam::DQuat::from_xyzw(i, j, k, w) * DVec3::X;
    let heading = format!("{:.1}", ahead.x.atan2(ahead.y).to_degrees().rem_euclid(360.0));
    CandidateRow {
        matched_with: &candidate.matched_with,
        numbers: [
            x,
            y,
            z,
            // A heading that rounds to 360° is 0°.
            if heading == "360.0" { "0.0°".to_owned() } else { heading + "°" },
            percent(candidate.overlap),
            percent(candidate.agreement),
            percent(candidate.contradicted),
            millimetres(candidate.residual),
        ],
    }
}

/// The range image of a station, or why there is none.
fn picture(folder: &Path, survey: &Survey, name: &str) -> anyhow::Result<Result<Picture, String>> {
    let drawn = survey.station(name).and_then(|station| {
        let mut reader = mask::open(folder, station, false)?;
        panorama::render(&mut reader, Show::Range, &mut [], PICTURE)
    });
    let drawn = match drawn {
        Ok(drawn) => drawn,
        Err(e) => return Ok(Err(format!("{:#}", anyhow::Error::from(e)))),
    };
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
        .write_image(&drawn.pixels, drawn.width, drawn.height, ExtendedColorType::Rgb8)
        .with_context(|| format!("the picture of station {name}"))?;
    let [near, far] = drawn.frame.scale.unwrap_or_default();
    Ok(Ok(Picture {
        data: STANDARD.encode(&jpeg),
        width: drawn.width,
        height: drawn.height,
        ends: format!("{near:.1} m (dark) to {far:.1} m (bright)"),
    }))
}

/// The plan; `None` if no station was placed.
fn plan<'a>(survey: &Survey, found: &'a Registration) -> Option<Plan<'a>> {
    let places: Vec<DVec2> = found.stations.iter().map(place).collect();
    let [min, max] = around(&places)?;
    let scale = LONGER / (max - min).max_element();
    let [width, height] = ((max - min) * scale).to_array();
    let at = |point: DVec2| {
        let at = (point - min) * scale;
        [at.x, height - at.y]
    };
    let by_name: HashMap<&str, DVec2> = found.stations.iter().map(|one| (one.name.as_str(), place(one))).collect();
    let line = |[a, b]: [&str; 2]| {
        let [[x1, y1], [x2, y2]] = [at(*by_name.get(a)?), at(*by_name.get(b)?)];
        Some([x1, y1, x2, y2].map(text))
    };
    let grades = Grades::of(&found.links);
    let mut drawn: Vec<&Link> = found.links.iter().collect();
    // The worst ones lie on top.
    drawn.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    let lines = drawn.into_iter().filter_map(|link| {
        let grades = grades?;
        let [a, b] = link.stations.each_ref().map(String::as_str);
        let what = format!("{a} – {b}: residual {} mm, {} samples", millimetres(link.residual), grouped(link.samples));
        Some(Line { ends: line([a, b])?, grade: grades.residual(link), samples: grades.samples(link), what })
    });
    let larger = enlargement(found, LARGEST * (max - min).max_element());
    let bar = bar((max - min).x, scale);
    let named: Vec<(&str, [f64; 2])> =
        found.stations.iter().map(|placed| (placed.name.as_str(), at(place(placed)))).collect();
    let labels = labels(&named, [width, height], bar.length);
    let has_spare = labels.iter().any(|label| label.as_ref().is_none_or(|label| label.is_for_large));
    Some(Plan {
        width: text(width),
        height: text(height),
        chain: found.weakest_chain.windows(2).filter_map(|pair| line([&pair[0], &pair[1]])).collect(),
        lines: lines.collect(),
        marks: found.stations.iter().map(|placed| mark(placed, at(place(placed)), larger.map(|k| k * scale))).collect(),
        names: named.iter().zip(labels).filter_map(|((name, _), label)| Some((*name, label?))).collect(),
        has_spare,
        bar: if bar.metres >= 1.0 { format!("{:.0} m", bar.metres) } else { format!("{} m", bar.metres) },
        bar_end: text(16.0 + bar.length),
        bar_y: text(height - 16.0),
        up: if survey.crs.is_some() { "N" } else { "y" },
        ellipses: match larger {
            Some(1.0) => {
                "Ellipses: 95 % confidence regions of the positions, true to scale. Rings: given poses.".to_owned()
            }
            Some(larger) => format!(
                "Ellipses: 95 % confidence regions of the positions, enlarged {} times. Rings: given poses.",
                grouped(larger as u64)
            ),
            None => "Rings: given poses.".to_owned(),
        },
        legend: grades.map(legend).unwrap_or_default(),
    })
}

fn place(placed: &Placed) -> DVec2 {
    DVec3::from_array(placed.translation).truncate()
}

fn legend(grades: Grades) -> Vec<(usize, String)> {
    let [median, more, most] = grades.bounds().map(millimetres);
    let texts = [
        format!("residual to {median} mm (the median)"),
        format!("to {more} mm"),
        format!("to {most} mm"),
        format!("above {most} mm"),
    ];
    (0..).zip(texts).collect()
}

fn mark(placed: &Placed, [x, y]: [f64; 2], larger: Option<f64>) -> Mark {
    let [metres, radians] = placed.sigma();
    let what = format!(
        "{} ({}): position ± {} mm, rotation ± {}° (standard deviations)",
        placed.name,
        placement(placed),
        millimetres(metres),
        degrees(radians)
    );
    let ellipse = larger.zip(ellipse(placed)).map(|(larger, (long, short, angle))| {
        // The plan's y axis points down: counterclockwise is negative.
        [text(long * larger), text(short * larger), text(-angle.to_degrees())]
    });
    Mark { x: text(x), y: text(y), ellipse, class: if is_given(placed) { "given" } else { "" }, what }
}

/// The 95 % confidence ellipse of the horizontal position: semi-axes in metres, and the angle of the longer one, counterclockwise from x, radians. `None` for
/// a position that is certain.
fn ellipse(placed: &Placed) -> Option<(f64, f64, f64)> {
    let c = &placed.covariance;
    let (xx, xy, yy) = (c[3][3], c[3][4], c[4][4]);
    let (middle, half) = (f64::midpoint(xx, yy), ((xx - yy) / 2.0).hypot(xy));
    let [long, short] = [middle + half, middle - half].map(|variance| WITHIN_95 * variance.max(0.0).sqrt());
    (long > 0.0).then(|| (long, short, 0.5 * (2.0 * xy).atan2(xx - yy)))
}

/// How much ellipses are enlarged so that the largest has at most this semi-axis, metres: 1, 2 or 5 times a power of ten, at least 1. `None` if all positions are certain.
fn enlargement(found: &Registration, largest: f64) -> Option<f64> {
    let long = found.stations.iter().filter_map(ellipse).map(|(long, ..)| long).reduce(f64::max)?;
    let times = largest / long;
    let power = 10_f64.powf(times.log10().floor());
    let round = [5.0, 2.0, 1.0].map(|k| k * power).into_iter().find(|k| *k <= times).unwrap_or(power);
    Some(round.max(1.0).round())
}

/// Metres to a tenth of a millimetre.
pub(crate) fn coordinate(metres: f64) -> String {
    let text = format!("{metres:.4}");
    if text == "-0.0000" { "0.0000".to_owned() } else { text.replace('-', "−") }
}

/// A length in millimetres with two or three significant digits.
pub(crate) fn millimetres(metres: f64) -> String {
    let value = metres * 1000.0;
    let digits = match value.abs() {
        v if v == 0.0 || v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 0.1 => 2,
        _ => 3,
    };
    format!("{value:.digits$}")
}

/// An angle in degrees, to a ten-thousandth where it is small.
pub(crate) fn degrees(radians: f64) -> String {
    let value = radians.to_degrees();
    let digits = match value.abs() {
        0.0 => 0,
        v if v >= 1.0 => 2,
        v if v >= 0.01 => 3,
        _ => 4,
    };
    format!("{value:.digits$}")
}

/// A share; small ones with a digit more.
pub(crate) fn percent(share: f64) -> String {
    let value = share * 100.0;
    if value > 0.0 && value < 9.95 { format!("{value:.1} %") } else { format!("{value:.0} %") }
}

#[cfg(test)]
mod tests;

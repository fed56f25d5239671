//! The page of a station: what is known of it, and a picture of it that zooms.

use super::Facts;
use super::control_page;
use super::pictures::{Drawn, PART, key, name_of};
use super::plan_page::{address, coordinates, facing, title};
use crate::portal::frame::{Reader, Top};
use crate::portal::language::Language;
use askama::Template;
use kilwa_archive::html::render;
use kilwa_scan::mask::is_outdated;
use kilwa_scan::panorama::{Show, mask_color};
use kilwa_scan::survey::{Station, Survey};
use std::sync::Arc;

/// What the page shows.
pub(crate) struct Asked<'a> {
    pub(crate) survey: &'a Survey,
    pub(crate) station: &'a Station,
    pub(crate) facts: &'a Facts,
    /// What there are pictures of.
    pub(crate) shown: &'a [Show],
    pub(crate) show: Show,
    /// The picture, or why there is none.
    pub(crate) picture: Result<Arc<Drawn>, String>,
}

#[derive(Template)]
#[template(path = "station.html")]
struct Page<'a> {
    top: Top,
    title: &'a str,
    name: &'a str,
    /// Name and value; direction where it is not the page's.
    rows: Vec<(&'static str, String, &'static str)>,
    /// Address, key of its name, and whether it is the one that is shown.
    pictures: Vec<(String, &'static str, bool)>,
    picture: Result<Panorama, String>,
    /// Addresses and names of the stations before and after this one.
    before: Option<(String, &'a str)>,
    after: Option<(String, &'a str)>,
    /// Address of the page where control points are marked; none if there is no other station.
    control: Option<String>,
}

pub(super) struct Panorama {
    pub(super) address: String,
    pub(super) width: u32,
    pub(super) height: u32,
    /// Columns and rows of the grid, and where its parts are: none where the picture has every cell.
    pub(super) full: [u32; 2],
    pub(super) parts: Option<String>,
    pub(super) part: u32,
    /// What it shows, for those who do not see it.
    pub(super) alternative: String,
    legend: Legend,
}

enum Legend {
    /// Class of the ramp, and the values at its ends.
    Ramp(&'static str, String, String),
    /// Masks: number of the colour, name and what it masks.
    Masks(Vec<(usize, String, String)>),
    None,
}

/// The page.
pub(crate) fn page(asked: Asked<'_>, reader: &Reader<'_>) -> String {
    let Asked { survey, station, facts, shown, show, picture } = asked;
    let l = reader.language;
    let here = format!("/stations/{}/", station.name);
    let of = |show: Show, lang: Option<&str>| {
        let lang = lang.map(|lang| format!("&lang={lang}")).unwrap_or_default();
        format!("{here}?show={}{lang}", name_of(show))
    };
    let at = survey.stations.iter().position(|other| other.name == station.name);
    let neighbour = |at: Option<usize>| {
        let other = survey.stations.get(at?)?;
        Some((address(&other.name, reader), other.name.as_str()))
    };
    let picture = picture.map(|drawn| panorama(&drawn, station, facts, show, survey, l));
    render(&Page {
        top: reader.top(&|code| of(show, Some(code))),
        title: title(survey, l),
        name: &station.name,
        rows: rows(station, facts, l),
        pictures: shown.iter().map(|other| (of(*other, reader.lang), message(*other), *other == show)).collect(),
        picture,
        before: neighbour(at.and_then(|at| at.checked_sub(1))),
        after: neighbour(at.map(|at| at + 1)),
        control: (survey.stations.len() > 1).then(|| control_page::link(&[Some(&station.name)], reader)),
    })
}

/// The key of what a picture shows.
pub(super) fn message(show: Show) -> &'static str {
    match show {
        Show::Range => "showRange",
        Show::Intensity => "showIntensity",
        Show::Colour => "showColour",
        Show::Mask => "showMask",
    }
}

fn rows(station: &Station, facts: &Facts, l: &'static Language) -> Vec<(&'static str, String, &'static str)> {
    let mut rows = Vec::new();
    let source = &station.source;
    rows.push(("surveySource", source.file.clone(), "auto"));
    if source.number > 1 {
        rows.push(("surveyNumber", l.count(source.number), ""));
    }
    if let Ok(header) = &facts.header {
        let grid = format!("{} × {}", l.count(header.grid.columns.into()), l.count(header.grid.rows.into()));
        let none = || l.t("surveyGridNone").to_owned();
        rows.push(("surveyGrid", if header.is_grid { grid } else { none() }, if header.is_grid { "ltr" } else { "" }));
        rows.push(("surveySamplesHead", l.count(header.statistics.measured), ""));
        if let Ok(masked) = &facts.masked {
            rows.push(("surveyMasked", l.count(*masked), ""));
        }
        let range = l.decimals(&format!("{:.1}", header.statistics.max_range));
        rows.push(("surveyRange", format!("{range} m"), "ltr"));
    }
    match station.pose {
        Some(pose) => {
            rows.push(("surveyPosition", coordinates(pose, l), "ltr"));
            rows.push(("surveyHeading", facing(pose, l), "ltr"));
            if station.is_fixed {
                rows.push(("surveyPose", l.t("surveyFixed").to_owned(), ""));
            }
        }
        None => rows.push(("surveyPose", l.t("surveyPoseUnknown").to_owned(), "")),
    }
    if let Some(instrument) = &station.instrument {
        rows.push(("surveyInstrument", instrument.clone(), "auto"));
    }
    rows
}

pub(super) fn panorama(
    drawn: &Drawn,
    station: &Station,
    facts: &Facts,
    show: Show,
    survey: &Survey,
    l: &'static Language,
) -> Panorama {
    let frame = drawn.frame.as_ref();
    let full = frame.map_or(drawn.size, |frame| frame.size);
    let ends = frame.and_then(|frame| frame.scale).map(|scale| {
        scale.map(|value| match show {
            Show::Range => l.decimals(&format!("{value:.1}")) + " m",
            _ => l.decimals(&number(value)),
        })
    });
    let [near, far] = ends.clone().unwrap_or_default();
    let name = station.name.as_str();
    let alternative = match show {
        Show::Range => l.with("altRange", &[("name", name), ("near", near.as_str()), ("far", far.as_str())]),
        Show::Intensity => l.with("altIntensity", &[("name", name), ("low", near.as_str()), ("high", far.as_str())]),
        Show::Colour => l.with("altColour", &[("name", name)]),
        Show::Mask => l.with("altMask", &[("name", name)]),
    };
    let legend = match (show, ends) {
        (Show::Mask, _) => Legend::Masks(masks(station, facts, survey, l)),
        (Show::Range, Some([near, far])) => Legend::Ramp("range", near, far),
        (Show::Intensity, Some([low, high])) => Legend::Ramp("grey", low, high),
        _ => Legend::None,
    };
    let here = format!("/stations/{}/{}", station.name, name_of(show));
    // Another address for another picture, so that no part of an old one is put over a new one.
    let state = &key(facts, show, None)[..12];
    Panorama {
        address: format!("{here}.png?state={state}"),
        width: drawn.size[0],
        height: drawn.size[1],
        full,
        parts: (full != drawn.size).then_some(here),
        part: PART,
        alternative,
        legend,
    }
}

/// An intensity in as few digits as tell it from others.
fn number(value: f32) -> String {
    if value.abs() >= 100.0 || value == value.trunc() { format!("{value:.0}") } else { format!("{value:.3}") }
}

fn masks(station: &Station, facts: &Facts, survey: &Survey, l: &'static Language) -> Vec<(usize, String, String)> {
    let each = station.masks.iter().zip(&facts.masks).enumerate();
    let legend = each.map(|(number, (mask, count))| {
        let mut what = match count {
            Ok(count) => l.with("surveySamples", &[("count", *count)]),
            Err(why) => why.clone(),
        };
        let notes = [(!mask.is_on, "maskOff"), (is_outdated(mask, station, survey), "maskOutdated")];
        for (_, key) in notes.iter().filter(|(is, _)| *is) {
            what = format!("{what} · {}", l.t(key));
        }
        // After the last colour they begin again.
        let color = (0..number).find(|other| mask_color(*other).1 == mask_color(number).1).unwrap_or(number);
        (color, mask.name.clone(), what)
    });
    legend.collect()
}

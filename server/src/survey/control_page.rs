//! The page where somebody marks the same places in the pictures of two stations.

use super::Facts;
use super::pictures::{Drawn, name_of};
use super::plan_page::{address, title};
use super::station::{Panorama, message, panorama};
use crate::portal::encoded;
use crate::portal::frame::{Reader, Top};
use crate::portal::language::Language;
use askama::Template;
use kilwa_archive::html::render;
use kilwa_scan::panorama::Show;
use kilwa_scan::spool::Header;
use kilwa_scan::survey::{Station, Survey};
use std::sync::Arc;

/// A station whose picture is shown.
pub(super) struct Chosen<'a> {
    pub(super) station: &'a Station,
    pub(super) facts: &'a Facts,
    pub(super) show: Show,
    /// The picture, or why there is none.
    pub(super) picture: Result<Arc<Drawn>, String>,
}

#[derive(Template)]
#[template(path = "control.html")]
struct Page<'a> {
    top: Top,
    title: &'a str,
    /// The language of the address and the picture, which the form keeps.
    kept: Vec<(&'static str, &'a str)>,
    /// The two choices.
    choices: Vec<Choice<'a>>,
    /// Whether the same station was chosen twice.
    is_same: bool,
    /// Address, key of its name, and whether it is the one that is shown.
    kinds: Vec<(String, &'static str, bool)>,
    pictures: Vec<Side<'a>>,
    /// Whether places can be marked: both pictures are there.
    is_ready: bool,
    messages: String,
}

/// A station to choose.
struct Choice<'a> {
    /// The field of the form.
    field: &'static str,
    label: &'static str,
    /// Names, and whether it is the chosen one.
    stations: Vec<(&'a str, bool)>,
}

/// The picture of a station.
struct Side<'a> {
    /// `a` or `b`.
    key: &'static str,
    name: &'a str,
    address: String,
    /// Of the column with its coordinates.
    heading: String,
    /// Distinguishes this scan from others, even of the same name.
    identity: String,
    picture: Result<Panorama, String>,
}

/// The address of the page for these stations, without the language.
pub(super) fn path(stations: &[Option<&str>]) -> String {
    let named = ["a", "b"].into_iter().zip(stations).filter_map(|(key, name)| Some((key, (*name)?)));
    let query: Vec<String> = named.map(|(key, name)| format!("{key}={}", encoded(name))).collect();
    if query.is_empty() { "/control/".to_owned() } else { format!("/control/?{}", query.join("&")) }
}

/// The same, for a link of a page.
pub(super) fn link(stations: &[Option<&str>], reader: &Reader<'_>) -> String {
    with(path(stations), "lang", reader.lang)
}

fn with(address: String, key: &str, value: Option<&str>) -> String {
    let Some(value) = value else { return address };
    let sign = if address.contains('?') { '&' } else { '?' };
    format!("{address}{sign}{key}={value}")
}

/// The page. `kinds` are the kinds of pictures to choose from, `asked` the one that the address names; `chosen` has both stations, or none.
pub(super) fn page(
    survey: &Survey,
    names: [Option<&str>; 2],
    kinds: &[Show],
    asked: Option<Show>,
    chosen: &[Chosen<'_>],
    reader: &Reader<'_>,
) -> String {
    let l = reader.language;
    let of = |show: Option<Show>, lang: Option<&str>| with(with(path(&names), "show", show.map(name_of)), "lang", lang);
    // What both stations show.
    let shown = chosen.first().map(|first| first.show).filter(|show| chosen.iter().all(|one| one.show == *show));
    let choice = |(field, label, name): (&'static str, &'static str, Option<&str>)| Choice {
        field,
        label: l.t(label),
        stations: survey.stations.iter().map(|station| (&*station.name, name == Some(&*station.name))).collect(),
    };
    let pictures: Vec<Side<'_>> =
        ["a", "b"].into_iter().zip(chosen).map(|(name, one)| side(name, one, survey, reader)).collect();
    render(&Page {
        top: reader.top(&|code| of(asked, Some(code))),
        title: title(survey, l),
        kept: [("show", asked.map(name_of)), ("lang", reader.lang)]
            .into_iter()
            .filter_map(|(k, v)| Some((k, v?)))
            .collect(),
        choices: [("a", "controlA", names[0]), ("b", "controlB", names[1])].map(choice).into(),
        is_same: names[0].is_some() && names[0] == names[1],
        kinds: kinds
            .iter()
            .filter(|_| !chosen.is_empty())
            .map(|kind| (of(Some(*kind), reader.lang), message(*kind), shown == Some(*kind)))
            .collect(),
        is_ready: pictures.len() == 2 && pictures.iter().all(|side| side.picture.is_ok()),
        pictures,
        messages: messages(l),
    })
}

fn side<'a>(key: &'static str, one: &Chosen<'a>, survey: &Survey, reader: &Reader<'_>) -> Side<'a> {
    let station = one.station;
    let picture = one.picture.clone();
    Side {
        key,
        name: &station.name,
        address: address(&station.name, reader),
        heading: reader.language.with("controlIn", &[("name", station.name.as_str())]),
        identity: identity(station, one.facts),
        picture: picture.map(|drawn| panorama(&drawn, station, one.facts, one.show, survey, reader.language)),
    }
}

/// See [`Side::identity`]. The same source imported again, in other units for example, has other coordinates: what was marked before is not used then.
fn identity(station: &Station, facts: &Facts) -> String {
    let mut hash = blake3::Hasher::new();
    for text in [&station.name, &station.source.blake3, &station.source.number.to_string()] {
        hash.update(&(text.len() as u64).to_le_bytes());
        hash.update(text.as_bytes());
    }
    if let Ok(Header { grid, statistics, .. }) = &facts.header {
        for size in [grid.columns, grid.rows, u32::from(grid.by_rows)] {
            hash.update(&size.to_le_bytes());
        }
        hash.update(&statistics.measured.to_le_bytes());
        for corner in statistics.bounds {
            for coordinate in corner.to_array() {
                hash.update(&coordinate.to_le_bytes());
            }
        }
    }
    hash.finalize().to_hex()[..16].to_owned()
}

/// The script's messages, as JSON; the script replaces names in braces with values.
fn messages(l: &'static Language) -> String {
    const PLAIN: [&str; 13] = [
        "controlFirst",
        "controlLine",
        "controlReading",
        "controlEmpty",
        "controlUnreachable",
        "controlRemove",
        "controlKnown",
        "controlCopied",
        "controlCopyByHand",
        "controlNext",
        "controlNextAgain",
        "controlNextFixed",
        "controlSuspect",
    ];
    let filled = |key: &'static str, names: &[&'static str]| {
        let braces: Vec<String> = names.iter().map(|name| format!("{{{name}}}")).collect();
        let values: Vec<(&str, &str)> = names.iter().copied().zip(braces.iter().map(String::as_str)).collect();
        (key.to_owned(), l.with(key, &values))
    };
    let with_values = [
        filled("controlOther", &["name"]),
        filled("controlPair", &["number"]),
        filled("controlCheck", &["point", "length"]),
        filled("controlCheckThree", &["length"]),
        filled("controlFits", &["length"]),
        filled("controlFailed", &["reason"]),
        filled("controlRemoveName", &["name"]),
        filled("controlMany", &["count"]),
    ];
    let needed = (1..=3_u64).map(|count| (format!("controlNeed{count}"), l.with("controlNeed", &[("count", count)])));
    let decimal = ("decimal".to_owned(), l.decimals("."));
    let plain = PLAIN.into_iter().map(|key| (key.to_owned(), l.t(key).to_owned()));
    let all: serde_json::Map<String, serde_json::Value> =
        plain.chain(with_values).chain(needed).chain([decimal]).map(|(key, text)| (key, text.into())).collect();
    serde_json::Value::Object(all).to_string()
}

//! Where notes are: near the model, in a scene with y up, and without the place on earth.

use super::{Body, MARGIN, Note, Notes, View, same_pack};
use crate::date::is_day;
use glam::DVec3;
use kilwa_pack::plural::counted;
use serde_json::{Map, Value, json};

/// What a note and a text of it may be for (Web Annotation Data Model, W3C 2017, section 3.3.5).
const MOTIVATIONS: [&str; 13] = [
    "assessing",
    "bookmarking",
    "classifying",
    "commenting",
    "describing",
    "editing",
    "highlighting",
    "identifying",
    "linking",
    "moderating",
    "questioning",
    "replying",
    "tagging",
];
/// Years in which a note may have been written. Others may be digits of a coordinate: `5659-07-07`.
const YEARS: std::ops::RangeInclusive<u32> = 1900..=2100;
/// Numeric regions and variants that are in use (IANA Language Subtag Registry).
const REGIONS: [&str; 3] = ["001", "150", "419"];
const VARIANTS: [&str; 6] = ["1901", "1996", "fonipa", "polyton", "tarask", "valencia"];
/// Moved positions are rounded to this part of a metre, a micrometre. Finer digits would be noise that reveals how large the number was before.
const PARTS: f64 = 1e6;

/// Whether a place is in a box with its margin.
pub(super) fn is_near(place: DVec3, min: DVec3, max: DVec3) -> bool {
    let margin = max.distance(min) * MARGIN;
    place.cmpge(min - margin).all() && place.cmple(max + margin).all()
}

/// A place of the pack in a scene with y up whose zero is at `origin` of the pack: as the preview stands in it.
pub fn scene_point(place: DVec3, origin: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = place - origin;
    DVec3::new(x, z, -y).map(rounded)
}

/// Rounded to the `PARTS`th part of a metre; minus zero becomes zero.
fn rounded(v: f64) -> f64 {
    (v * PARTS).round() / PARTS + 0.0
}

impl Notes {
    /// The notes without what reveals a location on earth: moved by `offset` (what has to be added to the new coordinates to get the old ones), without
    /// links, display, names of packs and everything else that is not words, dates or a name. Those that were made on a pack of `already`,
    /// whose place was taken out before, stand where they are to.
    #[must_use]
    pub fn without_place(mut self, offset: DVec3, already: &[&str]) -> Self {
        for (number, note) in (1..).zip(&mut self.notes) {
            let is_there = note.made_on.as_deref().is_some_and(|made_on| already.iter().any(|a| same_pack(a, made_on)));
            note.without_place(if is_there { DVec3::ZERO } else { offset }, number);
        }
        self
    }

    /// What [`Self::without_place`] would leave out, for people; empty where nothing.
    pub fn revealing(&self) -> Option<String> {
        let links = self.notes.iter().filter(|n| n.links().next().is_some()).count();
        let displays = self.notes.iter().filter(|n| n.view.as_ref().is_some_and(|v| v.display.is_some())).count();
        let parts = [(links, "links"), (displays, "shading and sections")];
        let kinds: Vec<String> = parts
            .iter()
            .filter(|(n, _)| *n > 0)
            .map(|&(n, what)| format!("{what} of {}", counted(n, "note", "notes")))
            .collect();
        (!kinds.is_empty()).then(|| format!("{}, which may reveal the location", kinds.join(" and ")))
    }
}

impl Note {
    fn without_place(&mut self, offset: DVec3, number: usize) {
        self.place = (self.place - offset).map(rounded);
        self.bodies.retain(|b| matches!(b, Body::Text { .. }));
        for body in &mut self.bodies {
            if let Body::Text { purpose, .. } = body {
                *purpose = known_motivation(purpose).to_owned();
            }
        }
        self.made_on = None;
        self.states.clear();
        let camera = self.view.take().and_then(|v| v.camera);
        self.view = camera.map(|mut camera| {
            for (v, offset) in camera.iter_mut().skip(3).zip(offset.to_array()) {
                *v = rounded(*v - offset);
            }
            View { camera: Some(camera), display: None }
        });
        let mut rest = Map::new();
        for key in ["created", "modified"] {
            if let Some(moment) = self.rest.get(key).and_then(Value::as_str).filter(|m| is_moment(m)) {
                rest.insert(key.to_owned(), moment.into());
            }
        }
        let motivation = self.rest.get("motivation").and_then(Value::as_str).unwrap_or_default();
        rest.insert("motivation".to_owned(), known_motivation(motivation).into());
        let creators: Vec<Value> = self.creators().into_iter().map(|name| json!({ "name": name })).collect();
        if !creators.is_empty() {
            rest.insert("creator".to_owned(), creators.into());
        }
        self.rest = rest;
        // A name may be an address, or contain the original location; a random one reveals nothing.
        if !self.id.strip_prefix("urn:uuid:").is_some_and(is_random_uuid) {
            self.id = self.derived_id(number);
        }
    }
}

/// Whether a text has the form of a registered language (BCP 47): language, script, region and a few variants. Private use (`x-565977`), extensions and
/// numbers could hide anything.
pub(super) fn is_registered_language(text: &str) -> bool {
    let mut parts = text.split('-').peekable();
    let letters = |part: &str, length: std::ops::RangeInclusive<usize>| {
        length.contains(&part.len()) && part.bytes().all(|b| b.is_ascii_alphabetic())
    };
    if !parts.next().is_some_and(|p| letters(p, 2..=3)) {
        return false;
    }
    // Like yue in zh-yue.
    parts.next_if(|p| letters(p, 3..=3));
    parts.next_if(|p| letters(p, 4..=4));
    parts.next_if(|p| letters(p, 2..=2) || REGIONS.contains(p));
    parts.all(|p| VARIANTS.contains(&p.to_ascii_lowercase().as_str()))
}

/// A motivation of the model; `describing` for every other word, which might be anything.
fn known_motivation(text: &str) -> &'static str {
    MOTIVATIONS.into_iter().find(|m| *m == text).unwrap_or("describing")
}

/// Whether a text is a random UUID as it is written: 8-4-4-4-12 hexadecimal digits of version 4 (RFC 9562, section 5.4). Others may be made of a name
/// or a place, which a guess confirms.
fn is_random_uuid(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    let lengths: Vec<usize> = parts.iter().map(|p| p.len()).collect();
    let is_version = parts.get(2).is_some_and(|p| p.starts_with('4'));
    let is_variant = parts.get(3).is_some_and(|p| p.starts_with(['8', '9', 'a', 'b', 'A', 'B']));
    lengths == [8, 4, 4, 4, 12] && is_version && is_variant && text.bytes().all(|b| b == b'-' || b.is_ascii_hexdigit())
}

/// Whether a text is a day of a recent year, or a moment of it to a millisecond at the finest: `2026-11-20T10:00:00.000Z` (ISO 8601-1).
fn is_moment(text: &str) -> bool {
    let is_recent =
        |day: &str| day.get(..4).and_then(|year| year.parse::<u32>().ok()).is_some_and(|year| YEARS.contains(&year));
    let Some((day, clock)) = text.split_once('T') else { return is_recent(text) && is_day(text) };
    let zone = clock.find(['Z', '+', '-']).unwrap_or(clock.len());
    let (time, zone) = clock.split_at(zone);
    let (time, fraction) = time.split_once('.').map_or((time, None), |(time, fraction)| (time, Some(fraction)));
    let digits = |text: &str, max: u32| {
        text.len() == 2 && text.bytes().all(|b| b.is_ascii_digit()) && text.parse::<u32>().is_ok_and(|n| n <= max)
    };
    // A leap second is the sixtieth.
    let is_clock = |text: &str, max: [u32; 3]| {
        let parts: Vec<&str> = text.split(':').collect();
        (2..=max.len()).contains(&parts.len()) && parts.iter().zip(max).all(|(part, max)| digits(part, max))
    };
    let is_zone = match zone.strip_prefix(['+', '-']) {
        Some(hours) => hours.len() == 5 && is_clock(hours, [23, 59, 59]),
        None => zone.is_empty() || zone == "Z",
    };
    let is_fraction = |f: &str| time.len() == 8 && (1..=3).contains(&f.len()) && f.bytes().all(|b| b.is_ascii_digit());
    is_recent(day) && is_day(day) && is_clock(time, [24, 59, 60]) && fraction.is_none_or(is_fraction) && is_zone
}

//! Where notes are: near the model, in a scene with y up, and without the place on earth.

use super::{Body, MARGIN, Note, Notes, View, same_pack};
use crate::object::date::is_day;
use serde_json::{Map, Value, json};

/// Map coordinates begin here: smaller numbers are lengths, years and house numbers.
const MAP: f64 = 10_000.0;
/// What is around the model tells its place as well, metres and degrees.
const AROUND: f64 = 1000.0;
const AROUND_DEGREES: f64 = 0.05;
/// Digits behind the point from which on a number may be degrees of a place, and not a length.
const DEGREE_DIGITS: usize = 4;
/// The same for two numbers, of which one is near the latitude and one near the longitude.
const PAIR_DIGITS: usize = 3;
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
/// Moved places are told to so many parts of a metre: a micrometre. Finer ones would be noise that tells how large the number was before.
const PARTS: f64 = 1e6;

/// Whether a place is in a box with its margin.
pub(super) fn is_near(place: [f64; 3], min: [f64; 3], max: [f64; 3]) -> bool {
    let diagonal = (0..3).map(|k| (max[k] - min[k]).powi(2)).sum::<f64>().sqrt();
    let margin = diagonal * MARGIN;
    (0..3).all(|k| place[k] >= min[k] - margin && place[k] <= max[k] + margin)
}

/// A place of the pack in a scene with y up whose zero is at `origin` of the pack: as the preview stands in it.
pub fn scene_point(place: [f64; 3], origin: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = [0, 1, 2].map(|k| place[k] - origin[k]);
    // Minus zero is no better zero.
    [x, z, -y].map(|v| ((v * PARTS).round() / PARTS) + 0.0)
}

impl Notes {
    /// The notes without what tells a place on earth: moved by `offset` (what has to be added to the new coordinates to get the old ones), without
    /// links, display, names of packs and everything else that is not words, dates or a name. Those that were made on a pack of `already`,
    /// whose place was taken out before, stand where they are to.
    #[must_use]
    pub fn without_place(mut self, offset: [f64; 3], already: &[&str]) -> Self {
        for (number, note) in (1..).zip(&mut self.notes) {
            let is_there = note.made_on.as_deref().is_some_and(|made_on| already.iter().any(|a| same_pack(a, made_on)));
            note.without_place(if is_there { [0.0; 3] } else { offset }, number);
        }
        self
    }

    /// What [`Self::without_place`] would leave out, for people; empty where nothing.
    pub fn telling(&self) -> Option<String> {
        let links = self.notes.iter().filter(|n| n.links().next().is_some()).count();
        let displays = self.notes.iter().filter(|n| n.view.as_ref().is_some_and(|v| v.display.is_some())).count();
        let parts = [(links, "links"), (displays, "shading and sections")];
        let said: Vec<String> =
            parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{what} of {n} notes")).collect();
        (!said.is_empty()).then(|| format!("{}, which may tell the place", said.join(" and ")))
    }
}

impl Note {
    fn without_place(&mut self, offset: [f64; 3], number: usize) {
        let moved = |k: usize, v: f64| (((v - offset[k]) * PARTS).round() / PARTS) + 0.0;
        self.place = [0, 1, 2].map(|k| moved(k, self.place[k]));
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
            for (k, v) in camera.iter_mut().skip(3).take(3).enumerate() {
                *v = moved(k, *v);
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
        // A name may be an address, or made of the place as it was; a random one tells nothing.
        if !self.id.strip_prefix("urn:uuid:").is_some_and(is_uuid) {
            self.id = self.derived_id(number);
        }
    }
}

/// A motivation of the model; `describing` for every other word, which might be anything.
fn known_motivation(text: &str) -> &'static str {
    MOTIVATIONS.into_iter().find(|m| *m == text).unwrap_or("describing")
}

/// Whether a text is a UUID as it is written: 8-4-4-4-12 hexadecimal digits (RFC 9562, section 4).
fn is_uuid(text: &str) -> bool {
    let lengths: Vec<usize> = text.split('-').map(str::len).collect();
    lengths == [8, 4, 4, 4, 12] && text.bytes().all(|b| b == b'-' || b.is_ascii_hexdigit())
}

/// Whether a text is a day that exists, or a moment of it to a millisecond at the finest: `2026-11-20T10:00:00.000Z` (ISO 8601-1).
fn is_moment(text: &str) -> bool {
    let Some((day, clock)) = text.split_once('T') else { return is_day(text) };
    let zone = clock.find(['Z', '+', '-']).unwrap_or(clock.len());
    let (time, zone) = clock.split_at(zone);
    let (time, fraction) = time.split_once('.').map_or((time, None), |(time, fraction)| (time, Some(fraction)));
    let digits = |text: &str, most: u32| {
        text.len() == 2 && text.bytes().all(|b| b.is_ascii_digit()) && text.parse::<u32>().is_ok_and(|n| n <= most)
    };
    // A leap second is the sixtieth.
    let is_clock = |text: &str, most: [u32; 3]| {
        let parts: Vec<&str> = text.split(':').collect();
        (2..=most.len()).contains(&parts.len()) && parts.iter().zip(most).all(|(part, most)| digits(part, most))
    };
    let is_zone = match zone.strip_prefix(['+', '-']) {
        Some(hours) => hours.len() == 5 && is_clock(hours, [23, 59, 59]),
        None => zone.is_empty() || zone == "Z",
    };
    let is_fraction = |f: &str| time.len() == 8 && (1..=3).contains(&f.len()) && f.bytes().all(|b| b.is_ascii_digit());
    is_day(day) && is_clock(time, [24, 59, 60]) && fraction.is_none_or(is_fraction) && is_zone
}

/// The first number in a text that is a map coordinate in or around this box, or what tells a latitude or longitude near one of `degrees`: a
/// number of four decimals, two of three decimals that are near two of them, or degrees and minutes.
pub fn digits_of_a_place(text: &str, min: [f64; 3], max: [f64; 3], degrees: &[f64]) -> Option<String> {
    let text: String = text.chars().map(plain).collect();
    let is_near = |v: f64| (0..2).any(|k| min[k].abs() >= MAP && v >= min[k] - AROUND && v <= max[k] + AROUND);
    let numbers = numbers(&text);
    let one = numbers.iter().find(|digits| {
        let Ok(v) = digits.parse::<f64>() else { return false };
        is_near(v) || is_near(-v) || (decimals(digits) >= DEGREE_DIGITS && near_degree(v, degrees).is_some())
    });
    one.cloned().or_else(|| pair(&numbers, degrees)).or_else(|| minutes(&text, degrees))
}

/// Digits behind the point.
fn decimals(digits: &str) -> usize {
    digits.split_once('.').map_or(0, |(_, behind)| behind.len())
}

/// Which of `degrees` a number is near, whatever their signs.
fn near_degree(v: f64, degrees: &[f64]) -> Option<f64> {
    degrees.iter().map(|d| d.abs()).find(|d| (v - d).abs() < AROUND_DEGREES)
}

/// A latitude and a longitude of three decimals each, one of which alone may be a length.
fn pair(numbers: &[String], degrees: &[f64]) -> Option<String> {
    let near = |digits: &String| {
        let v = digits.parse::<f64>().ok().filter(|_| decimals(digits) >= PAIR_DIGITS)?;
        Some((digits.clone(), near_degree(v, degrees)?))
    };
    let mut found = numbers.iter().filter_map(near);
    let (first, one) = found.next()?;
    let (second, _) = found.find(|(_, other)| (one - other).abs() > 2.0 * AROUND_DEGREES)?;
    Some(format!("{first} {second}"))
}

/// Degrees and minutes, with seconds or without, near one of `degrees`: `8° 57' 27.7" S`.
fn minutes(text: &str, degrees: &[f64]) -> Option<String> {
    text.match_indices(['°', 'º', '˚']).find_map(|(at, sign)| {
        let before = text.get(..at)?.trim_end();
        let digits = before.len() - before.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let whole = before.get(before.len() - digits..)?.parse::<f64>().ok()?;
        let (minutes, rest) = leading(text.get(at + sign.len()..)?)?;
        let seconds = rest.trim_start().strip_prefix(['\'', '′', '’']).and_then(leading).map_or(0.0, |(s, _)| s);
        near_degree(whole + minutes / 60.0 + seconds / 3600.0, degrees)?;
        Some(format!("{whole}° {minutes}'"))
    })
}

/// The number that a text begins with, after spaces, and what follows it.
fn leading(text: &str) -> Option<(f64, &str)> {
    let text = text.trim_start();
    let end = text.find(|c: char| !c.is_ascii_digit() && !".,".contains(c)).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    Some((digits.trim_end_matches(['.', ',']).replace(',', ".").parse().ok()?, rest))
}

/// Digits and separators of other scripts as ASCII has them.
fn plain(c: char) -> char {
    // The zeros of Arabic, Persian, Devanagari, Bengali and full-width digits; the other nine follow each.
    const ZEROS: [u32; 5] = [0x660, 0x6f0, 0x966, 0x9e6, 0xff10];
    let digit = |zero: &u32| char::from_digit(u32::from(c).checked_sub(*zero)?, 10);
    match c {
        // Arabic decimal and thousands separators, and the comma.
        '\u{66b}' => '.',
        '\u{66c}' | '\u{60c}' => ',',
        _ => ZEROS.iter().find_map(digit).unwrap_or(c),
    }
}

/// Numbers as they are written by people: with a point or a comma, grouped by spaces, commas, points or apostrophes.
fn numbers(text: &str) -> Vec<String> {
    let chars: Vec<char> = text.chars().collect();
    let digit = |i: usize| chars.get(i).is_some_and(char::is_ascii_digit);
    let mut all = Vec::new();
    let mut at = 0;
    while at < chars.len() {
        if !digit(at) {
            at += 1;
            continue;
        }
        // Runs of digits with a single other sign between them.
        let (mut runs, mut signs) = (vec![String::new()], Vec::new());
        loop {
            while digit(at) {
                if let (Some(run), Some(c)) = (runs.last_mut(), chars.get(at)) {
                    run.push(*c);
                }
                at += 1;
            }
            let sign = chars.get(at).copied().filter(|c| ".,'’_ \u{a0}\u{2009}\u{202f}".contains(*c));
            let Some(sign) = sign.filter(|_| digit(at + 1)) else { break };
            signs.push(sign);
            runs.push(String::new());
            at += 1;
        }
        all.extend(readings(&runs, &signs));
    }
    all
}

/// What runs of digits can mean: each for itself, all as one number, and with the last sign, or any one point, as the decimal one.
fn readings(runs: &[String], signs: &[char]) -> Vec<String> {
    let mut all = runs.to_vec();
    for from in 0..runs.len() {
        // A group of a map coordinate has three digits; seven of them are the most that is looked at.
        let mut whole = runs.get(from).cloned().unwrap_or_default();
        for (sign, next) in signs.iter().zip(runs.iter().skip(1)).skip(from).take(7) {
            if ".,".contains(*sign) {
                all.push(format!("{whole}.{next}"));
            }
            if next.len() != 3 {
                break;
            }
            whole.push_str(next);
            all.push(whole.clone());
        }
    }
    all
}

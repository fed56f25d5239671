//! Coordinates and reference systems of any place, by form alone: for texts whose withheld location is unknown.
//!
//! Stricter than what a known location needs: five decimals are a coordinate here, whatever they measure. A single whole number (`565977`) says nothing by
//! its form and passes.

use super::angles::{Angle, Axis, axis_of, word_before};
use super::codes::{grid_reference, labelled, labelled_grid};
use super::text::Number;
use super::{BESIDE, Kind, is_degree, may_be_degrees};

/// Reference systems of the whole earth (EPSG), which reveal no location.
const WORLDWIDE: [&str; 9] = ["4326", "4978", "4979", "4936", "3857", "3395", "3785", "9707", "900913"];
/// Decimals of a latitude or longitude without anything that says so, and of one beside another or with its letter.
const ALONE_DECIMALS: usize = 5;
const PAIR_DECIMALS: usize = 3;
/// Metres: eastings of UTM and its relatives, and northings beside them.
const EASTINGS: std::ops::Range<f64> = 100_000.0..900_000.0;
const NORTHINGS: std::ops::Range<f64> = 1_000_000.0..10_000_000.0;
/// Words that may come between an easting and a northing.
const AXES: [&str; 15] =
    ["e", "n", "s", "w", "m", "x", "y", "and", "east", "west", "north", "south", "easting", "northing", "mn"];
/// Words that may come between `UTM` and a zone.
const ZONE_WORDS: [&str; 12] =
    ["zone", "zona", "huso", "fuso", "fuseau", "no", "nr", "z", "wgs", "etrs", "nad", "projection"];

/// A place between two characters, and what is there.
type Found = (usize, usize, Kind);

/// How a text is searched.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    /// Whether the reference system is given.
    pub(super) is_system_known: bool,
    /// Whether the text is unchanged; otherwise its hyphens were replaced by points or spaces.
    pub(super) is_written: bool,
}

/// The first piece that can hardly be anything but a coordinate or a regional reference system; the latter only if it is not public.
pub(super) fn found(text: &[char], numbers: &[Number], angles: &[Angle], form: Form) -> Option<Found> {
    let coordinates = |(from, to): (usize, usize)| (from, to, Kind::Coordinates);
    let system = || {
        let zone = || zones(text, numbers).next().map(|(_, from, to)| (from, to));
        epsg(text).or_else(zone).map(|(from, to)| (from, to, Kind::RegionalSystem))
    };
    let from_system = if form.is_system_known { None } else { system() };
    from_system
        .or_else(|| degrees(text, numbers, angles, form).map(coordinates))
        .or_else(|| eastings(text, numbers).map(coordinates))
        .or_else(|| {
            let code = grid_reference(text)
                .or_else(|| geohash(text))
                .or_else(|| labelled(text))
                .or_else(|| labelled_grid(text));
            code.map(|(from, to)| (from, to, Kind::Code))
        })
}

/// UTM zones that are named as such (`UTM zone 37S`, `37L UTM`), and where they are.
pub(super) fn zones<'a>(text: &'a [char], numbers: &'a [Number]) -> impl Iterator<Item = (u32, usize, usize)> + 'a {
    let small = numbers.iter().filter(|n| n.decimals == 0 && n.to - n.from <= 2 && (1.0..=60.0).contains(&n.value));
    small.filter_map(move |n| {
        let before = lower(text, n.from.saturating_sub(28), n.from);
        let named = before.rfind("utm").and_then(|at| before.get(at + 3..));
        let is_before = named.is_some_and(|between| only_words(between, &ZONE_WORDS));
        let behind = lower(text, n.to, n.to + 12);
        let is_behind = behind
            .trim_start_matches(|c: char| c.is_ascii_alphabetic())
            .trim_start_matches([' ', '(', '/', ','])
            .starts_with("utm")
            || behind.trim_start_matches([' ', '(', '/', ',']).starts_with("utm");
        let letter = usize::from(text.get(n.to).is_some_and(char::is_ascii_alphabetic));
        (is_before || is_behind).then_some((n.value as u32, n.from, n.to + letter))
    })
}

/// `zone 37S`, without a word of UTM: for who knows the zone.
pub(super) fn bare_zone(text: &[char], numbers: &[Number], zone: u32) -> Option<(usize, usize)> {
    let of_it = numbers.iter().filter(|n| n.decimals == 0 && n.value == f64::from(zone) && n.to - n.from == 2);
    of_it.map(|n| (n.from, n.to)).find(|(from, to)| {
        let before = lower(text, from.saturating_sub(8), *from);
        let has_letter = lower(text, *to, to + 2).trim_start().starts_with(|c: char| c.is_ascii_alphabetic());
        has_letter && ["zone", "zona", "huso", "fuso"].iter().any(|w| before.trim_end().ends_with(w))
    })
}

fn lower(text: &[char], from: usize, to: usize) -> String {
    let part = text.get(from.min(text.len())..to.min(text.len())).unwrap_or_default();
    part.iter().map(char::to_ascii_lowercase).collect()
}

fn only_words(text: &str, words: &[&str]) -> bool {
    text.split(|c: char| !c.is_alphabetic()).all(|w| w.is_empty() || words.contains(&w))
}

/// The code of a regional reference system.
fn epsg(text: &[char]) -> Option<(usize, usize)> {
    let lower: Vec<char> = text.iter().map(char::to_ascii_lowercase).collect();
    (0..lower.len()).find_map(|at| {
        if lower.get(at..at + 4)? != ['e', 'p', 's', 'g'] {
            return None;
        }
        let from = (at + 4..lower.len().min(at + 20)).find(|i| lower.get(*i).is_some_and(char::is_ascii_digit))?;
        // A longer number is not an EPSG code.
        let code: String = lower.iter().skip(from).take(7).take_while(|c| c.is_ascii_digit()).collect();
        let is_regional = (4..=6).contains(&code.len()) && !WORLDWIDE.contains(&code.as_str());
        is_regional.then_some((at, from + code.len()))
    })
}

fn degrees(text: &[char], numbers: &[Number], angles: &[Angle], form: Form) -> Option<(usize, usize)> {
    let is_degrees = |n: &&Number| !n.is_list && may_be_degrees(text, n);
    let alone = numbers.iter().filter(is_degrees).find(|n| {
        let has_axis = || is_degree(text, n) || axis_of(text, n.from, n.to).is_some();
        let is_named = n.decimals >= 1 && is_named(text, n);
        is_named || form.is_written && n.decimals >= ALONE_DECIMALS || n.decimals >= PAIR_DECIMALS && has_axis()
    });
    if let Some(n) = alone {
        return Some((n.from, n.to));
    }
    if let Some(a) = angles.iter().find(|a| is_angle(text, a)) {
        return Some((a.from, a.to));
    }
    if let Some(range) = sixties(text, angles) {
        return Some(range);
    }
    let fine: Vec<&Number> = numbers.iter().filter(is_degrees).filter(|n| n.decimals >= PAIR_DECIMALS).collect();
    fine.windows(2)
        .find_map(|two| {
            let [a, b] = two else { return None };
            let between = text.get(a.to..b.from)?;
            let is_pair = (1..=4).contains(&between.len()) && between.iter().all(|c| " ,;/|+-".contains(*c));
            (is_pair && (a.value <= 90.0 || b.value <= 90.0)).then_some((a.from, b.to))
        })
        .or_else(|| in_address(text, numbers))
}

/// Whether a word for the axis precedes a number, except words that also mean a length (`12 m long, 8.5 m wide`, `Breite 8.5 m`).
fn is_named(text: &[char], n: &Number) -> bool {
    const WORDS: [&str; 5] = ["lat", "lon", "lng", "tude", "itud"];
    let before = lower(text, n.from.saturating_sub(24), n.from);
    let word = before.trim_end_matches(|c: char| !c.is_alphabetic());
    WORDS.iter().any(|w| word.ends_with(w)) && word_before(text, n.from).is_some()
}

/// The centre of a map in an address: `@-8.96,39.52,17z`.
fn in_address(text: &[char], numbers: &[Number]) -> Option<(usize, usize)> {
    let fine: Vec<&Number> = numbers.iter().filter(|n| n.decimals >= 2 && !n.is_list).collect();
    fine.windows(2).find_map(|two| {
        let [a, b] = two else { return None };
        let sign = usize::from(a.from >= 1 && text.get(a.from - 1) == Some(&'-'));
        let begins = a.from.checked_sub(1 + sign).and_then(|i| text.get(i)) == Some(&'@');
        let is_pair = matches!(text.get(a.to..b.from)?, [','] | [',', '-']);
        (begins && is_pair && a.value <= 90.0 && b.value <= 180.0).then_some((a.from, b.to))
    })
}

/// Whether a sexagesimal angle is unlikely to be a time or a date: it has unit signs, or all three parts and the letter of an axis.
/// Three numbers that look like a date or a version do not count if only a direction word or an initial follows.
fn is_angle(text: &[char], a: &Angle) -> bool {
    let max = if a.axis == Some(Axis::Latitude) { 90.0 } else { 180.0 };
    if a.value > max {
        return false;
    }
    if a.is_marked {
        return a.axis.is_some() || a.has_seconds;
    }
    let at = |i: Option<usize>| i.and_then(|i| text.get(i));
    // The end of a longer chain, such as a date.
    let is_inner = at(a.from.checked_sub(1)).is_some_and(|c| ".,:-/_".contains(*c))
        && at(a.from.checked_sub(2)).is_some_and(char::is_ascii_digit);
    let is_beside = |c: Option<&char>| c.is_some_and(|c| "NSEW".contains(*c));
    let has_letter = || is_beside(at(a.from.checked_sub(1))) || is_beside(at(Some(a.to)));
    a.axis.is_some() && !a.is_doubtful && !is_inner && (a.has_seconds || a.sign == ':' && has_letter())
}

/// Two angles side by side, written like times, one of them later than any time of day: `08:57:27, 39:31:22`.
fn sixties(text: &[char], angles: &[Angle]) -> Option<(usize, usize)> {
    let all: Vec<&Angle> = angles.iter().filter(|a| a.has_seconds && a.sign == ':').collect();
    all.windows(2).find_map(|two| {
        let [a, b] = two else { return None };
        let between = text.get(a.to..b.from)?;
        let is_pair = (1..=4).contains(&between.len()) && between.iter().all(|c| " ,;/|+-".contains(*c));
        (is_pair && a.value.max(b.value) >= 25.0 && a.value.min(b.value) <= 90.0).then_some((a.from, b.to))
    })
}

/// An easting beside a northing, with nothing but signs, axes and units between them.
fn eastings(text: &[char], numbers: &[Number]) -> Option<(usize, usize)> {
    let of = |range: &std::ops::Range<f64>| numbers.iter().filter(|n| range.contains(&n.value)).collect::<Vec<_>>();
    let (east, north) = (of(&EASTINGS), of(&NORTHINGS));
    let pair = |first: &Number, then: &Number| {
        let is_near = then.from > first.to && then.from <= first.to + BESIDE;
        (is_near && only_words(&lower(text, first.to, then.from), &AXES)).then_some((first.from, then.to))
    };
    // Both lists are in the order of the text: few are within reach of each.
    let follows = |ones: &[&Number], others: &[&Number]| {
        ones.iter().find_map(|a| {
            let start = others.partition_point(|b| b.from <= a.to);
            others.iter().skip(start).take(8).find_map(|b| pair(a, b))
        })
    };
    follows(&east, &north).or_else(|| follows(&north, &east)).or_else(|| lettered(text, numbers))
}

/// At least the last five digits of an easting and a northing, with their letters: `E65977 N09946`.
fn lettered(text: &[char], numbers: &[Number]) -> Option<(usize, usize)> {
    let of = |letters: &str| -> Vec<&Number> {
        let is_one = |n: &&Number| {
            let before = n.from.checked_sub(1).and_then(|i| text.get(i));
            let is_alone = !n.from.checked_sub(2).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric());
            n.decimals == 0
                && (5..=7).contains(&(n.to - n.from))
                && is_alone
                && before.is_some_and(|c| letters.contains(*c))
        };
        numbers.iter().filter(is_one).collect()
    };
    let (east, north) = (of("EW"), of("NS"));
    super::beside(&east, &north)
}

/// A word labelled as a geohash.
fn geohash(text: &[char]) -> Option<(usize, usize)> {
    let all = lower(text, 0, text.len());
    let (before, behind) = all.split_at(all.find("geohash")?);
    let rest = behind.get(7..)?.trim_start_matches(|c: char| !c.is_alphanumeric());
    let code: String = rest.chars().take_while(char::is_ascii_alphanumeric).collect();
    let from = before.chars().count();
    (code.len() >= 4 && code.chars().any(|c| c.is_ascii_digit())).then_some((from, from + 20))
}

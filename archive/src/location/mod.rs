//! Finds what gives a withheld location away, in texts and in scalar channels ([`channels`]).
//!
//! [`Location::of`] is made of the pack and the metadata that were given; [`Location::unknown`] is for who was given neither, as a server is that
//! takes an upload. Both refuse what can only be a statement of coordinates (a latitude with a longitude, a Plus Code, an address of a
//! map), wherever the place is; a comparison with another site names it in words. Single numbers are refused only where they agree with the
//! true location, so that sizes, dates and inventory numbers pass. Where nothing is known, whatever has the form of a coordinate is refused
//! ([`whichever`]). Words are not understood: names of places stay.
//!
//! Precision: map coordinates within 1 km of the model, degrees within 0.05° or as far as their last digit reaches. Nothing here fails or
//! panics; time grows with the length of the text.

mod angles;
pub mod channels;
mod codes;
mod names;
pub mod projection;
mod samples;
mod text;
mod unseen;
mod whichever;

use super::metadata::Place;
use angles::{Angle, Axis, angles, axis_of};
use codes::Square;
use glam::DVec3;
pub use names::is_name;
use projection::{degrees_of_box, projected};
use serde_json::Value;
use std::fmt;
use text::{Number, numbers, readable, shown};

/// Map coordinates begin here, metres: smaller numbers are lengths, years and house numbers.
const MAP: f64 = 10_000.0;
/// The surroundings of the model reveal its location as well: metres and degrees.
const AROUND: f64 = 1000.0;
const AROUND_DEGREES: f64 = 0.05;
/// Decimals from which on a number alone may be degrees, a pair anywhere in a text, and two numbers side by side.
const ALONE_DECIMALS: usize = 4;
const PAIR_DECIMALS: usize = 3;
const BESIDE_DECIMALS: usize = 2;
/// Decimals of two numbers side by side that can be nothing but coordinates, whichever place they name.
const ANYWHERE_DECIMALS: usize = 5;
/// Characters between two numbers that belong together.
const BESIDE: usize = 16;
/// Units of map coordinates besides the metre, in metres: international and US survey foot, yard, centimetre, millimetre.
const UNITS: [f64; 5] = [0.3048, 1200.0 / 3937.0, 0.9144, 0.01, 0.001];

/// What gives a location away in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The piece of the text, as it is read.
    pub found: String,
    /// What it is.
    pub kind: Kind,
}

/// What a [`Finding`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// An easting or northing in or around the model.
    MapCoordinate,
    /// A latitude or longitude near the model's.
    Degrees,
    /// A pair of coordinates of whichever place.
    Coordinates,
    /// An address that leads to a map or gazetteer.
    MapAddress,
    /// A geohash, Plus Code, grid reference or the like.
    Code,
    /// The model's reference system.
    ReferenceSystem,
    /// A reference system of some region, or a zone of one.
    RegionalSystem,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.kind {
            Kind::MapCoordinate => "is a map coordinate of the model",
            Kind::Degrees => "is a latitude or longitude of the model",
            Kind::Coordinates => "states coordinates",
            Kind::MapAddress => "leads to a map or a gazetteer",
            Kind::Code => "is a location code (geohash, Plus Code, grid reference)",
            Kind::RegionalSystem => "names a reference system that is used in one region only",
            Kind::ReferenceSystem => "names the model's reference system",
        };
        write!(f, "\"{}\" {what}, and the location is to be withheld; remove it from the text", self.found)
    }
}

/// A range of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    fn around(low: f64, high: f64, margin: f64) -> Self {
        Self { low: low.min(high) - margin, high: low.max(high) + margin }
    }

    /// Whatever the sign.
    fn has(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value) || (self.low..=self.high).contains(&-value)
    }
}

/// Two numbers that together reveal the location, and the minimum length of each as written, characters.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Together {
    ranges: [Range; 2],
    digits: usize,
}

/// The location that is to be withheld, as far as it is known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Location {
    /// Latitude and longitude, degrees.
    sites: Vec<[f64; 2]>,
    /// The same and those of which only one is known.
    degrees: Vec<f64>,
    /// Map coordinates each of which reveals it, metres.
    ranges: Vec<Range>,
    /// Numbers of which two side by side reveal it.
    together: Vec<Together>,
    squares: Vec<Square>,
    /// The code of the reference system, where that is withheld, too.
    epsg: Option<String>,
    /// Whether the reference system is public.
    is_system_known: bool,
    /// Whether coordinates are refused by their form alone, as nothing else is known.
    is_unknown: bool,
    /// The box of the model in its reference system, metres; for channels.
    bounds: Option<[DVec3; 2]>,
}

impl Location {
    /// Of which nothing is known.
    #[must_use]
    pub fn unknown() -> Self {
        Self { is_unknown: true, ..Self::default() }
    }

    /// Of a model in this box (metres, in the system `crs` where one is known) whose metadata say `place`.
    pub fn of(bounds: [DVec3; 2], crs: Option<&str>, place: Option<&Place>) -> Self {
        let mut all = Self { bounds: Some(bounds), ..Self::default() };
        let [min, max] = bounds;
        let (low, high) = (min.truncate().to_array(), max.truncate().to_array());
        all.add_map(low, high);
        all.add_last_five(low, high);
        all.epsg = crs.and_then(|c| c.strip_prefix("EPSG:")).map(str::to_owned);
        let given = place.map(|p| [p.latitude, p.longitude]).unwrap_or_default();
        all.degrees.extend(given.iter().flatten());
        if let [Some(lat), Some(lon)] = given {
            all.add_site([lat, lon], [0.0; 2]);
        }
        if let Some(site) = crs.and_then(|crs| degrees_of_box(crs, bounds)) {
            all.add_site(site, ((max - min) / 2.0).truncate().to_array());
        }
        all
    }

    /// The same if the reference system may be named, because a cell of it is public.
    #[must_use]
    pub fn with_known_system(mut self) -> Self {
        self.epsg = None;
        self.is_system_known = true;
        self
    }

    fn add_map(&mut self, min: [f64; 2], max: [f64; 2]) {
        for (low, high) in min.into_iter().zip(max).filter(|(low, _)| low.abs() >= MAP) {
            self.ranges.push(Range::around(low, high, AROUND));
        }
    }

    /// The last five digits of easting and northing side by side, as grid references are written.
    fn add_last_five(&mut self, min: [f64; 2], max: [f64; 2]) {
        let is_map = |k: usize| min[k].abs().max(max[k].abs()) >= MAP;
        if !(is_map(0) && is_map(1) && min.iter().chain(&max).all(|v| v.is_finite())) {
            return;
        }
        // A part of the model beyond the edge of a 100 km square has the digits of the next square.
        let all = [0, 1].map(|k| {
            let middle = f64::midpoint(min[k], max[k]).abs().rem_euclid(1e5);
            let half = (max[k] - min[k]).abs() / 2.0;
            let ranges = [-1e5, 0.0, 1e5].map(|by| Range::around(middle - half + by, middle + half + by, AROUND));
            ranges.into_iter().filter(|r| r.high >= 0.0 && r.low < 1e5)
        });
        let [east, north] = all;
        for e in east {
            self.together.extend(north.clone().map(|n| Together { ranges: [e, n], digits: 5 }));
        }
    }

    /// A place in degrees, and half of the model's size in metres.
    fn add_site(&mut self, [lat, lon]: [f64; 2], half: [f64; 2]) {
        if !(lat.abs() <= 90.0 && lon.abs() <= 180.0) {
            return;
        }
        self.sites.push([lat, lon]);
        self.degrees.extend([lat, lon]);
        let zone = (((lon + 180.0) / 6.0).floor() as u32).min(59) + 1;
        let utm = 32_600 + zone + if lat < 0.0 { 100 } else { 0 };
        let epsg = u16::try_from(utm).ok();
        if let Some([east, north]) = epsg.and_then(|utm| projected(utm, [lat, lon])) {
            self.add_map([east - half[0], north - half[1]], [east + half[0], north + half[1]]);
            self.squares.extend(Square::of(zone, [east, north]));
            // Metres south of the equator.
            self.add_map([MAP / 10.0, north - half[1] - 1e7], [MAP / 10.0, north + half[1] - 1e7]);
            let range = |k: usize, v: f64| Range::around(v - half[k], v + half[k], AROUND);
            // Without the false easting or northing, and the last five digits of both.
            for (e, n) in [(east - 5e5, north), (east, north - 1e7), (east - 5e5, north - 1e7)] {
                if e.abs() >= AROUND && n.abs() >= AROUND {
                    self.together.push(Together { ranges: [range(0, e), range(1, n)], digits: 4 });
                }
            }
            self.add_last_five([east - half[0], north - half[1]], [east + half[0], north + half[1]]);
        }
        if let Some([x, y]) = projected(3857, [lat, lon]) {
            self.add_map([x - half[0], y - half[1]], [x + half[0], y + half[1]]);
            // Tiles of maps in the web.
            for zoom in 12..=22 {
                let size = 40_075_016.685_578_49 / f64::from(1u32 << zoom);
                let tile = [(20_037_508.342_789_244 + x) / size, (20_037_508.342_789_244 - y) / size].map(f64::floor);
                let ranges = tile.map(|t| Range { low: t, high: t });
                self.together.push(Together { ranges, digits: 3 });
            }
        }
    }

    /// The first piece of a text that gives the location away.
    pub fn find(&self, text: &str) -> Option<Finding> {
        readable(text).iter().find_map(|text| self.find_in(text, true))
    }

    /// The first text of a JSON value that gives the location away, keys included, with the way to it: `creators[0].name`. `is_passed` says of which ways
    /// nothing is looked at.
    pub fn find_in_json(&self, value: &Value, is_passed: &dyn Fn(&str) -> bool) -> Option<(String, Finding)> {
        self.find_below(value, "", is_passed)
    }

    fn find_below(&self, value: &Value, at: &str, is_passed: &dyn Fn(&str) -> bool) -> Option<(String, Finding)> {
        if is_passed(at) {
            return None;
        }
        match value {
            Value::String(text) => {
                let found = if is_name(at) { self.find_in_name(text) } else { self.find(text) };
                found.map(|f| (at.to_owned(), f))
            }
            Value::Array(list) => {
                let item = |i: usize| format!("{at}[{i}]");
                let alone = list.iter().enumerate().find_map(|(i, v)| self.find_below(v, &item(i), is_passed));
                let together = || self.find_in_json_list(list, &|i| is_passed(&item(i)));
                alone.or_else(|| together().map(|f| (at.to_owned(), f)))
            }
            Value::Object(map) => map.iter().find_map(|(key, v)| {
                let below = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                let in_key = || self.find(key).map(|f| (at.to_owned(), f));
                self.find_below(v, &below, is_passed).or_else(in_key)
            }),
            _ => None,
        }
    }

    /// Search a text. If its hyphens were replaced (`is_written` is false) and the place is unknown, a single decimal number is ignored: it may be
    /// an inventory number.
    fn find_in(&self, text: &[char], is_written: bool) -> Option<Finding> {
        let says = |kind: Kind| move |range: (usize, usize)| says(text, range, kind);
        let (numbers, angles) = (numbers(text), angles(text));
        codes::map_address(text)
            .map(says(Kind::MapAddress))
            .or_else(|| self.map_coordinate(text, &numbers).map(says(Kind::MapCoordinate)))
            .or_else(|| self.degrees(text, &numbers, &angles).map(says(Kind::Degrees)))
            .or_else(|| stated(text, &numbers, &angles).map(says(Kind::Coordinates)))
            .or_else(|| codes::iso6709(text).map(says(Kind::Coordinates)))
            .or_else(|| codes::plus_code(text).map(says(Kind::Code)))
            .or_else(|| codes::near(text, &self.sites, &self.squares).map(says(Kind::Code)))
            .or_else(|| self.system(text, &numbers).map(says(Kind::ReferenceSystem)))
            .or_else(|| {
                let form = whichever::Form { is_system_known: self.is_system_known, is_written };
                let found = || whichever::found(text, &numbers, &angles, form);
                let (from, to, kind) = if self.is_unknown { found()? } else { return None };
                Some(Finding { found: shown(text, from, to), kind })
            })
    }

    fn map_coordinate(&self, text: &[char], numbers: &[Number]) -> Option<(usize, usize)> {
        let is_map = |v: f64| self.ranges.iter().any(|r| r.has(v));
        let alone = numbers.iter().find(|n| {
            let is_kilometres = n.decimals > 0 && begins(text, n.to, "km");
            is_map(n.value)
                || n.value >= 10.0 * MAP && UNITS.iter().any(|u| is_map(n.value * u))
                || is_kilometres && is_map(n.value * 1000.0)
        });
        // Count only digits before the decimal point: small lengths would otherwise look like the corner of a square.
        let whole = |n: &Number| {
            let is = |at: Option<usize>, what: &dyn Fn(&char) -> bool| at.and_then(|i| text.get(i)).is_some_and(what);
            let is_fraction =
                is(n.from.checked_sub(1), &|c| ".,".contains(*c)) && is(n.from.checked_sub(2), &char::is_ascii_digit);
            // A fraction, but not the second of two numbers with a comma between them: `65977,09946`.
            let before = text.get(..n.from.saturating_sub(1)).unwrap_or_default();
            let is_fraction = is_fraction && before.iter().rev().take_while(|c| c.is_ascii_digit()).take(4).count() < 4;
            let digits = text.get(n.from..n.to).unwrap_or_default().iter().filter(|c| c.is_ascii_digit()).count();
            if is_fraction { 0 } else { digits.saturating_sub(n.decimals) }
        };
        let both = || {
            self.together.iter().find_map(|t| {
                let of = |range: Range| -> Vec<&Number> {
                    numbers.iter().filter(|n| whole(n) >= t.digits && range.has(n.value)).collect()
                };
                beside(&of(t.ranges[0]), &of(t.ranges[1]))
            })
        };
        alone.map(|n| (n.from, n.to)).or_else(both)
    }

    /// Which of the degrees a number is near, as far as its last digit says, whatever the signs.
    fn near(&self, value: f64, decimals: usize) -> Option<f64> {
        let reach = 10f64.powi(-i32::try_from(decimals.min(9)).unwrap_or(9)).max(AROUND_DEGREES);
        self.degrees.iter().map(|d| d.abs()).find(|d| (value - d).abs() < reach)
    }

    fn degrees(&self, text: &[char], numbers: &[Number], angles: &[Angle]) -> Option<(usize, usize)> {
        let is_marked = |n: &Number| is_degree(text, n) || axis_of(text, n.from, n.to).is_some();
        let near = |n: &&Number| self.near(n.value, n.decimals).is_some();
        let alone =
            numbers.iter().filter(near).find(|n| n.decimals >= ALONE_DECIMALS || n.decimals >= 1 && is_marked(n));
        if let Some(n) = alone {
            return Some((n.from, n.to));
        }
        let in_parts = numbers.iter().filter(|n| n.decimals >= 1).find(|n| {
            let unit = |words: &[&str]| words.iter().any(|w| begins(text, n.to, w));
            let is_near = |v: f64| self.near(v, 9).is_some();
            unit(&["gon", "gra"]) && is_near(n.value * 0.9)
                || unit(&["min", "arcmin"]) && n.value > 60.0 && is_near(n.value / 60.0)
        });
        if let Some(n) = in_parts {
            return Some((n.from, n.to));
        }
        let angle = angles.iter().find(|a| (a.is_marked || a.axis.is_some()) && self.near(a.value, 9).is_some());
        if let Some(a) = angle {
            return Some((a.from, a.to));
        }
        let mut pairs = numbers
            .iter()
            .filter(|n| n.decimals >= PAIR_DECIMALS)
            .filter_map(|n| Some((n, self.near(n.value, n.decimals)?)));
        if let Some((first, one)) = pairs.next()
            && let Some((second, _)) =
                pairs.find(|(n, other)| n.from >= first.to && (one - other).abs() > 2.0 * AROUND_DEGREES)
        {
            return Some((first.from, if second.to - first.from < 60 { second.to } else { first.to }));
        }
        self.sites.iter().find_map(|site| {
            let decimal = |d: f64| -> Vec<&Number> {
                let is_near = |n: &&Number| {
                    let reach = 10f64.powi(-i32::try_from(n.decimals.min(9)).unwrap_or(9)).max(AROUND_DEGREES);
                    n.decimals >= BESIDE_DECIMALS && (n.value - d.abs()).abs() < reach
                };
                numbers.iter().filter(is_near).collect()
            };
            let sixty = |d: f64| -> Vec<&Angle> {
                angles.iter().filter(|a| (a.value - d.abs()).abs() < AROUND_DEGREES).collect()
            };
            beside(&decimal(site[0]), &decimal(site[1])).or_else(|| beside(&sixty(site[0]), &sixty(site[1])))
        })
    }

    fn system(&self, text: &[char], numbers: &[Number]) -> Option<(usize, usize)> {
        if self.is_system_known {
            return None;
        }
        let is_own = |zone: u32| self.squares.iter().any(|s| s.zone() == zone);
        let named = whichever::zones(text, numbers).find(|(zone, ..)| is_own(*zone)).map(|(_, from, to)| (from, to));
        let bare = || self.squares.iter().find_map(|s| whichever::bare_zone(text, numbers, s.zone()));
        named.or_else(bare).or_else(|| self.code(text))
    }

    fn code(&self, text: &[char]) -> Option<(usize, usize)> {
        let code: Vec<char> = self.epsg.as_ref()?.chars().collect();
        (0..text.len()).find_map(|at| {
            let is_code = text.get(at..at + code.len()) == Some(&code[..])
                && !text.get(at + code.len()).is_some_and(char::is_ascii_digit)
                && !at.checked_sub(1).and_then(|i| text.get(i)).is_some_and(char::is_ascii_digit);
            let before: String = text.get(at.saturating_sub(16)..at)?.iter().collect();
            (is_code && before.to_ascii_lowercase().contains("epsg")).then_some((at, at + code.len()))
        })
    }
}

/// The finding for this part of a text.
fn says(text: &[char], (from, to): (usize, usize), kind: Kind) -> Finding {
    Finding { found: shown(text, from, to), kind }
}

/// Anything that stands somewhere in a text.
trait Placed {
    fn span(&self) -> (usize, usize);
}

impl Placed for Number {
    fn span(&self) -> (usize, usize) {
        (self.from, self.to)
    }
}

impl Placed for Angle {
    fn span(&self) -> (usize, usize) {
        (self.from, self.to)
    }
}

/// Where anything stands.
struct Span(usize, usize);

impl Placed for Span {
    fn span(&self) -> (usize, usize) {
        (self.0, self.1)
    }
}

/// The first two, one of each list, that stand side by side, in either order. Both lists are in the order of the text.
fn beside<T: Placed>(ones: &[&T], others: &[&T]) -> Option<(usize, usize)> {
    let follows = |first: &[&T], then: &[&T]| {
        first.iter().find_map(|a| {
            let (from, to) = a.span();
            let start = then.partition_point(|b| b.span().0 < to);
            then.get(start).map(|b| b.span()).filter(|(next, _)| *next <= to + BESIDE).map(|(_, end)| (from, end))
        })
    };
    follows(ones, others).or_else(|| follows(others, ones))
}

/// Whether a sign or word for degrees follows.
fn is_degree(text: &[char], n: &Number) -> bool {
    let at = n.to + usize::from(text.get(n.to) == Some(&' '));
    text.get(at) == Some(&'°') || begins(text, at, "deg")
}

/// Whether a number can be a latitude or longitude of any place. A number below 1 with a unit of length after it, or after the list that it is in, is a
/// residual or a size.
fn may_be_degrees(text: &[char], n: &Number) -> bool {
    const UNITS: [&str; 8] = ["mm", "cm", "dm", "m", "km", "µm", "px", "ft"];
    if n.value >= 1.0 {
        return n.value <= 180.0;
    }
    let behind: String = text.iter().skip(n.to).take(48).collect();
    let mut words = behind.split(|c: char| " ,;/()".contains(c)).filter(|w| !w.is_empty());
    let is_in_list = |w: &&str| {
        w.chars().all(|c| c.is_ascii_digit() || ".+-".contains(c)) || ["and", "or", "to", "by", "x", "×"].contains(w)
    };
    let unit = words.find(|w| !is_in_list(w)).map(|w| w.trim_end_matches(['.', ':']));
    !unit.is_some_and(|w| UNITS.contains(&w))
}

/// Whether this word stands there, after spaces.
fn begins(text: &[char], at: usize, word: &str) -> bool {
    let rest = text.get(at..).unwrap_or_default().iter().skip_while(|c| **c == ' ');
    let found: String = rest.take(word.len()).flat_map(|c| c.to_lowercase()).collect();
    found == word
}

/// A latitude beside a longitude of whichever place: with letters or words that name the axes, or with so many digits that they can be nothing else.
fn stated(text: &[char], numbers: &[Number], angles: &[Angle]) -> Option<(usize, usize)> {
    let named = |wanted: Axis| -> Vec<(usize, usize)> {
        let max = if wanted == Axis::Latitude { 90.0 } else { 180.0 };
        let decimal = numbers.iter().filter(|n| {
            n.value <= max
                && (n.decimals >= BESIDE_DECIMALS || is_degree(text, n))
                && axis_of(text, n.from, n.to) == Some(wanted)
        });
        let sixty = angles.iter().filter(|a| a.value <= max && a.is_marked && a.axis == Some(wanted));
        let mut all: Vec<_> = decimal.map(Placed::span).chain(sixty.map(Placed::span)).collect();
        all.sort_unstable();
        all
    };
    let spans = |axis: Axis| named(axis).into_iter().map(|(a, b)| Span(a, b)).collect::<Vec<_>>();
    let (lat, lon) = (spans(Axis::Latitude), spans(Axis::Longitude));
    let by_letters = beside(&lat.iter().collect::<Vec<_>>(), &lon.iter().collect::<Vec<_>>());
    by_letters.or_else(|| {
        let fine: Vec<&Number> = numbers
            .iter()
            .filter(|n| n.decimals >= ANYWHERE_DECIMALS && !n.is_list && may_be_degrees(text, n))
            .collect();
        fine.windows(2).find_map(|two| {
            let [a, b] = two else { return None };
            let between = text.get(a.to..b.from)?;
            let is_pair = (1..=4).contains(&between.len()) && between.iter().all(|c| " ,;/|+-".contains(*c));
            (is_pair && (a.value <= 90.0 || b.value <= 90.0)).then_some((a.from, b.to))
        })
    })
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;

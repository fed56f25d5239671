//! Codes that name a small area: geohash, Plus Code (Open Location Code), grid reference (MGRS), Maidenhead locator, quadkey; and addresses of maps.

/// A square of the military grid around a place.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Square {
    /// UTM zone.
    zone: u32,
    /// Column and row of the square of 100 km.
    letters: [char; 2],
    /// Metres in it.
    inside: [f64; 2],
}

/// Degrees by which a code may be off, because the surroundings reveal a location as well.
const AROUND: f64 = 0.05;
/// Metres, of the same.
const AROUND_M: f64 = 1000.0;
/// Alphabets of geohash and Plus Code.
const GEOHASH: &str = "0123456789bcdefghjkmnpqrstuvwxyz";
const PLUS: &str = "23456789cfghjmpqrvwx";

/// Columns of the military grid, by zone, and its rows.
const COLUMNS: [&str; 3] = ["STUVWXYZ", "ABCDEFGH", "JKLMNPQR"];
const ROWS: &str = "ABCDEFGHJKLMNPQRSTUV";

/// Hosts that show a place on a map or contain its coordinates, with a path if the host has other pages too. They may be anywhere in an address.
const MAPS: [&str; 52] = [
    "osm.org/",
    "umap.openstreetmap",
    "opentopomap.org",
    "opencyclemap.org",
    "openseamap.org",
    "openhistoricalmap.org",
    "overpass-turbo.eu",
    "maps.google.",
    "earth.google.",
    "goo.gl/maps",
    "maps.app.goo.gl",
    "earth.app.goo.gl",
    "bing.com/maps",
    "maps.bing.",
    "virtualearth.net",
    "maps.apple.",
    "geohack",
    "geonames.org/",
    "wikidata.org/wiki/q",
    "wikidata.org/entity/q",
    "wikidata.org/wiki/special:entitydata/q",
    "wikidata.org/wiki/special:entitypage/q",
    "pleiades.stoa.org/places",
    "gazetteer.dainst.org/",
    "whosonfirst.org",
    "geohash.org/",
    "what3words.com/",
    "w3w.co/",
    "plus.codes/",
    "wikimapia.org",
    "mapcarta.com",
    "mapquest.com",
    "mapillary.com",
    "mapy.c",
    "maps.yandex.",
    "map.baidu.",
    "map.naver.",
    "map.kakao.",
    "map.qq.com",
    "map.geo.admin.ch",
    "maps.me/",
    "organicmaps.app",
    "osmand.net/",
    "wikiloc.com",
    "geocaching.com",
    "viamichelin.",
    "streetmap.co.uk",
    "gridreferencefinder.com",
    "zoom.earth",
    "latlong.net",
    "geoportail.gouv.fr/carte",
    "arcgis.com/home/webmap",
];
/// The same for hosts whose names are also the ends of other names: they must follow a dot or a slash.
const HOSTS: [&str; 9] = [
    "here.com/",
    "here.we/",
    "waze.com/",
    "waze.to/",
    "g.page/",
    "amap.com/",
    "gaode.com/",
    "2gis.com/",
    "coord.info/",
];
/// Companies with a site in every country, and the path of their maps.
const COUNTRIES: [&str; 2] = ["google.", "yandex."];
/// Gazetteers by prefix, before a number: `wd:Q1741245`.
const PREFIXES: [&str; 5] = ["wd:q", "tgn:", "geonames:", "pleiades:", "wikidata:q"];

/// An address that leads to a map, or is a place itself (`geo:`, RFC 5870; `///` of what3words).
pub(super) fn map_address(text: &[char]) -> Option<(usize, usize)> {
    let lower: Vec<char> = text.iter().map(char::to_ascii_lowercase).collect();
    let joined: String = lower.iter().collect();
    let range = |from: usize, to: usize| {
        let at = joined.get(..from)?.chars().count();
        Some((at, at + joined.get(from..to)?.chars().count()))
    };
    if let Some((at, host)) = MAPS.iter().find_map(|host| Some((joined.find(host)?, host))) {
        return range(at, at + host.len());
    }
    if let Some((from, to)) = of_any_country(&joined) {
        return range(from, to);
    }
    let begins = |at: usize, what: &str| what.chars().enumerate().all(|(i, c)| lower.get(at + i) == Some(&c));
    let digit = |at: usize| lower.get(at).is_some_and(char::is_ascii_digit);
    (0..lower.len()).find_map(|at| {
        let is_first = !at.checked_sub(1).and_then(|i| lower.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '/');
        if !is_first {
            return None;
        }
        let sign = usize::from(lower.get(at + 4).is_some_and(|c| matches!(c, '-' | '+')));
        if begins(at, "geo:") && digit(at + 4 + sign) {
            return Some((at, at + 24));
        }
        if let Some(prefix) = PREFIXES.iter().find(|p| begins(at, p) && digit(at + p.len())) {
            return Some((at, at + prefix.len() + 8));
        }
        let label = ["///", "what3words", "w3w"].iter().find(|l| begins(at, l))?;
        let from = at + label.len();
        let skipped = lower.iter().skip(from).take(4).take_while(|c| " :=,(/\"'".contains(**c)).count();
        let is_label = *label == "///" || skipped > 0;
        three_words(&lower, from + skipped).filter(|_| is_label).map(|to| (at, to))
    })
}

/// The end of three words with dots between them that begin here: `index.home.raft`, `index . home . raft`.
fn three_words(lower: &[char], from: usize) -> Option<usize> {
    const LONGEST: usize = 30;
    let blank = |at: usize| at + usize::from(lower.get(at) == Some(&' '));
    let mut at = from;
    for word in 0..3 {
        if word > 0 {
            at = blank(at);
            lower.get(at).filter(|c| **c == '.')?;
            at = blank(at + 1);
        }
        let letters = lower.iter().skip(at).take(LONGEST).take_while(|c| c.is_alphabetic()).count();
        if !(2..LONGEST).contains(&letters) {
            return None;
        }
        at += letters;
    }
    let goes_on = lower.get(at) == Some(&'.') && lower.get(at + 1).is_some_and(|c| c.is_alphabetic());
    if goes_on { None } else { Some(at) }
}

/// Addresses of services whose hosts differ by country, or whose paths do: `google.co.tz/maps`, `openstreetmap.fr`, `getty.edu/vow/TGNFullDisplay`. The
/// text is in lower case.
fn of_any_country(text: &str) -> Option<(usize, usize)> {
    let is_host = |at: usize| !text.get(..at).is_some_and(|t| t.ends_with(|c: char| c.is_alphanumeric() || c == '-'));
    let rest = |at: usize, longest: usize| {
        let rest = text.get(at..).unwrap_or_default();
        let to = rest.char_indices().take(longest).find(|(_, c)| *c == ' ').map(|(to, _)| to);
        rest.get(..to.unwrap_or_else(|| rest.char_indices().nth(longest).map_or(rest.len(), |(to, _)| to)))
            .unwrap_or_default()
    };
    let all = |what: &'static str| text.match_indices(what).map(|(at, _)| at);
    let plain = HOSTS.iter().find_map(|h| Some((all(h).find(|at| is_host(*at))?, h.len())));
    let country = || {
        COUNTRIES.iter().find_map(|company| {
            all(company).filter(|at| is_host(*at)).find_map(|at| {
                let (host, path) = rest(at + company.len(), 40).split_once('/')?;
                let host = host.split(':').next().unwrap_or_default();
                let is_country =
                    host.split('.').count() <= 3 && host.bytes().all(|b| b.is_ascii_lowercase() || b == b'.');
                (is_country && path.starts_with("maps")).then_some((at, company.len() + host.len() + 5))
            })
        })
    };
    let street = || {
        let what = "openstreetmap.";
        let country = |at: usize| {
            let rest = text.as_bytes().get(at + what.len()..).unwrap_or_default();
            rest.iter().take(12).take_while(|b| b.is_ascii_alphabetic()).count()
        };
        all(what).find(|at| country(*at) > 0).map(|at| (at, what.len() + country(at)))
    };
    let getty = || {
        let what = "getty.edu";
        let found = all(what).find_map(|at| Some((at, rest(at, 160).find("tgn")?)))?;
        Some((found.0, found.1 + 3))
    };
    plain.or_else(country).or_else(street).or_else(getty).map(|(at, length)| (at, at + length))
}

/// Coordinates of any place as ISO 6709 (annex H) writes them: `-085722+0393600/`, `-08.956+039.600/`.
pub(super) fn iso6709(text: &[char]) -> Option<(usize, usize)> {
    let sign = |at: usize| text.get(at).copied().filter(|c| matches!(c, '+' | '-'));
    (0..text.len()).find_map(|from| {
        let first = sign(from)?;
        if from.checked_sub(1).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric()) {
            return None;
        }
        let (whole, has_fraction, to) = angle_in_one(text, from + 1, 2)?;
        let second = sign(to)?;
        let (other, has_other, to) = angle_in_one(text, to + 1, 3)?;
        if other != whole + 1 || text.get(to).is_some_and(|c| c.is_alphanumeric()) && text.get(to) != Some(&'C') {
            return None;
        }
        // Telephone numbers begin with a plus sign and have hyphens; lengths have no leading zeros.
        let is_closed = text.get(to) == Some(&'/') || {
            let height = text.iter().skip(to + 1).take(12).take_while(|c| c.is_ascii_digit() || **c == '.').count();
            sign(to).is_some() && matches!(text.get(to + 1 + height), Some('/' | 'C'))
        };
        let is_whole = has_fraction && has_other || whole == 6 && !(first == '+' && second == '-');
        (is_closed || is_whole).then_some((from, to))
    })
}

/// Degrees (of `degrees` digits), minutes and seconds without separators; whether there is a fraction; and where it ends.
fn angle_in_one(text: &[char], from: usize, degrees: usize) -> Option<(usize, bool, usize)> {
    let digits: Vec<char> = text.iter().skip(from).take(8).take_while(|c| c.is_ascii_digit()).copied().collect();
    let parts = digits.len().checked_sub(degrees).filter(|n| matches!(n, 0 | 2 | 4))?;
    let number = |range: std::ops::Range<usize>| digits.get(range)?.iter().collect::<String>().parse::<u32>().ok();
    let is_angle = number(0..degrees)? <= if degrees == 2 { 90 } else { 180 }
        && (0..parts / 2).all(|k| number(degrees + 2 * k..degrees + 2 * k + 2).is_some_and(|n| n < 60));
    let end = from + digits.len();
    let fraction = match text.get(end) {
        Some('.' | ',') => text.iter().skip(end + 1).take(12).take_while(|c| c.is_ascii_digit()).count(),
        _ => 0,
    };
    let to = end + if fraction > 0 { fraction + 1 } else { 0 };
    // Both have the same parts; the degrees of a longitude have one more digit.
    is_angle.then_some((digits.len(), fraction > 0, to))
}

/// Words that show that a code is that of a place. Excavations have grids and squares too.
const LABELS: [&str; 5] = ["locator", "maidenhead", "qth", "quadkey", "geohash"];
const SQUARES: [&str; 4] = ["grid", "square", "loc", "gridsquare"];

/// Whether one of these words is within a few characters before or after a code.
fn has_word(text: &[char], (from, to): (usize, usize), words: &[&str]) -> bool {
    const AWAY: usize = 24;
    let part = |from: usize, to: usize| -> String {
        text.get(from..to.min(text.len())).unwrap_or_default().iter().map(char::to_ascii_lowercase).collect()
    };
    [part(from.saturating_sub(AWAY), from), part(to, to + AWAY)]
        .iter()
        .any(|part| part.split(|c: char| !c.is_alphanumeric()).any(|w| words.contains(&w)))
}

/// A code of any place beside a word that says what it is: `locator KI91tb`, `quadkey 300113200230`.
pub(super) fn labelled(text: &[char]) -> Option<(usize, usize)> {
    let joined: String = text.iter().map(char::to_ascii_lowercase).collect();
    if !LABELS.iter().chain(&SQUARES).any(|l| joined.contains(l)) {
        return None;
    }
    tokens(text, 4).find(|(from, to)| {
        let token: String = text.get(*from..*to).unwrap_or_default().iter().map(char::to_ascii_lowercase).collect();
        let is_code = match token.len() {
            4 => maidenhead(&token).is_some(),
            6 | 8 | 10 => maidenhead(&token).is_some() || quadkey(&token).is_some(),
            _ => quadkey(&token).is_some(),
        };
        // Dates and inventory numbers can consist of the digits 0 to 3 too, but not beside these words.
        let words = if token.len() == 6 && maidenhead(&token).is_some() {
            [&LABELS[..], &SQUARES].concat()
        } else {
            LABELS.to_vec()
        };
        is_code && has_word(text, (*from, *to), &words)
    })
}

/// A Plus Code with a letter in it, whichever place it names: nothing else is written so.
pub(super) fn plus_code(text: &[char]) -> Option<(usize, usize)> {
    plus_codes(text).find(|p| p.has_letter && p.before.len() + p.zeros >= 4).map(|p| (p.from, p.to))
}

/// A full Plus Code.
pub(super) fn full_plus_code(text: &[char]) -> Option<(usize, usize)> {
    plus_codes(text).find(|p| p.has_letter && p.before.len() == 8 && p.after.len() >= 2).map(|p| (p.from, p.to))
}

/// Whether an area, given by its centre and half its size, is near one of `sites`.
fn is_near(sites: &[[f64; 2]], ([lat, lon], [half_lat, half_lon]): Area) -> bool {
    sites.iter().any(|s| (s[0] - lat).abs() < AROUND + half_lat && apart(s[1], lon) < AROUND + half_lon)
}

/// A Plus Code, also a short one, of a place near one of `sites`.
pub(super) fn near_plus_code(text: &[char], sites: &[[f64; 2]]) -> Option<(usize, usize)> {
    let is_near = |p: &PlusCode| {
        let area = |site: &[f64; 2]| {
            if p.before.len() + p.zeros == 8 { plus(&p.before, &p.after) } else { recovered(p, *site) }
        };
        sites.iter().filter_map(area).any(|area| is_near(sites, area))
    };
    plus_codes(text).find(is_near).map(|p| (p.from, p.to))
}

/// A code of a place near one of `sites` (latitude, longitude), or in one of `squares`.
pub(super) fn near(text: &[char], sites: &[[f64; 2]], squares: &[Square]) -> Option<(usize, usize)> {
    for (from, to) in tokens(text, 4) {
        let token: String = text.get(from..to).unwrap_or_default().iter().flat_map(|c| c.to_lowercase()).collect();
        // Addresses of tiles put a letter before the digits: `a3001132002301203.jpeg`.
        let digits = token.trim_start_matches(|c: char| c.is_ascii_alphabetic());
        let is_square = || has_word(text, (from, to), &LABELS) || has_word(text, (from, to), &SQUARES);
        let locator = if token.len() > 4 || is_square() { maidenhead(&token) } else { None };
        let decoded = [geohash(&token), locator, quadkey(digits)];
        if decoded.into_iter().flatten().any(|area| is_near(sites, area)) {
            return Some((from, to));
        }
    }
    near_plus_code(text, sites).or_else(|| squares.iter().find_map(|square| grid(text, square)))
}

/// How far two longitudes are apart, across the line where they begin again.
fn apart(a: f64, b: f64) -> f64 {
    ((a - b + 540.0).rem_euclid(360.0) - 180.0).abs()
}

/// Words of letters and digits of a length that a code can have.
fn tokens(text: &[char], shortest: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
    const LONGEST: usize = 31;
    let mut at = 0;
    std::iter::from_fn(move || {
        loop {
            while text.get(at).is_some_and(|c| !c.is_ascii_alphanumeric()) {
                at += 1;
            }
            let from = at;
            while text.get(at).is_some_and(char::is_ascii_alphanumeric) {
                at += 1;
            }
            if from == at {
                return None;
            }
            if (shortest..=LONGEST).contains(&(at - from)) {
                return Some((from, at));
            }
        }
    })
}

/// Middle of an area and half of its height and width, degrees.
type Area = ([f64; 2], [f64; 2]);

/// Halve an area again and again: each bit says in which half a place lies, longitude first.
fn halved(bits: impl Iterator<Item = (usize, bool)>) -> Area {
    let mut range = [[-90.0, 90.0], [-180.0, 180.0]];
    for (axis, is_upper) in bits {
        let Some([low, high]) = range.get_mut(axis) else { continue };
        let middle = f64::midpoint(*low, *high);
        *(if is_upper { low } else { high }) = middle;
    }
    let [lat, lon] = range;
    ([f64::midpoint(lat[0], lat[1]), f64::midpoint(lon[0], lon[1])], [(lat[1] - lat[0]) / 2.0, (lon[1] - lon[0]) / 2.0])
}

/// Geohash (G. Niemeyer, 2008) of 5 to 12 characters: 5 km and finer.
fn geohash(token: &str) -> Option<Area> {
    if !(5..=12).contains(&token.len()) {
        return None;
    }
    let digits: Vec<usize> = token.chars().map(|c| GEOHASH.find(c)).collect::<Option<_>>()?;
    let bits = digits.iter().flat_map(|d| (0..5).rev().map(move |bit| d >> bit & 1 == 1));
    Some(halved(bits.enumerate().map(|(i, bit)| ((i + 1) % 2, bit))))
}

/// Maidenhead locator of two pairs and more: `KI81sb`.
fn maidenhead(token: &str) -> Option<Area> {
    let chars: Vec<char> = token.chars().collect();
    if ![4, 6, 8, 10].contains(&chars.len()) {
        return None;
    }
    let (mut lon, mut lat, mut size) = (-180.0, -90.0, [180.0, 360.0]);
    for (i, pair) in chars.chunks_exact(2).enumerate() {
        let (base, first) = match i {
            0 => (18u32, 'a'),
            1 | 3 => (10, '0'),
            _ => (24, 'a'),
        };
        size = size.map(|s: f64| s / f64::from(base));
        let digit =
            |c: Option<&char>| u32::from(*c?).checked_sub(u32::from(first)).filter(|d| *d < base).map(f64::from);
        lon += digit(pair.first())? * size[1];
        lat += digit(pair.get(1))? * size[0];
    }
    let half = size.map(|s| s / 2.0);
    Some(([lat + half[0], lon + half[1]], half))
}

/// Quadkey of map tiles (Bing), of 12 to 23 levels.
fn quadkey(token: &str) -> Option<Area> {
    if !(12..=23).contains(&token.len()) || !token.bytes().all(|b| (b'0'..=b'3').contains(&b)) {
        return None;
    }
    let (mut x, mut y) = (0.0, 0.0);
    for b in token.bytes() {
        let digit = b - b'0';
        x = x * 2.0 + f64::from(digit & 1);
        y = y * 2.0 + f64::from(digit >> 1);
    }
    let tiles = 2f64.powi(i32::try_from(token.len()).ok()?);
    let lat = |y: f64| (std::f64::consts::PI * (1.0 - 2.0 * y / tiles)).sinh().atan().to_degrees();
    let half = 180.0 / tiles;
    Some(([lat(y + 0.5), (x + 0.5) / tiles * 360.0 - 180.0], [half, half]))
}

/// A text around a `+` that has the form of a Plus Code.
struct PlusCode {
    from: usize,
    to: usize,
    before: Vec<usize>,
    after: Vec<usize>,
    /// Zeros as padding: `6G3X2J00+`.
    zeros: usize,
    has_letter: bool,
}

fn plus_codes(text: &[char]) -> impl Iterator<Item = PlusCode> + '_ {
    let value = |c: &char| PLUS.find(c.to_ascii_lowercase());
    (0..text.len()).filter(|at| text.get(*at) == Some(&'+')).filter_map(move |at| {
        let zeros = text.get(..at)?.iter().rev().take(7).take_while(|c| **c == '0').count();
        let before: Vec<usize> = text.get(..at - zeros)?.iter().rev().take(9).map_while(value).collect();
        let after: Vec<usize> = text.get(at + 1..)?.iter().take(8).map_while(value).collect();
        let (from, to) = (at - zeros - before.len(), at + 1 + after.len());
        let goes_on = |i: Option<usize>| i.and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '+');
        let is_code = match after.len() {
            // A code may end with its sign.
            0 => before.len() + zeros == 8 && matches!(zeros, 0 | 2 | 4),
            n => zeros == 0 && matches!(before.len(), 4 | 6 | 8) && (2..=7).contains(&n),
        };
        if !is_code || goes_on(from.checked_sub(1)) || goes_on(Some(to)) {
            return None;
        }
        let all = text.get(from..to)?;
        // Lower-case letters could be words around a plus sign.
        let is_of_capitals = all.iter().all(|c| !c.is_ascii_lowercase());
        let has_letter =
            all.iter().any(char::is_ascii_alphabetic) && (is_of_capitals || all.iter().any(char::is_ascii_digit));
        Some(PlusCode { from, to, before: before.into_iter().rev().collect(), after, zeros, has_letter })
    })
}

/// The area of a full Plus Code (Open Location Code specification, Google 2014).
fn plus(before: &[usize], after: &[usize]) -> Option<Area> {
    let digits: Vec<f64> = before.iter().chain(after).map(|d| *d as f64).collect();
    let (mut lat, mut lon, mut size) = (-90.0, -180.0, [400.0, 400.0]);
    for pair in digits.get(..digits.len().min(10))?.chunks_exact(2) {
        size = size.map(|s| s / 20.0);
        lat += pair.first()? * size[0];
        lon += pair.get(1)? * size[1];
    }
    for digit in digits.get(10..).unwrap_or_default() {
        size = [size[0] / 5.0, size[1] / 4.0];
        lat += (digit / 4.0).floor() * size[0];
        lon += (digit % 4.0) * size[1];
    }
    let half = size.map(|s| s / 2.0);
    Some(([lat + half[0], lon + half[1]], half))
}

/// The area of a short Plus Code. Such a code represents many places; it means the one nearest to a known place.
fn recovered(code: &PlusCode, [lat, lon]: [f64; 2]) -> Option<Area> {
    let lacking = 8usize.checked_sub(code.before.len()).filter(|n| matches!(n, 2 | 4))?;
    let (mut rest, mut size, mut digits) =
        ([lat.clamp(-90.0, 89.999) + 90.0, (lon + 180.0).rem_euclid(360.0)], 400.0, Vec::new());
    for _ in 0..lacking / 2 {
        size /= 20.0;
        for axis in &mut rest {
            digits.push((*axis / size).floor() as usize);
            *axis = axis.rem_euclid(size);
        }
    }
    digits.extend(&code.before);
    let (middle, half) = plus(&digits, &code.after)?;
    let nearest = |found: f64, known: f64| found + ((known - found) / size).round() * size;
    Some(([nearest(middle[0], lat), nearest(middle[1], lon)], half))
}

impl Square {
    /// The UTM zone that it is in.
    pub(super) fn zone(&self) -> u32 {
        self.zone
    }

    /// The square of a place in UTM.
    pub(super) fn of(zone: u32, [east, north]: [f64; 2]) -> Option<Self> {
        let column = COLUMNS.get(zone as usize % 3)?.chars().nth(((east / 1e5).floor() as usize).checked_sub(1)?)?;
        let row = (north / 1e5).floor() as usize + if zone.is_multiple_of(2) { 5 } else { 0 };
        let row = ROWS.chars().nth(row % 20)?;
        Some(Self { zone, letters: [column, row], inside: [east.rem_euclid(1e5), north.rem_euclid(1e5)] })
    }
}

/// A grid reference in this square: `37L EJ 65977 09946`, also without its zone and in fewer digits.
fn grid(text: &[char], square: &Square) -> Option<(usize, usize)> {
    let is = |at: usize, c: char| text.get(at).is_some_and(|t| t.to_ascii_uppercase() == c);
    (0..text.len()).find_map(|at| {
        if !is(at, square.letters[0])
            || !is(at + 1, square.letters[1])
            || text.get(at + 2).is_some_and(char::is_ascii_alphabetic)
        {
            return None;
        }
        let before: String = text.get(..at)?.iter().rev().take(5).filter(|c| **c != ' ').collect();
        let mut before = before.chars();
        let is_band = before.next().is_some_and(|c| c.is_ascii_alphabetic());
        let zone: String = before.take_while(char::is_ascii_digit).collect();
        let has_zone = is_band && zone.chars().rev().collect::<String>().parse() == Ok(square.zone);
        let is_alone = !at.checked_sub(1).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric());
        if !has_zone && !is_alone {
            return None;
        }
        let digits: Vec<(usize, char)> = (at + 2..text.len().min(at + 18))
            .map_while(|i| text.get(i).filter(|c| c.is_ascii_digit() || **c == ' ').map(|c| (i, *c)))
            .filter(|(_, c)| *c != ' ')
            .collect();
        let n = digits.len() / 2;
        // Two digits each name a square of one kilometre; lower-case letters before a four-digit number may be a word.
        let is_of_capitals = text.get(at..at + 2)?.iter().all(char::is_ascii_uppercase);
        let fewest = if has_zone {
            1
        } else if is_of_capitals {
            2
        } else {
            3
        };
        if digits.len() % 2 == 1 || !(fewest..=5).contains(&n) {
            return None;
        }
        let cell = 10f64.powi(5 - i32::try_from(n).ok()?);
        let part =
            |from: usize| digits.get(from..from + n)?.iter().map(|(_, c)| c).collect::<String>().parse::<f64>().ok();
        let near = |value: f64, inside: f64| {
            let low = value * cell;
            inside >= low - AROUND_M && inside <= low + cell + AROUND_M
        };
        let is_here = near(part(0)?, square.inside[0]) && near(part(n)?, square.inside[1]);
        is_here.then_some((at, digits.last()?.0 + 1))
    })
}

/// A reference of the military grid without its zone, after the word MGRS: `MGRS EL 6597 0994`.
pub(super) fn labelled_grid(text: &[char]) -> Option<(usize, usize)> {
    let is_label = |at: usize| {
        "mgrs".chars().enumerate().all(|(i, c)| text.get(at + i).is_some_and(|t| t.eq_ignore_ascii_case(&c)))
    };
    let letter = |at: usize| text.get(at).is_some_and(char::is_ascii_alphabetic);
    (0..text.len()).filter(|at| is_label(*at)).find_map(|at| {
        let from = (at + 4..text.len().min(at + 8)).find(|i| text.get(*i).is_some_and(|c| !" :=(".contains(*c)))?;
        let digits: Vec<usize> = (from + 2..text.len().min(from + 18))
            .take_while(|i| text.get(*i).is_some_and(|c| c.is_ascii_digit() || *c == ' '))
            .filter(|i| text.get(*i) != Some(&' '))
            .collect();
        let is_reference = letter(from) && letter(from + 1) && matches!(digits.len(), 4 | 6 | 8 | 10);
        is_reference.then_some((at, digits.last()? + 1))
    })
}

/// A reference in the military grid with zone, band, square and at least two digits each, for any place. With four digits (`3D VR 2023`)
/// there must be no space before the square, or a word such as "grid" nearby. An inventory number such as `12NUB3456` cannot be told from a reference.
pub(super) fn grid_reference(text: &[char]) -> Option<(usize, usize)> {
    let letter = |at: usize| text.get(at).map(char::to_ascii_uppercase).filter(char::is_ascii_uppercase);
    (0..text.len()).find_map(|start| {
        let zone: String = text.iter().skip(start).take(3).take_while(|c| c.is_ascii_digit()).collect();
        let number = zone.parse::<usize>().ok().filter(|z| zone.len() <= 2 && (1..=60).contains(z))?;
        if start.checked_sub(1).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric()) {
            return None;
        }
        let skip = |at: usize| at + usize::from(text.get(at) == Some(&' '));
        let band = skip(start + zone.len());
        let column = skip(band + 1);
        let is_square = "CDEFGHJKLMNPQRSTUVWX".contains(letter(band)?)
            && COLUMNS.get(number % 3)?.contains(letter(column)?)
            && ROWS.contains(letter(column + 1)?);
        let digits: Vec<usize> = (column + 2..text.len().min(column + 18))
            .take_while(|i| text.get(*i).is_some_and(|c| c.is_ascii_digit() || *c == ' '))
            .filter(|i| text.get(*i) != Some(&' '))
            .collect();
        if !is_square || !matches!(digits.len(), 4 | 6 | 8 | 10) {
            return None;
        }
        let range = (start, digits.last()? + 1);
        // Three dimensions, far more often than the zone in Antarctica.
        let is_3d = number == 3 && letter(band) == Some('D');
        let is_doubtful = column > band + 1 && (digits.len() == 4 || is_3d);
        (!is_doubtful || has_word(text, range, &["mgrs", "utm", "grid"])).then_some(range)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(found: Option<Area>) -> [f64; 2] {
        found.unwrap().0
    }

    /// Examples of the specifications.
    #[test]
    fn location_codes_decode_as_specified() {
        let close =
            |a: [f64; 2], b: [f64; 2]| assert!((a[0] - b[0]).abs() < 0.01 && (a[1] - b[1]).abs() < 0.01, "{a:?} {b:?}");
        close(area(geohash("u4pruydqqvj")), [57.649_11, 10.407_44]);
        close(area(geohash("ezs42")), [42.605, -5.603]);
        close(area(maidenhead("fn31pr")), [41.729, -72.708]);
        let code: Vec<char> = "8FVC2222+22".chars().collect();
        let found = plus_codes(&code).next().unwrap();
        close(area(plus(&found.before, &found.after)), [47.000_06, 8.000_06]);
        // 213 is tile 3, 5 of level 3.
        close(area(quadkey("213000000000000000000000"[..20].into())), [0.0 - 40.98 + 0.0, -45.0 + 0.0]);
        // Honolulu: 4Q FJ 12345 67890 is UTM 4, 612345 E 2367890 N.
        assert_eq!(Square::of(4, [612_345.0, 2_367_890.0]).unwrap().letters, ['F', 'J']);
    }
}

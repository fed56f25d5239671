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

/// Degrees by which a code may be off: what is around a place tells it as well.
const AROUND: f64 = 0.05;
/// Metres, of the same.
const AROUND_M: f64 = 1000.0;
/// Alphabets of geohash and Plus Code.
const GEOHASH: &str = "0123456789bcdefghjkmnpqrstuvwxyz";
const PLUS: &str = "23456789cfghjmpqrvwx";

/// Columns of the military grid, by zone, and its rows.
const COLUMNS: [&str; 3] = ["STUVWXYZ", "ABCDEFGH", "JKLMNPQR"];
const ROWS: &str = "ABCDEFGHJKLMNPQRSTUV";

/// Hosts, with paths where others share the host, that show a place on a map or hold its coordinates.
const MAPS: [&str; 32] = [
    "openstreetmap.org",
    "osm.org/",
    "openstreetmap.de",
    "umap.openstreetmap",
    "maps.google.",
    "google.com/maps",
    "google.de/maps",
    "google.fr/maps",
    "google.co.uk/maps",
    "google.it/maps",
    "google.es/maps",
    "earth.google.",
    "goo.gl/maps",
    "maps.app.goo.gl",
    "bing.com/maps",
    "maps.apple.com",
    "geohack",
    "geonames.org/",
    "wikidata.org/wiki/q",
    "wikidata.org/entity/q",
    "vocab.getty.edu/tgn",
    "vocab.getty.edu/page/tgn",
    "pleiades.stoa.org/places",
    "what3words.com/",
    "w3w.co/",
    "plus.codes/",
    "wikimapia.org",
    "mapcarta.com",
    "wego.here.com",
    "share.here.com",
    "yandex.com/maps",
    "mapy.c",
];

/// An address that leads to a map, or is a place itself (`geo:`, RFC 5870; `///` of what3words).
pub(super) fn map_address(text: &[char]) -> Option<(usize, usize)> {
    let lower: Vec<char> = text.iter().map(char::to_ascii_lowercase).collect();
    let joined: String = lower.iter().collect();
    let found = |needle: &str| -> Option<(usize, usize)> {
        let at = joined.get(..joined.find(needle)?)?.chars().count();
        Some((at, at + needle.chars().count()))
    };
    if let Some(range) = MAPS.iter().find_map(|host| found(host)) {
        return Some(range);
    }
    let begins = |at: usize, what: &str| what.chars().enumerate().all(|(i, c)| lower.get(at + i) == Some(&c));
    (0..lower.len()).find_map(|at| {
        let is_first = !at.checked_sub(1).and_then(|i| lower.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '/');
        if !is_first {
            return None;
        }
        let sign = usize::from(lower.get(at + 4).is_some_and(|c| matches!(c, '-' | '+')));
        if begins(at, "geo:") && lower.get(at + 4 + sign).is_some_and(char::is_ascii_digit) {
            return Some((at, at + 24));
        }
        if begins(at, "wd:q") && lower.get(at + 4).is_some_and(char::is_ascii_digit) {
            return Some((at, at + 12));
        }
        if begins(at, "///") {
            let words: String =
                lower.iter().skip(at + 3).take(90).take_while(|c| c.is_alphabetic() || **c == '.').collect();
            let parts: Vec<&str> = words.trim_end_matches('.').split('.').collect();
            return (parts.len() == 3 && parts.iter().all(|p| p.chars().count() >= 2))
                .then_some((at, at + 3 + words.chars().count()));
        }
        None
    })
}

/// A Plus Code with a letter in it, whichever place it names: nothing else is written so.
pub(super) fn plus_code(text: &[char]) -> Option<(usize, usize)> {
    plus_codes(text).find(|p| p.has_letter && p.before.len() >= 4).map(|p| (p.from, p.to))
}

/// A code of a place near one of `sites` (latitude, longitude), or in one of `squares`.
pub(super) fn near(text: &[char], sites: &[[f64; 2]], squares: &[Square]) -> Option<(usize, usize)> {
    let is_near = |[lat, lon]: [f64; 2], [half_lat, half_lon]: [f64; 2]| {
        sites.iter().any(|s| (s[0] - lat).abs() < AROUND + half_lat && apart(s[1], lon) < AROUND + half_lon)
    };
    for (from, to) in tokens(text) {
        let token: String = text.get(from..to).unwrap_or_default().iter().flat_map(|c| c.to_lowercase()).collect();
        let decoded = [geohash(&token), maidenhead(&token), quadkey(&token)];
        if decoded.into_iter().flatten().any(|(middle, half)| is_near(middle, half)) {
            return Some((from, to));
        }
    }
    for p in plus_codes(text) {
        let mut known = sites
            .iter()
            .filter_map(|site| if p.before.len() == 8 { plus(&p.before, &p.after) } else { recovered(&p, *site) });
        if known.any(|(middle, half)| is_near(middle, half)) {
            return Some((p.from, p.to));
        }
    }
    squares.iter().find_map(|square| grid(text, square))
}

/// How far two longitudes are apart, across the line where they begin again.
fn apart(a: f64, b: f64) -> f64 {
    ((a - b + 540.0).rem_euclid(360.0) - 180.0).abs()
}

/// Words of letters and digits of a length that a code can have.
fn tokens(text: &[char]) -> impl Iterator<Item = (usize, usize)> + '_ {
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
            if (5..=23).contains(&(at - from)) {
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

/// Maidenhead locator of three pairs and more: `KI81sb`.
fn maidenhead(token: &str) -> Option<Area> {
    let chars: Vec<char> = token.chars().collect();
    if ![6, 8, 10].contains(&chars.len()) {
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
    if token.len() < 12 || !token.bytes().all(|b| (b'0'..=b'3').contains(&b)) {
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
    has_letter: bool,
}

fn plus_codes(text: &[char]) -> impl Iterator<Item = PlusCode> + '_ {
    let value = |c: &char| PLUS.find(c.to_ascii_lowercase());
    (0..text.len()).filter(|at| text.get(*at) == Some(&'+')).filter_map(move |at| {
        let before: Vec<usize> = text.get(..at)?.iter().rev().take(9).map_while(value).collect();
        let after: Vec<usize> = text.get(at + 1..)?.iter().take(8).map_while(value).collect();
        let (from, to) = (at - before.len(), at + 1 + after.len());
        let goes_on = |i: Option<usize>| i.and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '+');
        let is_code = matches!(before.len(), 4 | 6 | 8) && (2..=7).contains(&after.len());
        if !is_code || goes_on(from.checked_sub(1)) || goes_on(Some(to)) {
            return None;
        }
        let all = text.get(from..to)?;
        // Lower-case letters could be words around a plus sign.
        let is_of_capitals = all.iter().all(|c| !c.is_ascii_lowercase());
        let has_letter =
            all.iter().any(char::is_ascii_alphabetic) && (is_of_capitals || all.iter().any(char::is_ascii_digit));
        Some(PlusCode { from, to, before: before.into_iter().rev().collect(), after, has_letter })
    })
}

/// The area of a full Plus Code (Open Location Code specification, Google 2014).
fn plus(before: &[usize], after: &[usize]) -> Option<Area> {
    let digits: Vec<f64> = before.iter().chain(after).map(|d| *d as f64).collect();
    let (mut lat, mut lon, mut size) = (-90.0, -180.0, [400.0, 400.0]);
    for pair in digits.get(..10)?.chunks_exact(2) {
        size = size.map(|s| s / 20.0);
        lat += pair.first()? * size[0];
        lon += pair.get(1)? * size[1];
    }
    for digit in digits.get(10..)? {
        size = [size[0] / 5.0, size[1] / 4.0];
        lat += (digit / 4.0).floor() * size[0];
        lon += (digit % 4.0) * size[1];
    }
    let half = size.map(|s| s / 2.0);
    Some(([lat + half[0], lon + half[1]], half))
}

/// The area of a short Plus Code. Such a code stands for many places; it means the one nearest to a known place.
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
        let fewest = if has_zone { 1 } else { 3 };
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

/// A reference in the military grid with zone, band, square and at least three digits each, whichever place it names.
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
        let is_reference = is_square && matches!(digits.len(), 6 | 8 | 10);
        is_reference.then_some((start, digits.last()? + 1))
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
    fn codes_decode_as_their_specifications_say() {
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

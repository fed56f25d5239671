//! Degrees, minutes and seconds, and on which axis a number lies: `8° 57' 27.7" S`, `8d57m S`, `S08:57:27`, `085727S`, `lat 8.96`.

/// Which of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// North or south.
    Latitude,
    /// East or west.
    Longitude,
}

/// An angle in parts of sixty, or a number that is said to be a latitude or longitude.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Angle {
    /// Degrees, without the sign.
    pub(super) value: f64,
    /// By its letter.
    pub(super) axis: Option<Axis>,
    /// Its signs say that it is an angle, and no time or date.
    pub(super) is_marked: bool,
    pub(super) from: usize,
    pub(super) to: usize,
}

/// Words before a number that name its axis; compared in lower case, at the end of what stands before.
const LATITUDE: [&str; 5] = ["lat", "latitude", "breite", "latitud", "latitudine"];
const LONGITUDE: [&str; 8] = ["lon", "lng", "long", "longitude", "länge", "longitud", "longitudine", "lang"];

/// Reads on in a text.
#[derive(Clone, Copy)]
struct Cursor<'a> {
    text: &'a [char],
    at: usize,
}

impl Cursor<'_> {
    fn peek(&self) -> Option<char> {
        self.text.get(self.at).copied()
    }

    fn spaces(&mut self) {
        // More than a few separate what does not belong together.
        for _ in 0..3 {
            if self.peek() == Some(' ') {
                self.at += 1;
            }
        }
    }

    fn take(&mut self, signs: &str) -> Option<char> {
        let c = self.peek().filter(|c| signs.contains(*c))?;
        self.at += 1;
        Some(c)
    }

    /// A word of these, and no longer one.
    fn word(&mut self, words: &[&str]) -> bool {
        let letters: String = self.text.iter().skip(self.at).take(10).take_while(|c| c.is_alphabetic()).collect();
        let is_one = words.contains(&letters.to_lowercase().as_str());
        if is_one {
            self.at += letters.chars().count();
        }
        is_one
    }

    /// A whole number of at most `most` digits that is followed by no further digit.
    fn whole(&mut self, most: usize) -> Option<f64> {
        let digits: String = self.text.iter().skip(self.at).take(most + 1).take_while(|c| c.is_ascii_digit()).collect();
        let value = digits.parse().ok().filter(|_| digits.len() <= most)?;
        self.at += digits.len();
        Some(value)
    }

    /// A number below sixty of one or two digits, with or without a fraction; and whether it has one.
    fn sixtieths(&mut self) -> Option<(f64, bool)> {
        let whole = self.whole(2).filter(|v| *v < 60.0)?;
        let has_point = self.peek().is_some_and(|c| c == '.' || c == ',');
        if !has_point || !self.text.get(self.at + 1).is_some_and(char::is_ascii_digit) {
            return Some((whole, false));
        }
        self.at += 1;
        let (mut value, mut part) = (whole, 0.1);
        while let Some(digit) = self.peek().and_then(|c| c.to_digit(10)) {
            value += f64::from(digit) * part;
            part /= 10.0;
            self.at += 1;
        }
        Some((value, true))
    }
}

/// Everything in a text that can be read as an angle in parts of sixty.
pub(super) fn angles(text: &[char]) -> Vec<Angle> {
    let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
    let mut all = Vec::new();
    for at in 0..text.len() {
        let is_start = digit(at) && !at.checked_sub(1).is_some_and(digit);
        if is_start {
            all.extend(sixty(text, at));
            all.extend(packed(text, at));
        }
    }
    all
}

/// Degrees, minutes and mostly seconds, with signs, letters or nothing between them.
fn sixty(text: &[char], from: usize) -> Option<Angle> {
    let mut c = Cursor { text, at: from };
    let degrees = c.whole(3).filter(|d| *d <= 180.0)?;
    c.spaces();
    let is_marked = c.take("°").is_some()
        || c.word(&["d", "deg", "degs", "degree", "degrees", "grad", "grados", "degrés", "gradi"]);
    if !is_marked {
        c.take(":-");
    }
    c.spaces();
    let (minutes, has_fraction) = c.sixtieths()?;
    c.spaces();
    let has_minutes = c.take("'").is_some() || c.word(&["m", "min", "minutes", "minutos", "minuti"]);
    if !has_minutes {
        c.take(":-");
    }
    let mut seconds = 0.0;
    let mut ahead = c;
    ahead.spaces();
    let found = if has_fraction { None } else { ahead.sixtieths() };
    if let Some((value, _)) = found {
        (seconds, c) = (value, ahead);
        c.spaces();
        let _ = c.take("\"").is_some() || c.take("'").is_some() || c.word(&["sec", "seconds"]);
        c.take("'");
        // A small s for seconds where the letter of a quarter follows; else it may be south.
        let mut behind = Cursor { at: c.at + 1, ..c };
        behind.spaces();
        if c.peek() == Some('s') && behind.peek().is_some_and(|l| "NSEWO".contains(l)) {
            c = behind;
        }
    }
    let to = c.at;
    let axis = axis_of(text, from, to);
    // Two whole numbers side by side are an angle only if something says so.
    if !is_marked && axis.is_none() && found.is_none() && !has_fraction {
        return None;
    }
    Some(Angle { value: degrees + minutes / 60.0 + seconds / 3600.0, axis, is_marked, from, to })
}

/// `085727S`, `0393122E`, `0857.462,S`: two digits each for minutes and seconds, with the letter of an axis.
fn packed(text: &[char], from: usize) -> Option<Angle> {
    let digits: String = text.iter().skip(from).take(8).take_while(|c| c.is_ascii_digit()).collect();
    let mut to = from + digits.len();
    let fraction: String = match text.get(to) {
        // A receiver writes a point or a comma.
        Some('.' | ',') => text.iter().skip(to + 1).take(8).take_while(|c| c.is_ascii_digit()).collect(),
        _ => String::new(),
    };
    to += if fraction.is_empty() { 0 } else { fraction.len() + 1 };
    let axis = axis_of(text, from, to)?;
    let tail = format!("0.{fraction}").parse::<f64>().unwrap_or(0.0);
    let part = |from: usize, to: usize| digits.get(from..to)?.parse::<f64>().ok();
    let n = digits.len();
    let value = match (n, fraction.is_empty()) {
        (6 | 7, _) => part(0, n - 4)? + part(n - 4, n - 2)? / 60.0 + (part(n - 2, n)? + tail) / 3600.0,
        (4 | 5, false) => part(0, n - 2)? + (part(n - 2, n)? + tail) / 60.0,
        _ => return None,
    };
    (value <= 180.0).then_some(Angle { value, axis: Some(axis), is_marked: true, from, to })
}

/// Which axis a number at this place is on, by a letter of a quarter beside it, or a word before it. None where letters of two axes are there: a bearing
/// (`N 45° E`).
pub(super) fn axis_of(text: &[char], from: usize, to: usize) -> Option<Axis> {
    let (before, after) = (letter_before(text, from), letter_after(text, to));
    let Some((a, belongs_before)) = before else { return after.or_else(|| word_before(text, from)) };
    match after {
        Some(b) if a == b => Some(a),
        // Of two letters one may be that of the number beside.
        Some(b) if belongs_before => Some(b),
        Some(_) => begins_another(text, to).then_some(a),
        None => Some(a),
    }
}

fn quarter(c: char) -> Option<Axis> {
    match c.to_ascii_uppercase() {
        'N' | 'S' => Some(Axis::Latitude),
        // O is east in German and west in French and Spanish.
        'E' | 'W' | 'O' => Some(Axis::Longitude),
        _ => None,
    }
}

/// Whether a number follows the letter behind this place.
fn begins_another(text: &[char], to: usize) -> bool {
    let rest = text.get(to..).unwrap_or_default().iter().skip_while(|c| " ,°'\"".contains(**c)).skip(1);
    rest.take(4).find(|c| !" :-".contains(**c)).is_some_and(char::is_ascii_digit)
}

fn letter_after(text: &[char], to: usize) -> Option<Axis> {
    let at = (to..text.len().min(to + 3)).find(|i| !text.get(*i).is_some_and(|c| " ,°".contains(*c)))?;
    let is_word = text.get(at + 1).is_some_and(|c| c.is_alphanumeric());
    if is_word {
        let word: String = text.iter().skip(at).take(6).take_while(|c| c.is_alphabetic()).collect();
        return match word.to_lowercase().as_str() {
            "north" | "south" => Some(Axis::Latitude),
            "east" | "west" => Some(Axis::Longitude),
            _ => None,
        };
    }
    quarter(*text.get(at)?)
}

/// The letter before a number, and whether it may be that of the number before it.
fn letter_before(text: &[char], from: usize) -> Option<(Axis, bool)> {
    let skipped = text.get(..from)?.iter().rev().take(3).take_while(|c| " -+".contains(**c)).count();
    let at = from.checked_sub(skipped + 1)?;
    let is_word = at.checked_sub(1).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '\'');
    let belongs_before = at.checked_sub(1).and_then(|last| text.get(..=last)).is_some_and(|t| {
        t.iter().rev().find(|c| **c != ' ').is_some_and(|c| c.is_ascii_digit() || "°'\"".contains(*c))
    });
    if is_word { None } else { Some((quarter(*text.get(at)?)?, belongs_before)) }
}

fn word_before(text: &[char], from: usize) -> Option<Axis> {
    let before = text.get(from.saturating_sub(24)..from)?;
    let is_between = |c: &char| " :=-+.,\"'[({".contains(*c);
    let end = before.len() - before.iter().rev().take_while(|c| is_between(c)).count();
    let letters = before.get(..end)?.iter().rev().take_while(|c| c.is_alphabetic()).count();
    let word: String = before.get(end - letters..end)?.iter().flat_map(|c| c.to_lowercase()).collect();
    if LATITUDE.iter().any(|w| *w == word || word == format!("m{w}")) {
        return Some(Axis::Latitude);
    }
    LONGITUDE.iter().any(|w| *w == word || word == format!("m{w}")).then_some(Axis::Longitude)
}

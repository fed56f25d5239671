//! Degrees, minutes and seconds, and the axis of a number: `8° 57' 27.7" S`, `8d57m S`, `S08:57:27`, `8.57.27 S`, `085727S`, `8/1,57/1,27/1`,
//! `lat 8.96`.

/// Which of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Axis {
    /// North or south.
    Latitude,
    /// East or west.
    Longitude,
}

/// An angle in parts of sixty, or a number labelled as latitude or longitude.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Angle {
    /// Degrees, without the sign.
    pub(super) value: f64,
    /// By its letter.
    pub(super) axis: Option<Axis>,
    /// Its signs say that it is an angle, and no time or date.
    pub(super) is_marked: bool,
    /// The separator of its parts if they have no unit signs: `:` in `08:57:22`. A space if there is none.
    pub(super) sign: char,
    /// Degrees, minutes and seconds.
    pub(super) has_seconds: bool,
    /// It may as well be a date or a version: `12/05/19 north wall`, `Metashape 2.0.1, N. Juma`.
    pub(super) is_doubtful: bool,
    pub(super) from: usize,
    pub(super) to: usize,
}

/// Words before a number that name its axis; compared in lower case, at the end of the text before the number.
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

    /// Skip what separates degrees, minutes and seconds in a sentence: `8 degrees, 57 minutes and 22 seconds`.
    fn gap(&mut self) {
        self.spaces();
        self.take(",;");
        self.spaces();
        self.word(&["and", "und", "et", "y", "na"]);
        self.spaces();
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
    fn whole(&mut self, max: usize) -> Option<f64> {
        let digits: String = self.text.iter().skip(self.at).take(max + 1).take_while(|c| c.is_ascii_digit()).collect();
        let value = digits.parse().ok().filter(|_| digits.len() <= max)?;
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
            all.extend(dotted(text, at));
            all.extend(fractions(text, at));
            all.extend(packed(text, at));
        }
    }
    all
}

const DEGREES: [&str; 13] = [
    "d", "deg", "degs", "degree", "degrees", "grad", "grados", "degrés", "degré", "gradi", "graus", "graden", "digrii",
];
const MINUTES: [&str; 10] =
    ["m", "min", "mins", "minute", "minutes", "minutos", "minuti", "minuten", "minuto", "dakika"];
const SECONDS: [&str; 9] =
    ["sec", "secs", "second", "seconds", "secondes", "segundos", "secondi", "sekunden", "sekunde"];

/// Degrees, minutes and mostly seconds, with signs, letters or nothing between them.
fn sixty(text: &[char], from: usize) -> Option<Angle> {
    let mut c = Cursor { text, at: from };
    let degrees = c.whole(3).filter(|d| *d <= 180.0)?;
    c.spaces();
    let is_marked = c.take("°").is_some() || c.word(&DEGREES);
    let sign = if is_marked { None } else { c.take(":-") };
    if is_marked {
        c.gap();
    } else {
        c.spaces();
    }
    let (minutes, has_fraction) = c.sixtieths()?;
    c.spaces();
    let has_minutes = c.take("'").is_some() || c.word(&MINUTES);
    if !has_minutes {
        c.take(":-");
    }
    let mut seconds = 0.0;
    let mut ahead = c;
    if has_minutes {
        ahead.gap();
    } else {
        ahead.spaces();
    }
    let found = if has_fraction { None } else { ahead.sixtieths() };
    let mut is_second = false;
    if let Some((value, _)) = found {
        (seconds, c) = (value, ahead);
        // `27s` are seconds; `27 s` may be south.
        let is_letter = c.peek() == Some('s') && !text.get(c.at + 1).is_some_and(|l| l.is_alphanumeric());
        c.spaces();
        is_second = c.take("\"").is_some() || c.take("'").is_some() || c.word(&SECONDS) || is_letter;
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
    let value = degrees + minutes / 60.0 + seconds / 3600.0;
    let has_seconds = if is_marked { is_second } else { found.is_some() };
    let sign = sign.unwrap_or(' ');
    let has_signs = is_marked || has_minutes || is_second;
    let is_doubtful = !has_signs && is_date_or_version(text, from, to, sign) && is_beside_word(text, from, to);
    Some(Angle { value, axis, is_marked, sign, has_seconds, is_doubtful, from, to })
}

/// `8.57.22 S`, `8,57,22S`, `8/57/22 S`: three numbers with the same separator, or two with the letter of an axis. Three numbers with such a letter count
/// as marked. Versions and dates look the same without a letter, or with a word or a name behind them.
fn dotted(text: &[char], from: usize) -> Option<Angle> {
    let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
    let mut c = Cursor { text, at: from };
    let degrees = c.whole(3).filter(|d| *d <= 180.0)?;
    let sign = c.take(".,;/_|")?;
    // Part of a longer chain.
    if from >= 2 && text.get(from - 1) == Some(&sign) && digit(from - 2) {
        return None;
    }
    let minutes = c.whole(2).filter(|m| *m < 60.0)?;
    let seconds = if c.peek() == Some(sign) && digit(c.at + 1) {
        c.at += 1;
        Some(c.sixtieths()?.0)
    } else {
        None
    };
    if c.peek().is_some_and(|next| ".,;/_|".contains(next)) && digit(c.at + 1) {
        return None;
    }
    let to = c.at;
    // Versions often have a zero in the middle.
    let is_day = (1.0..=31.0).contains(&degrees) && minutes <= 12.0 && ".,/".contains(sign);
    let axis = axis_of(text, from, to).filter(|_| !(is_day && is_initial(text, to)));
    if seconds.is_none() && axis.is_none() {
        return None;
    }
    let (has_seconds, value) = (seconds.is_some(), degrees + minutes / 60.0 + seconds.unwrap_or(0.0) / 3600.0);
    let is_doubtful = is_date_or_version(text, from, to, sign) && is_beside_word(text, from, to);
    let is_marked = has_seconds && axis.is_some() && !is_doubtful;
    Some(Angle { value, axis, is_marked, sign, has_seconds, is_doubtful, from, to })
}

/// Whether three numbers look like a date (`12/05/19`, `05/25/19`, `12-05-19`) or a version (`2.0.1`, `2.13.1`).
fn is_date_or_version(text: &[char], from: usize, to: usize, sign: char) -> bool {
    let digits = text.get(from..to).unwrap_or_default().split(|c| !c.is_ascii_digit()).filter(|part| !part.is_empty());
    let parts: Vec<u32> = digits.filter_map(|part| part.iter().collect::<String>().parse().ok()).collect();
    // With a fraction there are four.
    let [first, middle, _] = parts[..] else { return false };
    let is_day_first = (1..=31).contains(&first) && middle <= 12 && ".,/- ".contains(sign);
    let is_month_first = (1..=12).contains(&first) && (1..=31).contains(&middle) && sign == '/';
    // The last number of a version is seldom longer, and seconds are rarely written with one digit.
    let has_short_end = !to.checked_sub(2).and_then(|i| text.get(i)).is_some_and(char::is_ascii_digit);
    let is_version = sign == '.' && first <= 31 && (middle <= 12 || middle < 40 && has_short_end);
    is_day_first || is_month_first || is_version
}

/// Whether only a direction word (`north wall`) or an initial with a point (`N. Juma`) behind a number names its axis.
fn is_beside_word(text: &[char], from: usize, to: usize) -> bool {
    if letter_before(text, from).is_some() || word_before(text, from).is_some() {
        return false;
    }
    let Some((_, at, is_word)) = direction_after(text, to) else { return false };
    let mut behind = text.get(at + 1..).unwrap_or_default().iter();
    let has_point = behind.next() == Some(&'.');
    is_word || has_point && behind.find(|c| **c != ' ').is_some_and(|c| c.is_alphabetic())
}

/// Whether a letter follows that is not that of an axis but that of a page (`8.9.19, S. 12`), a name (`8.9.19 E. Juma`) or a shelf (`8.9.19, E 12`).
fn is_initial(text: &[char], to: usize) -> bool {
    let letter = (to..text.len().min(to + 3)).find(|i| text.get(*i).is_some_and(|c| c.is_alphabetic()));
    let rest = letter.and_then(|at| text.get(at + 1..)).unwrap_or_default();
    let has_stop = rest.first() == Some(&'.');
    let mut rest = rest.iter().skip(usize::from(has_stop)).skip_while(|c| **c == ' ').take(6).peekable();
    match rest.peek() {
        // Another angle has a sign after its degrees.
        Some(c) if c.is_ascii_digit() => !rest.find(|c| !c.is_ascii_digit()).is_some_and(|c| ".,:°/;".contains(*c)),
        Some(c) => has_stop && c.is_alphabetic(),
        None => false,
    }
}

/// `8/1,57/1,22/1`: fractions as cameras write them (EXIF 2.32, section 4.6.6).
fn fractions(text: &[char], from: usize) -> Option<Angle> {
    let mut c = Cursor { text, at: from };
    if from.checked_sub(1).and_then(|i| text.get(i)) == Some(&'/') {
        return None;
    }
    let (mut parts, mut denominators) = (Vec::new(), Vec::new());
    while parts.len() < 3 {
        let mut ahead = c;
        if !parts.is_empty() {
            ahead.gap();
        }
        let Some(above) = ahead.whole(9) else { break };
        if ahead.take("/").is_none() {
            break;
        }
        let Some(below) = ahead.whole(7).filter(|d| [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6].contains(d)) else { break };
        parts.push(above / below);
        denominators.push(below);
        c = ahead;
    }
    let [degrees, minutes, seconds] = parts[..] else { return None };
    let is_angle = degrees <= 180.0 && minutes < 60.0 && seconds < 60.0 && c.peek() != Some('/');
    // Scales are such fractions too: `1/1, 1/10, 1/100`.
    let is_scale = degrees * denominators.first()? <= 1.0 && minutes * denominators.get(1)? <= 1.0;
    let is_marked = denominators.first() == Some(&1.0) && !is_scale;
    let (value, to) = (degrees + minutes / 60.0 + seconds / 3600.0, c.at);
    is_angle.then(|| Angle {
        value,
        axis: axis_of(text, from, to),
        is_marked,
        sign: '/',
        has_seconds: true,
        is_doubtful: false,
        from,
        to,
    })
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
    let has_seconds = n >= 6;
    let (axis, is_doubtful) = (Some(axis), false);
    let angle = Angle { value, axis, is_marked: true, sign: ' ', has_seconds, is_doubtful, from, to };
    (value <= 180.0).then_some(angle)
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
    direction_after(text, to).map(|(axis, ..)| axis)
}

/// The axis by the letter or word behind this place, where that begins, and whether it is a word.
fn direction_after(text: &[char], to: usize) -> Option<(Axis, usize, bool)> {
    let at = (to..text.len().min(to + 3)).find(|i| !text.get(*i).is_some_and(|c| " ,°".contains(*c)))?;
    if text.get(at + 1).is_some_and(|c| c.is_alphanumeric()) && !is_between_numbers(text, at) {
        let word: String = text.iter().skip(at).take(8).take_while(|c| c.is_alphabetic()).collect();
        let axis = match word.to_lowercase().as_str() {
            "north" | "south" | "northern" | "southern" | "nord" | "süd" | "norte" | "sul" => Some(Axis::Latitude),
            "east" | "west" | "eastern" | "western" | "ost" | "ouest" | "oeste" | "ovest" | "leste" => {
                Some(Axis::Longitude)
            }
            _ => None,
        };
        return axis.map(|axis| (axis, at, true));
    }
    quarter(*text.get(at)?).map(|axis| (axis, at, false))
}

/// Whether the letter here is between two numbers without a space: `S8.956E39.600`, `8°57'22"S39°36'0"E`. Both must have a decimal point or
/// an angle sign, because the letters of a checksum are between digits too.
fn is_between_numbers(text: &[char], at: usize) -> bool {
    const LONGEST: usize = 16;
    let is_part = |c: &char| c.is_ascii_digit() || ".,:°'\" ".contains(*c);
    let is_sign = |c: &char| ".,:°'\"".contains(*c);
    let Some((before, after)) = text.get(..at).zip(text.get(at + 1..)) else { return false };
    let is_beside =
        before.last().is_some_and(|c| is_part(c) && *c != ' ') && after.first().is_some_and(char::is_ascii_digit);
    is_beside
        && before.iter().rev().take(LONGEST).take_while(|c| is_part(c)).any(is_sign)
        && after.iter().take(LONGEST).take_while(|c| is_part(c)).any(is_sign)
}

/// The letter before a number, and whether it may be that of the number before it.
fn letter_before(text: &[char], from: usize) -> Option<(Axis, bool)> {
    let skipped = text.get(..from)?.iter().rev().take(3).take_while(|c| " -+".contains(**c)).count();
    let at = from.checked_sub(skipped + 1)?;
    let is_word = at.checked_sub(1).and_then(|i| text.get(i)).is_some_and(|c| c.is_alphanumeric() || *c == '\'')
        && !is_between_numbers(text, at);
    let belongs_before = at.checked_sub(1).and_then(|last| text.get(..=last)).is_some_and(|t| {
        t.iter().rev().find(|c| **c != ' ').is_some_and(|c| c.is_ascii_digit() || "°'\"".contains(*c))
    });
    if is_word { None } else { Some((quarter(*text.get(at)?)?, belongs_before)) }
}

/// By the word before a number: `latitude: 8.96`.
pub(super) fn word_before(text: &[char], from: usize) -> Option<Axis> {
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

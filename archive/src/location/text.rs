//! Text as the searches read it: ASCII digits and signs, without the encodings of addresses, HTML and programs, and the numbers in it.

use super::unseen;

/// Times that encodings are taken off: links are put into links.
const DECODINGS: usize = 5;
/// HTML entities, and the character that each represents.
const ENTITIES: [(&str, char); 67] = [
    ("&deg;", '°'),
    ("&#176;", '°'),
    ("&#xb0;", '°'),
    ("&ring;", '°'),
    ("&ordm;", '°'),
    ("&prime;", '\''),
    ("&apos;", '\''),
    ("&#39;", '\''),
    ("&rsquo;", '\''),
    ("&lsquo;", '\''),
    ("&acute;", '\''),
    ("&grave;", '\''),
    ("&quot;", '"'),
    ("&QUOT;", '"'),
    ("&Prime;", '"'),
    ("&rdquo;", '"'),
    ("&ldquo;", '"'),
    ("&nbsp;", ' '),
    ("&thinsp;", ' '),
    ("&ensp;", ' '),
    ("&emsp;", ' '),
    ("&hairsp;", ' '),
    ("&numsp;", ' '),
    ("&puncsp;", ' '),
    ("&Tab;", ' '),
    ("&NewLine;", ' '),
    ("&minus;", '-'),
    ("&hyphen;", '-'),
    ("&dash;", '-'),
    ("&ndash;", '-'),
    ("&mdash;", '-'),
    ("&plus;", '+'),
    ("&comma;", ','),
    ("&period;", '.'),
    ("&middot;", '.'),
    ("&centerdot;", '.'),
    ("&CenterDot;", '.'),
    ("&sdot;", '.'),
    ("&bull;", '.'),
    ("&dot;", '.'),
    ("&colon;", ':'),
    ("&sol;", '/'),
    ("&lowbar;", '_'),
    ("&equals;", '='),
    ("&excl;", '!'),
    ("&quest;", '?'),
    ("&commat;", '@'),
    ("&lpar;", '('),
    ("&rpar;", ')'),
    ("&verbar;", '|'),
    ("&sup1;", '1'),
    ("&sup2;", '2'),
    ("&sup3;", '3'),
    ("&shy;", '\u{ad}'),
    ("&ZeroWidthSpace;", '\u{200b}'),
    ("&zwnj;", '\u{200c}'),
    ("&zwj;", '\u{200d}'),
    ("&lrm;", '\u{200e}'),
    ("&rlm;", '\u{200f}'),
    ("&NoBreak;", '\u{2060}'),
    ("&ic;", '\u{2063}'),
    ("&amp;", '&'),
    ("&AMP;", '&'),
    ("&num;", '#'),
    ("&semi;", ';'),
    ("&bsol;", '\\'),
    ("&percnt;", '%'),
];

/// A text in the forms in which it is searched: as it is, and with the encodings of addresses, HTML and programs taken off, where it has any.
pub(super) fn readable(text: &str) -> Vec<Vec<char>> {
    let mut all = vec![plain(text)];
    let mut decoded = text.to_owned();
    for _ in 0..DECODINGS {
        let next = without_escapes(&without_percent(&decoded));
        if next == decoded {
            break;
        }
        all.push(plain(&next));
        decoded = next;
    }
    all
}

/// With one sign for each meaning.
fn plain(text: &str) -> Vec<char> {
    let mut text = std::borrow::Cow::Borrowed(text);
    if text.contains('&') {
        for (entity, sign) in ENTITIES {
            if text.contains(entity) {
                text = text.replace(entity, sign.encode_utf8(&mut [0; 4])).into();
            }
        }
    }
    // Several spaces are shown as one.
    let mut all: Vec<char> = Vec::with_capacity(text.len());
    for c in text.chars().filter_map(one) {
        if c != ' ' || all.last() != Some(&' ') {
            all.push(c);
        }
    }
    all
}

/// One character as the searches read it; nothing of one that nobody sees.
fn one(c: char) -> Option<char> {
    if c.is_ascii() {
        return Some(if matches!(c, '\n' | '\r' | '\t') {
            ' '
        } else if c == '`' {
            '\''
        } else {
            c
        });
    }
    Some(match c {
        c if unseen::is_unseen(c) => return None,
        'º' | '˚' | '∘' | '◦' | '○' | 'ᵒ' => '°',
        '′' | '’' | '‘' | '‛' | '‵' | 'ʹ' | 'ʼ' | 'ˈ' | '´' | '׳' => '\'',
        '″' | '”' | '“' | '‟' | '‶' | 'ʺ' | '〃' | '״' => '"',
        '−' | '‐' | '‑' | '‒' | '–' | '—' | '―' | '⁃' | '˗' | '⁻' | '₋' | '﹘' | '﹣' | '➖' => {
            '-'
        }
        // Points in the middle of the line, and what looks like one.
        '\u{2d9}' | '\u{66b}' | '\u{6d4}' | '\u{701}' | '\u{702}' | '·' | '\u{387}' | '\u{1427}' | '\u{16eb}'
        | '\u{2022}' | '\u{2024}' | '\u{2027}' | '\u{2219}' | '\u{22c5}' | '\u{25cf}' | '\u{2981}' | '\u{2e31}'
        | '\u{2e33}' | '\u{3002}' | '\u{30fb}' | '\u{a4f8}' | '\u{a78f}' | '\u{fe52}' | '\u{ff61}' | '\u{ff65}'
        | '\u{10101}' => '.',
        '\u{66c}' | '\u{60c}' | '、' | '‚' | '\u{b8}' | '\u{2e32}' | '\u{2e41}' | '\u{a4f9}' | '\u{fe50}'
        | '\u{fe51}' | '\u{ff64}' => ',',
        '\u{2d0}' | '\u{2f8}' | '\u{589}' | '\u{2236}' | '\u{a789}' | '\u{fe55}' => ':',
        '\u{207a}' | '\u{208a}' | '\u{fe62}' => '+',
        '\u{2044}' | '\u{2215}' | '\u{29f8}' => '/',
        c if c.is_whitespace() => ' ',
        // Full-width ASCII, without the digits.
        '！'..='／' | '：'..='～' => char::from_u32(u32::from(c) - 0xfee0).unwrap_or(c),
        c => unseen::digit(c).unwrap_or(c),
    })
}

/// The text with `%2C` and the like decoded; everything else stays.
fn without_percent(text: &str) -> String {
    let bytes = text.as_bytes();
    let hex = |at: usize| bytes.get(at).and_then(|b| char::from(*b).to_digit(16));
    let (mut out, mut at) = (Vec::with_capacity(bytes.len()), 0);
    while let Some(&byte) = bytes.get(at) {
        if byte == b'%'
            && let (Some(high), Some(low)) = (hex(at + 1), hex(at + 2))
        {
            out.push(u8::try_from(high * 16 + low).unwrap_or(b'?'));
            at += 3;
        } else {
            out.push(byte);
            at += 1;
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

/// The text with `&#57;`, `&#x39;`, `\u0039`, `\u{39}` and `\x39` decoded; everything else stays.
fn without_escapes(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(at) = rest.find(['&', '\\']) {
        let (before, here) = rest.split_at(at);
        out.push_str(before);
        let Some((c, length)) = escape(here) else {
            out.push_str(here.get(..1).unwrap_or_default());
            rest = here.get(1..).unwrap_or_default();
            continue;
        };
        out.push(c);
        rest = here.get(length..).unwrap_or_default();
    }
    out + rest
}

/// Numeric escapes of a character: how they begin and end, the base of the number, and its maximum number of digits.
const FORMS: [(&str, &str, u32, usize); 9] = [
    ("&#x", ";", 16, 8),
    ("&#X", ";", 16, 8),
    ("&#", ";", 10, 8),
    ("\\u{", "}", 16, 6),
    ("\\x{", "}", 16, 6),
    ("\\u", "", 16, 4),
    ("\\U", "", 16, 8),
    ("\\x", "", 16, 2),
    ("\\", "", 8, 3),
];

/// The character that a text begins with in an escaped form, and the bytes of that form.
fn escape(text: &str) -> Option<(char, usize)> {
    if let Some((entity, sign)) = ENTITIES.iter().find(|(entity, _)| text.starts_with(entity)) {
        return Some((*sign, entity.len()));
    }
    if let Some(pair) = surrogates(text) {
        return Some((pair, 12));
    }
    FORMS.iter().find_map(|(begin, end, radix, max)| {
        let rest = text.strip_prefix(begin)?;
        let digits = rest.bytes().take(*max).take_while(|b| char::from(*b).is_digit(*radix)).count();
        let c = char::from_u32(u32::from_str_radix(rest.get(..digits)?, *radix).ok()?)?;
        let length = begin.len() + digits;
        // HTML is shown without the semicolon, too.
        Some((c, length + if text.get(length..)?.starts_with(end) { end.len() } else { 0 }))
    })
}

/// A character beyond U+FFFF as JSON escapes it: `\ud835\udfd3`.
fn surrogates(text: &str) -> Option<char> {
    let unit = |at: usize| {
        let digits = text.get(at..at + 6)?.strip_prefix("\\u")?;
        digits.bytes().all(|b| b.is_ascii_hexdigit()).then(|| u16::from_str_radix(digits, 16).ok())?
    };
    char::decode_utf16([unit(0)?, unit(6)?]).next()?.ok().filter(|c| u32::from(*c) > 0xffff)
}

/// A number as a text can be read; one place of the text may be read as several.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Number {
    /// Without its sign.
    pub(super) value: f64,
    /// Digits behind the point.
    pub(super) decimals: usize,
    /// Its place: its first character, and the one after its last.
    pub(super) from: usize,
    pub(super) to: usize,
    /// Whether a comma and a space were read as a decimal comma: more often these are two numbers of a list.
    pub(super) is_list: bool,
}

/// Digits without a sign between them.
struct Run {
    digits: String,
    from: usize,
    to: usize,
}

/// Numbers as people write them: with a point or a comma, grouped by spaces, commas, points or apostrophes, with an exponent.
pub(super) fn numbers(text: &[char]) -> Vec<Number> {
    let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
    let (mut all, mut at) = (Vec::new(), 0);
    while at < text.len() {
        if !digit(at) {
            at += 1;
            continue;
        }
        // Runs of digits with a single sign between them.
        let (mut runs, mut signs) = (Vec::new(), Vec::new());
        loop {
            let from = at;
            while digit(at) {
                at += 1;
            }
            runs.push(Run { digits: text.get(from..at).unwrap_or_default().iter().collect(), from, to: at });
            let sign = text.get(at).copied().filter(|c| ".,'_ ".contains(*c));
            let Some(sign) = sign.filter(|_| digit(at + 1)) else { break };
            signs.push(sign);
            at += 1;
        }
        readings(text, &runs, &signs, &mut all);
    }
    let blank = with_blanks(text);
    if !blank.is_empty() {
        all.extend(blank);
        // The searches rely on the order of the text.
        all.sort_by_key(|n| n.from);
    }
    all
}

/// Decimal numbers with a space beside their point: `39. 60023`. They must have three decimals, so that `rooms 12, 13` is not one.
fn with_blanks(text: &[char]) -> Vec<Number> {
    let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
    let is = |i: usize, what: &str| text.get(i).is_some_and(|c| what.contains(*c));
    let mut all = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let from = at;
        while digit(at) {
            at += 1;
        }
        if at == from {
            at += 1;
            continue;
        }
        let is_fraction = from >= 2 && is(from - 1, ".,") && digit(from - 2);
        let sign = at + usize::from(is(at, " "));
        let begin = sign + 1 + usize::from(is(sign + 1, " "));
        if at - from > 3 || is_fraction || !is(sign, ".,") || begin == at + 1 {
            continue;
        }
        let fraction: String = text.iter().skip(begin).take(13).take_while(|c| c.is_ascii_digit()).collect();
        let whole: String = text.get(from..at).unwrap_or_default().iter().collect();
        let value = format!("{whole}.{fraction}").parse::<f64>();
        if let Some(value) = value.ok().filter(|_| (3..=12).contains(&fraction.len())) {
            let (decimals, to) = (fraction.len(), begin + fraction.len());
            all.push(Number { value, decimals, from, to, is_list: is(sign, ",") });
        }
    }
    all
}

/// The numbers that runs of digits can mean: each run by itself, all runs as one number, and with the last sign, or any single point, as the decimal separator.
fn readings(text: &[char], runs: &[Run], signs: &[char], all: &mut Vec<Number>) {
    let mut add = |digits: &str, decimals: usize, from: usize, to: usize| {
        let Ok(mut value) = digits.parse::<f64>() else { return };
        let mut end = to;
        if let Some((power, behind)) = exponent(text, to) {
            (value, end) = (value * 10f64.powi(power), behind);
        }
        all.push(Number { value, decimals, from, to: end, is_list: false });
    };
    for (i, run) in runs.iter().enumerate() {
        add(&run.digits, 0, run.from, run.to);
        let is_date = is_date(runs, signs, i) || i.checked_sub(1).is_some_and(|i| is_date(runs, signs, i));
        // A group of a map coordinate has three digits; seven of them are the most that is looked at.
        let mut whole = run.digits.clone();
        let (signs, following) = (signs.get(i..).unwrap_or_default(), runs.get(i + 1..).unwrap_or_default());
        for (sign, next) in signs.iter().zip(following).take(7) {
            let is_doi = run.digits == "10" && next.digits.len() >= 4 && text.get(next.to) == Some(&'/');
            if ".,".contains(*sign) && !is_date && !is_doi {
                add(&format!("{whole}.{}", next.digits), next.digits.len(), run.from, next.to);
            }
            if next.digits.len() != 3 {
                break;
            }
            whole.push_str(&next.digits);
            add(&whole, 0, run.from, next.to);
        }
    }
}

/// Whether a date such as `21.11.2026` begins with this run.
fn is_date(runs: &[Run], signs: &[char], first: usize) -> bool {
    let (Some([day, month, year]), Some(['.', '.'])) = (runs.get(first..first + 3), signs.get(first..first + 2)) else {
        return false;
    };
    let small =
        |run: &Run, max: u32| run.digits.len() <= 2 && run.digits.parse::<u32>().is_ok_and(|n| (1..=max).contains(&n));
    let is_year = year.digits.len() == 4 && ('1'..='2').contains(&year.digits.chars().next().unwrap_or('0'));
    is_year && small(day, 31) && small(month, 12)
}

/// `e5`, `E+05`: the power of ten, and where it ends.
fn exponent(text: &[char], at: usize) -> Option<(i32, usize)> {
    text.get(at).filter(|c| matches!(c, 'e' | 'E'))?;
    let signed = usize::from(text.get(at + 1).is_some_and(|c| matches!(c, '+' | '-')));
    let from = at + 1 + signed;
    let digits: String = text.iter().skip(from).take(3).take_while(|c| c.is_ascii_digit()).collect();
    let power = digits.parse::<i32>().ok().filter(|_| digits.len() <= 2)?;
    // `8.956E39.600`: a longitude.
    let behind = from + digits.len();
    let is_number =
        matches!(text.get(behind), Some('.' | ',')) && text.get(behind + 1).is_some_and(char::is_ascii_digit);
    if is_number && signed == 0 {
        return None;
    }
    let negative = text.get(at + 1) == Some(&'-');
    Some((if negative { -power } else { power }, behind))
}

/// A piece of a text as messages show it.
pub(super) fn shown(text: &[char], from: usize, to: usize) -> String {
    text.get(from..to.min(from + 60).min(text.len())).unwrap_or_default().iter().collect()
}

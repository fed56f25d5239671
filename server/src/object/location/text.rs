//! Text as the searches read it: ASCII digits and signs, without the encodings of addresses and HTML, and the numbers in it.

/// Times that percent encoding is taken off: links are put into links.
const DECODINGS: usize = 3;
/// Zeros of the decimal digits of other scripts (Unicode category Nd); the other nine follow each.
const ZEROS: [u32; 24] = [
    0x660, 0x6f0, 0x7c0, 0x966, 0x9e6, 0xa66, 0xae6, 0xb66, 0xbe6, 0xc66, 0xce6, 0xd66, 0xe50, 0xed0, 0xf20, 0x1040,
    0x17e0, 0x1810, 0xff10, 0x1d7ce, 0x1d7d8, 0x1d7e2, 0x1d7ec, 0x1d7f6,
];
/// What stands for signs in HTML, and the sign.
const ENTITIES: [(&str, char); 14] = [
    ("&deg;", '°'),
    ("&#176;", '°'),
    ("&#xb0;", '°'),
    ("&prime;", '\''),
    ("&apos;", '\''),
    ("&#39;", '\''),
    ("&quot;", '"'),
    ("&Prime;", '"'),
    ("&nbsp;", ' '),
    ("&thinsp;", ' '),
    ("&minus;", '-'),
    ("&comma;", ','),
    ("&period;", '.'),
    ("&amp;", '&'),
];

/// A text in the forms in which it is searched: as it is, and with the encodings of addresses taken off, where it has any.
pub(super) fn readable(text: &str) -> Vec<Vec<char>> {
    let mut all = vec![plain(text)];
    let mut decoded = text.to_owned();
    for _ in 0..DECODINGS {
        let next = without_percent(&decoded);
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
    text.chars().filter_map(one).collect()
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
        '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}' => {
            return None;
        }
        'º' | '˚' | '∘' => '°',
        '′' | '’' | '‘' | 'ʹ' | 'ʼ' | '´' => '\'',
        '″' | '”' | '“' | 'ʺ' | '〃' => '"',
        '−' | '‐' | '‑' | '‒' | '–' | '—' | '﹣' | '－' => '-',
        '\u{66b}' | '．' => '.',
        '\u{66c}' | '\u{60c}' | '，' | '、' => ',',
        '：' => ':',
        '＋' => '+',
        c if c.is_whitespace() => ' ',
        // Latin letters of full width.
        'Ａ'..='Ｚ' | 'ａ'..='ｚ' => char::from_u32(u32::from(c) - 0xfee0).unwrap_or(c),
        c => ZEROS
            .iter()
            .find_map(|zero| char::from_digit(u32::from(c).checked_sub(*zero).filter(|d| *d < 10)?, 10))
            .unwrap_or(c),
    })
}

/// With `%2C` and the like as what they stand for; what is no encoding stays.
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

/// A number as a text can be read; one place of the text may be read as several.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Number {
    /// Without its sign.
    pub(super) value: f64,
    /// Digits behind the point.
    pub(super) decimals: usize,
    /// Where it stands: first character, and the one behind its last.
    pub(super) from: usize,
    pub(super) to: usize,
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
    all
}

/// What runs of digits can mean: each for itself, all as one number, and with the last sign, or any one point, as the decimal one.
fn readings(text: &[char], runs: &[Run], signs: &[char], all: &mut Vec<Number>) {
    let mut add = |digits: &str, decimals: usize, from: usize, to: usize| {
        let Ok(mut value) = digits.parse::<f64>() else { return };
        let mut end = to;
        if let Some((power, behind)) = exponent(text, to) {
            (value, end) = (value * 10f64.powi(power), behind);
        }
        all.push(Number { value, decimals, from, to: end });
    };
    for (i, run) in runs.iter().enumerate() {
        add(&run.digits, 0, run.from, run.to);
        let is_date = is_date(runs, signs, i) || i.checked_sub(1).is_some_and(|i| is_date(runs, signs, i));
        // A group of a map coordinate has three digits; seven of them are the most that is looked at.
        let mut whole = run.digits.clone();
        for (sign, next) in signs.iter().zip(runs.iter().skip(1)).skip(i).take(7) {
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
    let small = |run: &Run, most: u32| {
        run.digits.len() <= 2 && run.digits.parse::<u32>().is_ok_and(|n| (1..=most).contains(&n))
    };
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
    let negative = text.get(at + 1) == Some(&'-');
    Some((if negative { -power } else { power }, from + digits.len()))
}

/// What a piece of a text is, for messages.
pub(super) fn shown(text: &[char], from: usize, to: usize) -> String {
    text.get(from..to.min(from + 60).min(text.len())).unwrap_or_default().iter().collect()
}

//! Dates as archives write them: `2009`, `2009-07`, `2009-07-21`, and spans `2009-07/2009-08` (level 0 of EDTF, ISO 8601-2).
//!
//! Also days from seconds since 1970, for `SOURCE_DATE_EPOCH` and the clock. All in UTC. The calendar is [`chrono`]'s; which forms are taken is decided here.

use chrono::{DateTime, NaiveDate, SecondsFormat, Utc};

/// Whether a text is a day that exists, `YYYY-MM-DD`.
pub fn is_day(text: &str) -> bool {
    text.len() == 10 && is_date(text)
}

/// Whether a text is a year, a month or a day that exists.
pub fn is_date(text: &str) -> bool {
    let mut parts = text.split('-');
    let mut number = |digits: usize| -> Option<Option<u32>> {
        let Some(part) = parts.next() else { return Some(None) };
        (part.len() == digits && part.bytes().all(|b| b.is_ascii_digit())).then(|| part.parse().ok())
    };
    let (Some(Some(year)), Some(month), Some(day)) = (number(4), number(2), number(2)) else { return false };
    if parts.next().is_some() {
        return false;
    }
    match (month, day) {
        (None, _) => true,
        (Some(m), None) => (1..=12).contains(&m),
        (Some(m), Some(d)) => i32::try_from(year).is_ok_and(|y| NaiveDate::from_ymd_opt(y, m, d).is_some()),
    }
}

/// Whether a text is a date or a span of two of them, the first not after the second.
pub fn is_date_or_span(text: &str) -> bool {
    match text.split_once('/') {
        // The shorter of the two decides how far they can be compared.
        Some((from, to)) => {
            let n = from.len().min(to.len());
            is_date(from) && is_date(to) && from.get(..n) <= to.get(..n)
        }
        None => is_date(text),
    }
}

/// A date or span as it is said in English: `24 November 2026`, `July 2009 to August 2009`; any other text as it is.
pub fn in_words(text: &str) -> String {
    const MONTHS: [&str; 12] = [
        "January",
        "February",
        "March",
        "April",
        "May",
        "June",
        "July",
        "August",
        "September",
        "October",
        "November",
        "December",
    ];
    if !is_date_or_span(text) {
        return text.to_owned();
    }
    let one = |date: &str| {
        let number = |part: &str| part.parse::<usize>().ok();
        let mut parts = date.split('-');
        let year = parts.next().unwrap_or_default();
        let month = parts.next().and_then(number).and_then(|m| MONTHS.get(m.wrapping_sub(1)));
        match (month, parts.next().and_then(number)) {
            (Some(month), Some(day)) => format!("{day} {month} {year}"),
            (Some(month), None) => format!("{month} {year}"),
            (None, _) => year.to_owned(),
        }
    };
    text.split('/').map(one).collect::<Vec<_>>().join(" to ")
}

/// A hint such as `write 2026-11-23`, for a date written in another form; `None` if the text is not a date.
pub fn iso(text: &str) -> Option<String> {
    const MONTHS: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
    let parts: Vec<&str> = text.split(|c: char| !c.is_alphanumeric()).filter(|p| !p.is_empty()).collect();
    let number = |part: &str| part.trim_end_matches(['s', 't', 'n', 'd', 'r', 'h']).parse::<u32>().ok();
    let month = |part: &str| {
        let start: String = part.to_lowercase().chars().take(3).collect();
        MONTHS.iter().position(|m| *m == start).map(|at| at as u32 + 1)
    };
    let is_year = |part: &str| part.len() == 4 && part.bytes().all(|b| b.is_ascii_digit());
    let written = |year: u32, month: u32, day: u32| format!("{year:04}-{month:02}-{day:02}");
    let says = |day: String| is_day(&day).then(|| format!("write {day}"));
    match parts[..] {
        [year, m, d] if is_year(year) => says(written(number(year)?, month(m).or_else(|| number(m))?, number(d)?)),
        [a, b, year] if is_year(year) => {
            let year = number(year)?;
            if let Some(m) = month(b) {
                return says(written(year, m, number(a)?));
            }
            if let Some(m) = month(a) {
                return says(written(year, m, number(b)?));
            }
            let (first, second) = (number(a)?, number(b)?);
            let ways = [written(year, second, first), written(year, first, second)];
            match [is_day(&ways[0]), is_day(&ways[1])] {
                [true, true] if first != second => {
                    Some(format!("write {} or {}, whichever is meant", ways[0], ways[1]))
                }
                [true, _] => says(ways[0].clone()),
                [_, true] => says(ways[1].clone()),
                _ => None,
            }
        }
        [m, year] if is_year(year) => {
            let (year, m) = (number(year)?, month(m).or_else(|| number(m))?);
            (1..=12).contains(&m).then(|| format!("write {year:04}-{m:02}"))
        }
        [year, m] if is_year(year) => {
            let (year, m) = (number(year)?, month(m).or_else(|| number(m))?);
            (1..=12).contains(&m).then(|| format!("write {year:04}-{m:02}"))
        }
        _ => None,
    }
}

/// The day, `YYYY-MM-DD`, of seconds since 1970-01-01 in UTC; days after the year 9999 are its last.
pub fn day_of(seconds: u64) -> String {
    utc(seconds).date_naive().to_string()
}

/// The moment, `YYYY-MM-DDThh:mm:ssZ`, of seconds since 1970-01-01 in UTC; moments after the year 9999 are its last.
pub fn moment_of(seconds: u64) -> String {
    utc(seconds).to_rfc3339_opts(SecondsFormat::Secs, true)
}

fn utc(seconds: u64) -> DateTime<Utc> {
    /// 9999-12-31T23:59:59Z: years of five digits are no dates of ISO 8601.
    const LAST: i64 = 253_402_300_799;
    let seconds = i64::try_from(seconds).unwrap_or(LAST).min(LAST);
    DateTime::from_timestamp(seconds, 0).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_said_in_words_and_what_is_none_stays() {
        for (text, words) in [
            ("2026-11-24", "24 November 2026"),
            ("2009-07", "July 2009"),
            ("2009", "2009"),
            ("2009-07/2009-08-02", "July 2009 to 2 August 2009"),
            ("about 1505", "about 1505"),
            ("2026-13-01", "2026-13-01"),
            ("", ""),
        ] {
            assert_eq!(in_words(text), words);
        }
    }

    #[test]
    fn dates_exist_or_are_refused() {
        for good in ["2009", "2009-07", "2009-07-21", "2024-02-29", "2000-02-29"] {
            assert!(is_date(good) && is_date_or_span(good), "{good}");
        }
        for bad in [
            "",
            "209",
            "2009-13",
            "2009-00",
            "2009-7",
            "2023-02-29",
            "1900-02-29",
            "2009-07-32",
            "2009-07-21x",
            "21.7.2009",
            "2009-07-21-01",
            "+009",
        ] {
            assert!(!is_date(bad), "{bad}");
        }
        for good in ["2009-07/2009-08", "2009/2010-01-01", "2009-07-01/2009"] {
            assert!(is_date_or_span(good), "{good}");
        }
        for bad in ["2010/2009", "2009/", "/2009", "2009/2010/2011"] {
            assert!(!is_date_or_span(bad), "{bad}");
        }
    }

    #[test]
    fn dates_in_other_forms_are_recognised_and_the_message_gives_the_iso_form() {
        for (text, suggestion) in [
            ("21.7.2009", "write 2009-07-21"),
            ("21/07/2009", "write 2009-07-21"),
            ("7/21/2009", "write 2009-07-21"),
            ("4/5/2009", "write 2009-05-04 or 2009-04-05, whichever is meant"),
            ("2009/7/21", "write 2009-07-21"),
            ("2009-7", "write 2009-07"),
            ("21 July 2009", "write 2009-07-21"),
            ("July 21st, 2009", "write 2009-07-21"),
            ("Nov 2009", "write 2009-11"),
        ] {
            assert_eq!(iso(text).as_deref(), Some(suggestion), "{text}");
        }
        for none in ["", "summer", "31.2.2009", "c. 1505", "13/2009", "99/99/2009"] {
            assert_eq!(iso(none), None, "{none}");
        }
    }

    #[test]
    fn seconds_become_days() {
        for (seconds, day) in [
            (0, "1970-01-01"),
            (951_782_400, "2000-02-29"),
            (1_795_219_199, "2026-11-20"),
            (1_795_219_200, "2026-11-21"),
        ] {
            assert_eq!(day_of(seconds), day);
        }
        assert_eq!(day_of(u64::MAX), "9999-12-31");
        assert_eq!(moment_of(1_795_219_199), "2026-11-20T23:59:59Z");
        assert_eq!(moment_of(u64::MAX), "9999-12-31T23:59:59Z");
    }
}

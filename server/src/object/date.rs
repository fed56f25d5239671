//! Dates as archives write them: `2009`, `2009-07`, `2009-07-21`, and spans `2009-07/2009-08` (level 0 of EDTF, ISO 8601-2).
//!
//! Also days from seconds since 1970, for `SOURCE_DATE_EPOCH` and the clock. All in UTC.

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
        (Some(m), Some(d)) => (1..=12).contains(&m) && (1..=days_of(year, m)).contains(&d),
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

fn days_of(year: u32, month: u32) -> u32 {
    match month {
        4 | 6 | 9 | 11 => 30,
        2 if year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400)) => 29,
        2 => 28,
        _ => 31,
    }
}

/// The day, `YYYY-MM-DD`, of seconds since 1970-01-01 in UTC; days after the year 9999 are its last.
pub fn day_of(seconds: u64) -> String {
    // Days since 0000-03-01 (Hinnant, "chrono-compatible low-level date algorithms").
    let z = (seconds / 86_400).min(2_932_896) + 719_468;
    let (era, doe) = (z / 146_097, z % 146_097);
    let yoe = (doe - doe / 1460 + doe / 36_524 - doe / 146_096) / 365;
    let doy = doe - (365 * yoe + yoe / 4 - yoe / 100);
    let mp = (5 * doy + 2) / 153;
    let (day, month) = (doy - (153 * mp + 2) / 5 + 1, if mp < 10 { mp + 3 } else { mp - 9 });
    let year = yoe + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

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
    }
}

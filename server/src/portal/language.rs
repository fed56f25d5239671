//! The portal's messages in the viewer's languages (`i18n/`), and which language a reader wants.

use kilwa_archive::date::is_date_or_span;
use kilwa_messages::{Catalogue, Value};
use std::sync::LazyLock;

/// In the order in which they are offered.
static ALL: LazyLock<Vec<Language>> = LazyLock::new(|| {
    let all = kilwa_messages::portal().iter();
    all.map(|messages| Language { code: messages.code(), messages }).collect()
});

/// One language.
#[derive(Debug)]
pub(crate) struct Language {
    pub(crate) code: &'static str,
    messages: &'static Catalogue,
}

impl Language {
    /// All of them.
    pub(crate) fn all() -> &'static [Language] {
        &ALL
    }

    /// English, for what is not written for one reader.
    pub(crate) fn english() -> &'static Language {
        &ALL[0]
    }

    /// The one of a code.
    pub(crate) fn named(code: &str) -> Option<&'static Language> {
        ALL.iter().find(|l| code.split('-').next().is_some_and(|c| c.eq_ignore_ascii_case(l.code)))
    }

    /// The one of a code, else the first that a browser's `Accept-Language` names, else English.
    pub(crate) fn choose(code: Option<&str>, accepted: &str) -> &'static Language {
        let mut wanted: Vec<(f64, &str)> = accepted
            .split(',')
            .take(20)
            .map(|item| {
                let (name, weight) = item.split_once(";q=").unwrap_or((item, "1"));
                (weight.trim().parse().unwrap_or(0.0), name.trim())
            })
            .collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let first = || wanted.iter().filter(|(weight, _)| *weight > 0.0).find_map(|(_, name)| Self::named(name));
        code.and_then(Self::named).or_else(first).unwrap_or(&ALL[0])
    }

    /// The message of a key, or the key if there is none.
    pub(crate) fn t<'k>(&'static self, key: &'k str) -> &'k str {
        self.find(key).unwrap_or(key)
    }

    /// The message of a key, if there is one.
    pub(crate) fn find(&self, key: &str) -> Option<&'static str> {
        self.messages.text(key)
    }

    /// A number with its thousands apart. As in the viewer: the language's signs between the digits 0 to 9.
    pub(crate) fn count(&self, n: u64) -> String {
        self.messages.number(n)
    }

    /// A length of a file.
    pub(crate) fn size(&'static self, bytes: u64) -> String {
        if bytes < 1000 {
            return self.with("bytes", &[("count", bytes)]);
        }
        let (value, unit) = kilwa_files::size::decimal(bytes);
        format!("{} {}", self.decimals(&value), self.t(unit))
    }

    /// A number that was written with a point.
    pub(crate) fn decimals(&self, number: &str) -> String {
        if matches!(self.code, "fr" | "pt") { number.replace('.', ",") } else { number.to_owned() }
    }

    /// A date or span as it is said in this language; any other text as it is.
    pub(crate) fn date(&'static self, text: &str) -> String {
        if !is_date_or_span(text) {
            return text.to_owned();
        }
        let one = |date: &str| {
            let mut parts = date.split('-');
            let year = parts.next().unwrap_or_default();
            let number = |part: &str| part.parse::<usize>().ok();
            let month = parts.next().and_then(number).and_then(|m| self.t("months").split(' ').nth(m.checked_sub(1)?));
            let day = parts.next().and_then(number).map(|d| d.to_string());
            match (month, &day) {
                (Some(month), Some(day)) => {
                    self.with("dateDay", &[("day", day.as_str()), ("month", month), ("year", year)])
                }
                (Some(month), None) => self.with("dateMonth", &[("month", month), ("year", year)]),
                (None, _) => year.to_owned(),
            }
        };
        text.split('/').map(one).collect::<Vec<_>>().join(" – ")
    }

    /// The name of a country, or its code where it has none.
    pub(crate) fn country<'c>(&self, code: &'c str) -> &'c str {
        crate::countries::name(code, self.code).unwrap_or(code)
    }

    /// A message with its values. Numbers are given as such: they choose the plural form.
    pub(crate) fn with<'v, V: Into<Value<'v>> + Copy>(&self, key: &str, values: &[(&str, V)]) -> String {
        let values: Vec<_> = values.iter().map(|&(name, value)| (name, value.into())).collect();
        self.messages.format(key, &values).unwrap_or_else(|| key.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_in_the_style_of_each_language() {
        let of = |code: &str| Language::choose(Some(code), "");
        assert_eq!(of("en").count(1_234_567), "1,234,567");
        assert_eq!(of("fr").count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(of("pt").count(1_234_567), "1.234.567");
        assert_eq!(of("ar").count(1_234), "1,234");
        assert_eq!((of("en").size(5_230_000), of("fr").size(5_230_000)), ("5.2 MB".into(), "5,2 Mo".into()));
        assert_eq!((of("en").size(12), of("pt").size(2_500_000_000)), ("12 bytes".into(), "2,50 GB".into()));
        assert_eq!(
            (of("en").size(1), of("fr").size(0), of("sw").size(2)),
            ("1 byte".into(), "0 octet".into(), "baiti 2".into())
        );
        assert_eq!((of("fr").country("TZ"), of("fr").country("QQ")), ("Tanzanie", "QQ"));
    }

    #[test]
    fn dates_are_said_in_each_language() {
        let of = |code: &str, text: &str| Language::choose(Some(code), "").date(text);
        assert_eq!(of("en", "2026-11-24"), "24 November 2026");
        assert_eq!(of("fr", "2009-08"), "août 2009");
        assert_eq!(of("pt", "2026-01-02"), "2 de janeiro de 2026");
        assert_eq!(of("sw", "2009-07-21/2009-12"), "21 Julai 2009 – Desemba 2009");
        assert_eq!(of("ar", "2026-11-24"), "24 نوفمبر 2026");
        assert_eq!((of("fr", "1505"), of("en", "about 1505")), ("1505".into(), "about 1505".into()));
        for language in Language::all() {
            assert_eq!(language.t("months").split(' ').count(), 12, "{}", language.code);
        }
    }

    #[test]
    fn the_language_is_chosen_by_the_reader_then_the_browser_then_english() {
        for (code, accepted, wanted) in [
            (None, "", "en"),
            (None, "de-DE,de;q=0.9,fr;q=0.5,ar;q=0.6", "ar"),
            (None, "SW", "sw"),
            (None, "fr;q=0, xx", "en"),
            (Some("pt-BR"), "fr", "pt"),
            (Some("xx"), "fr", "fr"),
        ] {
            assert_eq!(Language::choose(code, accepted).code, wanted, "{code:?} {accepted}");
        }
    }
}

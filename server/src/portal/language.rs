//! The portal's texts in the viewer's five languages, and which one a reader wants.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Codes and texts, in the order in which they are offered.
static ALL: LazyLock<Vec<Language>> = LazyLock::new(|| {
    let files = [
        ("en", include_str!("texts/en.json")),
        ("fr", include_str!("texts/fr.json")),
        ("pt", include_str!("texts/pt.json")),
        ("sw", include_str!("texts/sw.json")),
        ("ar", include_str!("texts/ar.json")),
    ];
    // A test reads all of them; a file that is none would leave its language without words, never a page without an answer.
    files.map(|(code, text)| Language { code, texts: serde_json::from_str(text).unwrap_or_default() }).into()
});

/// One language.
#[derive(Debug)]
pub(crate) struct Language {
    pub(crate) code: &'static str,
    texts: BTreeMap<String, String>,
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

    /// A text, or its key where there is none.
    pub(crate) fn t<'k>(&'static self, key: &'k str) -> &'k str {
        self.texts.get(key).map_or(key, String::as_str)
    }

    /// A number with its thousands apart. As in the viewer: the language's signs between the digits 0 to 9.
    pub(crate) fn count(&self, n: u64) -> String {
        let between = match self.code {
            "fr" => '\u{202f}',
            "pt" => '.',
            _ => ',',
        };
        kilwa_archive::numbers::grouped(n).replace('\u{202f}', &between.to_string())
    }

    /// A length of a file.
    pub(crate) fn size(&'static self, bytes: u64) -> String {
        let (value, unit) = kilwa_files::size::decimal(bytes);
        format!("{} {}", self.decimals(&value), self.t(unit))
    }

    /// A number that was written with a point.
    pub(crate) fn decimals(&self, number: &str) -> String {
        if matches!(self.code, "fr" | "pt") { number.replace('.', ",") } else { number.to_owned() }
    }

    /// The name of a country, or its code where it has none.
    pub(crate) fn country<'c>(&self, code: &'c str) -> &'c str {
        crate::countries::name(code, self.code).unwrap_or(code)
    }

    /// A text with a place filled in.
    pub(crate) fn with(&'static self, key: &str, places: &[(&str, &str)]) -> String {
        places.iter().fold(self.t(key).to_owned(), |text, (name, value)| text.replace(&format!("{{{name}}}"), value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_language_has_every_text_with_its_places() {
        let english = &ALL[0].texts;
        assert!(english.len() > 30);
        for language in Language::all() {
            let keys = |l: &BTreeMap<String, String>| l.keys().cloned().collect::<Vec<_>>();
            assert_eq!(keys(&language.texts), keys(english), "{}", language.code);
            for (key, text) in &language.texts {
                let places = |s: &str| s.matches('{').count();
                assert_eq!(places(text), places(&english[key]), "{} {key}", language.code);
                assert!(
                    !text.contains(['<', '&', '"']),
                    "{} {key}: texts are put into HTML as they are",
                    language.code
                );
            }
        }
    }

    #[test]
    fn numbers_are_written_as_each_language_does() {
        let of = |code: &str| Language::choose(Some(code), "");
        assert_eq!(of("en").count(1_234_567), "1,234,567");
        assert_eq!(of("fr").count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(of("pt").count(1_234_567), "1.234.567");
        assert_eq!(of("ar").count(1_234), "1,234");
        assert_eq!((of("en").size(5_230_000), of("fr").size(5_230_000)), ("5.2 MB".into(), "5,2 Mo".into()));
        assert_eq!((of("en").size(12), of("pt").size(2_500_000_000)), ("12 bytes".into(), "2,50 GB".into()));
        assert_eq!((of("fr").country("TZ"), of("fr").country("QQ")), ("Tanzanie", "QQ"));
    }

    #[test]
    fn the_reader_chooses_else_the_browser_else_english() {
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

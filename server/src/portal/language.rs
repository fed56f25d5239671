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

    /// The one of a code, else the first that a browser's `Accept-Language` names, else English.
    pub(crate) fn choose(code: Option<&str>, accepted: &str) -> &'static Language {
        let of =
            |code: &str| ALL.iter().find(|l| code.split('-').next().is_some_and(|c| c.eq_ignore_ascii_case(l.code)));
        let mut wanted: Vec<(f64, &str)> = accepted
            .split(',')
            .take(20)
            .map(|item| {
                let (name, weight) = item.split_once(";q=").unwrap_or((item, "1"));
                (weight.trim().parse().unwrap_or(0.0), name.trim())
            })
            .collect();
        wanted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let first = || wanted.iter().filter(|(weight, _)| *weight > 0.0).find_map(|(_, name)| of(name));
        code.and_then(of).or_else(first).unwrap_or(&ALL[0])
    }

    /// A text, or its key where there is none.
    pub(crate) fn t<'k>(&'static self, key: &'k str) -> &'k str {
        self.texts.get(key).map_or(key, String::as_str)
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

//! The messages of the page and the portal in every language: a folder for each language, and in it a file for
//! the page, one each for its list of holes, its photographs and headsets, which few visitors load, one for the portal and one for the form for metadata files, in [Fluent](https://projectfluent.org)'s syntax. A message whose wording depends on a number has a
//! form for each plural category of its language (Unicode CLDR): two in English, six in Arabic.
//!
//! The server formats the messages of the portal and the form ([`portal`], [`metadata`]). The page gets its messages as JSON ([`page_json`], [`holes_json`], [`photographs_json`], [`headset_json`], written by
//! `cargo xtask web`), so that browsers need no parser; `www/i18n.js` formats them in the same way, with the browser's own plural rules.

use icu_locale_core::{Locale, locale};
use icu_plurals::{PluralCategory, PluralRules};
use message::Message;
use std::collections::BTreeMap;
use std::sync::LazyLock;

mod message;

pub use message::Value;

/// A language: its messages, and how it writes numbers.
struct Source {
    code: &'static str,
    locale: Locale,
    page: &'static str,
    holes: &'static str,
    photographs: &'static str,
    headset: &'static str,
    portal: &'static str,
    metadata: &'static str,
    /// Between groups of three digits. The digits are 0 to 9 in every language, as those of coordinates are.
    group: char,
}

/// A language from the files in the folder of its code.
macro_rules! language {
    ($code:literal, $group:literal) => {
        Source {
            code: $code,
            locale: locale!($code),
            page: include_str!(concat!("../", $code, "/page.ftl")),
            holes: include_str!(concat!("../", $code, "/holes.ftl")),
            photographs: include_str!(concat!("../", $code, "/photographs.ftl")),
            headset: include_str!(concat!("../", $code, "/headset.ftl")),
            portal: include_str!(concat!("../", $code, "/portal.ftl")),
            metadata: include_str!(concat!("../", $code, "/metadata.ftl")),
            group: $group,
        }
    };
}

/// The languages in the order in which they are offered, English first.
static SOURCES: [Source; 5] = [
    language!("en", ','),
    language!("fr", '\u{202f}'),
    language!("pt", '.'),
    language!("sw", ','),
    language!("ar", ','),
];

/// The codes of all languages (ISO 639-1), English first.
pub fn languages() -> impl Iterator<Item = &'static str> {
    SOURCES.iter().map(|s| s.code)
}

/// The page's messages in a language as JSON: an object of texts and plural forms by key (`message.rs` describes them).
///
/// # Errors
/// An unknown language, or a file that cannot be read; the text names the message.
pub fn page_json(code: &str) -> Result<String, String> {
    json(code, "page", |source| source.page)
}

/// As [`page_json`], the messages of the list of holes (`www/holes.js`).
///
/// # Errors
/// As [`page_json`].
pub fn holes_json(code: &str) -> Result<String, String> {
    json(code, "holes", |source| source.holes)
}

/// As [`page_json`], the messages of the photographs that a model was coloured from (`www/photographs/`).
///
/// # Errors
/// As [`page_json`].
pub fn photographs_json(code: &str) -> Result<String, String> {
    json(code, "photographs", |source| source.photographs)
}

/// As [`page_json`], the messages for headsets (`www/headset/`).
///
/// # Errors
/// As [`page_json`].
pub fn headset_json(code: &str) -> Result<String, String> {
    json(code, "headset", |source| source.headset)
}

fn json(code: &str, file: &str, text: fn(&Source) -> &'static str) -> Result<String, String> {
    let source =
        SOURCES.iter().find(|s| s.code == code).ok_or_else(|| format!("{code} is not one of the languages"))?;
    let messages = message::parse(text(source)).map_err(|why| format!("i18n/{code}/{file}.ftl: {why}"))?;
    let all = messages.iter().map(|(key, message)| (key.as_str(), message.to_json()));
    Ok(all.collect::<serde_json::Value>().to_string())
}

/// The portal's messages, in the order of [`languages`].
pub fn portal() -> &'static [Catalogue] {
    static ALL: LazyLock<Vec<Catalogue>> =
        LazyLock::new(|| SOURCES.iter().map(|s| Catalogue::new(s, s.portal)).collect());
    &ALL
}

/// The messages of the form for metadata files, in the order of [`languages`].
pub fn metadata() -> &'static [Catalogue] {
    static ALL: LazyLock<Vec<Catalogue>> =
        LazyLock::new(|| SOURCES.iter().map(|s| Catalogue::new(s, s.metadata)).collect());
    &ALL
}

/// The messages of a language.
#[derive(Debug)]
pub struct Catalogue {
    code: &'static str,
    group: char,
    /// Absent for a language that CLDR does not know: its numbers then all take the form `other`.
    rules: Option<PluralRules>,
    messages: BTreeMap<String, Message>,
}

impl Catalogue {
    fn new(source: &Source, text: &str) -> Self {
        Self {
            code: source.code,
            group: source.group,
            rules: PluralRules::try_new_cardinal((&source.locale).into()).ok(),
            // A test reads all files; in the program a damaged file would show keys, and fail no page.
            messages: message::parse(text).unwrap_or_default().into_iter().collect(),
        }
    }

    /// Its code, such as `en`.
    pub fn code(&self) -> &'static str {
        self.code
    }

    /// The message of a key, if there is one and it has no values.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.messages.get(key).and_then(Message::text)
    }

    /// The message of a key with its values, if there is one. A value that is not given is shown as its name in braces.
    pub fn format(&self, key: &str, values: &[(&str, Value<'_>)]) -> Option<String> {
        Some(self.messages.get(key)?.format(self, values))
    }

    /// A number with its thousands apart.
    pub fn number(&self, n: u64) -> String {
        let digits = n.to_string();
        let mut text = String::new();
        for (i, digit) in digits.chars().enumerate() {
            if i > 0 && (digits.len() - i).is_multiple_of(3) {
                text.push(self.group);
            }
            text.push(digit);
        }
        text
    }

    fn category(&self, n: u64) -> PluralCategory {
        self.rules.as_ref().map_or(PluralCategory::Other, |rules| rules.category_for(n))
    }
}

#[cfg(test)]
mod tests;

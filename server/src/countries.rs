//! Names of countries and territories in the page's languages, by their codes of ISO 3166-1.
//!
//! The table is `assets/countries.json`, made by `xtask/npm/countries.mjs` from Unicode CLDR. A code that is not in it has no name, and is shown as
//! it is.

use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Names by code, in the order of the languages of `kilwa_messages`.
static NAMES: LazyLock<BTreeMap<String, Vec<String>>> = LazyLock::new(|| {
    // A test reads it; a table that is none would leave codes as they are.
    serde_json::from_str(include_str!("../assets/countries.json")).unwrap_or_default()
});

/// The name of a country in a language.
pub(crate) fn name(code: &str, language: &str) -> Option<&'static str> {
    let at = kilwa_messages::languages().position(|l| l == language)?;
    NAMES.get(code)?.get(at).map(String::as_str)
}

/// Its names in all languages, for whoever searches.
pub(crate) fn names(code: &str) -> &'static [String] {
    NAMES.get(code).map(Vec::as_slice).unwrap_or_default()
}

/// All countries: code and name in a language.
pub(crate) fn all(language: &str) -> impl Iterator<Item = (&'static str, &'static str)> {
    let at = kilwa_messages::languages().position(|l| l == language).unwrap_or(0);
    let countries = NAMES.iter().filter(|(code, _)| code.len() == 2);
    countries.filter_map(move |(code, names)| Some((code.as_str(), names.get(at)?.as_str())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_country_has_a_name_in_every_language() {
        assert!(NAMES.len() > 240, "{}", NAMES.len());
        for (code, names) in NAMES.iter().filter(|(code, _)| *code != "source") {
            assert!(code.len() == 2 && code.bytes().all(|b| b.is_ascii_uppercase()), "{code}");
            assert_eq!(names.len(), kilwa_messages::languages().count(), "{code}");
            // A code in place of a name is what a table without it gives.
            assert!(names.iter().all(|name| name.chars().count() > 2 && !name.contains(['<', '"'])), "{code}");
        }
        let tanzania: Vec<_> = kilwa_messages::languages().map(|l| name("TZ", l).unwrap()).collect();
        assert_eq!(tanzania, ["Tanzania", "Tanzanie", "Tanzânia", "Tanzania", "تنزانيا"]);
        assert_eq!((name("QQ", "en"), name("TZ", "xx")), (None, None));
    }
}

//! The common parts of the portal's pages: head, header with links to its parts and the choice of language.

use super::encoded;
use super::language::Language;

/// For whom a page is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reader<'a> {
    pub(crate) language: &'static Language,
    /// The code of the language that the address names, which its links keep: one of ours, never the address's own text.
    pub(crate) lang: Option<&'a str>,
    /// Whether there are collections to lead to.
    pub(crate) has_collections: bool,
    /// Whether there is an index, and so a map.
    pub(crate) has_map: bool,
}

impl Reader<'_> {
    /// An address of this site with the reader's language; `path` has no query.
    pub(crate) fn to(&self, path: &str) -> String {
        let lang = self.lang.map(|lang| format!("?lang={}", encoded(lang))).unwrap_or_default();
        format!("{path}{lang}")
    }

    /// The top of a page; `other` is the address of the same page in another language.
    pub(crate) fn top(&self, other: &dyn Fn(&str) -> String) -> Top {
        let parts = [("/map", "map", self.has_map), ("/collections/", "collections", self.has_collections)];
        let parts: Vec<_> = parts.into_iter().filter(|(.., is_there)| *is_there).collect();
        let all = (!parts.is_empty()).then_some(("/", "title", true));
        let choice = |one: &'static Language| Choice {
            address: other(one.code),
            code: one.code,
            name: one.t("name"),
            is_current: one.code == self.language.code,
        };
        Top {
            l: self.language,
            home: self.to("/"),
            parts: all.into_iter().chain(parts).map(|(path, key, _)| (self.to(path), key)).collect(),
            languages: Language::all().iter().map(choice).collect(),
        }
    }
}

/// What `templates/portal.html` has above the content of a page: the ways to the site's parts, and the languages.
#[derive(Debug)]
pub(crate) struct Top {
    pub(crate) l: &'static Language,
    /// Address of the list.
    pub(crate) home: String,
    /// Addresses of the parts and the keys of their names.
    pub(crate) parts: Vec<(String, &'static str)>,
    pub(crate) languages: Vec<Choice>,
}

/// A language that the page can be read in.
#[derive(Debug)]
pub(crate) struct Choice {
    pub(crate) address: String,
    pub(crate) code: &'static str,
    pub(crate) name: &'static str,
    pub(crate) is_current: bool,
}

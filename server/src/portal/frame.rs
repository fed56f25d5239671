//! What the portal's pages have in common: head, header with the ways to its parts and the languages.

use super::encoded;
use super::language::Language;
use kilwa_archive::record::xml::escape;
use std::fmt::Write as _;

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
    /// An address of this site with the reader's language; `path` has no query. Escaped.
    pub(crate) fn to(&self, path: &str) -> String {
        let lang = self.lang.map(|lang| format!("?lang={}", encoded(lang))).unwrap_or_default();
        escape(&format!("{path}{lang}"))
    }
}

/// Up to and with `<main>`. `title` is escaped; `other` is the address of the same page in another language; `more` goes into the head.
pub(crate) fn head(reader: &Reader<'_>, title: &str, other: &dyn Fn(&str) -> String, more: &str) -> String {
    let l = reader.language;
    let mut s = format!(
        "<!doctype html>\n<html lang=\"{}\" dir=\"{}\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"/viewer/icons/kilwa.svg\" type=\"image/svg+xml\">\n\
         <link rel=\"stylesheet\" href=\"/viewer/style.css\">\n{more}</head>\n<body class=\"list portal\">\n\
         <header class=\"site\"><a class=\"brand\" href=\"{}\"><img src=\"/viewer/icons/kilwa.svg\" alt=\"\" width=\"28\" height=\"28\"> Kilwa</a>\n",
        l.code,
        l.t("dir"),
        reader.to("/"),
    );
    let parts = [("/map", "map", reader.has_map), ("/collections/", "collections", reader.has_collections)];
    if parts.iter().any(|(.., is_there)| *is_there) {
        let _ = write!(s, "<nav class=\"parts\" aria-label=\"{}\">", l.t("parts"));
        for (path, key, _) in [("/", "title", true)].into_iter().chain(parts).filter(|(.., is_there)| *is_there) {
            let _ = write!(s, "<a href=\"{}\">{}</a> ", reader.to(path), l.t(key));
        }
        s.push_str("</nav>\n");
    }
    let _ = write!(s, "<nav class=\"languages\" aria-label=\"{}\">", l.t("language"));
    for one in Language::all() {
        let current = if one.code == l.code { " aria-current=\"true\"" } else { "" };
        let _ = write!(
            s,
            "<a href=\"{}\" lang=\"{code}\" hreflang=\"{code}\"{current}>{}</a> ",
            escape(&other(one.code)),
            one.t("name"),
            code = one.code
        );
    }
    s.push_str("</nav></header>\n<main>\n");
    s
}

/// The end of every page.
pub(crate) const FOOT: &str = "</main>\n</body>\n</html>\n";

/// `<link>` of a feed, for the head.
pub(crate) fn feed_link(address: &str, title: &str) -> String {
    format!("<link rel=\"alternate\" type=\"application/atom+xml\" href=\"{}\" title=\"{title}\">\n", escape(address))
}

//! The catalogue's page: search, facets, order, pages of cards. Plain HTML: the form and the links do all of it, with or without scripts.
//!
//! Its state is its address: `?q=…&country=…&kind=…&sort=newest&page=2&lang=sw`.

use super::collections::{self, Collection};
use super::encoded;
use super::frame::{FOOT, Reader, feed_link, head};
use super::language::Language;
use super::limit::{QUERY_MAX, TooMuch, VALUES_MAX};
use crate::index::{Entry, Facet, Found, Query, Sort};
use kilwa_archive::AccessState;
use kilwa_archive::record::xml::escape;
use kilwa_archive::site::poster;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

/// Cards of a page.
const PER_PAGE: u32 = 24;
/// Names of orders in addresses, and their texts.
const SORTS: [(&str, &str, Sort); 4] = [
    ("relevance", "relevance", Sort::Relevance),
    ("title", "byTitle", Sort::Title),
    ("newest", "newest", Sort::Newest),
    ("largest", "largest", Sort::Largest),
];
/// Longest question that is read.
const TEXT_MAX: usize = 300;
/// Collections on the first page; all of them have a page of their own.
const COLLECTIONS: usize = 24;

/// Read the address of the catalogue or the map, which is at `path`.
///
/// # Errors
/// [`TooMuch`].
pub(crate) fn query(path: &str, pairs: &[(String, String)]) -> Result<Query, TooMuch> {
    let get = |name: &str| pairs.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str());
    let mut facets: BTreeMap<Facet, BTreeSet<String>> = BTreeMap::new();
    let mut surplus = None;
    for (name, value) in pairs.iter().filter(|(_, value)| !value.is_empty()) {
        let Some(facet) = Facet::of(name) else { continue };
        let chosen = facets.entry(facet).or_default();
        if chosen.len() < VALUES_MAX || chosen.contains(value) {
            chosen.insert(value.clone());
        } else {
            surplus.get_or_insert(facet);
        }
    }
    let sort = get("sort").and_then(|name| SORTS.iter().find(|(n, ..)| *n == name)).map(|(.., sort)| *sort);
    let page = get("page").and_then(|n| n.parse::<u32>().ok()).unwrap_or(1);
    let query = Query {
        text: get("q").unwrap_or_default().trim().chars().take(TEXT_MAX).collect(),
        facets,
        sort: sort.unwrap_or_default(),
        page: page.clamp(1, 1_000_000) - 1,
        per_page: PER_PAGE,
    };
    // As its links would have it, which may be longer than what came.
    if address(path, &query, query.page, None).len() > QUERY_MAX {
        return Err(TooMuch::Long);
    }
    match surplus {
        Some(facet) => Err(TooMuch::Values(facet, Box::new(query))),
        None => Ok(query),
    }
}

/// The address of a query, with another page. `path` is the catalogue or the map.
pub(super) fn address(path: &str, query: &Query, page: u32, lang: Option<&str>) -> String {
    let mut parts = Vec::new();
    if !query.text.is_empty() {
        parts.push(format!("q={}", encoded(&query.text)));
    }
    for (facet, values) in &query.facets {
        parts.extend(values.iter().map(|value| format!("{}={}", facet.name(), encoded(value))));
    }
    if let Some((name, ..)) = SORTS.iter().find(|(.., sort)| *sort == query.sort && *sort != Sort::Relevance) {
        parts.push(format!("sort={name}"));
    }
    if page > 0 {
        parts.push(format!("page={}", page + 1));
    }
    parts.extend(lang.map(|lang| format!("lang={}", encoded(lang))));
    if parts.is_empty() { path.to_owned() } else { format!("{path}?{}", parts.join("&")) }
}

/// What else the page is made of.
pub(crate) struct Around<'a> {
    pub(crate) reader: Reader<'a>,
    /// Today, UTC: embargoes that have ended are not spoken of.
    pub(crate) today: &'a str,
    /// Cards of what is not in the index, in a list: packs without metadata, and what cannot be read.
    pub(crate) others: &'a str,
    /// Collections, in their order.
    pub(crate) collections: &'a [Collection],
}

/// The page.
pub(crate) fn page(query: &Query, found: &Found, around: &Around<'_>) -> String {
    let l = around.reader.language;
    let more = feed_link("/feed.xml", l.t("feed"));
    let mut s = head(&around.reader, l.t("title"), &|code| address("/", query, query.page, Some(code)), &more);
    let _ = writeln!(s, "<h1>{}</h1>", l.t("title"));
    search_form(&mut s, "/", query, &around.reader);
    let _ = writeln!(s, "<div class=\"portal-body\">\n<section class=\"results\" aria-label=\"{}\">", l.t("title"));
    let _ = writeln!(
        s,
        "<p class=\"lead\" role=\"status\">{} <a class=\"way\" href=\"{}\">{}</a> <a class=\"jump\" href=\"#filters\">{}</a></p>",
        l.with("results", &[("count", found.total)]),
        escape(&address("/map", query, 0, around.reader.lang)),
        l.t("map"),
        l.t("filters")
    );
    chosen(&mut s, "/", query, &around.reader);
    if found.entries.is_empty() {
        let _ = writeln!(
            s,
            "<p><strong>{}</strong> {} <a href=\"{}\">{}</a></p>",
            l.t("none"),
            l.t("noneNext"),
            around.reader.to("/"),
            l.t("all")
        );
    } else {
        s.push_str("<ul class=\"cards\">\n");
        for entry in &found.entries {
            card(&mut s, entry, &around.reader, around.today);
        }
        s.push_str("</ul>\n");
        pages(&mut s, query, found.total, around);
    }
    if query.is_start() && !around.collections.is_empty() {
        let first = around.collections.iter().take(COLLECTIONS);
        let _ = writeln!(s, "<h2 class=\"others\">{}</h2>", l.t("collections"));
        s.push_str(&collections::list(first, &around.reader));
    }
    if query.is_start() && !around.others.is_empty() {
        let _ = writeln!(s, "<h2 class=\"others\" id=\"packs\">{}</h2>\n{}", l.t("packs"), around.others);
    }
    s.push_str("</section>\n");
    facets(&mut s, query, found, around);
    let _ = writeln!(s, "</div>\n<p class=\"lead feed\"><a href=\"/feed.xml\">{}</a></p>\n{FOOT}", l.t("feed"));
    s
}

/// The page while the index gives no answer.
pub(crate) fn failed(around: &Around<'_>) -> String {
    let l = around.reader.language;
    let mut s = head(&around.reader, l.t("title"), &|code| format!("/?lang={code}"), "");
    let _ = writeln!(
        s,
        "<h1>{}</h1>\n<p class=\"lead\"><strong>{}</strong> {}</p>\n{}{FOOT}",
        l.t("title"),
        l.t("failed"),
        l.t("failedNext"),
        around.others
    );
    s
}

/// The form, whose answer is at `path`.
pub(super) fn search_form(s: &mut String, path: &str, query: &Query, reader: &Reader<'_>) {
    let l = reader.language;
    let _ = write!(
        s,
        "<form id=\"search\" class=\"search\" role=\"search\" action=\"{path}\" method=\"get\">\n\
         <label class=\"hidden\" for=\"q\">{label}</label>\
         <input id=\"q\" name=\"q\" type=\"search\" value=\"{}\" placeholder=\"{label}\" maxlength=\"{TEXT_MAX}\" dir=\"auto\" autocomplete=\"off\">\n",
        escape(&query.text),
        label = l.t("searchLabel"),
    );
    if path == "/" {
        let _ =
            write!(s, "<label class=\"hidden\" for=\"sort\">{}</label><select id=\"sort\" name=\"sort\">", l.t("sort"));
        for (name, text, sort) in SORTS {
            let selected = if sort == query.sort { " selected" } else { "" };
            let _ = write!(s, "<option value=\"{name}\"{selected}>{}</option>", l.t(text));
        }
        s.push_str("</select>\n");
    } else {
        // Where there is no order to choose there are no filters either: what was chosen in the list stays.
        for (facet, value) in query.facets.iter().flat_map(|(facet, values)| values.iter().map(move |v| (facet, v))) {
            let _ = writeln!(s, "<input type=\"hidden\" name=\"{}\" value=\"{}\">", facet.name(), escape(value));
        }
    }
    let _ = writeln!(s, "<button class=\"button filled\">{}</button>", l.t("search"));
    if let Some(lang) = reader.lang {
        let _ = writeln!(s, "<input type=\"hidden\" name=\"lang\" value=\"{}\">", escape(lang));
    }
    s.push_str("</form>\n");
}

/// The text of a facet's value.
fn named(l: &'static Language, facet: Facet, value: &str) -> String {
    match facet {
        // The value comes from an address. A value that is not one of ours is shown unchanged, so it must be escaped.
        Facet::Size => escape(l.find(&format!("size-{value}")).unwrap_or(value)),
        Facet::Country => escape(l.country(value)),
        _ => escape(value),
    }
}

/// What is chosen, each with a link that takes it away.
pub(super) fn chosen(s: &mut String, path: &str, query: &Query, reader: &Reader<'_>) {
    let l = reader.language;
    if query.facets.is_empty() {
        return;
    }
    let _ = write!(s, "<ul class=\"chosen\" aria-label=\"{}\">", l.t("chosen"));
    for (facet, values) in &query.facets {
        for value in values {
            let mut without = query.clone();
            if let Some(values) = without.facets.get_mut(facet) {
                values.remove(value);
            }
            without.facets.retain(|_, values| !values.is_empty());
            let _ = write!(
                s,
                "<li><a class=\"button outlined\" href=\"{}\"><span dir=\"auto\">{}</span> <span aria-hidden=\"true\">×</span><span class=\"hidden\">{}</span></a></li>",
                escape(&address(path, &without, 0, reader.lang)),
                named(l, *facet, value),
                l.t("remove")
            );
        }
    }
    let all = Query { text: query.text.clone(), sort: query.sort, ..Query::default() };
    let _ = writeln!(
        s,
        "<li><a class=\"button outlined\" href=\"{}\">{}</a></li></ul>",
        escape(&address(path, &all, 0, reader.lang)),
        l.t("clear")
    );
}

fn facets(s: &mut String, query: &Query, found: &Found, around: &Around<'_>) {
    let l = around.reader.language;
    let _ = writeln!(s, "<aside class=\"filters\" id=\"filters\" aria-label=\"{}\">", l.t("filters"));
    for facet in Facet::ALL {
        let counts = found.facets.get(&facet).map(Vec::as_slice).unwrap_or_default();
        let picked = query.facets.get(&facet);
        // What is chosen stays to be taken away, also where nothing has it.
        let missing = picked.into_iter().flatten().filter(|value| !counts.iter().any(|c| c.value == **value));
        let rows: Vec<(&str, u64)> = counts
            .iter()
            .map(|c| (c.value.as_str(), c.count))
            .chain(missing.map(|value| (value.as_str(), 0)))
            .collect();
        if rows.is_empty() {
            continue;
        }
        let _ = writeln!(s, "<fieldset><legend>{}</legend>", l.t(facet.name()));
        for (value, count) in rows {
            let checked = if picked.is_some_and(|p| p.contains(value)) { " checked" } else { "" };
            let _ = writeln!(
                s,
                "<label><input type=\"checkbox\" form=\"search\" name=\"{}\" value=\"{}\"{checked}> <span dir=\"auto\">{}</span> <span class=\"quiet\">{}</span></label>",
                facet.name(),
                escape(value),
                named(l, facet, value),
                l.count(count)
            );
        }
        s.push_str("</fieldset>\n");
    }
    let _ = writeln!(s, "<button class=\"button filled\" form=\"search\">{}</button>\n</aside>", l.t("apply"));
}

/// A card in a list.
pub(super) fn card(s: &mut String, entry: &Entry, reader: &Reader<'_>, today: &str) {
    let l = reader.language;
    let slug = escape(&entry.slug);
    let place = entry.place.as_ref().and_then(|p| p.name.as_deref());
    let line: Vec<String> = [place, entry.captured.as_deref()]
        .into_iter()
        .flatten()
        .map(|text| format!("<bdi>{}</bdi>", escape(text)))
        .collect();
    let folder = format!("/{slug}/v{}", entry.version);
    let page = reader.to(&format!("/{}/", entry.slug));
    let _ = write!(
        s,
        "<li class=\"card\">\n{}\n<h2 lang=\"{lang}\" dir=\"auto\"><a href=\"{page}\">{}</a></h2>\n<p class=\"quiet\">{}</p>\n<dl class=\"facts\">\n",
        poster(&folder),
        escape(&entry.title),
        line.join(" · "),
        lang = escape(&entry.language),
    );
    let mut row = |name: &str, value: &str| {
        let _ = writeln!(s, "<div><dt>{}</dt><dd>{}</dd></div>", l.t(name), escape(value));
    };
    row("triangles", &l.count(entry.triangles));
    row("file", &l.size(entry.pack_bytes));
    row("licence", &entry.rights.short);
    s.push_str("</dl>\n");
    let until = entry.access.until.as_deref().unwrap_or("9999-12-31");
    match entry.access.state {
        AccessState::Embargo if until > today => {
            let _ = writeln!(
                s,
                "<p class=\"state\"><strong>{}</strong></p>",
                l.with("embargo", &[("day", &escape(until))])
            );
        }
        AccessState::Restricted => {
            let _ = writeln!(s, "<p class=\"state\"><strong>{}</strong></p>", l.t("restricted"));
        }
        _ => {}
    }
    s.push_str("</li>\n");
}

fn pages(s: &mut String, query: &Query, total: u64, around: &Around<'_>) {
    let pages = usize::try_from(total.div_ceil(u64::from(PER_PAGE))).unwrap_or(usize::MAX);
    let part = Part { page: query.page as usize, pages };
    let to = |page: usize| address("/", query, u32::try_from(page).unwrap_or(u32::MAX), around.reader.lang);
    pager(s, part, &to, around.reader.language);
}

/// One page of several.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Which, from 0.
    pub(crate) page: usize,
    /// How many there are.
    pub(crate) pages: usize,
}

/// Links to the page before and the next; `to` gives their addresses.
pub(super) fn pager(s: &mut String, Part { page, pages }: Part, to: &dyn Fn(usize) -> String, l: &'static Language) {
    if pages < 2 {
        return;
    }
    let _ = write!(s, "<nav class=\"pages\" aria-label=\"{}\">", l.t("pages"));
    let mut link = |page: usize, rel: &str, text: &str| {
        let _ = write!(s, "<a class=\"button outlined\" rel=\"{rel}\" href=\"{}\">{text}</a> ", escape(&to(page)));
    };
    if page > 0 {
        link(page.min(pages) - 1, "prev", l.t("previous"));
    }
    if page + 1 < pages {
        link(page + 1, "next", l.t("next"));
    }
    let numbers = [("page", page + 1), ("pages", pages)];
    let _ = writeln!(s, "<span class=\"quiet\">{}</span></nav>", l.with("page", &numbers));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::portal::pairs;

    #[test]
    fn an_address_is_a_query_and_back() {
        for text in ["", "q=fort%20x&country=TZ&kind=fort&kind=wall&sort=newest&page=3", "q=%22%3E&subject=a%26b"] {
            let asked = query("/", &pairs(text)).unwrap();
            let again = address("/", &asked, asked.page, None);
            assert_eq!(query("/", &pairs(again.trim_start_matches(['/', '?']))), Ok(asked), "{again}");
        }
        let odd = query("/", &pairs("page=0&sort=x&nothing=y&country=&q=%20a%20")).unwrap();
        assert_eq!((odd.page, odd.sort, odd.facets.len(), odd.text.as_str()), (0, Sort::Relevance, 0, "a"));
        assert_eq!(address("/", &Query::default(), 0, Some("sw")), "/?lang=sw");
    }
    #[test]
    fn ten_values_of_a_filter_are_taken_and_no_address_grows_beyond_its_limit() {
        let values = |n: usize| (0..n).map(|i| format!("kind=k{i}")).collect::<Vec<_>>().join("&");
        assert!(query("/", &pairs(&format!("{}&kind=k3", values(10)))).is_ok(), "the same twice is one");
        let Err(TooMuch::Values(Facet::Kind, first)) = query("/", &pairs(&values(11))) else { panic!("eleven") };
        assert_eq!(first.facets[&Facet::Kind].len(), 10);
        // Three bytes for each in the address that came, nine in those of links.
        assert_eq!(query("/", &pairs(&format!("subject={}", "%ff".repeat(400)))), Err(TooMuch::Long));
    }
}

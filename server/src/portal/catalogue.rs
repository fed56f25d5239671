//! The catalogue's page: search, facets, order, pages of cards. Plain HTML: the form and the links do all of it, with or without scripts.
//!
//! Its state is its address: `?q=…&country=…&kind=…&sort=newest&page=2&lang=sw`.

use super::collections::{self, Collection};
use super::encoded;
use super::featured::{self, Featured};
use super::frame::{Reader, Top};
use super::language::Language;
use super::limit::{QUERY_MAX, TooMuch, VALUES_MAX};
use crate::index::{Entry, Facet, Found, Query, Sort};
use askama::Template;
use kilwa_archive::AccessState;
use kilwa_archive::html::render;
use kilwa_archive::layout::{POSTER, THUMBNAILS};
use kilwa_archive::site::poster;
use std::collections::{BTreeMap, BTreeSet};

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
    /// Models that the institution shows first.
    pub(crate) featured: &'a [Entry],
}

/// A filter, with what can be chosen.
struct Filter<'a> {
    name: &'static str,
    values: Vec<FilterValue<'a>>,
}

struct FilterValue<'a> {
    value: &'a str,
    text: &'a str,
    count: String,
    is_checked: bool,
}

#[derive(Template)]
#[template(path = "catalogue.html")]
struct Page<'a> {
    top: Top,
    /// Whether it is the institution's front page, which introduces it before the list.
    is_front: bool,
    /// The paragraphs of the introduction, and their language.
    introduction: Option<(&'a str, Vec<&'a str>)>,
    featured: Vec<Featured<'a>>,
    search: Search<'a>,
    results: String,
    /// Address of the map.
    map: String,
    chosen: Option<Chosen>,
    cards: Vec<Card<'a>>,
    pager: Option<Pager>,
    collections: Option<collections::List<'a>>,
    others: &'a str,
    filters: Vec<Filter<'a>>,
}

/// The page.
pub(crate) fn page(query: &Query, found: &Found, around: &Around<'_>) -> String {
    let (reader, l) = (&around.reader, around.reader.language);
    let first = around.collections.iter().take(COLLECTIONS);
    let has_collections = query.is_start() && !around.collections.is_empty();
    render(&Page {
        top: reader.top(&|code| address("/", query, query.page, Some(code))),
        is_front: query.is_start() && reader.name().is_some(),
        introduction: reader.introduction(),
        featured: around.featured.iter().map(|entry| featured::card(entry, reader)).collect(),
        search: search("/", query, reader),
        results: l.with("results", &[("count", found.total)]),
        map: address("/map", query, 0, reader.lang),
        chosen: chosen("/", query, reader),
        cards: found.entries.iter().map(|entry| card(entry, reader, around.today)).collect(),
        pager: pages(query, found.total, around),
        collections: has_collections.then(|| collections::list(first, reader)),
        others: if query.is_start() { around.others } else { "" },
        filters: filters(query, found, l),
    })
}

#[derive(Template)]
#[template(path = "failed.html")]
struct FailedPage<'a> {
    top: Top,
    others: &'a str,
}

/// The page while the index gives no answer.
pub(crate) fn failed(around: &Around<'_>) -> String {
    render(&FailedPage { top: around.reader.top(&|code| format!("/?lang={code}")), others: around.others })
}

/// The form, whose answer is at `path`.
#[derive(Template)]
#[template(path = "search.html")]
pub(super) struct Search<'a> {
    l: &'static Language,
    path: &'a str,
    query: &'a Query,
    lang: Option<&'a str>,
}

pub(super) fn search<'a>(path: &'a str, query: &'a Query, reader: &Reader<'a>) -> Search<'a> {
    Search { l: reader.language, path, query, lang: reader.lang }
}

/// The text of a facet's value.
fn named<'v>(l: &'static Language, facet: Facet, value: &'v str) -> &'v str {
    match facet {
        // The value comes from an address. One that is not ours is shown unchanged.
        Facet::Size => l.find(&format!("size-{value}")).unwrap_or(value),
        Facet::Country => l.country(value),
        _ => value,
    }
}

/// What is chosen, each with a link that takes it away.
#[derive(Template)]
#[template(path = "chosen.html")]
pub(super) struct Chosen {
    l: &'static Language,
    /// Addresses without a value, and its text.
    values: Vec<(String, String)>,
    /// Address without all of them.
    all: String,
}

/// `None` where nothing is chosen.
pub(super) fn chosen(path: &str, query: &Query, reader: &Reader<'_>) -> Option<Chosen> {
    let l = reader.language;
    if query.facets.is_empty() {
        return None;
    }
    let mut values = Vec::new();
    for (facet, value) in query.facets.iter().flat_map(|(facet, values)| values.iter().map(move |v| (facet, v))) {
        let mut without = query.clone();
        if let Some(values) = without.facets.get_mut(facet) {
            values.remove(value);
        }
        without.facets.retain(|_, values| !values.is_empty());
        values.push((address(path, &without, 0, reader.lang), named(l, *facet, value).to_owned()));
    }
    let all = Query { text: query.text.clone(), sort: query.sort, ..Query::default() };
    Some(Chosen { l, values, all: address(path, &all, 0, reader.lang) })
}

fn filters<'a>(query: &'a Query, found: &'a Found, l: &'static Language) -> Vec<Filter<'a>> {
    let mut filters = Vec::new();
    for facet in Facet::ALL {
        let counts = found.facets.get(&facet).map(Vec::as_slice).unwrap_or_default();
        let picked = query.facets.get(&facet);
        // A chosen value stays, so that it can be removed, even if no object has it.
        let missing = picked.into_iter().flatten().filter(|value| !counts.iter().any(|c| c.value == **value));
        let rows = counts.iter().map(|c| (c.value.as_str(), c.count)).chain(missing.map(|value| (value.as_str(), 0)));
        let values: Vec<FilterValue<'_>> = rows
            .map(|(value, count)| FilterValue {
                value,
                text: named(l, facet, value),
                count: l.count(count),
                is_checked: picked.is_some_and(|p| p.contains(value)),
            })
            .collect();
        if !values.is_empty() {
            filters.push(Filter { name: facet.name(), values });
        }
    }
    filters
}

/// A card in a list.
#[derive(Template)]
#[template(path = "card.html")]
pub(super) struct Card<'a> {
    l: &'static Language,
    entry: &'a Entry,
    poster: String,
    page: String,
    /// Place, period and day of capture.
    line: Vec<String>,
    /// Who made it: the first few names.
    creators: Option<String>,
    /// Triangles, or points.
    parts: String,
    size: String,
    /// Who may have the model, where not everybody may.
    state: Option<String>,
}

/// Names of people who are named on a card.
const NAMED: usize = 3;

/// The first names of a list, with an ellipsis if there are more; none of an empty one.
fn some_of(names: &[String]) -> Option<String> {
    let first = names.get(..NAMED.min(names.len()))?.join("; ");
    (!first.is_empty()).then(|| if names.len() > NAMED { format!("{first}; …") } else { first })
}

/// Place, period and day of capture, as far as they are known.
pub(super) fn line(entry: &Entry, l: &'static Language) -> Vec<String> {
    let place = entry.place.as_ref().and_then(|p| p.name.clone());
    let captured = entry.captured.as_deref().map(|day| l.date(day));
    [place, entry.period.clone(), captured].into_iter().flatten().collect()
}

pub(super) fn card<'a>(entry: &'a Entry, reader: &Reader<'_>, today: &str) -> Card<'a> {
    let l = reader.language;
    let until = entry.access.until.as_deref().unwrap_or("9999-12-31");
    let state = match entry.access.state {
        AccessState::Embargo if until > today => Some(l.with("embargo", &[("day", l.date(until).as_str())])),
        AccessState::Restricted => Some(l.t("restricted").to_owned()),
        _ => None,
    };
    Card {
        l,
        entry,
        poster: poster(&format!("/{}/v{}", entry.slug, entry.version)),
        page: reader.to(&format!("/{}/", entry.slug)),
        line: line(entry, l),
        creators: some_of(&entry.creators),
        parts: l.count(entry.points.unwrap_or(entry.triangles)),
        size: l.size(entry.pack_bytes),
        state,
    }
}

fn pages(query: &Query, total: u64, around: &Around<'_>) -> Option<Pager> {
    let pages = usize::try_from(total.div_ceil(u64::from(PER_PAGE))).unwrap_or(usize::MAX);
    let part = Part { page: query.page as usize, pages };
    let to = |page: usize| address("/", query, u32::try_from(page).unwrap_or(u32::MAX), around.reader.lang);
    pager(part, &to, around.reader.language)
}

/// One page of several.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Which, from 0.
    pub(crate) page: usize,
    /// How many there are.
    pub(crate) pages: usize,
}

/// Links to the page before and the next.
#[derive(Template)]
#[template(path = "pager.html")]
pub(super) struct Pager {
    l: &'static Language,
    /// `rel`, address, text.
    links: Vec<(&'static str, String, &'static str)>,
    numbers: String,
}

/// `to` gives the addresses; `None` where there is one page.
pub(super) fn pager(Part { page, pages }: Part, to: &dyn Fn(usize) -> String, l: &'static Language) -> Option<Pager> {
    if pages < 2 {
        return None;
    }
    let previous = (page > 0).then(|| ("prev", to(page.min(pages) - 1), l.t("previous")));
    let next = (page + 1 < pages).then(|| ("next", to(page + 1), l.t("next")));
    let numbers = [("page", page + 1), ("pages", pages)];
    Some(Pager { l, links: previous.into_iter().chain(next).collect(), numbers: l.with("page", &numbers) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::portal::pairs;

    #[test]
    fn a_query_round_trips_through_its_address() {
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
    fn ten_values_of_a_filter_are_accepted_and_no_address_exceeds_its_limit() {
        let values = |n: usize| (0..n).map(|i| format!("kind=k{i}")).collect::<Vec<_>>().join("&");
        assert!(query("/", &pairs(&format!("{}&kind=k3", values(10)))).is_ok(), "the same twice is one");
        let Err(TooMuch::Values(Facet::Kind, first)) = query("/", &pairs(&values(11))) else { panic!("eleven") };
        assert_eq!(first.facets[&Facet::Kind].len(), 10);
        // Three bytes for each in the address that came, nine in those of links.
        assert_eq!(query("/", &pairs(&format!("subject={}", "%ff".repeat(400)))), Err(TooMuch::Long));
    }
}

//! The portal's routes: they bring index, objects and pages together.

use super::catalogue::{self, Around, Part};
use super::collections::{self, Collection};
use super::feeds::Sitemap;
use super::frame::{Reader, Visit};
use super::language::Language;
use super::limit::{QUERY_MAX, refused};
use super::plain::{page as plain_page, part as plain_part};
use super::site_file::Branding;
use super::{base, featured, feeds, map, oai, oembed, pairs};
use crate::access::{Verdict, verdict};
use crate::budget::lean;
use crate::catalogue::Model;
use crate::content::{plain, text};
use crate::flow;
use crate::gate::Turns;
use crate::index::{Entry, Index, IndexError, Query, Sort};
use crate::packs::blocking;
use crate::site::{Site, lost, page};
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, RawQuery, State};
use axum::http::header::{
    ACCEPT_LANGUAGE, ACCESS_CONTROL_ALLOW_ORIGIN, CACHE_CONTROL, CONTENT_TYPE, COOKIE, RETRY_AFTER, VARY,
};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::response::{IntoResponse as _, Response};
use kilwa_archive::layout::DUBLIN_CORE;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A reader waits for that at most this long; what is new is then there for the next.
const PATIENCE: Duration = Duration::from_millis(50);

/// Cards of what no index knows, on one page.
const OTHERS: usize = 48;
/// Members of a collection on one page.
const MEMBERS: usize = 100;

const XML: &str = "application/xml; charset=utf-8";
const ATOM: &str = "application/atom+xml; charset=utf-8";

/// Bring the index up to the folder, and ask it.
pub(super) async fn ask<T: Send + 'static>(
    index: &Arc<Index>,
    what: impl FnOnce(&Index) -> Result<T, IndexError> + Send + 'static,
) -> Result<T, StatusCode> {
    let refreshed = Arc::clone(index);
    let refresh = blocking(move || {
        let began = Instant::now();
        if let Err(e) = refreshed.refresh_if_due()
            && !e.is_away()
        {
            tracing::warn!("the index could not be updated from the folder: {e}");
        }
        began.elapsed()
    });
    // Given up here, it still continues.
    drop(tokio::time::timeout(PATIENCE, refresh).await);
    let index = Arc::clone(index);
    blocking(move || what(&index)).await?.map_err(|e| {
        tracing::error!("{e}");
        StatusCode::SERVICE_UNAVAILABLE
    })
}

/// The parts of a request's address and headers that affect the page, and what every page shows of the site.
pub(crate) struct Given {
    pairs: Vec<(String, String)>,
    language: &'static Language,
    collections: Arc<Vec<Collection>>,
    has_map: bool,
    branding: Branding,
    visit: Option<Visit>,
}

impl Given {
    /// `words` is a query or the body of a form.
    pub(crate) async fn of(site: &Site, words: &str, headers: &HeaderMap) -> Self {
        let pairs = pairs(words);
        let lang = pairs.iter().find(|(name, _)| name == "lang").map(|(_, value)| value.as_str());
        let language = Language::choose(lang, text(headers, &ACCEPT_LANGUAGE).unwrap_or_default());
        let (collections, branding) = (collections(site).await, branding(site).await);
        Self { pairs, language, collections, has_map: has_map(site), branding, visit: visit(site, headers).await }
    }

    /// The page of a list that has more than one, from 0.
    fn page(&self, name: &str) -> usize {
        self.get(name).and_then(|n| n.parse::<usize>().ok()).unwrap_or(1).clamp(1, 1_000_000) - 1
    }

    pub(crate) fn get(&self, name: &str) -> Option<&str> {
        self.pairs.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    pub(crate) fn reader(&self) -> Reader<'_> {
        Reader {
            language: self.language,
            lang: self.get("lang").and_then(Language::named).map(|l| l.code),
            has_collections: !self.collections.is_empty(),
            has_map: self.has_map,
            branding: Some(&self.branding),
            visit: self.visit.as_ref(),
        }
    }
}

/// Whether there is an index, and so a map.
pub(crate) fn has_map(site: &Site) -> bool {
    site.index.is_some() && site.catalogue.has_objects()
}

/// The collections as they are now.
pub(crate) async fn collections(site: &Site) -> Arc<Vec<Collection>> {
    let Some(collections) = site.collections.clone() else { return Arc::default() };
    blocking(move || collections.all()).await.unwrap_or_default()
}

/// The institution, as far as `site.toml` describes it.
pub(crate) async fn branding(site: &Site) -> Branding {
    let Some(file) = site.institution.clone() else { return Branding::default() };
    blocking(move || file.branding()).await.unwrap_or_default()
}

/// The visitor, if the server has accounts.
pub(crate) async fn visit(site: &Site, headers: &HeaderMap) -> Option<Visit> {
    let auth = site.auth.clone()?;
    if !headers.contains_key(COOKIE) {
        return Some(Visit::default());
    }
    let (now, headers) = (site.clock.seconds(), headers.clone());
    let holder = blocking(move || auth.visitor(&headers, now)).await.ok().flatten();
    Some(Visit { who: holder.map(|holder| holder.who) })
}

/// A page for one reader.
pub(crate) fn for_reader(html: String, reader: &Reader<'_>, headers: &HeaderMap) -> Response {
    let mut response = page(html, headers);
    let names = response.headers_mut();
    // Whether somebody is signed in is in the header of the page.
    let vary = if reader.visit.is_some() {
        "Accept-Encoding, Accept-Language, Cookie"
    } else {
        "Accept-Encoding, Accept-Language"
    };
    names.insert(VARY, HeaderValue::from_static(vary));
    if reader.visit.is_some_and(|visit| visit.who.is_some()) {
        names.insert(CACHE_CONTROL, HeaderValue::from_static("private, no-cache"));
    }
    response
}

/// A page that says that the index gives no answer.
fn failed(around: &Around<'_>, status: StatusCode, headers: &HeaderMap) -> Response {
    let mut response = for_reader(catalogue::failed(around), &around.reader, headers);
    *response.status_mut() = status;
    response.headers_mut().insert(RETRY_AFTER, HeaderValue::from_static("60"));
    response
}

/// `/`
pub(crate) async fn list(site: &Site, index: &Arc<Index>, query: Option<String>, headers: &HeaderMap) -> Response {
    let given = Given::of(site, query.as_deref().unwrap_or_default(), headers).await;
    let reader = given.reader();
    let asked = match catalogue::query("/", &given.pairs) {
        Ok(asked) => asked,
        Err(why) => return refused("/", &why, &reader, headers),
    };
    let others = if asked.is_start() { others(site, &reader, given.page("packs")).await } else { String::new() };
    let featured = if asked.is_start() { featured::entries(site, index, &given.branding).await } else { Vec::new() };
    let today = site.clock.day();
    let around =
        Around { reader, today: &today, others: &others, collections: &given.collections, featured: &featured };
    let question = asked.clone();
    match ask(index, move |index| index.search(&question)).await {
        Ok(found) => for_reader(catalogue::page(&asked, &found, &around), &reader, headers),
        Err(status) => failed(&around, status, headers),
    }
}

/// `/` of a folder that holds packs alone.
pub(crate) async fn plain_list(
    site: &Site,
    models: &[Arc<Model>],
    query: Option<String>,
    headers: &HeaderMap,
) -> Response {
    let given = Given::of(site, query.as_deref().unwrap_or_default(), headers).await;
    let reader = given.reader();
    for_reader(plain_page(models, given.page("page"), &site.clock, &reader), &reader, headers)
}

/// `/map`
pub(crate) async fn map(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let Some(index) = &site.index else { return lost() };
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let reader = given.reader();
    let asked = match catalogue::query("/map", &given.pairs) {
        Ok(asked) => asked,
        Err(why) => return refused("/map", &why, &reader, &headers),
    };
    let question = asked.clone();
    match ask(index, move |index| index.located(&question)).await {
        Ok(places) => {
            let window = given.get("box").and_then(map::Window::parse);
            for_reader(map::page(&map::Shown { query: &asked, places: &places, window }, &reader), &reader, &headers)
        }
        Err(status) => {
            let around = Around { reader, today: &site.clock.day(), others: "", collections: &[], featured: &[] };
            failed(&around, status, &headers)
        }
    }
}

/// `/collections/`
pub(crate) async fn all_collections(
    State(site): State<Site>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let page = given.page("page");
    let reader = given.reader();
    for_reader(collections::all_page(&given.collections, page, &reader), &reader, &headers)
}

/// A collection, the slugs of those of its members that are shown, in its order, with the day of each one's current version, and of these what `pick` picks.
async fn members(
    site: &Site,
    slug: &str,
    pick: impl FnOnce(&[(String, String)]) -> Vec<String> + Send + 'static,
) -> Result<(Collection, usize, Vec<Entry>), StatusCode> {
    let (Some(index), Some(collections)) = (&site.index, site.collections.clone()) else {
        return Err(StatusCode::NOT_FOUND);
    };
    let slug = slug.to_owned();
    let collection = blocking(move || collections.get(&slug)).await?.ok_or(StatusCode::NOT_FOUND)?;
    let named = collection.members.clone();
    let found = ask(index, move |index| {
        let shown = index.shown(&named)?;
        let picked = pick(&shown).iter().map(|slug| index.entry(slug)).collect::<Result<Vec<_>, _>>()?;
        Ok((shown.len(), picked.into_iter().flatten().collect()))
    });
    let (count, entries) = found.await?;
    Ok((collection, count, entries))
}

/// `/collections/<slug>/`
pub(crate) async fn collection(
    State(site): State<Site>,
    Path(slug): Path<String>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let page = given.page("page");
    let pick = move |shown: &[(String, String)]| {
        let part = shown.iter().skip(page.saturating_mul(MEMBERS)).take(MEMBERS);
        part.map(|(slug, _)| slug.clone()).collect()
    };
    match members(&site, &slug, pick).await {
        Ok((collection, count, members)) => {
            let today = site.clock.day();
            let part = Part { page, pages: count.div_ceil(MEMBERS) };
            let reader = given.reader();
            for_reader(collections::page(&collection, (count, &members), part, &reader, &today), &reader, &headers)
        }
        Err(StatusCode::NOT_FOUND) => lost(),
        Err(status) => plain(status),
    }
}

/// `/collections/<slug>/feed.xml`: latest first, whatever the order of the page.
pub(crate) async fn collection_feed(
    State(site): State<Site>,
    Path(slug): Path<String>,
    headers: HeaderMap,
) -> Response {
    let newest = |shown: &[(String, String)]| {
        let mut all: Vec<&(String, String)> = shown.iter().collect();
        all.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        all.into_iter().take(feeds::NEWEST as usize).map(|(slug, _)| slug.clone()).collect()
    };
    match members(&site, &slug, newest).await {
        Ok((collection, _, members)) => {
            let path = format!("/collections/{}/", collection.slug);
            document(ATOM, feeds::atom(&site_base(&site, &headers), &path, &collection.title, &members))
        }
        Err(status) => plain(status),
    }
}

/// Cards of packs without metadata, and of objects that cannot be read: a part of them, and links to the others.
async fn others(site: &Site, reader: &Reader<'_>, page: usize) -> String {
    let catalogue = Arc::clone(&site.catalogue);
    // Given up here, it still continues; what is new is there for the next reader.
    drop(tokio::time::timeout(PATIENCE, blocking(move || catalogue.refresh())).await);
    let others = site.catalogue.others();
    plain_part(&others, Part { page, pages: others.len().div_ceil(OTHERS) }, OTHERS, "packs", &site.clock, reader)
}

fn site_base(site: &Site, headers: &HeaderMap) -> String {
    base(site.url.as_deref(), headers, site.behind_proxy)
}

fn document(kind: &'static str, body: String) -> Response {
    ([(CONTENT_TYPE, kind), (ACCESS_CONTROL_ALLOW_ORIGIN, "*")], body).into_response()
}

/// `/feed.xml`
pub(crate) async fn feed(State(site): State<Site>, headers: HeaderMap) -> Response {
    let Some(index) = &site.index else { return plain(StatusCode::NOT_FOUND) };
    let newest = Query { sort: Sort::Newest, per_page: feeds::NEWEST, ..Query::default() };
    match ask(index, move |index| index.search(&newest)).await {
        Ok(found) => {
            let branding = branding(&site).await;
            let title = branding.title().unwrap_or("3D models");
            document(ATOM, feeds::atom(&site_base(&site, &headers), "/", title, &found.entries))
        }
        Err(status) => plain(status),
    }
}

/// `/sitemap.xml`
pub(crate) async fn sitemap(
    State(site): State<Site>,
    Extension(turns): Extension<Turns>,
    headers: HeaderMap,
) -> Response {
    let Some(index) = &site.index else { return plain(StatusCode::NOT_FOUND) };
    let (base, collections) = (site_base(&site, &headers), collections(&site).await);
    let sitemap = Sitemap::new(&base, collections);
    // The first piece shows whether there is an index to make it from.
    let of = Arc::clone(index);
    let begun = ask(index, move |_| {
        let mut state = (sitemap, of);
        Ok(sitemap_piece(&mut state).map(|first| (first.unwrap_or_default(), state)))
    });
    match begun.await {
        Ok(Ok((first, state))) => {
            let headers = [(CONTENT_TYPE, XML), (ACCESS_CONTROL_ALLOW_ORIGIN, "*")];
            lean((headers, flow::body(first, state, sitemap_piece, Some(turns))).into_response())
        }
        Ok(Err(e)) => {
            tracing::error!("{e}");
            plain(StatusCode::SERVICE_UNAVAILABLE)
        }
        Err(status) => plain(status),
    }
}

fn sitemap_piece((sitemap, index): &mut (Sitemap, Arc<Index>)) -> std::io::Result<Option<String>> {
    sitemap.next(|after, limit| index.after(after, limit)).map_err(std::io::Error::other)
}

/// `/robots.txt`
pub(crate) async fn robots(State(site): State<Site>, headers: HeaderMap) -> Response {
    document("text/plain; charset=utf-8", feeds::robots(&site_base(&site, &headers)))
}

/// `/oembed`
pub(crate) async fn embed(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let Some(index) = &site.index else { return plain(StatusCode::NOT_FOUND) };
    let base = site_base(&site, &headers);
    let question = match oembed::question(&base, query.as_deref().unwrap_or_default()) {
        Ok(question) => question,
        Err(status) => return plain(StatusCode::from_u16(status).unwrap_or(StatusCode::BAD_REQUEST)),
    };
    let slug = question.slug.clone();
    let branding = branding(&site).await;
    match ask(index, move |index| index.entry(&slug)).await {
        Ok(entry) => match entry.and_then(|entry| {
            let is_open = matches!(verdict(&entry.access, &site.clock), Verdict::Open);
            let may_embed = is_open && site.policy.lets_any_site_embed();
            oembed::answer((&base, branding.title()), &question, &entry, may_embed)
        }) {
            Some(answer) if question.xml => document("text/xml; charset=utf-8", oembed::to_xml(&answer)),
            Some(answer) => document("application/json", answer.to_string()),
            None => plain(StatusCode::NOT_FOUND),
        },
        Err(status) => plain(status),
    }
}

/// What harvesters ask, answered from the index and the objects' own files.
struct Archive {
    site: Site,
    index: Arc<Index>,
    base: String,
    sets: Arc<Vec<Collection>>,
}

impl oai::Source for Archive {
    fn after(&self, slug: &str, limit: u32) -> Result<Vec<Entry>, String> {
        self.index.after(slug, limit).map_err(|e| e.to_string())
    }

    fn entry(&self, slug: &str) -> Result<Option<Entry>, String> {
        self.index.entry(slug).map_err(|e| e.to_string())
    }

    fn dublin_core(&self, slug: &str) -> Option<String> {
        let model = self.site.catalogue.model(slug)?;
        let table = model.object()?.files.table().ok()?;
        let version = table.manifest.current()?;
        let entry = table.get(&format!("{}/{DUBLIN_CORE}", version.folder))?;
        let bytes = Some(entry).filter(|e| e.identity().bytes() <= oai::RECORD_MAX)?.read().ok()?;
        String::from_utf8(bytes.into()).ok()
    }

    fn page(&self, slug: &str) -> String {
        format!("{}/{slug}/", self.base)
    }

    fn sets(&self) -> &[Collection] {
        &self.sets
    }
}

/// `/oai`, by GET, or by POST with a form, which the gate has already read.
pub(crate) async fn harvest(
    State(site): State<Site>,
    RawQuery(query): RawQuery,
    method: Method,
    headers: HeaderMap,
    body: Body,
) -> Response {
    let Some(index) = site.index.clone() else { return plain(StatusCode::NOT_FOUND) };
    let query = match query {
        Some(query) => query,
        None if method == Method::POST => match axum::body::to_bytes(body, QUERY_MAX).await {
            Ok(form) => String::from_utf8_lossy(&form).into_owned(),
            Err(_) => return plain(StatusCode::PAYLOAD_TOO_LARGE),
        },
        None => String::new(),
    };
    let base = site_base(&site, &headers);
    let now = site.clock.instant();
    let (sets, branding) = (collections(&site).await, branding(&site).await);
    let archive = Archive { site, index: Arc::clone(&index), base, sets };
    let answered = ask(&index, move |_| {
        let base = archive.base.clone();
        let host = base.split("://").nth(1).unwrap_or_default().split(':').next().unwrap_or_default().to_owned();
        let contact = archive.site.contact.clone().unwrap_or_else(|| format!("webmaster@{host}"));
        let name = branding.title();
        let asked = oai::Asked { url: format!("{base}/oai"), host, name, now, contact: &contact };
        Ok(oai::answer(&archive, &asked, &query))
    });
    match answered.await {
        Ok(Ok(xml)) => document("text/xml; charset=utf-8", xml),
        Ok(Err(e)) => {
            tracing::error!("{e}");
            plain(StatusCode::SERVICE_UNAVAILABLE)
        }
        Err(status) => plain(status),
    }
}

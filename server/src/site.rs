//! The routes.
//!
//! | URL | what |
//! |---|---|
//! | `/` | the catalogue ([`crate::portal`]), or the list of packs; readable without JavaScript |
//! | `/map`, `/collections/…` | where the models are; models that belong together |
//! | `/site.css`, `/logo.svg` … | style sheet of the portal, with the institution's colours, and its logo ([`crate::portal::site_file`]) |
//! | `/oai`, `/oembed`, `/feed.xml`, `/sitemap.xml`, `/robots.txt` | the catalogue for other systems |
//! | `/<slug>/` | landing page of an archive object; its files are below ([`crate::objects`]) |
//! | `/<slug>/extract…` | meshes for other programs, made on request ([`crate::extracts`]) |
//! | `/m/<slug>` | a pack that lies in the folder: the viewer page, with its facts in the HTML |
//! | `/packs/<slug>.kilwa` | the pack ([`crate::packs`]) |
//! | `/viewer/<file>` | the page's files |
//! | `/models.json` | the list for machines |
//! | `/uploads` | versions that are published from elsewhere ([`crate::upload`]) |
//! | `/healthz`, `/metrics` | for those who keep the server |
//!
//! A survey has other routes ([`crate::survey`]) beside the last two, `/viewer/<file>`, the style sheet and the logo.

use crate::FRESHNESS;
use crate::access::{Clock, Verdict, verdict};
use crate::auth::{self, Auth};
use crate::budget::{Budget, Counting, count, lean};
use crate::catalogue::{Catalogue, Kind, Model};
use crate::content::{condition, share, text};
use crate::extracts::{self, Extracts};
use crate::flow;
use crate::gate::{Gate, Passing, pass};
use crate::html;
use crate::index::Index;
use crate::metrics::Metrics;
use crate::objects;
use crate::observe::{Observer, observe};
use crate::packs::{self, blocking};
use crate::policy::Policy;
use crate::portal::collections::Collections;
use crate::portal::color::Accent;
use crate::portal::limit::short_query;
use crate::portal::logo::Format;
use crate::portal::routes::{Given, for_reader};
use crate::portal::site_file::SiteFile;
use crate::portal::{base, routes, signposting};
use crate::range::lists;
use crate::recheck;
use crate::socket::Peer;
use crate::store;
use crate::survey::{self, Surveyed};
use crate::upload::{self, Uploads};
use axum::Router;
use axum::body::{Body, HttpBody as _};
use axum::extract::{Path, RawQuery, Request, State};
use axum::http::header::{
    ACCEPT_ENCODING, ACCEPT_LANGUAGE, ACCESS_CONTROL_ALLOW_ORIGIN, ALLOW, CACHE_CONTROL, CONNECTION, CONTENT_ENCODING,
    CONTENT_SECURITY_POLICY, CONTENT_TYPE, COOKIE, ETAG, HOST, IF_NONE_MATCH, LINK, LOCATION, REFERRER_POLICY, VARY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::uri::Authority;
use axum::http::{Extensions, HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::{get, post};
use flate2::Compression;
use flate2::write::GzEncoder;
use kilwa_archive::viewer::{Asset, Page, PageError};
use std::io::Write;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

/// Of the portal's pages.
const STYLE: &str = include_str!("../assets/portal.css");
/// Nothing here takes more than this of a request's body.
const BODY_LIMIT: u64 = 64 * 1024;

/// Who gets `/metrics`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Audience {
    /// This computer only, and nobody through a proxy.
    #[default]
    Local,
    /// Everyone.
    All,
    /// Nobody.
    None,
}

/// What is served.
#[derive(Clone)]
pub struct Site {
    /// The packs and objects.
    pub catalogue: Arc<Catalogue>,
    /// The viewer page.
    pub page: Page,
    /// Who may frame the pages and talk to them.
    pub policy: Arc<Policy>,
    /// Its figures.
    pub metrics: Arc<Metrics>,
    /// Who gets them.
    pub metrics_for: Audience,
    /// A proxy of ours stands before the server and names the client in `X-Forwarded-For`.
    pub behind_proxy: bool,
    /// What embargoes go by.
    pub clock: Clock,
    /// Time between checks whether a running transfer may continue; [`FRESHNESS`] unless a test cannot wait.
    pub recheck: Duration,
    /// The index of the objects, for the catalogue.
    pub index: Option<Arc<Index>>,
    /// Where the site is for the world, `https://museum.example`; without it, as each request names it.
    pub url: Option<String>,
    /// Whom harvesters may write to.
    pub contact: Option<String>,
    /// Meshes for other programs, made on request; without it there are none.
    pub extracts: Option<Arc<Extracts>>,
    /// Models that belong together.
    pub collections: Option<Arc<Collections>>,
    /// Whose archive it is.
    pub institution: Option<Arc<SiteFile>>,
    /// Who is let in to what is not public; without it nobody is.
    pub auth: Option<Arc<Auth>>,
    /// Where versions are taken that are published from elsewhere; without it none are.
    pub uploads: Option<Arc<Uploads>>,
    /// The survey of the folder: then its pages are served, and no models.
    pub survey: Option<Arc<Surveyed>>,
}

impl Site {
    /// With the usual policy: nobody else may frame it, figures for this computer only, no proxy.
    pub fn new(catalogue: Catalogue, page: Page) -> Self {
        let (catalogue, metrics) = (Arc::new(catalogue), Arc::default());
        Self {
            catalogue,
            page,
            policy: Arc::default(),
            metrics,
            metrics_for: Audience::Local,
            behind_proxy: false,
            clock: Clock::default(),
            recheck: FRESHNESS,
            index: None,
            url: None,
            contact: None,
            extracts: None,
            collections: None,
            institution: None,
            auth: None,
            uploads: None,
            survey: None,
        }
    }

    /// With another policy, which the page's HTML carries too.
    #[must_use]
    pub fn with_policy(mut self, policy: Policy) -> Self {
        self.page = self.page.with_head(&policy.meta());
        self.policy = Arc::new(policy);
        self
    }
}

/// The whole site.
pub fn app(site: Site) -> Router {
    let observer = Observer { metrics: Arc::clone(&site.metrics), behind_proxy: site.behind_proxy };
    let fixed_headers =
        SecurityHeaders { policy: HeaderValue::from_str(&site.policy.header()).ok(), vary: vary_of(&site) };
    let place = site.catalogue.place().clone();
    let counting = Counting { budget: Arc::new(Budget::default()), behind_proxy: site.behind_proxy };
    let content = if site.survey.is_some() { survey::routes::routes(&site) } else { models_of(&site) };
    let logos = Format::ALL.into_iter().fold(content, |content, format| {
        content.route(format.address(), get(move |State(site): State<Site>, headers| logo(site, format, headers)))
    });
    logos
        .route("/site.css", get(style))
        .route("/viewer/{*file}", get(asset).options(preflight))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .fallback(|| async { lost() })
        .layer(from_fn_with_state(site.clone(), frame_lost))
        .layer(from_fn_with_state(place, store::report_outage))
        .layer(from_fn_with_state(counting, count))
        .layer(from_fn_with_state(site.recheck, recheck::watch))
        .layer(from_fn_with_state(fixed_headers, security_headers))
        .layer(from_fn_with_state(observer, observe))
        .with_state(site)
}

/// A site of models.
fn models_of(site: &Site) -> Router<Site> {
    Router::new()
        .route("/models.json", get(list_json))
        .route("/m/{slug}", get(model))
        .route("/packs/{*file}", get(pack).options(preflight))
        .route("/viewer/", get(viewer))
        .route("/robots.txt", get(routes::robots))
        .route("/{slug}", get(towards))
        .route("/{slug}/", get(landing))
        .route("/sign-in", get(auth::routes::ask).post(auth::routes::sign_in))
        .route("/sign-out", post(auth::routes::sign_out))
        .route("/{slug}/{*file}", get(object).post(auth::routes::open).options(preflight))
        .merge(questions(site))
        .merge(upload::routes::routes())
}

/// Headers of every response.
#[derive(Clone)]
struct SecurityHeaders {
    policy: Option<HeaderValue>,
    vary: Option<HeaderValue>,
}

/// Without `--url` absolute addresses in answers are made of what the request was sent to: no cache may give them to who asks elsewhere.
fn vary_of(site: &Site) -> Option<HeaderValue> {
    let value = if site.behind_proxy { "Host, X-Forwarded-Proto" } else { "Host" };
    site.url.is_none().then(|| HeaderValue::from_static(value))
}

/// Pages that repeat in their links what they were asked, which has a limited length; what the index answers, in turns. Harvesters, whose records may have to
/// be fetched from a store, have turns of their own.
fn questions(site: &Site) -> Router<Site> {
    let behind_proxy = site.behind_proxy;
    let short = || from_fn_with_state(site.clone(), short_query);
    let gated = |router: Router<Site>| {
        let gate = Arc::new(Gate::default());
        router.route_layer(from_fn_with_state(Passing { gate, behind_proxy }, pass))
    };
    let pages = Router::new()
        .route("/", get(list))
        .route("/map", get(routes::map))
        .route("/collections/", get(routes::all_collections))
        .route("/collections/{slug}/", get(routes::collection))
        .route_layer(short())
        .route("/collections/{slug}/feed.xml", get(routes::collection_feed))
        .route("/oembed", get(routes::embed))
        .route("/feed.xml", get(routes::feed))
        .route("/sitemap.xml", get(routes::sitemap));
    let harvest = Router::new().route("/oai", get(routes::harvest).post(routes::harvest));
    let extracts = Router::new()
        .route("/{slug}/extract", get(extracts::routes::ask).post(extracts::routes::begin))
        .route("/{slug}/extract/{name}", get(extracts::routes::file));
    gated(pages).merge(gated(harvest.route_layer(short()))).merge(extracts.route_layer(short()))
}

/// Adds the headers of every response, and refuses requests with unexpected bodies.
async fn security_headers(
    State(SecurityHeaders { policy, vary }): State<SecurityHeaders>,
    request: Request,
    next: Next,
) -> Response {
    let max = if upload::is_upload(request.uri().path()) { upload::BODY_MAX } else { BODY_LIMIT };
    let mut response = match request.body().size_hint().upper() {
        Some(length) if length <= max => next.run(request).await,
        // What is not read cannot be followed by another request.
        _ => (StatusCode::PAYLOAD_TOO_LARGE, [(CONNECTION, "close")], "413 Payload Too Large\n").into_response(),
    };
    let headers = response.headers_mut();
    if let Some(policy) = policy.filter(|_| !headers.contains_key(CONTENT_SECURITY_POLICY)) {
        headers.insert(CONTENT_SECURITY_POLICY, policy);
    }
    for (name, value) in [(X_CONTENT_TYPE_OPTIONS, "nosniff"), (REFERRER_POLICY, "strict-origin-when-cross-origin")] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(CACHE_CONTROL) {
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    }
    // What never changes is the same wherever it was asked for.
    let is_fixed = headers.get(CACHE_CONTROL).is_some_and(|v| v.as_bytes().ends_with(b"immutable"));
    if let Some(vary) = vary.filter(|_| !is_fixed) {
        headers.append(VARY, vary);
    }
    response
}

/// A page of HTML, gzipped where the client takes it: it is what stands between a slow line and the first picture.
pub(crate) fn page(html: String, headers: &HeaderMap) -> Response {
    let accepted = text(headers, &ACCEPT_ENCODING).unwrap_or_default();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    let packed = if accepts("gzip", accepted) && encoder.write_all(html.as_bytes()).is_ok() {
        encoder.finish().ok()
    } else {
        None
    };
    let vary = (VARY, "Accept-Encoding");
    match packed {
        Some(packed) => {
            let kind = (CONTENT_TYPE, "text/html; charset=utf-8");
            ([vary, kind, (CONTENT_ENCODING, "gzip")], packed).into_response()
        }
        None => ([vary], Html(html)).into_response(),
    }
}

/// `/site.css`: what the portal has beside the page's own style sheet, with the institution's colours.
async fn style(State(site): State<Site>, headers: HeaderMap) -> Response {
    let accent = routes::branding(&site).await.institution.accent;
    let css = format!("{STYLE}{}", accent.map(Accent::css).unwrap_or_default());
    let etag = format!("\"{}\"", &blake3::hash(css.as_bytes()).to_hex()[..32]);
    match condition(&etag, &headers) {
        Some(status) => (status, [(ETAG, etag)]).into_response(),
        None => ([(CONTENT_TYPE, "text/css; charset=utf-8"), (ETAG, etag.as_str())], css).into_response(),
    }
}

/// The institution's logo, at the address of its format.
async fn logo(site: Site, format: Format, headers: HeaderMap) -> Response {
    let logo = routes::branding(&site).await.logo.filter(|logo| logo.format == format);
    logo.map_or_else(lost, |logo| logo.respond(&headers))
}

async fn list(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    if let Some(index) = site.index.as_ref().filter(|_| site.catalogue.has_objects()) {
        return routes::list(&site, index, query, &headers).await;
    }
    match models(&site).await {
        Ok(models) => routes::plain_list(&site, &models, query, &headers).await,
        Err(status) => status.into_response(),
    }
}

async fn list_json(State(site): State<Site>) -> Response {
    let catalogue = Arc::clone(&site.catalogue);
    let begun = blocking(move || {
        catalogue.refresh();
        let mut list = (catalogue, None, false);
        models_json(&mut list).map(|first| (first.unwrap_or_default(), list))
    });
    match begun.await {
        Ok(Ok((first, list))) => {
            let headers = [(CONTENT_TYPE, "application/json"), (ACCESS_CONTROL_ALLOW_ORIGIN, "*")];
            lean((headers, flow::body(first, list, models_json, None)).into_response())
        }
        Ok(Err(_)) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
        Err(status) => status.into_response(),
    }
}

/// The next piece of the list for machines: models behind the slug of the last one; and whether the list has ended.
#[expect(clippy::unnecessary_wraps, reason = "what makes pieces may fail")]
fn models_json(
    (catalogue, last, ended): &mut (Arc<Catalogue>, Option<String>, bool),
) -> std::io::Result<Option<String>> {
    const PIECE: usize = 100;
    if *ended {
        return Ok(None);
    }
    let mut s = String::from(if last.is_none() { "{\"models\":[" } else { "" });
    let models = catalogue.after(last.as_deref(), PIECE);
    for model in &models {
        if last.is_some() {
            s.push(',');
        }
        s.push_str(&html::model_json(model).to_string());
        *last = Some(model.slug.clone());
    }
    if models.len() < PIECE {
        s.push_str("]}");
        *ended = true;
    }
    Ok(Some(s))
}

async fn models(site: &Site) -> Result<Vec<Arc<Model>>, StatusCode> {
    let catalogue = Arc::clone(&site.catalogue);
    blocking(move || catalogue.models()).await
}

async fn model(
    State(site): State<Site>,
    Path(slug): Path<String>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    match find(&site, &slug).await {
        Ok(model) if model.object().is_some() => to(&model.page()),
        Ok(model) => {
            let extracts = site.extracts.as_ref().map(|_| slug.as_str());
            match html::model(&site.page, &model, has_notes(&model).await, extracts) {
                Ok(html) => for_frames(&site, query.as_deref(), page(html, &headers)),
                Err(e) => unusable(&e),
            }
        }
        Err(status) => or_lost(status),
    }
}

/// A page with the viewer in it; where it is asked for with `?embed=`, with the policy of pages that other sites may frame.
fn for_frames(site: &Site, query: Option<&str>, mut response: Response) -> Response {
    let is_embedded = query.is_some_and(|q| q.split('&').any(|p| p == "embed" || p.starts_with("embed=")));
    if let Some(policy) = HeaderValue::from_str(&site.policy.embed_header()).ok().filter(|_| is_embedded) {
        response.headers_mut().insert(CONTENT_SECURITY_POLICY, policy);
    }
    response
}

/// A page folder is checked when the server begins.
fn unusable(e: &PageError) -> Response {
    tracing::error!("{e}");
    StatusCode::INTERNAL_SERVER_ERROR.into_response()
}

pub(crate) async fn find(site: &Site, slug: &str) -> Result<Arc<Model>, StatusCode> {
    let (catalogue, slug) = (Arc::clone(&site.catalogue), slug.to_owned());
    blocking(move || catalogue.model(&slug).ok_or_else(|| catalogue.missing())).await?
}

async fn has_notes(model: &Model) -> bool {
    match &model.kind {
        Kind::Pack { notes, .. } => notes.is_some(),
        Kind::Object(object) => objects::has_notes(&object.files).await,
    }
}

/// An object's address without its last slash: what its page names is relative to the address with it.
async fn towards(State(site): State<Site>, Path(slug): Path<String>) -> Response {
    match find(&site, &slug).await {
        Ok(model) => to(&model.page()),
        Err(status) => or_lost(status),
    }
}

async fn landing(
    State(site): State<Site>,
    Path(slug): Path<String>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let model = match find(&site, &slug).await {
        Ok(model) if model.object().is_none() => return to(&model.page()),
        Ok(model) => model,
        Err(status) => return or_lost(status),
    };
    let (html, status, table) = match objects::landing(&model, &site.clock).await {
        Ok(landing) => landing,
        Err(status) => return or_lost(status),
    };
    let notes = table.get(objects::NOTES).map(|_| format!("/{slug}/{}", objects::NOTES));
    let extracts = site.extracts.as_ref().filter(|_| status == StatusCode::OK).map(|_| slug.as_str());
    let html = match html {
        Some(html) => html::landing(&html, &site.policy.meta(), notes.as_deref(), extracts),
        None => match html::model(&site.page, &model, notes.is_some(), extracts) {
            Ok(html) => html,
            Err(e) => return unusable(&e),
        },
    };
    let mut response = page(html, &headers);
    *response.status_mut() = status;
    if status == StatusCode::OK {
        let base = base(site.url.as_deref(), &headers, site.behind_proxy);
        let links = signposting::links(&base, &table.manifest, |name| table.get(name).is_some());
        if let Ok(links) = HeaderValue::from_str(&links) {
            response.headers_mut().insert(LINK, links);
        }
    }
    // What is not public is not shown in frames of other sites, where nobody is signed in.
    if matches!(verdict(&table.manifest.access, &site.clock), Verdict::Open) {
        return for_frames(&site, query.as_deref(), response);
    }
    response
}

async fn object(
    State(site): State<Site>,
    Path((slug, file)): Path<(String, String)>,
    method: Method,
    headers: HeaderMap,
) -> Response {
    match find(&site, &slug).await {
        Ok(model) => objects::respond(&model, &file, &site.clock, site.auth.as_ref(), &method, &headers).await,
        Err(status) => or_lost(status),
    }
}

async fn pack(State(site): State<Site>, Path(file): Path<String>, method: Method, headers: HeaderMap) -> Response {
    packs::respond(&site.catalogue, &file, &site.clock, &method, &headers).await
}

/// `ok`, or why the folder cannot be read.
async fn health(State(site): State<Site>) -> Response {
    let catalogue = Arc::clone(&site.catalogue);
    match blocking(move || catalogue.check()).await {
        Ok(Ok(())) => "ok\n".into_response(),
        Ok(Err(e)) => {
            tracing::warn!("the folder cannot be read: {e}");
            (StatusCode::SERVICE_UNAVAILABLE, "the folder cannot be read\n").into_response()
        }
        Err(status) => status.into_response(),
    }
}

async fn metrics(State(site): State<Site>, extensions: Extensions, headers: HeaderMap) -> Response {
    let from_here = extensions.get::<Peer>().is_none_or(|peer| peer.0.to_canonical().is_loopback());
    let local = from_here && asks_this_computer(&headers) && !is_forwarded(&headers);
    match site.metrics_for {
        Audience::None => lost(),
        Audience::Local if !local => lost(),
        Audience::Local | Audience::All => {
            let kind = (CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8");
            ([kind], site.metrics.to_text(site.catalogue.count())).into_response()
        }
    }
}

/// Whether a proxy added a header that proxies and content delivery networks add.
fn is_forwarded(headers: &HeaderMap) -> bool {
    const NAMES: [&str; 6] = ["forwarded", "via", "x-real-ip", "x-client-ip", "true-client-ip", "cf-connecting-ip"];
    headers.keys().any(|name| name.as_str().starts_with("x-forwarded-") || NAMES.contains(&name.as_str()))
}

/// Whether the request names this computer by a loopback address: a page of another site whose name was made to lead here does not.
fn asks_this_computer(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(HOST) else { return true };
    let Ok(authority) = host.to_str().unwrap_or_default().parse::<Authority>() else { return false };
    let name = authority.host().trim_matches(['[', ']']);
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|ip| ip.to_canonical().is_loopback())
}

/// What a browser on another site asks before a request with a `Range` header.
async fn preflight() -> Response {
    const ALLOW_METHODS: HeaderName = HeaderName::from_static("access-control-allow-methods");
    const ALLOW_HEADERS: HeaderName = HeaderName::from_static("access-control-allow-headers");
    const MAX_AGE: HeaderName = HeaderName::from_static("access-control-max-age");
    let headers = [
        (ALLOW, "GET, HEAD, OPTIONS"),
        (ACCESS_CONTROL_ALLOW_ORIGIN, "*"),
        (ALLOW_METHODS, "GET, HEAD"),
        (ALLOW_HEADERS, "Range, If-Range, If-Match, If-None-Match"),
        (MAX_AGE, "86400"),
    ];
    (StatusCode::NO_CONTENT, headers).into_response()
}

/// The viewer without a model, and the page of `?pack=`.
async fn viewer(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let send = |asset| for_frames(&site, query.as_deref(), send(asset, &headers));
    site.page.file("index.html").map_or_else(lost, send)
}

async fn asset(
    State(site): State<Site>,
    Path(file): Path<String>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let query = query.filter(|_| file == "index.html");
    site.page.file(&file).map_or_else(lost, |asset| for_frames(&site, query.as_deref(), send(asset, &headers)))
}

fn send(asset: &Asset, headers: &HeaderMap) -> Response {
    let accepted = text(headers, &ACCEPT_ENCODING).unwrap_or_default();
    let brotli = asset.brotli.as_ref().filter(|_| accepts("br", accepted)).map(|b| ("br", b));
    let packed = brotli.or_else(|| asset.gzip.as_ref().filter(|_| accepts("gzip", accepted)).map(|b| ("gzip", b)));
    // Each representation has a tag of its own.
    let etag = match packed {
        Some((coding, _)) => asset.etag.replacen('"', &format!("\"{coding}-"), 1),
        None => asset.etag.clone(),
    };
    let mut response = if lists(text(headers, &IF_NONE_MATCH).unwrap_or_default(), &etag, true) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        Body::from(packed.map_or(&asset.bytes, |(_, bytes)| bytes).clone()).into_response()
    };
    let h = response.headers_mut();
    h.insert(CONTENT_TYPE, HeaderValue::from_static(asset.content_type));
    h.insert(VARY, HeaderValue::from_static("Accept-Encoding"));
    if let Some((coding, _)) = packed {
        h.insert(CONTENT_ENCODING, HeaderValue::from_static(coding));
    }
    if let Ok(v) = HeaderValue::from_str(&etag) {
        h.insert(ETAG, v);
    }
    // A page of another site may load `<kilwa-viewer>` from here, which as a module needs leave.
    share(&mut response);
    // All readers have the same bytes.
    lean(response)
}

/// Whether a header `Accept-Encoding` allows a coding.
pub(crate) fn accepts(coding: &str, value: &str) -> bool {
    value.split(',').any(|item| {
        let mut parts = item.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let refused = parts.any(|p| matches!(p, "q=0" | "q=0.0" | "q=0.00" | "q=0.000"));
        (name.eq_ignore_ascii_case(coding) || name == "*") && !refused
    })
}

fn to(address: &str) -> Response {
    (StatusCode::PERMANENT_REDIRECT, [(LOCATION, address)]).into_response()
}

fn or_lost(status: StatusCode) -> Response {
    if status == StatusCode::NOT_FOUND { lost() } else { status.into_response() }
}

/// The answer for an address that leads nowhere, whose page [`frame_lost`] writes.
pub(crate) fn lost() -> Response {
    let mut response = StatusCode::NOT_FOUND.into_response();
    response.extensions_mut().insert(Lost);
    response
}

/// Marks an answer that gets a page for an address that leads nowhere.
#[derive(Clone)]
struct Lost;

/// Gives answers that lead nowhere their page, in the reader's language and with the institution's header and footer.
async fn frame_lost(State(site): State<Site>, request: Request, next: Next) -> Response {
    const READ: [HeaderName; 3] = [ACCEPT_ENCODING, ACCEPT_LANGUAGE, COOKIE];
    let named = |name: HeaderName| Some((request.headers().get(&name)?.clone(), name));
    let headers: HeaderMap = READ.into_iter().filter_map(named).map(|(value, name)| (name, value)).collect();
    let response = next.run(request).await;
    if response.extensions().get::<Lost>().is_none() {
        return response;
    }
    let given = Given::of(&site, "", &headers).await;
    let reader = given.reader();
    let mut response = for_reader(html::lost(&reader), &reader, &headers);
    *response.status_mut() = StatusCode::NOT_FOUND;
    response
}

//! The routes.
//!
//! | URL | what |
//! |---|---|
//! | `/` | the list of models, readable without JavaScript |
//! | `/m/<slug>` | one model: the viewer page, with its facts in the HTML |
//! | `/packs/<slug>.kilwa` | the pack ([`crate::packs`]) |
//! | `/viewer/<file>` | the page's files |
//! | `/models.json` | the list for machines |
//! | `/healthz` | `ok` |

use crate::catalogue::{Catalogue, Model};
use crate::html;
use crate::packs::{self, blocking};
use crate::page::{Asset, Page};
use crate::range::lists;
use axum::Router;
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::header::{
    ACCEPT_ENCODING, ACCESS_CONTROL_ALLOW_ORIGIN, ALLOW, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY,
    CONTENT_TYPE, ETAG, IF_NONE_MATCH, REFERRER_POLICY, VARY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::{Next, from_fn};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::sync::Arc;

/// `style-src` and `img-src` beyond `'self'`: the page sets styles from scripts (which the policy allows) and shows
/// pictures that it made itself; workers are files of the page. wasm needs `'wasm-unsafe-eval'`.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; \
    img-src 'self' data: blob:; object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'self'";

/// What is served.
#[derive(Clone)]
pub struct Site {
    /// The packs.
    pub catalogue: Arc<Catalogue>,
    /// The viewer page.
    pub page: Page,
}

/// The whole site.
pub fn app(site: Site) -> Router {
    Router::new()
        .route("/", get(list))
        .route("/models.json", get(list_json))
        .route("/m/{slug}", get(model))
        .route("/packs/{file}", get(pack).options(preflight))
        .route("/viewer/{*file}", get(asset))
        .route("/healthz", get(|| async { "ok\n" }))
        .fallback(|| async { lost() })
        .layer(from_fn(manners))
        .with_state(site)
}

/// Headers that every answer carries.
async fn manners(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "strict-origin-when-cross-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(CACHE_CONTROL) {
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    }
    response
}

/// A page of HTML, gzipped where the client takes it: it is what stands between a slow line and the first picture.
fn page(html: String, headers: &HeaderMap) -> Response {
    let accepted = headers.get(ACCEPT_ENCODING).and_then(|v| v.to_str().ok()).unwrap_or_default();
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

async fn list(State(site): State<Site>, headers: HeaderMap) -> Response {
    match models(&site).await {
        Ok(models) => page(html::list(&models), &headers),
        Err(status) => status.into_response(),
    }
}

async fn list_json(State(site): State<Site>) -> Response {
    match models(&site).await {
        Ok(models) => (
            [(CONTENT_TYPE, "application/json"), (ACCESS_CONTROL_ALLOW_ORIGIN, "*")],
            html::list_json(&models).to_string(),
        )
            .into_response(),
        Err(status) => status.into_response(),
    }
}

async fn models(site: &Site) -> Result<Vec<Arc<Model>>, StatusCode> {
    let catalogue = Arc::clone(&site.catalogue);
    blocking(move || catalogue.models()).await
}

async fn model(State(site): State<Site>, Path(slug): Path<String>, headers: HeaderMap) -> Response {
    let catalogue = Arc::clone(&site.catalogue);
    match blocking(move || catalogue.model(&slug)).await {
        Ok(Some(model)) => page(html::model(site.page.html(), &model), &headers),
        Ok(None) => lost(),
        Err(status) => status.into_response(),
    }
}

async fn pack(State(site): State<Site>, Path(file): Path<String>, method: Method, headers: HeaderMap) -> Response {
    packs::answer(&site.catalogue, &file, &method, &headers).await
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

async fn asset(State(site): State<Site>, Path(file): Path<String>, headers: HeaderMap) -> Response {
    site.page.file(&file).map_or_else(lost, |asset| send(asset, &headers))
}

fn send(asset: &Asset, headers: &HeaderMap) -> Response {
    let text = |name: &HeaderName| headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or_default();
    let accepted = text(&ACCEPT_ENCODING);
    let brotli = asset.brotli.as_ref().filter(|_| accepts("br", accepted)).map(|b| ("br", b));
    let packed = brotli.or_else(|| asset.gzip.as_ref().filter(|_| accepts("gzip", accepted)).map(|b| ("gzip", b)));
    // Each representation has a tag of its own.
    let etag = match packed {
        Some((coding, _)) => asset.etag.replacen('"', &format!("\"{coding}-"), 1),
        None => asset.etag.clone(),
    };
    let mut response = if lists(text(&IF_NONE_MATCH), &etag, true) {
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
    response
}

/// Whether a header `Accept-Encoding` allows a coding.
fn accepts(coding: &str, value: &str) -> bool {
    value.split(',').any(|item| {
        let mut parts = item.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let refused = parts.any(|p| matches!(p, "q=0" | "q=0.0" | "q=0.00" | "q=0.000"));
        (name.eq_ignore_ascii_case(coding) || name == "*") && !refused
    })
}

fn lost() -> Response {
    (StatusCode::NOT_FOUND, Html(html::lost())).into_response()
}

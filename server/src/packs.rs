//! `/packs/<slug>.kilwa` and `/packs/<slug>.<hash>.kilwa`: the bytes of a pack, whole or one range.
//!
//! The ETag is the BLAKE3 hash of the content, so it changes exactly when the content does. The hash URL may be kept
//! for ever (`immutable`); the other is revalidated. Never a `Content-Encoding`: offsets in a pack are offsets on the wire.

use crate::catalogue::{Catalogue, Identity, Model};
use crate::range::{Wanted, lists, parse};
use axum::body::Body;
use axum::http::header::{
    ACCEPT_RANGES, ACCESS_CONTROL_ALLOW_ORIGIN, ACCESS_CONTROL_EXPOSE_HEADERS, CACHE_CONTROL, CONTENT_LENGTH,
    CONTENT_RANGE, CONTENT_TYPE, ETAG, IF_MATCH, IF_NONE_MATCH, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Response, StatusCode};
use std::sync::Arc;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

/// Bytes read at a time for one response; with the connection limit this bounds memory.
const BUFFER: usize = 64 * 1024;
const CROSS_ORIGIN_RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// Answer a GET or HEAD for the file name of a pack URL.
pub(crate) async fn answer(
    catalogue: &Arc<Catalogue>,
    name: &str,
    method: &Method,
    headers: &HeaderMap,
) -> Response<Body> {
    let mut response = match find(catalogue, name).await {
        Ok((found, pinned)) => serve(&found, pinned, method, headers).await,
        Err(status) => plain(status),
    };
    let h = response.headers_mut();
    h.insert(ACCESS_CONTROL_ALLOW_ORIGIN, HeaderValue::from_static("*"));
    h.insert(
        ACCESS_CONTROL_EXPOSE_HEADERS,
        HeaderValue::from_static("ETag, Content-Range, Content-Length, Accept-Ranges"),
    );
    h.insert(CROSS_ORIGIN_RESOURCE_POLICY, HeaderValue::from_static("cross-origin"));
    response
}

/// An open file and the hash of what it holds.
struct Found {
    file: tokio::fs::File,
    bytes: u64,
    hash: Arc<str>,
}

/// Open the pack of a URL; `true` when the URL carries the hash. A file that changed since it was listed is listed again.
async fn find(catalogue: &Arc<Catalogue>, name: &str) -> Result<(Found, bool), StatusCode> {
    let stem = name.strip_suffix(".kilwa").ok_or(StatusCode::NOT_FOUND)?;
    let (slug, pin) = match stem.split_once('.') {
        Some((slug, hash)) => (slug.to_owned(), Some(hash)),
        None => (stem.to_owned(), None),
    };
    for _ in 0..3 {
        let (c, s) = (Arc::clone(catalogue), slug.clone());
        let model = blocking(move || c.model(&s)).await?.ok_or(StatusCode::NOT_FOUND)?;
        if let Some(found) = open(&model).await {
            let pinned = match pin {
                Some(hash) if hash == &*found.hash => true,
                Some(_) => return Err(StatusCode::NOT_FOUND),
                None => false,
            };
            return Ok((found, pinned));
        }
        let c = Arc::clone(catalogue);
        blocking(move || c.list()).await?.map_err(|_| StatusCode::INTERNAL_SERVER_ERROR)?;
    }
    Err(StatusCode::SERVICE_UNAVAILABLE)
}

/// The file, if it is still the version that was listed.
async fn open(model: &Model) -> Option<Found> {
    let hash = model.hash().await.inspect_err(|e| tracing::warn!("{}: {e}", model.file_name)).ok()?;
    let file = tokio::fs::File::open(&model.path).await.ok()?;
    let identity = Identity::of(&file.metadata().await.ok()?);
    (identity == model.identity).then_some(Found { file, bytes: model.bytes, hash })
}

pub(crate) async fn blocking<T: Send + 'static>(f: impl FnOnce() -> T + Send + 'static) -> Result<T, StatusCode> {
    tokio::task::spawn_blocking(f).await.map_err(|_| StatusCode::INTERNAL_SERVER_ERROR)
}

async fn serve(found: &Found, pinned: bool, method: &Method, headers: &HeaderMap) -> Response<Body> {
    let etag = format!("\"{}\"", found.hash);
    let text = |name: &HeaderName| headers.get(name).and_then(|v| v.to_str().ok());
    let mut response = if text(&IF_MATCH).is_some_and(|v| !lists(v, &etag, false)) {
        plain(StatusCode::PRECONDITION_FAILED)
    } else if text(&IF_NONE_MATCH).is_some_and(|v| lists(v, &etag, true)) {
        plain(StatusCode::NOT_MODIFIED)
    } else {
        // A validator that is not exactly ours, a date included, means: send everything.
        let current = text(&IF_RANGE).is_none_or(|v| v.trim() == etag);
        let wanted = match text(&RANGE) {
            Some(range) if method == Method::GET && current => parse(range, found.bytes),
            _ => Wanted::Whole,
        };
        send(found, wanted, method == Method::HEAD).await
    };
    let cache = if pinned { "public, max-age=31536000, immutable" } else { "no-cache" };
    let h = response.headers_mut();
    h.insert(CACHE_CONTROL, HeaderValue::from_static(cache));
    h.insert(ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    if let Ok(v) = HeaderValue::from_str(&etag) {
        h.insert(ETAG, v);
    }
    response
}

async fn send(found: &Found, wanted: Wanted, head: bool) -> Response<Body> {
    let (status, start, length) = match wanted {
        Wanted::Whole => (StatusCode::OK, 0, found.bytes),
        Wanted::Part { start, end } => (StatusCode::PARTIAL_CONTENT, start, end - start + 1),
        Wanted::Unsatisfiable => {
            let mut r = plain(StatusCode::RANGE_NOT_SATISFIABLE);
            insert(&mut r, CONTENT_RANGE, &format!("bytes */{}", found.bytes));
            return r;
        }
    };
    let body = if head {
        Body::empty()
    } else {
        match stream(found, start, length).await {
            Ok(body) => body,
            Err(e) => {
                tracing::warn!("cannot read a pack: {e}");
                return plain(StatusCode::INTERNAL_SERVER_ERROR);
            }
        }
    };
    let mut r = Response::new(body);
    *r.status_mut() = status;
    insert(&mut r, CONTENT_TYPE, "application/octet-stream");
    insert(&mut r, CONTENT_LENGTH, &length.to_string());
    if status == StatusCode::PARTIAL_CONTENT {
        insert(&mut r, CONTENT_RANGE, &format!("bytes {start}-{}/{}", start + length - 1, found.bytes));
    }
    r
}

async fn stream(found: &Found, start: u64, length: u64) -> std::io::Result<Body> {
    let mut file = found.file.try_clone().await?;
    file.seek(std::io::SeekFrom::Start(start)).await?;
    Ok(Body::from_stream(ReaderStream::with_capacity(file.take(length), BUFFER)))
}

fn insert(r: &mut Response<Body>, name: HeaderName, value: &str) {
    if let Ok(v) = HeaderValue::from_str(value) {
        r.headers_mut().insert(name, v);
    }
}

fn plain(status: StatusCode) -> Response<Body> {
    let body = match status {
        StatusCode::NOT_MODIFIED => Body::empty(),
        _ => Body::from(format!("{status}\n")),
    };
    let mut r = Response::new(body);
    *r.status_mut() = status;
    if status != StatusCode::NOT_MODIFIED {
        insert(&mut r, CONTENT_TYPE, "text/plain; charset=utf-8");
    }
    r
}

//! A store that does not answer: detected once, logged once, asked again until it does.
//!
//! From the first failure on, nothing waits for the store: who needs it is answered 503 with `Retry-After` and the reason at once, and
//! what is held is served. A task of the store asks again by itself; its answer ends the outage.

use super::Place;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_TYPE, RETRY_AFTER};
use axum::http::{HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use std::fmt;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Readers are asked to come again after so many seconds.
const COME_AGAIN: &str = "10";
/// Outages that follow each other more closely than this are logged as one.
const ONE: Duration = Duration::from_secs(60);

/// The store does not answer, or refuses: what was seen of it.
#[derive(Debug, Clone)]
pub(crate) struct Away(pub(crate) String);

impl fmt::Display for Away {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Away {}

impl From<Away> for io::Error {
    fn from(away: Away) -> Self {
        Self::new(io::ErrorKind::HostUnreachable, away)
    }
}

/// Whether the store gave no answer, which says nothing about what was asked for.
pub(crate) fn is_away(e: &io::Error) -> bool {
    e.get_ref().and_then(|inner| inner.downcast_ref::<Away>()).is_some()
}

/// Whether the store answers.
#[derive(Debug, Default)]
pub(super) struct Outage {
    now: Mutex<Now>,
}

#[derive(Debug, Default)]
struct Now {
    /// Since when it does not, and why.
    away: Option<(Instant, Away)>,
    logged: Option<Instant>,
}

impl Outage {
    /// Why the store is not asked now.
    pub(super) fn why(&self) -> Option<Away> {
        self.lock().away.as_ref().map(|(_, away)| away.clone())
    }

    /// It did not answer. True for the first to notice, who sees to its being asked again.
    pub(super) fn begin(&self, name: &str, away: &Away) -> bool {
        let mut now = self.lock();
        if now.away.is_some() {
            return false;
        }
        let again = now.logged.is_some_and(|at| at.elapsed() < ONE);
        now.away = Some((Instant::now(), away.clone()));
        now.logged = Some(Instant::now());
        if again {
            tracing::debug!("{name}: {away}, again");
        } else {
            tracing::warn!(
                "{name}: {away}; cached files are served, everything else gets 503, and the store is tried again until it answers"
            );
        }
        true
    }

    /// It answers.
    pub(super) fn end(&self, name: &str) {
        if let Some((since, _)) = self.lock().away.take() {
            tracing::info!("{name} answers again, after {} s", since.elapsed().as_secs());
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Say in a 503 that the store is the reason, and when to come again; also where it refuses one file alone.
pub(crate) async fn report_outage(State(place): State<Place>, request: Request, next: Next) -> Response {
    let wants_page =
        request.headers().get(ACCEPT).and_then(|v| v.to_str().ok()).is_some_and(|v| v.contains("text/html"));
    let slug = slug_of(request.uri().path());
    let mut response = next.run(request).await;
    let away = place.store().and_then(|store| store.away());
    if response.status() != StatusCode::SERVICE_UNAVAILABLE {
        return response;
    }
    if away.is_none() {
        if !place.store().is_some_and(|store| slug.is_some_and(|slug| store.refuses(&slug))) {
            return response;
        }
        let headers = response.headers_mut();
        headers.entry(RETRY_AFTER).or_insert(HeaderValue::from_static(COME_AGAIN));
        headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
        return response;
    }
    let message = "The archive's storage does not answer at the moment. Nothing is lost; please try again in a minute.";
    let (kind, body) = if wants_page {
        ("text/html; charset=utf-8", crate::html::away(message))
    } else {
        ("text/plain; charset=utf-8", format!("503 Service Unavailable: {message}\n"))
    };
    let headers = response.headers_mut();
    let is_of = |kind: &str| headers.get(CONTENT_TYPE).is_some_and(|v| v.as_bytes().starts_with(kind.as_bytes()));
    let has_words = is_of("text/html") || is_of("application/json");
    headers.insert(RETRY_AFTER, HeaderValue::from_static(COME_AGAIN));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if has_words {
        // It says so itself, in the reader's language, or to a program.
        return response;
    }
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.remove(axum::http::header::CONTENT_LENGTH);
    *response.body_mut() = Body::from(body);
    response
}

/// The object that an address is about.
fn slug_of(path: &str) -> Option<String> {
    let mut parts = path.trim_start_matches('/').split('/');
    let slug = match (parts.next()?, parts.next()) {
        ("packs", Some(name)) => name.split('.').next()?,
        (slug, _) => slug,
    };
    (!slug.is_empty()).then(|| slug.to_owned())
}

//! How much of a question is read: longer ones are refused with a page that says what to do.
//!
//! A page repeats its question in each of its links, so that the length of an answer grows with the square of that of its address. Both the query as it came
//! and the query as the page would write it are limited, and so are the values of one filter.

use super::catalogue::address;
use super::frame::{Reader, Top};
use super::language::Language;
use super::routes::{branding, for_reader};
use crate::content::text;
use crate::index::{Facet, Query};
use crate::site::Site;
use askama::Template;
use axum::extract::{Request, State};
use axum::http::header::ACCEPT_LANGUAGE;
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use kilwa_archive::html::render;
use kilwa_messages::Value;

/// Bytes of a query.
pub(crate) const QUERY_MAX: usize = 2048;
/// Values of one filter.
pub(crate) const VALUES_MAX: usize = 10;

/// Why a question is not answered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum TooMuch {
    /// Its address would be longer than [`QUERY_MAX`].
    Long,
    /// Too many values of a filter; the question with the first [`VALUES_MAX`].
    Values(Facet, Box<Query>),
}

/// Refuse addresses whose query is too long, before anything is made of them.
pub(crate) async fn short_query(State(site): State<Site>, request: Request, next: Next) -> Response {
    let query = request.uri().query().unwrap_or_default();
    if query.len() <= QUERY_MAX {
        return next.run(request).await;
    }
    let lang = form_urlencoded::parse(query.as_bytes()).take(20).find(|(name, _)| name == "lang");
    let lang = lang.and_then(|(_, value)| Language::named(&value));
    let accepted = text(request.headers(), &ACCEPT_LANGUAGE).unwrap_or_default();
    let language = lang.unwrap_or_else(|| Language::choose(None, accepted));
    let branding = branding(&site).await;
    let reader = Reader { branding: Some(&branding), ..Reader::of(language, lang.map(|l| l.code)) };
    refused("/", &TooMuch::Long, &reader, request.headers())
}

#[derive(Template)]
#[template(path = "refused.html")]
struct Refused {
    top: Top,
    why: String,
    next: Option<&'static str>,
    /// Where to continue, and what is there.
    address: String,
    link: String,
}

/// The page that says why a question at `path` is not answered, and what to do.
pub(crate) fn refused(path: &str, why: &TooMuch, reader: &Reader<'_>, headers: &HeaderMap) -> Response {
    let l = reader.language;
    let top = reader.top(&|code| format!("{path}?lang={code}"));
    let (status, refused) = match why {
        TooMuch::Long => {
            let (why, link) = (l.t("tooLong").to_owned(), l.t("all").to_owned());
            let next = Some(l.t("tooLongNext"));
            (StatusCode::URI_TOO_LONG, Refused { top, why, next, address: reader.to(path), link })
        }
        TooMuch::Values(facet, query) => {
            let why = l.with("tooMany", &[("count", VALUES_MAX.into()), ("filter", Value::from(l.t(facet.name())))]);
            let address = address(path, query, 0, reader.lang);
            let link = l.with("tooManyNext", &[("count", VALUES_MAX)]);
            (StatusCode::BAD_REQUEST, Refused { top, why, next: None, address, link })
        }
    };
    let mut response = for_reader(render(&refused), reader, headers);
    *response.status_mut() = status;
    response
}

//! Every request gets a name, a line in the log and its share in the figures.
//!
//! The line (target `kilwa::access`, level info) has: id, client, method, path, status, bytes, milliseconds, whether the answer was cut.
//! Invariants: no query, cookie, authorization or referrer is ever logged, so no token and nothing that somebody searched for is; control
//! characters of a path arrive percent-encoded and are logged like that; what a client sends as `X-Request-Id` is taken only if it is short
//! and plain.

use crate::connections::counted_as;
use crate::content::text;
use crate::ending::Ending;
use crate::metrics::{Answered, Metrics};
use crate::range::split;
use crate::socket::Peer;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue};
use axum::middleware::Next;
use axum::response::Response;
use std::hash::{BuildHasher as _, RandomState};
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");
const FORWARDED_FOR: HeaderName = HeaderName::from_static("x-forwarded-for");
/// Longest path in the log, in bytes.
const PATH: usize = 300;

/// What observing needs.
#[derive(Debug, Clone)]
pub(crate) struct Observer {
    pub(crate) metrics: Arc<Metrics>,
    /// Whether a trusted proxy in front of the server reports the client's address.
    pub(crate) behind_proxy: bool,
}

pub(crate) async fn observe(State(observer): State<Observer>, request: Request, next: Next) -> Response {
    let began = Instant::now();
    let id = request_id(text(request.headers(), &REQUEST_ID));
    let client = client(&request, observer.behind_proxy);
    let method = request.method().clone();
    let path: String = request.uri().path().chars().take(PATH).collect();
    let route = route(request.uri().path());
    let mut response = next.run(request).await;
    if let Ok(value) = HeaderValue::from_str(&id) {
        response.headers_mut().insert(REQUEST_ID, value);
    }
    let status = response.status().as_u16();
    let ending = Ending::new(move |end: crate::ending::End| {
        let took = began.elapsed();
        observer.metrics.answered(Answered { route, status, bytes: end.bytes, took, complete: end.complete });
        let client = client.map(tracing::field::display);
        tracing::info!(
            target: "kilwa::access",
            id, client, %method, path, status, bytes = end.bytes, ms = took.as_secs_f64() * 1e3, cut = !end.complete
        );
    });
    ending.wrap(response)
}

/// Who asks: the socket's other end, or what the proxy before us says of its own other end (the last of the list; what stands before
/// that the client supplied).
fn client(request: &Request, behind_proxy: bool) -> Option<IpAddr> {
    // Proxies that do not replace the header add a line of their own at the end.
    let forwarded = || {
        let last = request.headers().get_all(&FORWARDED_FOR).iter().next_back()?.to_str().ok()?;
        last.rsplit(',').next()?.trim().parse().ok()
    };
    let socket = request.extensions().get::<Peer>().map(|peer| peer.0);
    if behind_proxy { forwarded().or(socket) } else { socket }
}

/// The same as text for the record, and as it is counted (IPv6: its /64).
pub(crate) fn client_of(request: &Request, behind_proxy: bool) -> (String, String) {
    let text = |a: IpAddr| a.to_canonical().to_string();
    let client = client(request, behind_proxy);
    let or_unknown = |a: Option<String>| a.unwrap_or_else(|| "unknown".to_owned());
    (or_unknown(client.map(text)), or_unknown(client.map(|a| text(counted_as(a)))))
}

/// A client's own, if it is short and plain, else one of ours: start of the server and a number.
fn request_id(given: Option<&str>) -> String {
    static START: OnceLock<u64> = OnceLock::new();
    static LAST: AtomicU64 = AtomicU64::new(0);
    let plain = |s: &&str| {
        (8..=64).contains(&s.len()) && s.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
    };
    given.filter(plain).map_or_else(
        || {
            let start = START.get_or_init(|| RandomState::new().hash_one(std::process::id()));
            format!("{:08x}-{:06x}", start & 0xffff_ffff, LAST.fetch_add(1, Ordering::Relaxed))
        },
        str::to_owned,
    )
}

/// What kind of address it is, for the figures.
fn route(path: &str) -> &'static str {
    let mut parts = path.split('/').skip(1);
    let (first, second) = (parts.next().unwrap_or_default(), parts.next());
    match (first, second) {
        ("", None) => "list",
        ("m", Some(_)) | (_, Some("")) => "page",
        ("packs", Some(_)) => "pack",
        ("viewer", Some(_)) => "viewer",
        ("uploads", _) => "upload",
        (
            "healthz" | "metrics" | "models.json" | "oai" | "oembed" | "feed.xml" | "sitemap.xml" | "robots.txt"
            | "sign-in" | "sign-out",
            None,
        ) => "machine",
        (_, Some(_)) if has_end(split(path).0, ".kilwa") => "pack",
        (_, Some(_)) => "object",
        (_, None) => "other",
    }
}

fn has_end(path: &str, end: &str) -> bool {
    path.len() > end.len() && path.ends_with(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_plain_request_id_is_accepted() {
        assert_eq!(request_id(Some("abcd-EF_01")), "abcd-EF_01");
        let long = "x".repeat(65);
        for bad in [None, Some("short"), Some("has space in it"), Some("line\nbreak----"), Some(long.as_str())] {
            let made = request_id(bad);
            assert!(made.len() >= 15 && bad != Some(made.as_str()), "{bad:?}");
            assert_ne!(made, request_id(bad));
        }
    }

    #[test]
    fn addresses_are_grouped_into_few_kinds() {
        for (path, kind) in [
            ("/", "list"),
            ("/m/fort", "page"),
            ("/fort/", "page"),
            ("/packs/fort.kilwa", "pack"),
            ("/fort/v1/pack.00.kilwa", "pack"),
            ("/fort/v1/pack.00.kilwa/0-9,20-29", "pack"),
            ("/fort/v1/metadata/dc.xml", "object"),
            ("/viewer/boot.js", "viewer"),
            ("/metrics", "machine"),
            ("/nothing", "other"),
        ] {
            assert_eq!(route(path), kind, "{path}");
        }
    }
}

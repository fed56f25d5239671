//! The portal: the catalogue that people search, and what other systems read of it.
//!
//! | URL | what |
//! |---|---|
//! | `/` | catalogue: search, facets, pages; plain HTML, works without JavaScript ([`catalogue`]); above it the institution and what it features ([`featured`]) |
//! | `/site.css`, `/logo.svg` … | colours and logo of the institution ([`site_file`]: the content of `site.toml`) |
//! | `/map` | where the models are ([`map`], over the outline of the [`land`]) |
//! | `/collections/…` | models that belong together ([`mod@collections`]) |
//! | `/oai` | OAI-PMH 2.0, `oai_dc` ([`oai`]) |
//! | `/oembed` | oEmbed 1.0 ([`oembed`]) |
//! | `/feed.xml` | what is new, Atom ([`feeds`]) |
//! | `/sitemap.xml`, `/robots.txt` | for search engines ([`feeds`]) |
//! | `Link` headers of landing pages | signposting ([`signposting`]) |
//!
//! Inputs: the index over the folder ([`crate::index`]) and the objects themselves; both are only read. Invariants: everything that comes from
//! metadata or an address is escaped; absolute addresses are made from `--url` or from a `Host` that is nothing but a host. Failures: where the
//! index gives no answer, 503 with a sentence; the objects themselves are served all the same.

pub(crate) mod catalogue;
pub(crate) mod collections;
pub(crate) mod color;
pub(crate) mod featured;
pub(crate) mod feeds;
pub(crate) mod frame;
pub(crate) mod institution;
pub(crate) mod land;
pub(crate) mod language;
pub(crate) mod limit;
pub(crate) mod logo;
pub(crate) mod map;
pub(crate) mod oai;
pub(crate) mod oembed;
pub(crate) mod plain;
pub(crate) mod routes;
pub(crate) mod signposting;
pub(crate) mod site_file;
pub(crate) mod watched;

use crate::content::text;
use axum::http::header::HOST;
use axum::http::{HeaderMap, HeaderName};

/// Where the site is, for what needs absolute addresses: without the last slash.
pub(crate) fn base(given: Option<&str>, headers: &HeaderMap, behind_proxy: bool) -> String {
    if let Some(url) = given {
        return url.trim_end_matches('/').to_owned();
    }
    let plain = |host: &&str| {
        (1..=255).contains(&host.len()) && host.bytes().all(|b| b.is_ascii_alphanumeric() || b"-.:[]_".contains(&b))
    };
    let host = text(headers, &HOST).filter(plain).unwrap_or("localhost");
    let forwarded = text(headers, &HeaderName::from_static("x-forwarded-proto"));
    let scheme = if behind_proxy && forwarded == Some("https") { "https" } else { "http" };
    format!("{scheme}://{host}")
}

/// A value for an address's query.
pub(crate) fn encoded(text: &str) -> String {
    form_urlencoded::byte_serialize(text.as_bytes()).collect()
}

/// The pairs of a query, decoded; what is no UTF-8 has replacement characters. Many more than any page has are not looked at.
pub(crate) fn pairs(query: &str) -> Vec<(String, String)> {
    form_urlencoded::parse(query.as_bytes()).into_owned().take(200).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn queries_are_parsed_as_browsers_encode_them() {
        let read = pairs("q=%C3%B1and%C3%BA+x&country=TZ&&odd&bad=%zz%f");
        let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
        assert_eq!(read, [pair("q", "ñandú x"), pair("country", "TZ"), pair("odd", ""), pair("bad", "%zz%f")]);
        for text in ["", "a b", "ñ&=+%", "قلعة"] {
            assert_eq!(pairs(&format!("q={}", encoded(text))), [pair("q", text)]);
        }
        assert_eq!(pairs("q=%ff"), [pair("q", "\u{fffd}")]);
    }

    #[test]
    fn a_host_header_is_used_only_if_valid() {
        let mut headers = HeaderMap::new();
        let mut with = |host: &str| {
            headers.insert(HOST, host.parse().unwrap());
            base(None, &headers, true)
        };
        assert_eq!(with("museum.example:8080"), "http://museum.example:8080");
        assert_eq!(with("x\"><script>"), "http://localhost");
        headers.insert(HOST, "museum.example".parse().unwrap());
        headers.insert("x-forwarded-proto", "https".parse().unwrap());
        assert_eq!(base(None, &headers, true), "https://museum.example");
        assert_eq!(base(None, &headers, false), "http://museum.example");
        assert_eq!(base(Some("https://a.example/"), &headers, false), "https://a.example");
    }
}

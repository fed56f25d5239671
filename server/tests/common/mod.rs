//! A site over a temporary folder, driven without a socket.

#![allow(dead_code, reason = "each test program uses a part of it")]

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, Request, StatusCode};
use kilwa_server::{Catalogue, Page, Site, app};
use std::path::Path;
use std::sync::Arc;
use tower::ServiceExt as _;

/// A page of a few small files.
pub(crate) fn page() -> Page {
    let html = "<!doctype html><html lang=\"en\"><head><base href=\"./\"><title>Kilwa</title></head>\
        <body data-pack=\"\" data-list=\"\"><h1><!--title--></h1><!--facts--></body></html>";
    let files = [
        ("index.html", html.as_bytes()),
        ("boot.js", b"export {};".as_slice()),
        ("boot.js.gz", b"(gzip)".as_slice()),
        ("i18n/sw.json", b"{}".as_slice()),
        ("i18n/sw.json.br", b"(brotli)".as_slice()),
        ("i18n/sw.json.gz", b"(gzip)".as_slice()),
        ("viewer_bg.wasm", b"\0asm".as_slice()),
    ];
    Page::from_files(files.into_iter().map(|(n, b)| (n.to_owned(), b.to_vec())).collect())
}

/// The site over a folder or a file.
pub(crate) fn site(path: &Path) -> Router {
    app(Site { catalogue: Arc::new(Catalogue::open(path).expect("a readable folder")), page: page() })
}

/// A reproducible file of no particular content.
pub(crate) fn noise(length: usize, seed: u64) -> Vec<u8> {
    let mut x = seed | 1;
    let mut next = || {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 32) as u8
    };
    (0..length).map(|_| next()).collect()
}

/// One answer, read to its end.
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or("")
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

/// Ask.
pub(crate) async fn ask(app: &Router, method: &str, uri: &str, headers: &[(&str, &str)]) -> Answer {
    let mut request = Request::builder().method(method).uri(uri);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    let response = app.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    let (parts, body) = response.into_parts();
    let body = axum::body::to_bytes(body, usize::MAX).await.unwrap();
    Answer { status: parts.status, headers: parts.headers, body }
}

/// GET without further headers.
pub(crate) async fn get(app: &Router, uri: &str) -> Answer {
    ask(app, "GET", uri, &[]).await
}

//! The requests of the form, and what each must have to be answered.

use super::page::{self, Texts};
use super::{Editor, FileError, Saved};
use crate::content::text;
use crate::packs::blocking;
use crate::{Limits, Metrics, listen};
use axum::extract::{DefaultBodyLimit, RawQuery, Request, State};
use axum::http::header::{
    ACCEPT_LANGUAGE, CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HOST, ORIGIN, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{Html, IntoResponse as _, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use kilwa_archive::metadata::document::{Document, Fault, Unwritable, Values};
use serde::Deserialize;
use serde_json::json;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;

/// Largest request: a metadata file of the largest size, as JSON.
const BODY_MAX: usize = 4 << 20;
/// Stricter than that of other pages: no wasm, no workers, no frames.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const HEADERS: [(HeaderName, &str); 6] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    // The secret is in the address.
    (REFERRER_POLICY, "same-origin"),
    (CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
];
/// Files of the page: name, type, content.
const FILES: [(&str, &str, &str); 4] = [
    ("style.css", "text/css", include_str!("../../../www/style.css")),
    ("metadata.css", "text/css", include_str!("../../assets/metadata.css")),
    ("metadata.js", "text/javascript", include_str!("../../assets/metadata.js")),
    ("kilwa.svg", "image/svg+xml", include_str!("../../../www/icons/kilwa.svg")),
];

/// Serve the form on `listener` until its user is done or `stop` resolves.
///
/// # Errors
/// If the listener's address is unknown or it is broken.
pub async fn serve_form(
    listener: TcpListener,
    editor: Arc<Editor>,
    stop: impl Future<Output = ()>,
) -> std::io::Result<()> {
    let app = form(Arc::clone(&editor), listener.local_addr()?);
    let mut done = editor.done.subscribe();
    let end = async move {
        let done = std::pin::pin!(async move { drop(done.wait_for(|is_done| *is_done).await) });
        futures_util::future::select(done, std::pin::pin!(stop)).await;
    };
    let limits = Limits { connections: 64, shutdown: Duration::from_secs(2), ..Limits::default() };
    listen(listener, app, Arc::new(Metrics::default()), limits, end).await
}

/// The form at `/SECRET/` of a server that listens on `address`.
pub fn form(editor: Arc<Editor>, address: SocketAddr) -> Router {
    let mut app = Router::new()
        .route("/{secret}/", get(show))
        .route("/{secret}/check", post(check))
        .route("/{secret}/save", post(save))
        .route("/{secret}/done", post(done));
    for (name, kind, content) in FILES {
        let kind = format!("{kind}; charset=utf-8");
        let answer = move || async move { ([(CONTENT_TYPE, kind)], content) };
        app = app.route(&format!("/{{secret}}/{name}"), get(answer));
    }
    let guard = Guard { editor: Arc::clone(&editor), hosts: hosts(address) };
    app.layer(DefaultBodyLimit::max(BODY_MAX)).layer(from_fn_with_state(guard, admit)).with_state(editor)
}

/// The names under which a browser on this computer can ask for the address.
fn hosts(address: SocketAddr) -> Arc<[String]> {
    [address.to_string(), format!("localhost:{}", address.port())].into()
}

#[derive(Clone)]
struct Guard {
    editor: Arc<Editor>,
    hosts: Arc<[String]>,
}

/// Answer only requests that know the secret, were meant for this server, and, if they can change anything, come from its page.
async fn admit(State(guard): State<Guard>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let host = text(headers, &HOST).unwrap_or_default();
    // Another name that leads to this computer is how a page of another site would reach the server (DNS rebinding).
    let is_here = guard.hosts.iter().any(|known| known == host);
    let is_read = matches!(*request.method(), Method::GET | Method::HEAD);
    let is_own = text(headers, &ORIGIN).is_some_and(|origin| origin.strip_prefix("http://") == Some(host));
    let given = request.uri().path().split('/').nth(1).unwrap_or_default();
    // Compared as hashes, so that the time says nothing about how much of it is right.
    let knows = blake3::hash(given.as_bytes()) == blake3::hash(guard.editor.secret().as_bytes());
    let mut response = if !is_here || !(is_read || is_own) {
        (StatusCode::FORBIDDEN, "403 Forbidden\n").into_response()
    } else if knows {
        next.run(request).await
    } else {
        (StatusCode::NOT_FOUND, "404 Not Found: use the whole address that kilwa printed\n").into_response()
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// What the page sends.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Given {
    /// Of the file that the page was made from.
    hash: String,
    lang: String,
    values: Values,
    #[serde(default)]
    copy: bool,
}

async fn show(State(editor): State<Arc<Editor>>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let query = query.unwrap_or_default();
    let lang = form_urlencoded::parse(query.as_bytes()).find(|(name, _)| name == "lang").map(|(_, code)| code);
    let texts = Texts::choose(lang.as_deref(), text(&headers, &ACCEPT_LANGUAGE).unwrap_or_default());
    match blocking(move || editor.show().map(|shown| page::page(&shown, texts))).await {
        Ok(Ok(html)) => Html(html).into_response(),
        Ok(Err(why)) => unreadable(&why),
        Err(status) => status.into_response(),
    }
}

/// The file was damaged while the program ran.
fn unreadable(why: &FileError) -> Response {
    (StatusCode::CONFLICT, format!("{why}\nCorrect the file with a text editor, then load this page again.\n"))
        .into_response()
}

async fn check(State(editor): State<Arc<Editor>>, Json(given): Json<Given>) -> Response {
    let texts = Texts::choose(Some(&given.lang), "");
    match blocking(move || checked(&editor, &given, texts)).await {
        Ok(response) => response,
        Err(status) => status.into_response(),
    }
}

fn checked(editor: &Editor, given: &Given, texts: Texts) -> Response {
    match editor.preview(&given.hash, &given.values) {
        Some(Ok(document)) => Json(state(&document, &document.faults(), texts)).into_response(),
        Some(Err(why)) => unwritable(editor, &why),
        None => (StatusCode::CONFLICT, Json(json!({ "kind": "unknown" }))).into_response(),
    }
}

fn state(document: &Document, faults: &[Fault], texts: Texts) -> serde_json::Value {
    let faults: Vec<_> = faults.iter().map(|fault| texts.fault(fault)).collect();
    json!({ "text": document.text(), "faults": faults })
}

fn unwritable(editor: &Editor, why: &Unwritable) -> Response {
    let field = if why.0.is_empty() { editor.name() } else { why.0.clone() };
    (StatusCode::UNPROCESSABLE_ENTITY, Json(json!({ "kind": "unwritable", "field": field }))).into_response()
}

async fn save(State(editor): State<Arc<Editor>>, Json(given): Json<Given>) -> Response {
    let texts = Texts::choose(Some(&given.lang), "");
    let own = Arc::clone(&editor);
    let saving = move || own.save(&given.hash, &given.values, given.copy);
    let saved = match blocking(saving).await {
        Ok(saved) => saved,
        Err(status) => return status.into_response(),
    };
    match saved {
        Saved::Written { seen, faults, is_copy } => {
            let mut answer = state(&seen.document, &faults, texts);
            answer["hash"] = seen.hash.into();
            answer["file"] = seen.name.into();
            answer["isCopy"] = is_copy.into();
            Json(answer).into_response()
        }
        Saved::Wrong(faults) => {
            let faults: Vec<_> = faults.iter().map(|fault| texts.fault(fault)).collect();
            (StatusCode::UNPROCESSABLE_ENTITY, Json(json!({ "kind": "wrong", "faults": faults }))).into_response()
        }
        Saved::Changed(copy) => {
            (StatusCode::CONFLICT, Json(json!({ "kind": "changed", "copy": copy }))).into_response()
        }
        Saved::Unwritable(why) => unwritable(&editor, &why),
        Saved::Failed(why) => {
            (StatusCode::INTERNAL_SERVER_ERROR, Json(json!({ "kind": "failed", "why": why }))).into_response()
        }
    }
}

async fn done(State(editor): State<Arc<Editor>>) -> Response {
    let written: Vec<String> = editor.written().iter().map(|path| path.display().to_string()).collect();
    editor.finish();
    Json(json!({ "written": written })).into_response()
}

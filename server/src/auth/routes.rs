//! Signing in and out, and opening an object.
//!
//! Requests that change something come from this site's own pages only: browsers say where a request comes from (`Origin`,
//! `Sec-Fetch-Site`), and what comes from elsewhere is refused, so that no other page can sign a reader in or out. Passwords are hashed on
//! threads of their own, a few at a time: who guesses keeps nobody else from reading.

use super::page::{Message, form};
use super::{Auth, PACK_COOKIE, SESSION_COOKIE};
use crate::access::audit::Action;
use crate::access::capability::{LIFE, SESSION};
use crate::access::{Verdict, verdict};
use crate::content::{plain, text};
use crate::objects;
use crate::observe::client_of;
use crate::packs::blocking;
use crate::portal::routes::Given;
use crate::portal::{base, encoded, pairs};
use crate::site::{Site, page};
use axum::body::Body;
use axum::extract::{Path, RawQuery, Request, State};
use axum::http::header::{CACHE_CONTROL, HOST, LOCATION, ORIGIN, RETRY_AFTER, SET_COOKIE, VARY};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse as _, Response};
use serde_json::json;
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use tokio::sync::Semaphore;

/// A form must be there within this, and no longer than this.
const FORM: Duration = Duration::from_secs(10);
const FORM_BYTES: usize = 16 * 1024;
/// Longest address to continue to: a link holds a view and measurements.
const NEXT_MAX: usize = 4000;
/// Longest name that is looked at, characters: longer than those of accounts.
const NAME_MAX: usize = 80;
/// Passwords hashed at once; each takes 19 MiB and some 20 ms. The permit goes with the work: who hangs up does not free it.
static HASHING: LazyLock<Arc<Semaphore>> = LazyLock::new(|| Arc::new(Semaphore::new(2)));

/// `GET /sign-in?next=/slug/`
pub(crate) async fn ask(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    if site.auth.is_none() {
        return plain(StatusCode::NOT_FOUND).into_response();
    }
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let reader = given.reader();
    let next = inside(given.get("next").unwrap_or("/"));
    match reader.visit.and_then(|visit| visit.who.as_deref()) {
        Some(who) => answer(form(&reader, Message::Done, next, Some(who)), StatusCode::OK, &headers),
        None => answer(form(&reader, Message::Nothing, next, None), StatusCode::OK, &headers),
    }
}

/// `POST /sign-in`
pub(crate) async fn sign_in(State(site): State<Site>, request: Request) -> Response {
    let Some(auth) = site.auth.clone() else { return plain(StatusCode::NOT_FOUND).into_response() };
    let headers = request.headers().clone();
    if !from_here(&site, &headers) {
        return plain(StatusCode::FORBIDDEN).into_response();
    }
    let client = client_of(&request, site.behind_proxy);
    let read = tokio::time::timeout(FORM, axum::body::to_bytes(request.into_body(), FORM_BYTES)).await;
    let Ok(Ok(body)) = read else { return plain(StatusCode::REQUEST_TIMEOUT).into_response() };
    let given = Given::of(&site, &String::from_utf8_lossy(&body), &headers).await;
    let value = |wanted: &str| given.get(wanted).unwrap_or_default().to_owned();
    // Longer than any name is none, and goes into no page.
    let name: String = value("name").trim().chars().take(NAME_MAX).collect::<String>().to_lowercase();
    let (password, next) = (value("password"), value("next"));
    let next = inside(&next).to_owned();
    let reader = given.reader();
    let now = site.clock.seconds();
    let session = match check(&auth, &name, password, client, now).await {
        Ok(session) => session,
        Err(Denied::Wrong) => {
            return answer(form(&reader, Message::Wrong, &next, Some(&name)), StatusCode::FORBIDDEN, &headers);
        }
        Err(Denied::Failed) => {
            let page = form(&reader, Message::Failed, &next, Some(&name));
            return answer(page, StatusCode::SERVICE_UNAVAILABLE, &headers);
        }
        Err(Denied::Wait(wait)) => {
            let page = form(&reader, Message::Wait(wait), &next, Some(&name));
            let mut response = answer(page, StatusCode::TOO_MANY_REQUESTS, &headers);
            insert(&mut response, RETRY_AFTER, &wait.to_string());
            return response;
        }
    };
    let mut response = StatusCode::SEE_OTHER.into_response();
    insert(&mut response, LOCATION, &next);
    let secure = secure(&site, &headers);
    insert(
        &mut response,
        SET_COOKIE,
        &format!("{SESSION_COOKIE}={session}; Path=/; HttpOnly; SameSite=Lax; Max-Age={SESSION}{secure}"),
    );
    insert(&mut response, CACHE_CONTROL, "no-store");
    response
}

/// Why somebody is not signed in.
enum Denied {
    /// Name or password is wrong.
    Wrong,
    /// Too many attempts: seconds to wait.
    Wait(u64),
    /// The server could not do it.
    Failed,
}

/// A session for whoever has the password. What is begun is counted and recorded to its end, also when the other side is gone.
async fn check(
    auth: &Arc<Auth>,
    name: &str,
    password: String,
    (address, network): (String, String),
    now: u64,
) -> Result<String, Denied> {
    // By network and by name: neither many names from one nor one name from many gets far.
    let counted: String = name.chars().take(64).collect();
    auth.begin(&counted, &network, now).map_err(Denied::Wait)?;
    let turn = Arc::clone(&HASHING).acquire_owned().await.map_err(|_| Denied::Failed)?;
    let (auth, name) = (Arc::clone(auth), name.to_owned());
    let checked = blocking(move || {
        let _turn = turn;
        let accounts = auth.accounts();
        let user = accounts.as_ref().and_then(|a| Some((a, a.sign_in(&name, &password)?)));
        let Some((accounts, user)) = user else {
            auth.record(Action::SignInFailed, None, &address, None, now);
            return Err(Denied::Wrong);
        };
        auth.succeeded(&counted, &network);
        let session = auth.begin_session(accounts, user, now).map_err(|e| {
            tracing::error!("nobody can sign in: a session cannot be stored: {e}");
            Denied::Failed
        })?;
        auth.record(Action::SignIn, Some(&user.name), &address, None, now);
        Ok(session)
    });
    checked.await.map_err(|_| Denied::Failed)?
}

/// `POST /sign-out`; with `everywhere` in the form, all sessions of the user end. It leads to `next` in the form, an address of this site.
pub(crate) async fn sign_out(State(site): State<Site>, request: Request) -> Response {
    let headers = request.headers().clone();
    if !from_here(&site, &headers) {
        return plain(StatusCode::FORBIDDEN).into_response();
    }
    let (address, _) = client_of(&request, site.behind_proxy);
    let read = tokio::time::timeout(FORM, axum::body::to_bytes(request.into_body(), FORM_BYTES)).await;
    let Ok(Ok(body)) = read else { return plain(StatusCode::REQUEST_TIMEOUT).into_response() };
    let pairs = pairs(&String::from_utf8_lossy(&body));
    let value = |wanted: &str| pairs.iter().find(|(name, _)| name == wanted).map(|(_, value)| value.as_str());
    let (everywhere, next) = (value("everywhere").is_some(), inside(value("next").unwrap_or("/")).to_owned());
    if let Some(auth) = site.auth.clone() {
        let (now, asked) = (site.clock.seconds(), headers.clone());
        let ended = blocking(move || {
            let who = auth.sign_out(&asked, everywhere)?;
            if let Some(who) = who {
                auth.record(Action::SignOut, Some(&who), &address, None, now);
            }
            Ok::<_, std::io::Error>(())
        });
        if let Err(e) = ended.await.unwrap_or_else(|status| Err(std::io::Error::other(status.to_string()))) {
            tracing::error!("a session could not be ended: {e}");
            let message = "You are still signed in: the server could not end the session. Please try again.\n";
            return (StatusCode::SERVICE_UNAVAILABLE, [(CACHE_CONTROL, "no-store"), (RETRY_AFTER, "5")], message)
                .into_response();
        }
    }
    let mut response = StatusCode::SEE_OTHER.into_response();
    insert(&mut response, LOCATION, &next);
    let secure = secure(&site, &headers);
    insert(&mut response, SET_COOKIE, &format!("{SESSION_COOKIE}=; Path=/; HttpOnly; SameSite=Lax; Max-Age=0{secure}"));
    insert(&mut response, CACHE_CONTROL, "no-store");
    response
}

/// `POST /<slug>/open`: a capability for the pack, for whoever may see it; else why not, and where to sign in.
pub(crate) async fn open(
    State(site): State<Site>,
    Path((slug, file)): Path<(String, String)>,
    request: Request,
) -> Response {
    if file != "open" {
        return plain(StatusCode::METHOD_NOT_ALLOWED).into_response();
    }
    let headers = request.headers().clone();
    if !from_here(&site, &headers) {
        return plain(StatusCode::FORBIDDEN).into_response();
    }
    let (address, _) = client_of(&request, site.behind_proxy);
    let manifest = match objects::manifest(&site, &slug).await {
        Ok(manifest) => manifest,
        Err(status) => return plain(status).into_response(),
    };
    let why = match verdict(&manifest.access, &site.clock) {
        Verdict::Open => return StatusCode::NO_CONTENT.into_response(),
        Verdict::Gone(why) => return refused(StatusCode::GONE, &why, None),
        Verdict::WithoutGeometry(why) => why,
    };
    let (true, Some(version)) = (site.auth.is_some(), manifest.current()) else {
        return refused(StatusCode::FORBIDDEN, &why, None);
    };
    match capability(&site, &headers, &slug, &version.pack.sha256, address).await {
        Some(Some(cookie)) => {
            let mut response = StatusCode::NO_CONTENT.into_response();
            insert(&mut response, SET_COOKIE, &cookie);
            insert(&mut response, CACHE_CONTROL, "no-store");
            response
        }
        Some(None) => refused(StatusCode::FORBIDDEN, &why, None),
        None => {
            refused(StatusCode::UNAUTHORIZED, &why, Some(&format!("/sign-in?next={}", encoded(&format!("/{slug}/")))))
        }
    }
}

/// The cookie with a capability for the pack of an object, for a visitor who is signed in and may see it; `Some(None)` for one who may not, `None` for
/// who is not signed in. Recorded.
pub(crate) async fn capability(
    site: &Site,
    headers: &HeaderMap,
    slug: &str,
    content: &str,
    address: String,
) -> Option<Option<String>> {
    let auth = site.auth.clone()?;
    let now = site.clock.seconds();
    let (asked, object, content) = (headers.clone(), slug.to_owned(), content.to_owned());
    let found = blocking(move || {
        let visitor = auth.visitor(&asked, now)?;
        let sees = auth.sees(&visitor.who, &object);
        let capability = if sees { auth.capability(&content, &visitor, now) } else { None };
        let action = if capability.is_some() { Action::Opened } else { Action::Refused };
        auth.record(action, Some(&visitor.who), &address, Some(&object), now);
        Some(capability)
    });
    let capability = found.await.ok().flatten()?;
    let secure = secure(site, headers);
    Some(capability.map(|capability| {
        format!("{PACK_COOKIE}={capability}; Path=/{slug}/; HttpOnly; SameSite=Strict; Max-Age={LIFE}{secure}")
    }))
}

/// Why an object is not opened, for the page.
fn refused(status: StatusCode, why: &str, sign_in: Option<&str>) -> Response {
    let mut response = (status, axum::Json(json!({ "reason": why, "signIn": sign_in }))).into_response();
    insert(&mut response, CACHE_CONTROL, "no-store");
    response
}

fn answer(html: String, status: StatusCode, headers: &HeaderMap) -> Response {
    let mut response = page(html, headers);
    *response.status_mut() = status;
    insert(&mut response, CACHE_CONTROL, "no-store");
    insert(&mut response, VARY, "Accept-Encoding, Accept-Language, Cookie");
    response
}

fn insert(response: &mut Response<Body>, name: HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::from_str(value) {
        response.headers_mut().insert(name, value);
    }
}

/// Where to go next: an address of this site, never of another.
fn inside(next: &str) -> &str {
    let is_plain = next.starts_with('/') && !next.starts_with("//") && next.len() <= NEXT_MAX;
    if is_plain && next.bytes().all(|b| b.is_ascii_graphic() && b != b'\\') { next } else { "/" }
}

/// Whether the request comes from a page of this site, or from no page. Browsers that send `Sec-Fetch-Site` have compared scheme, host and port
/// themselves; of others the `Origin` is compared, with `--url` or with what the request itself was sent to.
pub(crate) fn from_here(site: &Site, headers: &HeaderMap) -> bool {
    let origin = text(headers, &ORIGIN);
    if headers.get_all(ORIGIN).iter().count() > usize::from(origin.is_some()) {
        return false;
    }
    match text(headers, &HeaderName::from_static("sec-fetch-site")) {
        Some("same-origin") => origin.is_none_or(|origin| origin != "null"),
        Some("none") | None => origin.is_none_or(|origin| {
            let is_this = |base: String| origin.eq_ignore_ascii_case(&origin_of(&base));
            let asked = headers.contains_key(HOST).then(|| base(None, headers, site.behind_proxy));
            asked.is_some_and(is_this) || site.url.clone().is_some_and(is_this)
        }),
        Some(_) => false,
    }
}

/// Scheme, host and port of an address, without the port that the scheme implies, as browsers write it.
fn origin_of(address: &str) -> String {
    let (scheme, rest) = address.split_once("://").unwrap_or_default();
    let host = rest.split('/').next().unwrap_or_default();
    let implied = if scheme.eq_ignore_ascii_case("https") { ":443" } else { ":80" };
    format!("{scheme}://{}", host.strip_suffix(implied).unwrap_or(host))
}

/// Cookies of a site behind TLS never go out without it.
fn secure(site: &Site, headers: &HeaderMap) -> &'static str {
    let forwarded = text(headers, &HeaderName::from_static("x-forwarded-proto"));
    let is_secure = site.url.as_deref().is_some_and(|u| u.starts_with("https://"))
        || (site.behind_proxy && forwarded == Some("https"));
    if is_secure { "; Secure" } else { "" }
}

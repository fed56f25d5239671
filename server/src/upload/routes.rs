//! The requests of an upload. Errors are JSON, `{"error": "…"}`, with what to do.

use super::finish::{Ending, Job, check_version, publish};
use super::staging::{Part, Staging, none};
use super::wire::{Intent, State as At, Status};
use super::{Refusal, Uploads, lock};
use crate::access::audit::Action;
use crate::auth::{Auth, Publisher};
use crate::catalogue::Catalogue;
use crate::content::{insert, text};
use crate::index::Index;
use crate::observe::client_of;
use crate::packs::blocking;
use crate::site::Site;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Path, Request, State};
use axum::http::header::{CACHE_CONTROL, CONNECTION, CONTENT_TYPE, LOCATION, RETRY_AFTER, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, head, post};
use http_body::Body as _;
use kilwa_archive::assemble::is_published;
use kilwa_archive::layout::Slug;
use serde_json::json;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

const RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
const OFFSET: HeaderName = HeaderName::from_static("upload-offset");
const LENGTH: HeaderName = HeaderName::from_static("upload-length");
/// The version of tus that is spoken.
const TUS: &str = "1.0.0";
/// Largest intent, bytes, and the time to send it. A version with 10,000 photographs, their masks and smaller copies has about 6 MB.
const INTENT_MAX: usize = 16 << 20;
const INTENT_TIME: Duration = Duration::from_secs(30);
/// A body that sends nothing for this long is given up.
const STALL: Duration = Duration::from_secs(30);
/// After so long, one slower than this many bytes a second too.
const GRACE: Duration = Duration::from_secs(60);
const FLOOR: u64 = 256;
/// Bytes that are held before they are written.
const HELD: usize = 1 << 20;

/// The routes, below `/uploads`.
pub(crate) fn routes() -> Router<Site> {
    Router::new()
        .route("/uploads", post(begin).options(options))
        .route("/uploads/{slug}", get(status).post(finish).delete(give_up))
        .route("/uploads/{slug}/{sha256}", head(offset).patch(append).options(options))
}

/// Who asks, and the folder that takes uploads.
struct Allowed {
    uploads: Arc<Uploads>,
    auth: Arc<Auth>,
    who: String,
    address: String,
    now: u64,
}

/// Whether a request may publish `slug`, or anything at all.
async fn allowed(
    site: &Site,
    client: (String, String),
    headers: &HeaderMap,
    slug: Option<&str>,
) -> Result<Allowed, Refusal> {
    let (Some(uploads), Some(auth)) = (site.uploads.clone(), site.auth.clone()) else {
        let message = "this server accepts no uploads; its administrator can start it with `kilwa serve --accept-uploads --access FILE`";
        return Err(Refusal::new(StatusCode::NOT_IMPLEMENTED, message));
    };
    // Paths are made of it: `..%2Fx` in an address is `../x` here.
    if slug.is_some_and(|s| Slug::new(s).is_err()) {
        return Err(none());
    }
    let now = site.clock.seconds();
    let (asked, headers, object, network) = (Arc::clone(&auth), headers.clone(), slug.map(str::to_owned), client.1);
    let publisher = blocking(move || asked.publisher(&headers, object.as_deref(), &network, now)).await;
    let publisher = publisher.map_err(|status| Refusal::new(status, "the server cannot identify the user"))?;
    let who = match publisher {
        Publisher::Is(who) => who,
        Publisher::Unknown => {
            let message =
                "publishing needs a valid token that has not expired: `kilwa access token FILE NAME --for publish`";
            return Err(Refusal::new(StatusCode::UNAUTHORIZED, message));
        }
        Publisher::NotFor => {
            let message = "this token is only for viewing; publishing needs a token of its own: `kilwa access token FILE NAME --for publish`";
            return Err(Refusal::new(StatusCode::FORBIDDEN, message));
        }
        Publisher::NotGranted(who) => {
            let slug = slug.unwrap_or_default();
            auth.record(Action::Refused, Some(&who), &client.0, Some(slug), now);
            let message = format!(
                "{who} was not granted {slug}: `kilwa access user FILE {who} --object {slug} --no-password`, or --all"
            );
            return Err(Refusal::new(StatusCode::FORBIDDEN, message));
        }
        Publisher::Wait(seconds) => {
            let message = "too many unknown tokens were sent from this address";
            let refusal = Refusal::new(StatusCode::TOO_MANY_REQUESTS, message);
            return Err(Refusal { retry_after: Some(seconds), ..refusal });
        }
    };
    Ok(Allowed { uploads, auth, who, address: client.0, now })
}

/// `POST /uploads`
async fn begin(State(site): State<Site>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let headers = request.headers().clone();
    // Nobody's body is read before it is known that somebody sends it.
    if let Err(refusal) = allowed(&site, client.clone(), &headers, None).await {
        return refuse(&refusal);
    }
    let read = tokio::time::timeout(INTENT_TIME, axum::body::to_bytes(request.into_body(), INTENT_MAX)).await;
    let Ok(Ok(body)) = read else {
        return refuse(&Refusal::new(
            StatusCode::BAD_REQUEST,
            "the announcement of the version did not arrive completely",
        ));
    };
    answer(begun(&site, client, &headers, &body).await)
}

async fn begun(
    site: &Site,
    client: (String, String),
    headers: &HeaderMap,
    body: &Bytes,
) -> Result<(StatusCode, Status), Refusal> {
    let intent: Intent = kilwa_pack::json::from_slice(body).map_err(|e| {
        Refusal::content(format!(
            "this is not the announcement of a version: {e}; use the same version of kilwa on both sides"
        ))
    })?;
    Slug::new(&intent.slug).map_err(|e| Refusal::content(format!("slug: {e}")))?;
    let Allowed { uploads, who, now, .. } = allowed(site, client, headers, Some(&intent.slug)).await?;
    uploads.brake(&who, now)?;
    let work = move || -> Result<(StatusCode, Status), Refusal> {
        let meant = intent.check(&uploads.limits, now)?;
        uploads.sweep(now);
        if let Some(job) = uploads.job(&intent.slug).filter(|j| j.is_running()) {
            return if job.who == who { Ok(job.status()) } else { Err(Refusal::busy()) };
        }
        uploads.tidy(&meant.slug)?;
        let there = uploads.there(&meant.slug)?;
        let (object, before) = (there.shelf.join(meant.slug.as_str()), &there.before);
        if let Some(m) = before
            .as_ref()
            .filter(|m| is_published(&object, m, &meant.pack.sha256, &intent.metadata, intent.optional()))
        {
            // A crash after the last step leaves what was sent behind.
            if let Ok(Some(left)) = uploads.staging(&intent.slug, &who) {
                left.remove();
            }
            return Ok((StatusCode::OK, Status { already: true, ..Status::new(At::Published, m.current) }));
        }
        check_version(&intent, before.as_ref())?;
        lock(&uploads.jobs).remove(&intent.slug);
        let staging = uploads.stage(&who, intent, now)?;
        Ok((StatusCode::CREATED, of_staging(&uploads, &staging, now)))
    };
    blocking(work).await.map_err(|status| Refusal::new(status, "the server could not check the upload"))?
}

fn of_staging(uploads: &Uploads, staging: &Staging, now: u64) -> Status {
    let lacks = staging.lacking();
    let state = if lacks.is_empty() { At::Ready } else { At::Sending };
    Status { lacks, until: Some(uploads.until(now)), ..Status::new(state, staging.record.intent.version) }
}

/// `GET /uploads/<slug>`
async fn status(State(site): State<Site>, Path(slug): Path<String>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let headers = request.into_parts().0.headers;
    let found = async {
        let Allowed { uploads, who, now, .. } = allowed(&site, client, &headers, Some(&slug)).await?;
        let last = uploads.job(&slug).filter(|j| j.who == who).map(|j| j.status());
        if let Some(under_way) = last.as_ref().filter(|(_, last)| last.state != At::Refused) {
            return Ok(under_way.clone());
        }
        let look = move || {
            // A client that finds its version published sends no further request, so interrupted work is finished now.
            uploads.tidy(&Slug::new(&slug).map_err(|_| none())?)?;
            if let Some(refused) = last {
                return Ok(refused);
            }
            Ok((StatusCode::OK, of_staging(&uploads, &uploads.staging(&slug, &who)?.ok_or_else(none)?, now)))
        };
        blocking(look).await.map_err(|status| Refusal::new(status, "the server could not check the upload"))?
    };
    answer(found.await)
}

/// `POST /uploads/<slug>`
async fn finish(State(site): State<Site>, Path(slug): Path<String>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let headers = request.into_parts().0.headers;
    let begun = async {
        let allowed = allowed(&site, client, &headers, Some(&slug)).await?;
        allowed.uploads.brake(&allowed.who, allowed.now)?;
        start(&site, allowed, slug).await
    };
    answer(begun.await)
}

/// Verify and publish what lies there, on a thread of its own.
async fn start(site: &Site, allowed: Allowed, slug: String) -> Result<(StatusCode, Status), Refusal> {
    let Allowed { uploads, auth, who, address, now } = allowed;
    if let Some(job) = uploads.job(&slug).filter(|j| j.who == who && j.is_running()) {
        return Ok(job.status());
    }
    let (looked, name, object) = (Arc::clone(&uploads), who.clone(), slug.clone());
    let staging = blocking(move || looked.staging(&object, &name)).await;
    let staging =
        staging.map_err(|status| Refusal::new(status, "the server could not check the upload"))??.ok_or_else(none)?;
    let job = Arc::new(Job::new(&who, &staging.record.intent, uploads.store.is_some()));
    lock(&uploads.jobs).insert(slug.clone(), Arc::clone(&job));
    let (status, body) = job.status();
    let (catalogue, index) = (Arc::clone(&site.catalogue), site.index.clone());
    let (own, turn) = (uploads.queue(&who), Arc::clone(&uploads.turn));
    let ending = Ending(Arc::clone(&job));
    tokio::spawn(async move {
        let turn = (own.acquire_owned().await, turn.acquire_owned().await);
        let work = move || {
            let ended = publish(&uploads, staging, &job, now);
            match &ended {
                Ok(done) => {
                    show(&catalogue, index.as_deref());
                    if !done.already {
                        auth.published(&who, &address, &slug, done.version, now);
                    }
                }
                Err(refusal) => tracing::warn!("{slug} was not published: {}", refusal.why),
            }
            *lock(&job.ended) = Some(ended);
            drop(ending);
        };
        // A thread of its own: those that read files for readers are not for this. It is waited for by whoever asks for the status.
        if let Err(e) = std::thread::Builder::new().name("publish".to_owned()).spawn(move || (work(), drop(turn)).0) {
            tracing::error!("no thread for verifying an upload: {e}");
        }
    });
    let status = if status == StatusCode::OK { StatusCode::ACCEPTED } else { status };
    Ok((status, body))
}

/// Look at what there is at once: a store is else looked at seldom.
fn show(catalogue: &Catalogue, index: Option<&Index>) {
    if let Some(store) = catalogue.place().store() {
        store.forget_list();
    }
    if let Err(e) = catalogue.list() {
        tracing::warn!("{} cannot be listed: {e}", catalogue.place());
    }
    // Of a folder whoever searches looks at most a second later.
    if let Some(index) = index.filter(|_| catalogue.place().store().is_some())
        && let Err(e) = index.refresh()
    {
        tracing::warn!("{e}");
    }
}

/// `DELETE /uploads/<slug>`
async fn give_up(State(site): State<Site>, Path(slug): Path<String>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let headers = request.into_parts().0.headers;
    let given = async {
        let Allowed { uploads, who, .. } = allowed(&site, client, &headers, Some(&slug)).await?;
        let remove = move || {
            let staging = uploads.staging(&slug, &who)?;
            if uploads.job(&slug).is_some_and(|j| j.who == who && !j.is_running()) {
                lock(&uploads.jobs).remove(&slug);
            }
            staging.ok_or_else(none).map(Staging::remove)
        };
        blocking(remove).await.map_err(|status| Refusal::new(status, "the server could not check the upload"))?
    };
    match given.await {
        Ok(()) => tus(StatusCode::NO_CONTENT.into_response()),
        Err(refusal) => refuse(&refusal),
    }
}

/// `HEAD /uploads/<slug>/<sha256>`
async fn offset(State(site): State<Site>, Path((slug, sha256)): Path<(String, String)>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let headers = request.into_parts().0.headers;
    let found = async {
        let Allowed { uploads, who, .. } = allowed(&site, client, &headers, Some(&slug)).await?;
        let look = move || uploads.staging(&slug, &who)?.ok_or_else(none)?.offset(&sha256);
        blocking(look).await.map_err(|status| Refusal::new(status, "the server could not check the upload"))?
    };
    match found.await {
        Ok((there, length)) => {
            let mut response = tus(StatusCode::OK.into_response());
            insert(&mut response, OFFSET, &there.to_string());
            insert(&mut response, LENGTH, &length.to_string());
            response
        }
        Err(refusal) => refuse(&refusal),
    }
}

/// `PATCH /uploads/<slug>/<sha256>`
async fn append(State(site): State<Site>, Path((slug, sha256)): Path<(String, String)>, request: Request) -> Response {
    let client = client_of(&request, site.behind_proxy);
    let (parts, body) = request.into_parts();
    let done = async {
        let Allowed { uploads, who, .. } = allowed(&site, client, &parts.headers, Some(&slug)).await?;
        let from = offset_of(&parts.headers)?;
        let looked = Arc::clone(&uploads);
        let part = blocking(move || looked.part(&slug, &sha256, &who, from)).await;
        let part = part.map_err(|status| Refusal::new(status, "the server could not check the upload"))??;
        receive(&uploads, part, body).await
    };
    match done.await {
        Ok(there) => {
            let mut response = tus(StatusCode::NO_CONTENT.into_response());
            insert(&mut response, OFFSET, &there.to_string());
            response
        }
        Err(refusal) => refuse(&refusal),
    }
}

/// What tus asks of a request with bytes; from where on they are.
fn offset_of(headers: &HeaderMap) -> Result<u64, Refusal> {
    if text(headers, &RESUMABLE) != Some(TUS) {
        return Err(Refusal::new(
            StatusCode::PRECONDITION_FAILED,
            "this server uses tus 1.0.0 (send Tus-Resumable: 1.0.0)",
        ));
    }
    if text(headers, &CONTENT_TYPE) != Some("application/offset+octet-stream") {
        let status = StatusCode::UNSUPPORTED_MEDIA_TYPE;
        return Err(Refusal::new(status, "expected Content-Type: application/offset+octet-stream"));
    }
    let offset = text(headers, &OFFSET).and_then(|o| o.parse().ok());
    offset.ok_or_else(|| Refusal::new(StatusCode::BAD_REQUEST, "Upload-Offset must be a number"))
}

/// Write a body to a part as it comes; what came before it broke off is written too. How far the file is then.
async fn receive(uploads: &Arc<Uploads>, mut part: Part, mut body: Body) -> Result<u64, Refusal> {
    let (began, mut came) = (Instant::now(), 0u64);
    let mut held = Vec::with_capacity(HELD);
    let ended = loop {
        let frame = poll_fn(|cx| Pin::new(&mut body).poll_frame(cx));
        let data = match tokio::time::timeout(STALL, frame).await {
            Err(_) => break Err(Refusal::new(StatusCode::REQUEST_TIMEOUT, "no data arrived for 30 seconds")),
            Ok(None) => break Ok(()),
            Ok(Some(Err(_))) => break Err(Refusal::new(StatusCode::BAD_REQUEST, "the transfer was interrupted")),
            Ok(Some(Ok(frame))) => frame.into_data().unwrap_or_default(),
        };
        came += data.len() as u64;
        if came < began.elapsed().saturating_sub(GRACE).as_secs().saturating_mul(FLOOR) {
            break Err(Refusal::new(StatusCode::REQUEST_TIMEOUT, "the data arrive too slowly"));
        }
        if (held.len() + data.len()) as u64 > part.remaining() {
            break Err(Refusal::new(StatusCode::BAD_REQUEST, "more bytes were sent than announced for the file"));
        }
        held.extend_from_slice(&data);
        if held.len() >= HELD {
            (part, held) = write(uploads, part, held).await?;
        }
    };
    let (part, _) = write(uploads, part, held).await?;
    let closed = blocking(move || part.close()).await;
    let there = closed.map_err(|status| Refusal::new(status, "the server could not write"))??;
    ended.map(|()| there)
}

/// Whoever hangs up meanwhile does not keep it from being written, nor the lock from being held until it is.
async fn write(uploads: &Arc<Uploads>, mut part: Part, mut held: Vec<u8>) -> Result<(Part, Vec<u8>), Refusal> {
    let uploads = Arc::clone(uploads);
    let work = move || {
        part.write(&uploads, &held)?;
        held.clear();
        Ok((part, held))
    };
    blocking(work).await.map_err(|status| Refusal::new(status, "the server could not write"))?
}

/// What is spoken here.
async fn options(State(site): State<Site>) -> Response {
    let mut response = tus(StatusCode::NO_CONTENT.into_response());
    insert(&mut response, HeaderName::from_static("tus-version"), TUS);
    if let Some(uploads) = &site.uploads {
        insert(&mut response, HeaderName::from_static("tus-max-size"), &uploads.limits.version_bytes.to_string());
    }
    response
}

fn answer(result: Result<(StatusCode, Status), Refusal>) -> Response {
    match result {
        Ok((code, status)) => {
            let mut response = tus((code, axum::Json(&status)).into_response());
            if code == StatusCode::CREATED {
                insert(&mut response, LOCATION, "/uploads");
            }
            response
        }
        Err(refusal) => refuse(&refusal),
    }
}

fn refuse(refusal: &Refusal) -> Response {
    let mut response = tus((refusal.status, axum::Json(json!({ "error": refusal.why }))).into_response());
    // Of a body that was not read to its end nothing must be left for another request.
    insert(&mut response, CONNECTION, "close");
    if let Some(seconds) = refusal.retry_after {
        insert(&mut response, RETRY_AFTER, &seconds.to_string());
    }
    if let Some(offset) = refusal.offset {
        insert(&mut response, OFFSET, &offset.to_string());
    }
    if refusal.status == StatusCode::UNAUTHORIZED {
        insert(&mut response, WWW_AUTHENTICATE, "Bearer realm=\"kilwa\"");
    }
    response
}

fn tus(mut response: Response) -> Response {
    insert(&mut response, RESUMABLE, TUS);
    insert(&mut response, CACHE_CONTROL, "no-store");
    response
}

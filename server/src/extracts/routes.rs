//! Answers about extracts. Who may have the pack may have an extract of it: for everybody where it is public, for whoever holds a capability or a
//! token where it is not; a visitor who is signed in and granted it gets the capability here, so that no script is needed, and it is recorded.

use super::job_spec::{Detail, Format, JobSpec};
use super::pace::Wait;
use super::page::{About, Message, Stage, closed, form, stage, why};
use super::{Extracts, Failure, JobStatus, Pack, Refusal};
use crate::access::{Verdict, verdict};
use crate::auth::routes::{capability, from_here};
use crate::catalogue::Model;
use crate::content::{ASK_AGAIN, Source, answer, insert, plain, text};
use crate::objects::{self, Sent};
use crate::observe::client_of;
use crate::packs::blocking;
use crate::portal::encoded;
use crate::portal::frame::Reader;
use crate::portal::language::Language;
use crate::portal::routes::Given;
use crate::site::{Site, find, lost, page};
use crate::store::Content;
use axum::extract::{Path, Request, State};
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_DISPOSITION, LOCATION, RETRY_AFTER, SET_COOKIE, VARY};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::response::{IntoResponse as _, Response};
use kilwa_archive::viewer::content_type;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// A form must be there within this, and no longer than this.
const FORM: Duration = Duration::from_secs(10);
const FORM_BYTES: usize = 16 * 1024;

/// What is asked of, and who asks.
struct Asked {
    extracts: Arc<Extracts>,
    about: About,
    /// Where the pack lies, and its hash.
    pack: (Pack, Arc<str>),
    /// The model that it is of.
    model: Arc<Model>,
    /// Whether only some may have it.
    is_closed: bool,
    /// Leave that was given now, to be kept by the browser.
    cookie: Option<String>,
}

/// `GET /<slug>/extract`
pub(crate) async fn ask(State(site): State<Site>, Path(slug): Path<String>, request: Request) -> Response {
    let (address, _) = client_of(&request, site.behind_proxy);
    let (parts, _) = request.into_parts();
    let headers = &parts.headers;
    let given = Given::of(&site, parts.uri.query().unwrap_or_default(), headers).await;
    match admit(&site, &slug, None, headers, address, &given).await {
        Ok(asked) => {
            let message = if given.get("unknown").is_some() { Message::Unknown } else { Message::Nothing };
            html(&asked, form(&asked.about, &given.reader(), message, None), StatusCode::OK, headers)
        }
        Err(refused) => refused,
    }
}

/// `POST /<slug>/extract`
pub(crate) async fn begin(State(site): State<Site>, Path(slug): Path<String>, request: Request) -> Response {
    if !from_here(&site, request.headers()) {
        return plain(StatusCode::FORBIDDEN).into_response();
    }
    let (address, network) = client_of(&request, site.behind_proxy);
    let (parts, body) = request.into_parts();
    let read = tokio::time::timeout(FORM, axum::body::to_bytes(body, FORM_BYTES)).await;
    let Ok(Ok(words)) = read else { return plain(StatusCode::REQUEST_TIMEOUT).into_response() };
    let headers = &parts.headers;
    let given = Given::of(&site, &String::from_utf8_lossy(&words), headers).await;
    let asked = match admit(&site, &slug, None, headers, address, &given).await {
        Ok(asked) => asked,
        Err(refused) => return refused,
    };
    let reader = given.reader();
    let Some(spec) = spec(&given) else {
        let html_ = form(&asked.about, &reader, Message::Wrong, None);
        return html(&asked, html_, StatusCode::UNPROCESSABLE_ENTITY, headers);
    };
    let triangles = asked.about.triangles;
    let [mesh, read] = asked.extracts.disk_bytes(&asked.pack.0, triangles, spec);
    let (size, max) = (mesh.saturating_add(read), asked.extracts.max_bytes());
    if size > max {
        let page = form(&asked.about, &reader, Message::TooLarge(size, max), Some(spec));
        return html(&asked, page, StatusCode::UNPROCESSABLE_ENTITY, headers);
    }
    let (extracts, pack) = (Arc::clone(&asked.extracts), asked.pack.clone());
    let taken = blocking(move || extracts.ask((&pack.0, &pack.1), triangles, spec, &network)).await;
    match taken {
        Err(status) => plain(status).into_response(),
        Ok(Err(refusal)) => busy(&asked, &reader, spec, refusal, headers),
        Ok(Ok(())) => {
            let lang = reader.lang.map(|lang| format!("&lang={}", encoded(lang))).unwrap_or_default();
            let to = format!("/{slug}/extract/{}?page=1{lang}", spec.name(asked.about.version));
            let mut response = StatusCode::SEE_OTHER.into_response();
            insert(&mut response, LOCATION, &to);
            keep(&mut response, &asked);
            response
        }
    }
}

fn busy(asked: &Asked, reader: &Reader<'_>, spec: JobSpec, refusal: Refusal, headers: &HeaderMap) -> Response {
    let (status, seconds) = match refusal {
        Refusal::Busy(seconds) => (StatusCode::SERVICE_UNAVAILABLE, seconds),
        Refusal::Share(seconds) | Refusal::TooMany(seconds) => (StatusCode::TOO_MANY_REQUESTS, seconds),
    };
    let mut response = if wants_json(headers) {
        let message = why(&Reader { language: Language::english(), ..*reader }, refusal);
        let mut response = (status, axum::Json(json!({ "error": message, "seconds": seconds }))).into_response();
        insert(&mut response, CACHE_CONTROL, "no-store");
        response
    } else {
        html(asked, form(&asked.about, reader, Message::Refused(refusal), Some(spec)), status, headers)
    };
    insert(&mut response, RETRY_AFTER, &seconds.to_string());
    response
}

/// What the form holds.
fn spec(given: &Given) -> Option<JobSpec> {
    let format = Format::of(given.get("format")?)?;
    let detail = match given.get("detail")? {
        "whole" => Detail::Whole,
        "triangles" => Detail::triangles(given.get("triangles")?)?,
        "error" => Detail::error(given.get("error")?)?,
        _ => return None,
    };
    Some(JobSpec { format, detail })
}

/// `GET /<slug>/extract/<name>`: the file, or with `?page=1` the page that leads to it.
pub(crate) async fn file(
    State(site): State<Site>,
    Path((slug, name)): Path<(String, String)>,
    method: Method,
    request: Request,
) -> Response {
    let (address, _) = client_of(&request, site.behind_proxy);
    let (parts, _) = request.into_parts();
    let headers = &parts.headers;
    let given = Given::of(&site, parts.uri.query().unwrap_or_default(), headers).await;
    let Some((version, spec)) = JobSpec::parse(&name) else { return lost() };
    let asked = match admit(&site, &slug, Some(version), headers, address, &given).await {
        Ok(asked) => asked,
        Err(refused) => return refused,
    };
    let (extracts, hash) = (Arc::clone(&asked.extracts), Arc::clone(&asked.pack.1));
    let job_status = match blocking(move || extracts.job_status(&hash, spec)).await {
        Ok(job_status) => job_status,
        Err(status) => return plain(status).into_response(),
    };
    let wants_page = given.get("page").is_some();
    let report = status_json(&job_status);
    let shown = |stage_: &Stage, status: StatusCode| {
        if wants_json(headers) {
            let mut response = (status, axum::Json(&report)).into_response();
            insert(&mut response, CACHE_CONTROL, "no-store");
            keep(&mut response, &asked);
            return response;
        }
        html(&asked, stage(&asked.about, &given.reader(), spec, stage_), status, headers)
    };
    match job_status {
        JobStatus::Waiting(before, wait) => soon(shown(&Stage::Waiting(before, wait), StatusCode::ACCEPTED), wait),
        // It continues when the store answers again.
        JobStatus::Running(_, fetched @ Some(_), _) if is_away(&site) => {
            later(shown(&Stage::Halted(fetched), StatusCode::SERVICE_UNAVAILABLE))
        }
        JobStatus::Running(percent, fetched, wait) => {
            soon(shown(&Stage::Running(percent, fetched, wait), StatusCode::ACCEPTED), wait)
        }
        JobStatus::Failed(Failure::Away) => {
            later(shown(&Stage::Failed(Failure::Away), StatusCode::SERVICE_UNAVAILABLE))
        }
        JobStatus::Failed(Failure::Full) => shown(&Stage::Failed(Failure::Full), StatusCode::INSUFFICIENT_STORAGE),
        JobStatus::Failed(failure) => {
            // It may be another file by now than the one that was listed.
            objects::forget(&asked.model);
            shown(&Stage::Failed(failure), StatusCode::INTERNAL_SERVER_ERROR)
        }
        JobStatus::Unknown => html(
            &asked,
            form(&asked.about, &given.reader(), Message::Unknown, Some(spec)),
            StatusCode::NOT_FOUND,
            headers,
        ),
        JobStatus::Ready(path) => {
            let extracts = Arc::clone(&asked.extracts);
            match blocking(move || extracts.open_ready(&path)).await {
                Ok(Ok(content)) if wants_page => shown(&Stage::Ready(content.bytes()), StatusCode::OK),
                Ok(Ok(content)) => {
                    let sent = send(&asked, spec, &name, content, &method, headers).await;
                    objects::while_allowed(sent, Sent::Model, &asked.model, &site.clock, site.auth.as_ref(), headers)
                }
                // It went for others in this moment.
                _ => html(
                    &asked,
                    form(&asked.about, &given.reader(), Message::Unknown, Some(spec)),
                    StatusCode::NOT_FOUND,
                    headers,
                ),
            }
        }
    }
}

/// Look again when a good part of the time will have gone by.
fn soon(mut response: Response, wait: Option<Wait>) -> Response {
    let seconds = wait.map_or(2, |wait| (wait.from.as_secs() / 4).clamp(2, 60));
    insert(&mut response, RETRY_AFTER, &seconds.to_string());
    response
}

/// Whether a program asks.
fn wants_json(headers: &HeaderMap) -> bool {
    text(headers, &ACCEPT)
        .is_some_and(|accepted| accepted.split(',').any(|kind| kind.trim().starts_with("application/json")))
}

/// The status of a job, for programs: `seconds` is the estimated range of the wait, if known.
fn status_json(status: &JobStatus) -> Value {
    let seconds = |wait: &Option<Wait>| wait.map(|w| [w.from.as_secs(), w.to.as_secs()]);
    match status {
        JobStatus::Waiting(before, wait) => json!({ "state": "waiting", "before": before, "seconds": seconds(wait) }),
        JobStatus::Running(percent, fetched, wait) => {
            json!({ "state": "running", "percent": percent, "fetched": fetched, "seconds": seconds(wait) })
        }
        JobStatus::Ready(_) => json!({ "state": "ready" }),
        JobStatus::Failed(Failure::Full) => json!({ "state": "failed", "error": "the server's disk is full" }),
        JobStatus::Failed(Failure::Away) => {
            json!({ "state": "failed", "error": "the archive's storage does not answer" })
        }
        JobStatus::Failed(Failure::Other(_)) => json!({ "state": "failed", "error": "the file could not be made" }),
        JobStatus::Unknown => json!({ "state": "unknown", "error": "this file was not requested" }),
    }
}

fn later(mut response: Response) -> Response {
    insert(&mut response, RETRY_AFTER, "10");
    response
}

/// Whether the store of the archive does not answer.
fn is_away(site: &Site) -> bool {
    site.catalogue.place().store().is_some_and(|store| store.away().is_some())
}

/// The file, whole or a range of it. The same pack and job give the same bytes, so their hash is a strong tag.
async fn send(
    asked: &Asked,
    spec: JobSpec,
    name: &str,
    content: Content,
    method: &Method,
    headers: &HeaderMap,
) -> Response {
    let hash = blake3::hash(spec.key(&asked.pack.1).as_bytes()).to_hex();
    let kind = content_type(name);
    let source =
        Source { bytes: content.bytes(), content, hash: hash.as_str().into(), content_type: kind, cache: ASK_AGAIN };
    let mut response = answer(source, method, headers).await.unwrap_or_else(|_| plain(StatusCode::SERVICE_UNAVAILABLE));
    let disposition = format!("attachment; filename=\"{}-{name}\"", asked.about.slug);
    insert(&mut response, CONTENT_DISPOSITION, &disposition);
    keep(&mut response, asked);
    response
}

fn html(asked: &Asked, html: String, status: StatusCode, headers: &HeaderMap) -> Response {
    let mut response = page(html, headers);
    *response.status_mut() = status;
    insert(&mut response, CACHE_CONTROL, "no-store");
    insert(&mut response, VARY, "Accept-Encoding, Accept-Language, Cookie");
    keep(&mut response, asked);
    response
}

/// Leave that was given now goes with the answer; what is not for everybody is kept by nobody on the way.
fn keep(response: &mut Response, asked: &Asked) {
    if asked.is_closed {
        insert(response, CACHE_CONTROL, "private, no-store");
    }
    if let Some(cookie) = &asked.cookie {
        insert(response, SET_COOKIE, cookie);
    }
}

/// The model, its pack, and whether this visitor may have it; else the answer that says why not.
async fn admit(
    site: &Site,
    slug: &str,
    version: Option<u32>,
    headers: &HeaderMap,
    address: String,
    given: &Given,
) -> Result<Asked, Response> {
    let extracts = site.extracts.clone().ok_or_else(lost)?;
    let or_lost =
        |status: StatusCode| if status == StatusCode::NOT_FOUND { lost() } else { plain(status).into_response() };
    let model = find(site, slug).await.map_err(or_lost)?;
    let manifest = match model.object() {
        Some(object) => Some(objects::manifest_of(&object.files).await.map_err(or_lost)?),
        None => None,
    };
    let verdict = manifest.as_ref().map(|manifest| verdict(&manifest.access, &site.clock));
    // Checked before its files, which are gone too and would give 404.
    if matches!(verdict, Some(Verdict::Gone(_))) {
        return Err(plain(StatusCode::GONE).into_response());
    }
    let (about, pack) = match model.object() {
        Some(_) => of_object(&model, version).await.map_err(or_lost)?,
        None => of_pack(&model, version).await.map_err(or_lost)?,
    };
    let mut asked = Asked { extracts, about, pack, model: Arc::clone(&model), is_closed: false, cookie: None };
    let (Some(manifest), Some(Verdict::WithoutGeometry(why))) = (manifest, verdict) else { return Ok(asked) };
    asked.is_closed = true;
    // Capabilities are for the content of the current version, as in `objects`.
    let content = manifest.current().map(|v| v.pack.sha256.clone()).unwrap_or_default();
    if let Some(auth) = &site.auth {
        if objects::lets_out(auth, headers, slug, &content, &site.clock).await {
            return Ok(asked);
        }
        if let Some(Some(cookie)) = capability(site, headers, slug, &content, address).await {
            asked.cookie = Some(cookie);
            return Ok(asked);
        }
    }
    let sign_in = site.auth.as_ref().map(|_| format!("/sign-in?next={}", encoded(&format!("/{slug}/extract"))));
    let page = closed(&asked.about, &given.reader(), &why, sign_in.as_deref());
    Err(html(&asked, page, StatusCode::FORBIDDEN, headers))
}

type Found = (About, (Pack, Arc<str>));

async fn of_object(model: &Arc<Model>, version: Option<u32>) -> Result<Found, StatusCode> {
    let object = model.object().ok_or(StatusCode::NOT_FOUND)?;
    let found = objects::pack_of(&object.files, version).await?;
    let slug = &model.slug;
    let about = About {
        slug: slug.clone(),
        title: model.title().to_owned(),
        page: model.page(),
        triangles: found.version.figures.triangles,
        version: found.version.version,
        pack: (format!("/{slug}/{}", found.version.pack.url), found.version.pack.bytes),
        preview: found.preview.map(|name| format!("/{slug}/{name}")),
    };
    Ok((about, (Pack::of(&found.place, &found.identity), found.version.pack.sha256.as_str().into())))
}

/// A pack of the folder has one version, which is what it is now.
async fn of_pack(model: &Arc<Model>, version: Option<u32>) -> Result<Found, StatusCode> {
    if version.is_some_and(|v| v != 1) {
        return Err(StatusCode::NOT_FOUND);
    }
    let summary = model.summary.as_ref().map_err(|_| StatusCode::NOT_FOUND)?;
    let hash = model.hash().await.map_err(|_| StatusCode::SERVICE_UNAVAILABLE)?;
    let about = About {
        slug: model.slug.clone(),
        title: model.title().to_owned(),
        page: model.page(),
        triangles: summary.triangles,
        version: 1,
        pack: (model.pack().unwrap_or_default(), model.bytes),
        preview: None,
    };
    Ok((about, (Pack::of(&model.place, &model.identity), hash)))
}

//! `/<slug>/…`: the files of an archive object, found in its table ([`crate::object_files`]).
//!
//! | address | answer |
//! |---|---|
//! | `/<slug>/` | its landing page, `no-cache` |
//! | `/<slug>/manifest.json`, other files of the root | as they are now, tag from their content, `no-cache` |
//! | `/<slug>/v1/…` | a file of a version: tag its SHA-256, ranges, `immutable`; of a pack, with ranges behind it, these |
//! | geometry under an embargo or restricted | 403 with the reason; where people can sign in, 401, and for those let in the file ([`crate::auth`]) |
//! | anything of what was withdrawn | 410, with the landing page as its tombstone |

use crate::access::{Clock, Verdict, verdict};
use crate::auth::Auth;
use crate::catalogue::Model;
use crate::content::{
    ASK_AGAIN, FOR_EVER, Source, answer, condition, insert, offer_pieces, pieces, plain, share, share_ranges, text,
};
use crate::html;
use crate::object_files::{Entry, ObjectFiles, Table};
use crate::packs::blocking;
use crate::range::{is_pack, split};
use crate::recheck::WhileAllowed;
use crate::site::{Site, accepts};
use crate::store::{Content, Identity, Place, is_silent, warn};
use axum::body::{Body, Bytes};
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE, ETAG, VARY, WWW_AUTHENTICATE,
};
use axum::http::{HeaderMap, HeaderName, Method, Response, StatusCode};
use kilwa_archive::Manifest;
use kilwa_archive::checksums::sha256;
use kilwa_archive::layout::is_geometry;
use kilwa_archive::layout::{MANIFEST, PAGE, PREVIEW, VIEWER};
use kilwa_archive::manifest::Version;
use kilwa_archive::viewer::content_type;
use std::fs::File;
use std::io::{self, Read as _};
use std::sync::Arc;

/// Longer files of the root are not read into memory for each request.
const WHOLE_MAX: u64 = 64 * 1024;
/// Published notes, in the root: they may change, so they are in no version.
pub(crate) const NOTES: &str = "annotations.json";

/// Answer a GET or HEAD for a file of an object.
pub(crate) async fn respond(
    model: &Model,
    name: &str,
    clock: &Clock,
    auth: Option<&Arc<Auth>>,
    method: &Method,
    headers: &HeaderMap,
) -> Response<Body> {
    let Some(object) = model.object() else { return plain(StatusCode::NOT_FOUND) };
    // First of all: who may have a file may have ranges of it, and nobody else.
    let (name, ranges) = split(name);
    let found = match table(&object.files).await {
        Ok(table) => match verdict(&table.manifest.access, clock) {
            Verdict::Gone(why) => Ok(gone(&object.files, &table, name, &why).await),
            Verdict::WithoutGeometry(why) if is_geometry(name) => {
                let content = table.manifest.current().map(|v| v.pack.sha256.as_str()).unwrap_or_default();
                match auth {
                    Some(auth) if lets_out(auth, headers, &model.slug, content, clock).await => {
                        let asked = Asked { files: &object.files, table: &table, ranges, method, headers };
                        file(&asked, name)
                            .await
                            .map(keep_nowhere)
                            .map(|r| while_allowed(r, Sent::File(name), model, clock, Some(auth), headers))
                    }
                    Some(_) => Ok(locked(&model.slug, &why)),
                    None => Ok(withheld(&why)),
                }
            }
            _ => {
                let asked = Asked { files: &object.files, table: &table, ranges, method, headers };
                file(&asked, name).await.map(|r| while_allowed(r, Sent::File(name), model, clock, auth, headers))
            }
        },
        Err(status) => Err(status),
    };
    let mut response = found.unwrap_or_else(plain);
    if is_viewer(name) {
        share(&mut response);
    } else {
        share_ranges(&mut response);
    }
    response
}

/// The kind of content that a response carries.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Sent<'a> {
    /// The model in any form: a pack or a mesh made of it.
    Model,
    /// A file of the object, by its name there.
    File(&'a str),
}

/// A response that ends when a request for the same would no longer be answered. Without access control, only public files are sent.
pub(crate) fn while_allowed(
    mut response: Response<Body>,
    sent: Sent<'_>,
    model: &Model,
    clock: &Clock,
    auth: Option<&Arc<Auth>>,
    headers: &HeaderMap,
) -> Response<Body> {
    let Some(object) = model.object() else { return response };
    let has_geometry = match sent {
        Sent::Model => true,
        // These two remain of a withdrawn object.
        Sent::File(MANIFEST | PAGE) => return response,
        Sent::File(name) => is_geometry(name),
    };
    let (files, slug) = (Arc::clone(&object.files), model.slug.clone());
    let (clock, auth, headers) = (clock.clone(), auth.cloned(), headers.clone());
    let may_go_on = move || {
        let Ok(table) = files.table() else { return false };
        match verdict(&table.manifest.access, &clock) {
            Verdict::Open => true,
            Verdict::Gone(_) => false,
            Verdict::WithoutGeometry(_) if !has_geometry => true,
            Verdict::WithoutGeometry(_) => {
                let content = table.manifest.current().map(|v| v.pack.sha256.as_str()).unwrap_or_default();
                let now = clock.seconds();
                // A visitor who receives the capability with this answer sends it only with the next request.
                let is_visitor = |auth: &Auth| auth.visitor(&headers, now).is_some_and(|v| auth.sees(&v.who, &slug));
                auth.as_ref().is_some_and(|auth| auth.lets_out(&headers, &slug, content, now) || is_visitor(auth))
            }
        }
    };
    response.extensions_mut().insert(WhileAllowed::new(may_go_on));
    response
}

/// The landing page of an object, or `None` where it has none; its status, 410 for a tombstone; and its table.
pub(crate) async fn landing(
    model: &Model,
    clock: &Clock,
) -> Result<(Option<String>, StatusCode, Arc<Table>), StatusCode> {
    let object = model.object().ok_or(StatusCode::NOT_FOUND)?;
    let table = table(&object.files).await?;
    let html = match read_page(&object.files, &table).await {
        Ok(bytes) => Some(String::from_utf8_lossy(&bytes).into_owned()),
        Err(StatusCode::SERVICE_UNAVAILABLE) => return Err(StatusCode::SERVICE_UNAVAILABLE),
        Err(_) => None,
    };
    Ok(match verdict(&table.manifest.access, clock) {
        Verdict::Gone(why) => {
            let html = html.unwrap_or_else(|| html::gone(&table.manifest.title, &why));
            (Some(html), StatusCode::GONE, table)
        }
        _ => (html, StatusCode::OK, table),
    })
}

/// Whether the object publishes notes.
pub(crate) async fn has_notes(files: &Arc<ObjectFiles>) -> bool {
    table(files).await.is_ok_and(|table| table.get(NOTES).is_some())
}

/// The pack of the current version.
pub(crate) async fn current_pack(files: &Arc<ObjectFiles>, clock: &Clock) -> Result<Source, StatusCode> {
    let table = table(files).await?;
    match verdict(&table.manifest.access, clock) {
        Verdict::Open => {}
        Verdict::WithoutGeometry(_) => return Err(StatusCode::FORBIDDEN),
        Verdict::Gone(_) => return Err(StatusCode::GONE),
    }
    let version = table.manifest.current().ok_or(StatusCode::NOT_FOUND)?;
    source(files, &table, &version.pack.url).await
}

/// Why the pack of the current version is not for everybody.
pub(crate) async fn closed(files: &Arc<ObjectFiles>, clock: &Clock) -> Result<Option<Response<Body>>, StatusCode> {
    let table = table(files).await?;
    Ok(match verdict(&table.manifest.access, clock) {
        Verdict::Open => None,
        Verdict::WithoutGeometry(why) => Some(withheld(&why)),
        Verdict::Gone(why) => Some(gone(files, &table, PAGE, &why).await),
    })
}

async fn table(files: &Arc<ObjectFiles>) -> Result<Arc<Table>, StatusCode> {
    let files = Arc::clone(files);
    blocking(move || {
        files.table().map_err(|e| {
            warn(files.folder(), &e);
            // Not found: the folder, or its manifest, has been removed.
            let gone = e.kind() == io::ErrorKind::NotFound;
            if gone { StatusCode::NOT_FOUND } else { StatusCode::SERVICE_UNAVAILABLE }
        })
    })
    .await?
}

/// A request for a file of an object.
struct Asked<'a> {
    files: &'a Arc<ObjectFiles>,
    table: &'a Arc<Table>,
    /// Of the file, where they are part of its address.
    ranges: Option<&'a str>,
    method: &'a Method,
    headers: &'a HeaderMap,
}

/// A file of the root or of a version.
async fn file(asked: &Asked<'_>, name: &str) -> Result<Response<Body>, StatusCode> {
    match asked.table.get(name).ok_or(StatusCode::NOT_FOUND)?.sha256 {
        None if asked.ranges.is_some() => Err(StatusCode::NOT_FOUND),
        None if name == PAGE => {
            let bytes = read_page(asked.files, asked.table).await?;
            Ok(whole(bytes, content_type(name), asked.method, asked.headers))
        }
        None => root_file(asked, name).await,
        Some(_) if is_viewer(name) => viewer_file(asked, name).await,
        Some(_) => sent(asked, name, name).await,
    }
}

/// A file of the root, under the hash of its content: a long one of this computer is sent a buffer at a time, like those of versions.
async fn root_file(asked: &Asked<'_>, name: &str) -> Result<Response<Body>, StatusCode> {
    let entry = asked.table.get(name).ok_or(StatusCode::NOT_FOUND)?.clone();
    if entry.identity().bytes() > WHOLE_MAX && entry.place().path().is_some() {
        let opened = blocking(move || match entry.open()? {
            (Content::File(file, _), _) => hashed(file).map(Some),
            _ => Ok(None),
        });
        if let Ok(Some(source)) = opened.await? {
            let source = Source { content_type: content_type(name), ..source };
            return answer(source, asked.method, asked.headers).await.map_err(|_| StatusCode::SERVICE_UNAVAILABLE);
        }
    }
    let bytes = read_entry(asked.table, name).await?;
    Ok(whole(bytes, content_type(name), asked.method, asked.headers))
}

/// An open file under the hash of its content. Blocks.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn hashed(mut file: File) -> io::Result<Source> {
    let identity = Identity::of(&file.metadata()?);
    let (mut hasher, mut bytes, mut buffer) = (blake3::Hasher::new(), 0, vec![0; 64 * 1024]);
    loop {
        let read = file.read(&mut buffer)?;
        if read == 0 {
            break;
        }
        hasher.update(buffer.get(..read).unwrap_or_default());
        bytes += read as u64;
    }
    let hash = hasher.finalize().to_hex().as_str().into();
    let content_type = "application/octet-stream";
    Ok(Source { content: Content::File(file, identity), bytes, hash, content_type, cache: ASK_AGAIN })
}

/// A file of a version, under the name that says what kind it is; once more after looking again, where it is not what was listed.
async fn sent(asked: &Asked<'_>, name: &str, kind: &str) -> Result<Response<Body>, StatusCode> {
    for _ in 0..2 {
        let mut source = source(asked.files, asked.table, name).await?;
        source.content_type = content_type(kind);
        let answered = match asked.ranges {
            Some(ranges) => pieces(source, ranges, asked.method, asked.headers).await,
            None => answer(source, asked.method, asked.headers).await,
        };
        match answered {
            Ok(mut response) => {
                if is_pack(name) {
                    offer_pieces(&mut response);
                }
                return Ok(response);
            }
            Err(e) => look_again(asked.files, &e),
        }
    }
    Err(StatusCode::SERVICE_UNAVAILABLE)
}

/// The folder differs from the list: it is listed again when next asked for.
fn look_again(files: &ObjectFiles, e: &io::Error) {
    warn(files.folder(), e);
    if !is_silent(e) {
        files.forget();
    }
}

/// The same for a model.
pub(crate) fn again(model: &Model, e: &io::Error) {
    if let Some(object) = model.object() {
        look_again(&object.files, e);
    }
}

/// List a model again when it is next asked for.
pub(crate) fn forget(model: &Model) {
    if let Some(object) = model.object() {
        object.files.forget();
    }
}

/// Whether a file is one of the version's viewer, which publishing writes in packed forms too (`NAME.br`, `NAME.gz`).
fn is_viewer(name: &str) -> bool {
    name.split('/').nth(1) == Some(VIEWER)
}

/// A file of the viewer, in the smallest form that the client takes: on a slow line the first picture waits for it.
async fn viewer_file(asked: &Asked<'_>, name: &str) -> Result<Response<Body>, StatusCode> {
    let accepted = text(asked.headers, &ACCEPT_ENCODING).unwrap_or_default();
    let is_there =
        |(coding, end): &(&str, &str)| accepts(coding, accepted) && asked.table.get(&format!("{name}{end}")).is_some();
    let packed = [("br", ".br"), ("gzip", ".gz")].into_iter().find(is_there);
    let mut response = sent(asked, &format!("{name}{}", packed.map_or("", |(_, end)| end)), name).await?;
    if let Some((coding, _)) = packed {
        insert(&mut response, CONTENT_ENCODING, coding);
    }
    insert(&mut response, VARY, "Accept-Encoding");
    Ok(response)
}

/// Open a file that has a checksum; once more after looking again, where it is not what was listed.
async fn source(files: &Arc<ObjectFiles>, table: &Arc<Table>, name: &str) -> Result<Source, StatusCode> {
    let open = |entry: Entry| {
        blocking(move || match entry.open() {
            Ok(opened) => Ok(entry.sha256.map(|sum| (opened, sum))),
            Err(e) => {
                warn(entry.place(), &e);
                if is_silent(&e) { Err(StatusCode::SERVICE_UNAVAILABLE) } else { Ok(None) }
            }
        })
    };
    let mut found = open(table.get(name).ok_or(StatusCode::NOT_FOUND)?.clone()).await??;
    if found.is_none() {
        files.forget();
        let again = self::table(files).await?;
        found = open(again.get(name).ok_or(StatusCode::NOT_FOUND)?.clone()).await??;
    }
    let ((content, bytes), hash) = found.ok_or(StatusCode::SERVICE_UNAVAILABLE)?;
    Ok(Source { content, bytes, hash, content_type: content_type(name), cache: FOR_EVER })
}

/// The landing page, 404 if there is none. While a version is being published, and where that was cut off, `index.html` may be another one than
/// the manifest names: then that one is looked for.
async fn read_page(files: &Arc<ObjectFiles>, table: &Arc<Table>) -> Result<Bytes, StatusCode> {
    let (folder, sum) = (files.folder().clone(), table.manifest.page.sha256.clone());
    let is_folder = folder.store().is_none();
    let kept = move || {
        folder.kept_page(&sum).unwrap_or_else(|e| {
            warn(&folder, &e);
            None
        })
    };
    if is_folder {
        // To look for it costs less than to hash the page.
        return match blocking(kept).await? {
            Some(page) => Ok(page),
            None => read_entry(table, PAGE).await,
        };
    }
    let page = read_entry(table, PAGE).await;
    if page.as_ref().is_ok_and(|page| sha256(page) == table.manifest.page.sha256) {
        return page;
    }
    blocking(kept).await?.map_or(page, Ok)
}

/// A file of the root, 404 if there is none.
async fn read_entry(table: &Arc<Table>, name: &str) -> Result<Bytes, StatusCode> {
    let entry = table.get(name).ok_or(StatusCode::NOT_FOUND)?.clone();
    let read = move || {
        entry.read().map_err(|e| {
            warn(entry.place(), &e);
            if is_silent(&e) { StatusCode::SERVICE_UNAVAILABLE } else { StatusCode::NOT_FOUND }
        })
    };
    blocking(read).await?
}

/// Bytes in memory under the hash of their content; asked about each time.
pub(crate) fn whole(bytes: impl Into<Bytes>, kind: &str, method: &Method, headers: &HeaderMap) -> Response<Body> {
    let bytes: Bytes = bytes.into();
    let etag = format!("\"{}\"", blake3::hash(&bytes).to_hex());
    let mut response = if let Some(status) = condition(&etag, headers) {
        plain(status)
    } else {
        let length = bytes.len();
        let mut r = Response::new(if method == Method::HEAD { Body::empty() } else { Body::from(bytes) });
        insert(&mut r, CONTENT_TYPE, kind);
        insert(&mut r, CONTENT_LENGTH, &length.to_string());
        r
    };
    insert(&mut response, ETAG, &etag);
    insert(&mut response, CACHE_CONTROL, ASK_AGAIN);
    response
}

/// The decision of [`Auth`], which may have to read its file.
pub(crate) async fn lets_out(auth: &Arc<Auth>, headers: &HeaderMap, slug: &str, content: &str, clock: &Clock) -> bool {
    let (auth, headers, now) = (Arc::clone(auth), headers.clone(), clock.seconds());
    let (slug, content) = (slug.to_owned(), content.to_owned());
    blocking(move || auth.lets_out(&headers, &slug, &content, now)).await.unwrap_or(false)
}

/// No cache may keep an answer that is not public.
fn keep_nowhere(mut response: Response<Body>) -> Response<Body> {
    insert(&mut response, CACHE_CONTROL, "private, no-store");
    response
}

/// 401: the geometry can be had by whoever is let in; `Kilwa-Open` is where the page asks for that.
fn locked(slug: &str, why: &str) -> Response<Body> {
    let mut r = withheld(why);
    *r.status_mut() = StatusCode::UNAUTHORIZED;
    insert(&mut r, WWW_AUTHENTICATE, "Bearer realm=\"kilwa\"");
    insert(&mut r, HeaderName::from_static("kilwa-open"), &format!("/{slug}/open"));
    insert(&mut r, CACHE_CONTROL, "no-store");
    r
}

/// The manifest of an object.
pub(crate) async fn manifest(site: &Site, slug: &str) -> Result<Manifest, StatusCode> {
    let (catalogue, slug) = (Arc::clone(&site.catalogue), slug.to_owned());
    let model = blocking(move || catalogue.model(&slug).ok_or_else(|| catalogue.missing())).await??;
    let object = model.object().ok_or(StatusCode::NOT_FOUND)?;
    Ok(table(&object.files).await?.manifest.clone())
}

/// The manifest of an object that was found.
pub(crate) async fn manifest_of(files: &Arc<ObjectFiles>) -> Result<Manifest, StatusCode> {
    Ok(table(files).await?.manifest.clone())
}

/// The pack of a version, and where it lies.
pub(crate) struct FoundPack {
    pub(crate) place: Place,
    /// As it was listed.
    pub(crate) identity: Identity,
    pub(crate) version: Version,
    /// Address of the version's preview in the object, where there is one.
    pub(crate) preview: Option<String>,
}

/// The pack of a version, by default of the current one.
pub(crate) async fn pack_of(files: &Arc<ObjectFiles>, version: Option<u32>) -> Result<FoundPack, StatusCode> {
    let table = table(files).await?;
    let manifest = &table.manifest;
    let version = match version {
        Some(number) => manifest.versions.iter().find(|v| v.version == number),
        None => manifest.current(),
    };
    let version = version.ok_or(StatusCode::NOT_FOUND)?.clone();
    let entry = table.get(&version.pack.url).ok_or(StatusCode::NOT_FOUND)?;
    let preview = Some(format!("{}/{PREVIEW}", version.folder)).filter(|name| table.get(name).is_some());
    Ok(FoundPack { place: entry.place().clone(), identity: entry.identity().clone(), version, preview })
}

/// 403: why the geometry cannot be had.
fn withheld(why: &str) -> Response<Body> {
    let mut r = Response::new(Body::from(format!("The model itself is not public. {why}\n")));
    *r.status_mut() = StatusCode::FORBIDDEN;
    insert(&mut r, CONTENT_TYPE, "text/plain; charset=utf-8");
    r
}

/// 410: the manifest for programs that ask for it, the landing page, which is the tombstone, for everything else.
async fn gone(files: &Arc<ObjectFiles>, table: &Arc<Table>, name: &str, why: &str) -> Response<Body> {
    let wanted = if name == MANIFEST { MANIFEST } else { PAGE };
    let read = if wanted == MANIFEST { read_entry(table, MANIFEST).await } else { read_page(files, table).await };
    let bytes = read.ok();
    let kind = content_type(if bytes.is_some() { wanted } else { PAGE });
    let tombstone = || html::gone(&table.manifest.title, why).into();
    let mut r = Response::new(Body::from(bytes.unwrap_or_else(tombstone)));
    *r.status_mut() = StatusCode::GONE;
    insert(&mut r, CONTENT_TYPE, kind);
    insert(&mut r, CACHE_CONTROL, ASK_AGAIN);
    r
}

//! `/packs/<slug>.kilwa` and `/packs/<slug>.<hash>.kilwa`: the bytes of a pack, whole or one range, with ranges behind it several;
//! `/packs/<slug>.annotations.json` and `/packs/<slug>.holes.geojson`: the notes and the list of holes that are published beside it.
//!
//! The ETag is a hash of the content, so it changes exactly when the content does: BLAKE3 for a pack that lies in the folder, the SHA-256
//! of its list for one of an archive object. The hash URL may be kept for ever (`immutable`); the other is revalidated.

use crate::access::Clock;
use crate::catalogue::{Catalogue, HOLES, Kind, Model, NOTES};
use crate::content::{ASK_AGAIN, FOR_EVER, Source, answer, offer_pieces, pieces, plain, share_ranges};
use crate::objects::{self, Sent};
use crate::range::split;
use crate::store::{Content, Identity};
use axum::body::Body;
use axum::http::{HeaderMap, Method, Response, StatusCode};
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_files::plain_file;
use std::sync::Arc;

/// Answer a GET or HEAD for the file name of a pack URL.
pub(crate) async fn respond(
    catalogue: &Arc<Catalogue>,
    name: &str,
    clock: &Clock,
    method: &Method,
    headers: &HeaderMap,
) -> Response<Body> {
    let list = [NOTES, HOLES].into_iter().find_map(|list| Some((name.strip_suffix(list)?.strip_suffix('.')?, list)));
    let found = match list {
        Some(list) => beside(catalogue, list, clock, method, headers).await,
        None => pack(catalogue, name, clock, method, headers).await,
    };
    let mut response = found.unwrap_or_else(plain);
    share_ranges(&mut response);
    response
}

/// The pack of a URL; once more, where it is not what was listed.
async fn pack(
    catalogue: &Arc<Catalogue>,
    name: &str,
    clock: &Clock,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response<Body>, StatusCode> {
    let (name, ranges) = split(name);
    for _ in 0..2 {
        let (source, model) = match find(catalogue, name, clock).await {
            Err(StatusCode::FORBIDDEN | StatusCode::GONE) => return closed(catalogue, name, clock).await,
            found => found?,
        };
        let answered = match ranges {
            Some(ranges) => pieces(source, ranges, method, headers).await,
            None => answer(source, method, headers).await,
        };
        match answered {
            Ok(mut response) => {
                offer_pieces(&mut response);
                // There is no sign-in here: closed models are not served, and transfers end when a model is closed.
                return Ok(objects::while_allowed(response, Sent::Model, &model, clock, None, headers));
            }
            Err(e) => objects::again(&model, &e),
        }
    }
    Err(StatusCode::SERVICE_UNAVAILABLE)
}

/// Why the pack of a URL is not given out, as at the object's own address.
async fn closed(catalogue: &Arc<Catalogue>, name: &str, clock: &Clock) -> Result<Response<Body>, StatusCode> {
    let (c, slug) = (Arc::clone(catalogue), name.split('.').next().unwrap_or_default().to_owned());
    let model = blocking(move || c.model(&slug).ok_or_else(|| c.missing())).await??;
    let object = model.object().ok_or(StatusCode::NOT_FOUND)?;
    objects::closed(&object.files, clock).await?.ok_or(StatusCode::SERVICE_UNAVAILABLE)
}

/// Open the pack of a URL. A file that changed since it was listed is listed again.
async fn find(catalogue: &Arc<Catalogue>, name: &str, clock: &Clock) -> Result<(Source, Arc<Model>), StatusCode> {
    let stem = name.strip_suffix(".kilwa").ok_or(StatusCode::NOT_FOUND)?;
    let (slug, pin) = match stem.split_once('.') {
        Some((slug, hash)) => (slug.to_owned(), Some(hash)),
        None => (stem.to_owned(), None),
    };
    for _ in 0..3 {
        let (c, s) = (Arc::clone(catalogue), slug.clone());
        let model = blocking(move || c.model(&s).ok_or_else(|| c.missing())).await??;
        if let Some(object) = model.object() {
            let source = objects::current_pack(&object.files, clock).await?;
            return pinned(source, pin).map(|source| (source, model));
        }
        if is_no_pack(catalogue, &model).await? {
            return Err(StatusCode::NOT_FOUND);
        }
        if let Some(source) = open(&model).await {
            return pinned(source, pin).map(|source| (source, model));
        }
        let c = Arc::clone(catalogue);
        blocking(move || c.list()).await?.map_err(|_| StatusCode::INTERNAL_SERVER_ERROR)?;
    }
    Err(StatusCode::SERVICE_UNAVAILABLE)
}

/// Whether a file with the ending of packs is none, also after looking at the folder again where that is due.
async fn is_no_pack(catalogue: &Arc<Catalogue>, model: &Arc<Model>) -> Result<bool, StatusCode> {
    let is_none = |model: &Model| matches!(model.kind, Kind::Pack { begins_as_pack: false, .. });
    if !is_none(model) {
        return Ok(false);
    }
    let (c, slug) = (Arc::clone(catalogue), model.slug.clone());
    blocking(move || {
        c.refresh();
        c.model(&slug).is_none_or(|model| is_none(&model))
    })
    .await
}

/// An address with the hash of something else leads nowhere; one with the right hash never changes.
fn pinned(mut source: Source, pin: Option<&str>) -> Result<Source, StatusCode> {
    if pin.is_some_and(|hash| hash != &*source.hash) {
        return Err(StatusCode::NOT_FOUND);
    }
    source.cache = if pin.is_some() { FOR_EVER } else { ASK_AGAIN };
    Ok(source)
}

/// The file, if it is still the version that was listed.
async fn open(model: &Arc<Model>) -> Option<Source> {
    let hash = model.hash().await.inspect_err(|e| tracing::warn!("{}: {e}", model.file_name)).ok()?;
    let model = Arc::clone(model);
    let opened = blocking(move || {
        let file = plain_file::open_direct(model.place.path()?).ok()?;
        (Identity::of(&file.metadata().ok()?) == model.identity).then_some((file, model.identity.clone()))
    });
    let (file, identity) = opened.await.ok().flatten()?;
    Some(Source {
        bytes: identity.bytes(),
        content: Content::File(file, identity),
        hash,
        content_type: "application/octet-stream",
        cache: ASK_AGAIN,
    })
}

/// The notes or the holes beside a pack; of an object the notes in its root.
async fn beside(
    catalogue: &Arc<Catalogue>,
    (slug, list): (&str, &str),
    clock: &Clock,
    method: &Method,
    headers: &HeaderMap,
) -> Result<Response<Body>, StatusCode> {
    let (c, s) = (Arc::clone(catalogue), slug.to_owned());
    let model = blocking(move || c.model(&s).ok_or_else(|| c.missing())).await??;
    let path = match &model.kind {
        Kind::Object(_) if list == HOLES => return Err(StatusCode::NOT_FOUND),
        Kind::Object(_) => return Ok(objects::respond(&model, objects::NOTES, clock, None, method, headers).await),
        Kind::Pack { notes, holes, .. } => {
            let file = if list == HOLES { holes } else { notes };
            file.clone().ok_or(StatusCode::NOT_FOUND)?
        }
    };
    let opened = blocking(move || {
        let file = plain_file::open_direct(&path)?;
        if file.metadata()?.len() > SMALL_FILE_MAX {
            return Err(std::io::Error::other("too long for a list of notes or holes"));
        }
        objects::hashed(file)
    });
    let source = opened.await?.map_err(|_| StatusCode::NOT_FOUND)?;
    let content_type = if list == HOLES { "application/geo+json" } else { "application/json" };
    answer(Source { content_type, ..source }, method, headers).await.map_err(|_| StatusCode::SERVICE_UNAVAILABLE)
}

pub(crate) async fn blocking<T: Send + 'static>(f: impl FnOnce() -> T + Send + 'static) -> Result<T, StatusCode> {
    tokio::task::spawn_blocking(f).await.map_err(|_| StatusCode::INTERNAL_SERVER_ERROR)
}

//! The answer for one file: whole, one range, or several of a pack, under a strong tag, byte for byte.
//!
//! Inputs: an open [`Source`] (content, length, tag, how long it may be kept) and the request's method and headers. Invariants: what is
//! sent is exactly `length` bytes of the file as it was opened, never encoded, because offsets in a pack are offsets on the wire; one
//! response holds a buffer or two, whatever the file's size and however slow the reader. Failures: a file that was changed or made shorter
//! meanwhile, and a store that stops in the middle, end the connection before `Content-Length` is reached, which no client takes for the end.

use crate::budget::Lean;
use crate::range::{RANGES_MAX, Wanted, lists, parse};
use crate::store::{Content, Identity};
use axum::body::{Body, Bytes};
use axum::http::header::{
    ACCEPT_RANGES, ACCESS_CONTROL_ALLOW_ORIGIN, ACCESS_CONTROL_EXPOSE_HEADERS, CACHE_CONTROL, CONTENT_LENGTH,
    CONTENT_RANGE, CONTENT_TYPE, ETAG, IF_MATCH, IF_NONE_MATCH, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Response, StatusCode};
use futures_util::stream::{self, BoxStream};
use futures_util::{StreamExt as _, TryStreamExt as _};
use http_body::{Frame, SizeHint};
use std::collections::VecDeque;
use std::fs::File;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio::task::JoinHandle;

/// Bytes read at a time for one response: with the connection limit this bounds memory.
const BUFFER: usize = 16 * 1024;
pub(crate) const CROSS_ORIGIN_RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");
/// Stretches of a store's file that are asked for at a time for one answer: its delay is waited for once, not for each.
const AHEAD: usize = 4;
/// How many ranges an address of a pack may name ([`pieces`]).
const KILWA_RANGES: HeaderName = HeaderName::from_static("kilwa-ranges");
/// `Cache-Control` of an address whose content never changes.
pub(crate) const FOR_EVER: &str = "public, max-age=31536000, immutable";
/// `Cache-Control` of what is asked about each time.
pub(crate) const ASK_AGAIN: &str = "no-cache";

/// An open file and what is known of it.
pub(crate) struct Source {
    pub(crate) content: Content,
    pub(crate) bytes: u64,
    /// Hash of the content, without quotes.
    pub(crate) hash: Arc<str>,
    pub(crate) content_type: &'static str,
    pub(crate) cache: &'static str,
}

/// Answer a GET or HEAD.
///
/// # Errors
/// When the store has something else by now, or does not answer.
pub(crate) async fn answer(source: Source, method: &Method, headers: &HeaderMap) -> io::Result<Response<Body>> {
    let etag = format!("\"{}\"", source.hash);
    let cache = source.cache;
    let mut response = if let Some(status) = condition(&etag, headers) {
        plain(status)
    } else {
        // A validator that is not exactly ours, a date included, means: send everything.
        let current = headers.get(IF_RANGE).is_none_or(|v| v.as_bytes().trim_ascii() == etag.as_bytes());
        let mut ranges = headers.get_all(RANGE).iter();
        let wanted = match (ranges.next().and_then(|v| v.to_str().ok()), ranges.next()) {
            (Some(range), None) if method == Method::GET && current => parse(range, source.bytes),
            _ => Wanted::Whole,
        };
        send(source, wanted, method == Method::HEAD).await?
    };
    insert(&mut response, CACHE_CONTROL, cache);
    insert(&mut response, ACCEPT_RANGES, "bytes");
    insert(&mut response, ETAG, &etag);
    Ok(response)
}

/// Answer a GET or HEAD for several ranges of a pack ([`crate::range::list`]): what is in them, one behind the other. 404 where that
/// is nonsense.
///
/// # Errors
/// As of [`answer`].
pub(crate) async fn pieces(
    source: Source,
    ranges: &str,
    method: &Method,
    headers: &HeaderMap,
) -> io::Result<Response<Body>> {
    let Some(stretches) = crate::range::list(ranges, source.bytes) else {
        return Ok(plain(StatusCode::NOT_FOUND));
    };
    let etag = format!("\"{}\"", source.hash);
    let mut response = if let Some(status) = condition(&etag, headers) {
        plain(status)
    } else {
        let length = stretches.iter().map(|s| s.1).sum();
        let (is_head, is_lean) = (method == Method::HEAD, source.content.is_lean());
        let body = if is_head { Body::empty() } else { several(source.content, stretches, length).await? };
        let mut r = Response::new(body);
        insert(&mut r, CONTENT_TYPE, source.content_type);
        insert(&mut r, CONTENT_LENGTH, &length.to_string());
        if is_lean {
            r.extensions_mut().insert(Lean);
        }
        r
    };
    insert(&mut response, CACHE_CONTROL, source.cache);
    insert(&mut response, ETAG, &etag);
    Ok(response)
}

/// Stretches, start and length, one behind the other; `length` bytes in all. A store is asked for [`AHEAD`] of them at a time.
async fn several(content: Content, stretches: Vec<(u64, u64)>, length: u64) -> io::Result<Body> {
    let (store, key, identity) = match content {
        Content::File(file, identity) => return Ok(Body::new(Part::new((file, identity), stretches, length))),
        Content::Held(bytes) => {
            let part = |&(start, length): &(u64, u64)| {
                let place = usize::try_from(start).ok().zip(usize::try_from(start + length).ok());
                place.and_then(|(start, end)| bytes.get(start..end))
            };
            let parts: Option<Vec<&[u8]>> = stretches.iter().map(part).collect();
            return Ok(Body::from(parts.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof))?.concat()));
        }
        Content::Remote(store, key, identity) => (store, key, identity),
    };
    let ask = move |(start, length): (u64, u64)| {
        let (store, key, identity) = (Arc::clone(&store), key.clone(), identity.clone());
        async move {
            let flow = store.stretch(&key, &identity, start..start + length).await?;
            let exact = Body::new(Flow { flow, left: length }).into_data_stream();
            Ok::<_, io::Error>(exact.map_err(io::Error::other))
        }
    };
    let mut stretches = stretches.into_iter();
    let Some(first) = stretches.next() else { return Ok(Body::empty()) };
    // Before the answer begins: what is there may be something else by now.
    let first = ask(first).await?;
    let others = stream::iter(stretches).map(ask).buffered(AHEAD).try_flatten();
    Ok(Body::new(Flow { flow: first.chain(others).boxed(), left: length }))
}

/// Tell that [`pieces`] of this pack can be had, and how many at once.
pub(crate) fn offer_pieces(response: &mut Response<Body>) {
    insert(response, KILWA_RANGES, &RANGES_MAX.to_string());
}

/// Let a script of another site read the answer.
pub(crate) fn share(response: &mut Response<Body>) {
    insert(response, ACCESS_CONTROL_ALLOW_ORIGIN, "*");
    insert(response, CROSS_ORIGIN_RESOURCE_POLICY, "cross-origin");
}

/// The same, and the headers that ranges need; a hundred bytes that the many files of the viewer do without.
pub(crate) fn share_ranges(response: &mut Response<Body>) {
    share(response);
    insert(response, ACCESS_CONTROL_EXPOSE_HEADERS, "ETag, Content-Range, Content-Length, Accept-Ranges, Kilwa-Ranges");
}

/// 412 or 304, where the request's conditions say so (RFC 9110 section 13.2.2).
pub(crate) fn condition(etag: &str, headers: &HeaderMap) -> Option<StatusCode> {
    // A list may be spread over several lines.
    let any = |name: HeaderName, weak| {
        let mut lines = headers.get_all(name).iter().peekable();
        // An ETag may have non-ASCII bytes (RFC 9110 section 8.8.3): it differs from ours, but it is one.
        lines.peek().is_some().then(|| lines.any(|line| lists(&String::from_utf8_lossy(line.as_bytes()), etag, weak)))
    };
    if any(IF_MATCH, false) == Some(false) {
        Some(StatusCode::PRECONDITION_FAILED)
    } else if any(IF_NONE_MATCH, true) == Some(true) {
        Some(StatusCode::NOT_MODIFIED)
    } else {
        None
    }
}

/// A header as text, where it is there once or the first of several.
pub(crate) fn text<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    headers.get(name).and_then(|v| v.to_str().ok())
}

async fn send(source: Source, wanted: Wanted, head: bool) -> io::Result<Response<Body>> {
    let (status, start, length) = match wanted {
        Wanted::Whole => (StatusCode::OK, 0, source.bytes),
        Wanted::Part { start, end } => (StatusCode::PARTIAL_CONTENT, start, end - start + 1),
        Wanted::Unsatisfiable => {
            let mut r = plain(StatusCode::RANGE_NOT_SATISFIABLE);
            insert(&mut r, CONTENT_RANGE, &format!("bytes */{}", source.bytes));
            return Ok(r);
        }
    };
    let (bytes, kind, is_lean) = (source.bytes, source.content_type, source.content.is_lean());
    let body = if head || length == 0 { Body::empty() } else { stretch(source.content, start, length).await? };
    let mut r = Response::new(body);
    *r.status_mut() = status;
    if is_lean {
        r.extensions_mut().insert(Lean);
    }
    insert(&mut r, CONTENT_TYPE, kind);
    insert(&mut r, CONTENT_LENGTH, &length.to_string());
    if status == StatusCode::PARTIAL_CONTENT {
        insert(&mut r, CONTENT_RANGE, &format!("bytes {start}-{}/{bytes}", start + length - 1));
    }
    Ok(r)
}

/// `length` bytes from `start` on.
async fn stretch(content: Content, start: u64, length: u64) -> io::Result<Body> {
    Ok(match content {
        Content::File(file, identity) => Body::new(Part::new((file, identity), vec![(start, length)], length)),
        Content::Held(bytes) => {
            let end = usize::try_from(start + length).ok();
            let part = usize::try_from(start).ok().zip(end).filter(|(_, end)| *end <= bytes.len());
            let (start, end) = part.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof))?;
            Body::from(bytes.slice(start..end))
        }
        Content::Remote(store, key, identity) => {
            let flow = store.stretch(&key, &identity, start..start + length).await?;
            Body::new(Flow { flow, left: length })
        }
    })
}

pub(crate) fn insert(r: &mut Response<Body>, name: HeaderName, value: &str) {
    if let Ok(v) = HeaderValue::from_str(value) {
        r.headers_mut().insert(name, v);
    }
}

/// A status with its own words as the body, empty for 304.
pub(crate) fn plain(status: StatusCode) -> Response<Body> {
    let body = match status {
        StatusCode::NOT_MODIFIED => Body::empty(),
        _ => Body::from(format!("{status}\n")),
    };
    let mut r = Response::new(body);
    *r.status_mut() = status;
    if status != StatusCode::NOT_MODIFIED {
        insert(&mut r, CONTENT_TYPE, "text/plain; charset=utf-8");
    }
    r
}

/// Stretches of a file as a response body, read a buffer at a time, and only when the one before has gone.
struct Part {
    /// The file, and its identity when its tag was computed.
    file: Arc<(File, Identity)>,
    /// What is to be read, start and length, none empty.
    stretches: VecDeque<(u64, u64)>,
    left: u64,
    reading: Option<JoinHandle<io::Result<Bytes>>>,
}

impl Part {
    /// `left` bytes in all.
    fn new(file: (File, Identity), stretches: Vec<(u64, u64)>, left: u64) -> Self {
        Self { file: Arc::new(file), stretches: stretches.into(), left, reading: None }
    }

    /// The contents of the next buffer: as many stretches as fit.
    fn next(&mut self) -> Vec<(u64, usize)> {
        let (mut parts, mut left) = (Vec::new(), BUFFER);
        while left > 0 {
            let Some((start, length)) = self.stretches.pop_front() else { break };
            let taken = usize::try_from(length).map_or(left, |n| n.min(left));
            parts.push((start, taken));
            left -= taken;
            if length > taken as u64 {
                self.stretches.push_front((start + taken as u64, length - taken as u64));
            }
        }
        parts
    }
}

impl http_body::Body for Part {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        if self.left == 0 {
            return Poll::Ready(None);
        }
        let begun = self.reading.take();
        let mut reading = begun.unwrap_or_else(|| {
            let (file, parts) = (Arc::clone(&self.file), self.next());
            tokio::task::spawn_blocking(move || read(&file, &parts))
        });
        let Poll::Ready(read) = Pin::new(&mut reading).poll(cx) else {
            self.reading = Some(reading);
            return Poll::Pending;
        };
        let bytes = read.map_err(io::Error::other).flatten()?;
        self.left -= bytes.len() as u64;
        Poll::Ready(Some(Ok(Frame::data(bytes))))
    }

    fn is_end_stream(&self) -> bool {
        self.left == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}

/// A stretch of a file as it comes from a store: exactly so many bytes, or an error.
struct Flow {
    flow: BoxStream<'static, io::Result<Bytes>>,
    left: u64,
}

impl http_body::Body for Flow {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        if self.left == 0 {
            return Poll::Ready(None);
        }
        let Some(bytes) = ready!(self.flow.as_mut().poll_next(cx)).transpose()? else {
            return Poll::Ready(Some(Err(io::Error::new(
                io::ErrorKind::UnexpectedEof,
                "the store stopped in the middle",
            ))));
        };
        let length = bytes.len() as u64;
        if length > self.left {
            return Poll::Ready(Some(Err(io::Error::other("the store sent more than was requested"))));
        }
        self.left -= length;
        Poll::Ready(Some(Ok(Frame::data(bytes))))
    }

    fn is_end_stream(&self) -> bool {
        self.left == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}

/// Parts of a file, one after the other. Fails if the file was changed before they were read.
fn read((file, identity): &(File, Identity), parts: &[(u64, usize)]) -> io::Result<Bytes> {
    let mut buffer = vec![0; parts.iter().map(|p| p.1).sum()];
    let mut left = buffer.as_mut_slice();
    for &(mut at, length) in parts {
        let (mut rest, others) = left.split_at_mut(length);
        left = others;
        while !rest.is_empty() {
            let n = match read_at(file, rest, at) {
                Ok(0) => {
                    let kind = io::ErrorKind::UnexpectedEof;
                    return Err(io::Error::new(kind, "the file became shorter while it was sent"));
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                read => read?,
            };
            at += n as u64;
            rest = rest.get_mut(n..).unwrap_or_default();
        }
    }
    if Identity::of(&file.metadata()?) != *identity {
        return Err(io::Error::other("the file was changed while it was sent"));
    }
    Ok(buffer.into())
}

/// Reading at a place moves no position that several responses could share.
#[cfg(unix)]
fn read_at(file: &File, buffer: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, buffer, at)
}

#[cfg(windows)]
fn read_at(file: &File, buffer: &mut [u8], at: u64) -> io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, buffer, at)
}

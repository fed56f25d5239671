//! Ending transfers when access ends: by revocation, signing out, closing a model or withdrawing it.
//!
//! A handler that answers with a file that is not public for ever puts a [`WhileAllowed`] into the response ([`crate::objects::while_allowed`]).
//! One layer of the site ([`watch`]) gives such responses a body that checks once in a while (`Site::recheck`) whether it may continue. If not, it ends in an error,
//! so that the connection is closed before `Content-Length` is reached. The layer is outside of those that replace bodies ([`crate::budget`]).
//! A body hands out at most [`PIECE`] at a time, because the HTTP library sends everything that it has taken. Bytes that the client has received cannot be
//! taken back.

use axum::body::{Body, Bytes, HttpBody as _};
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use http_body::{Frame, SizeHint};
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;

/// Bytes handed out at a time.
const PIECE: usize = 16 * 1024;

/// Whether the transfer may continue. May block.
type Check = Arc<dyn Fn() -> bool + Send + Sync>;

/// Marks a response whose transfer may continue only while this check succeeds.
#[derive(Clone)]
pub(crate) struct WhileAllowed(Check);

impl WhileAllowed {
    /// The check may block.
    pub(crate) fn new(may_go_on: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(may_go_on))
    }
}

/// End marked responses when they are no longer allowed, which is checked at intervals of `every`.
pub(crate) async fn watch(State(every): State<Duration>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    match response.extensions_mut().remove::<WhileAllowed>() {
        Some(WhileAllowed(may_go_on)) => response.map(|body| rechecked(body, may_go_on, every)),
        None => response,
    }
}

struct Rechecked {
    body: Body,
    /// The part of the body's last frame that was not handed out yet.
    rest: Bytes,
    may_go_on: Check,
    every: Duration,
    next: Instant,
    checking: Option<JoinHandle<bool>>,
}

/// A body that ends in an error when the check, made at intervals of `every`, fails.
fn rechecked(body: Body, may_go_on: Check, every: Duration) -> Body {
    if body.is_end_stream() {
        return body;
    }
    let next = Instant::now() + every;
    Body::new(Rechecked { body, rest: Bytes::new(), may_go_on, every, next, checking: None })
}

impl http_body::Body for Rechecked {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        if self.checking.is_none() && Instant::now() >= self.next {
            let may_go_on = Arc::clone(&self.may_go_on);
            self.checking = Some(tokio::task::spawn_blocking(move || may_go_on()));
        }
        if let Some(checking) = &mut self.checking {
            let may_go_on = ready!(Pin::new(checking).poll(cx));
            self.checking = None;
            if !may_go_on.unwrap_or(false) {
                let ended = io::Error::new(io::ErrorKind::PermissionDenied, "access ended during the transfer");
                return Poll::Ready(Some(Err(axum::Error::new(ended))));
            }
            self.next = Instant::now() + self.every;
        }
        if self.rest.is_empty() {
            match ready!(Pin::new(&mut self.body).poll_frame(cx)) {
                Some(Ok(frame)) => match frame.into_data() {
                    Ok(data) => self.rest = data,
                    Err(trailers) => return Poll::Ready(Some(Ok(trailers))),
                },
                ended => return Poll::Ready(ended),
            }
        }
        let length = self.rest.len().min(PIECE);
        Poll::Ready(Some(Ok(Frame::data(self.rest.split_to(length)))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty() && self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let (body, rest) = (self.body.size_hint(), self.rest.len() as u64);
        let mut hint = SizeHint::new();
        hint.set_lower(body.lower().saturating_add(rest));
        if let Some(upper) = body.upper() {
            hint.set_upper(upper.saturating_add(rest));
        }
        hint
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::StreamExt as _;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// A small file of a store is one frame, which the HTTP library would otherwise take whole.
    #[tokio::test]
    async fn a_body_of_a_single_frame_is_ended() {
        let bytes: Vec<u8> = (0..20 * PIECE + 7).map(|n| (n % 251) as u8).collect();
        // An interval of zero checks before every piece, a long one never.
        let long = Duration::from_secs(3600);
        for (is_ended, every) in [(true, Duration::ZERO), (false, Duration::ZERO), (false, long)] {
            let allowed = Arc::new(AtomicBool::new(true));
            let asked = Arc::clone(&allowed);
            let body = rechecked(Body::from(bytes.clone()), Arc::new(move || asked.load(Ordering::Relaxed)), every);
            assert_eq!(body.size_hint().exact(), Some(bytes.len() as u64));
            let mut stream = body.into_data_stream();
            let (mut came, mut is_cut) = (stream.next().await.unwrap().unwrap().to_vec(), false);
            allowed.store(!is_ended && every.is_zero(), Ordering::Relaxed);
            while let Some(piece) = stream.next().await {
                match piece {
                    Ok(piece) if piece.len() <= PIECE => came.extend_from_slice(&piece),
                    Ok(piece) => panic!("{} bytes at once", piece.len()),
                    Err(_) => is_cut = true,
                }
                if is_cut {
                    break;
                }
            }
            assert_eq!((is_cut, came.len() == PIECE), (is_ended, is_ended), "{every:?}");
            assert_eq!(came.len() == bytes.len(), !is_ended, "{every:?}");
            assert!(bytes.starts_with(&came));
        }
    }
}

//! Ending transfers when access ends: by revocation, signing out or a withdrawal.
//!
//! A body checks every [`EVERY`] whether it may go on. If not, it ends in an error, so that the connection is closed before `Content-Length` is
//! reached. Bytes that the client has received by then cannot be taken back.

use axum::body::{Body, Bytes, HttpBody as _};
use http_body::{Frame, SizeHint};
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};
use tokio::task::JoinHandle;

/// Time between checks; the accounts are re-read equally often.
const EVERY: Duration = Duration::from_secs(1);

/// Whether the transfer may go on. May block.
pub(crate) type Check = Arc<dyn Fn() -> bool + Send + Sync>;

struct Rechecked {
    body: Body,
    may_go_on: Check,
    next: Instant,
    checking: Option<JoinHandle<bool>>,
}

/// A body that is allowed now, and ends in an error when it no longer is.
pub(crate) fn rechecked(body: Body, may_go_on: Check) -> Body {
    if body.is_end_stream() {
        return body;
    }
    Body::new(Rechecked { body, may_go_on, next: Instant::now() + EVERY, checking: None })
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
            self.next = Instant::now() + EVERY;
        }
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

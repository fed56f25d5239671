//! How many bytes of answers are held in memory until their readers have taken them: in all, and for each network.
//!
//! Files are read a buffer at a time ([`crate::content`]), and what is long by nature is made piece by piece; such answers are marked [`Lean`]. Every
//! other answer is made whole before its first byte goes out, and a reader who takes nothing keeps it in memory for as long as the time limits of the
//! socket allow. So all of them together have a budget, and each network a share of it: what exceeds it is answered 503 with `Retry-After`, and
//! readers of other networks notice nothing. Invariant: an answer is counted until its last byte was handed to the system or given up, also
//! where the HTTP library holds it, because the count belongs to the bytes themselves.

use crate::content::{insert, plain};
use crate::observe::client_of;
use axum::body::{Body, Bytes, HttpBody as _, to_bytes};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::http::header::RETRY_AFTER;
use axum::middleware::Next;
use axum::response::Response;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes of all networks, and of one.
const ALL: usize = 64 << 20;
const SHARE: usize = ALL / 8;
/// Shorter answers are not counted: the number of connections bounds them.
const SMALL: usize = 4096;
/// Seconds until a reader who was refused may come again.
const AGAIN: &str = "5";

/// Marks an answer that holds little memory of its own, however long it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lean;

/// Mark an answer.
pub(crate) fn lean(mut response: Response) -> Response {
    response.extensions_mut().insert(Lean);
    response
}

/// What is held at the moment.
#[derive(Debug)]
pub(crate) struct Budget {
    all: usize,
    share: usize,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    bytes: usize,
    by_network: HashMap<String, usize>,
}

impl Default for Budget {
    fn default() -> Self {
        Self::new(ALL, SHARE)
    }
}

impl Budget {
    /// So many bytes in all, and for one network.
    fn new(all: usize, share: usize) -> Self {
        Self { all, share, held: Mutex::default() }
    }

    /// Count so many bytes for a network; `None` where they exceed what is left. A network that holds nothing may hold one answer of any length that
    /// is left of all.
    fn take(self: &Arc<Self>, network: &str, bytes: usize) -> Option<Claim> {
        let mut held = self.lock();
        let own = held.by_network.get(network).copied().unwrap_or(0);
        if held.bytes + bytes > self.all || (own > 0 && own + bytes > self.share) {
            return None;
        }
        held.bytes += bytes;
        *held.by_network.entry(network.to_owned()).or_default() += bytes;
        Some(Claim { budget: Arc::clone(self), network: network.to_owned(), bytes })
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Bytes that are counted until this is dropped.
#[derive(Debug)]
struct Claim {
    budget: Arc<Budget>,
    network: String,
    bytes: usize,
}

impl Drop for Claim {
    fn drop(&mut self) {
        let mut held = self.budget.lock();
        held.bytes -= self.bytes;
        if let Some(own) = held.by_network.get_mut(&self.network) {
            *own -= self.bytes;
            if *own == 0 {
                held.by_network.remove(&self.network);
            }
        }
    }
}

/// Bytes with their claim.
struct Counted {
    bytes: Bytes,
    _claim: Claim,
}

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// What counting needs.
#[derive(Debug, Clone)]
pub(crate) struct Counting {
    pub(crate) budget: Arc<Budget>,
    /// Whether a trusted proxy in front of the server reports the client's address.
    pub(crate) behind_proxy: bool,
}

/// Count what an answer holds, or refuse it.
pub(crate) async fn count(State(counting): State<Counting>, request: Request, next: Next) -> Response {
    let (_, network) = client_of(&request, counting.behind_proxy);
    let response = next.run(request).await;
    let length = response.body().size_hint().exact().and_then(|bytes| usize::try_from(bytes).ok());
    if response.extensions().get::<Lean>().is_some() || length.is_some_and(|bytes| bytes < SMALL) {
        return response;
    }
    let (parts, body) = response.into_parts();
    // It is whole already: nothing is waited for or copied.
    let Ok(bytes) = to_bytes(body, usize::MAX).await else { return plain(StatusCode::INTERNAL_SERVER_ERROR) };
    let Some(claim) = counting.budget.take(&network, bytes.len()) else {
        let mut refusal = plain(StatusCode::SERVICE_UNAVAILABLE);
        *refusal.body_mut() = Body::from(
            "503 Service Unavailable\nToo many responses are being sent. Please try again in a few seconds.\n",
        );
        insert(&mut refusal, RETRY_AFTER, AGAIN);
        return refusal;
    };
    Response::from_parts(parts, Body::from(Bytes::from_owner(Counted { bytes, _claim: claim })))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_has_its_share_and_regains_it_with_the_last_byte_sent() {
        let budget = Arc::new(Budget::new(100, 30));
        let first = budget.take("a", 20).expect("fits");
        assert!(budget.take("a", 20).is_none(), "beyond its share");
        let large = budget.take("b", 60).expect("one answer may be larger than a share");
        assert!(budget.take("c", 30).is_none() && budget.take("c", 20).is_some(), "beyond all");
        let bytes = Bytes::from_owner(Counted { bytes: Bytes::from_static(b"0123456789"), _claim: large });
        let part = bytes.slice(3..5);
        drop(bytes);
        assert!(budget.take("c", 30).is_none(), "a part of it is still held");
        drop(part);
        assert!(budget.take("c", 30).is_some());
        drop(first);
        assert_eq!(budget.lock().bytes, 0);
        assert!(budget.lock().by_network.is_empty());
    }
}

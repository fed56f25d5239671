//! How many questions to the index are answered at once: in all, and for each network; the others wait, each network in a line of its own.
//!
//! A question may read thousands of entries (OAI-PMH, the map), on one of the threads that also read files for everybody. With the gate, a network that asks
//! hundreds at once waits for itself, and what is being made takes little memory at any moment. Invariants: whoever waits holds no thread; a place is
//! given back when the work has ended, not when the client hangs up; a request's body is read before the request gets a place; an answer that is made
//! piece by piece ([`crate::flow`]) holds a place while a piece is made, and none while the reader receives it.

use crate::content::plain;
use crate::observe::client_of;
use axum::body::{Body, to_bytes};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::Response;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Questions at once, in all and of one network.
const ALL: usize = 8;
const SHARE: usize = 2;
/// A form must be there within this, and no longer than this.
const FORM: Duration = Duration::from_secs(10);
const FORM_BYTES: usize = 16 * 1024;

/// See the module.
#[derive(Debug)]
pub(crate) struct Gate {
    all: Arc<Semaphore>,
    share: usize,
    networks: Mutex<HashMap<String, Arc<Semaphore>>>,
}

impl Default for Gate {
    fn default() -> Self {
        Self::of(ALL, SHARE)
    }
}

impl Gate {
    /// With other numbers of questions at once, in all and of one network.
    pub(crate) fn of(all: usize, share: usize) -> Self {
        Self { all: Arc::new(Semaphore::new(all)), share, networks: Mutex::default() }
    }

    /// A place for a question of a network; `None` only while the program ends.
    pub(crate) async fn enter(&self, network: &str) -> Option<Place> {
        let own = {
            let mut networks = self.networks.lock().unwrap_or_else(PoisonError::into_inner);
            // A line in which nobody is or waits is held by nobody else.
            networks.retain(|_, line| Arc::strong_count(line) > 1);
            Arc::clone(networks.entry(network.to_owned()).or_insert_with(|| Arc::new(Semaphore::new(self.share))))
        };
        // First its own line: in that of all, no network has more than its share.
        let own = own.acquire_owned().await.ok()?;
        Some([own, Arc::clone(&self.all).acquire_owned().await.ok()?])
    }
}

/// One of the places of a network and one of all places, given back when dropped.
pub(crate) type Place = [OwnedSemaphorePermit; 2];

/// Access to the gate for an answer that is made piece by piece: each further piece needs a place of its own, because the first one is given back when the
/// answer begins.
#[derive(Debug, Clone)]
pub(crate) struct Turns {
    gate: Arc<Gate>,
    network: String,
}

impl Turns {
    pub(crate) fn new(gate: &Arc<Gate>, network: &str) -> Self {
        Self { gate: Arc::clone(gate), network: network.to_owned() }
    }

    /// As [`Gate::enter`].
    pub(crate) async fn next(&self) -> Option<Place> {
        self.gate.enter(&self.network).await
    }
}

/// What passing needs.
#[derive(Debug, Clone)]
pub(crate) struct Passing {
    pub(crate) gate: Arc<Gate>,
    /// Whether a trusted proxy in front of the server reports the client's address.
    pub(crate) behind_proxy: bool,
}

/// Answer a question when it is its turn.
pub(crate) async fn pass(State(passing): State<Passing>, request: Request, next: Next) -> Response {
    let (_, network) = client_of(&request, passing.behind_proxy);
    // For every method: a GET request can announce a body too.
    let (mut parts, body) = request.into_parts();
    let form = match tokio::time::timeout(FORM, to_bytes(body, FORM_BYTES)).await {
        Ok(Ok(form)) => form,
        Ok(Err(_)) => return plain(StatusCode::PAYLOAD_TOO_LARGE),
        Err(_) => return plain(StatusCode::REQUEST_TIMEOUT),
    };
    parts.extensions.insert(Turns::new(&passing.gate, &network));
    let request = Request::from_parts(parts, Body::from(form));
    let Some(place) = passing.gate.enter(&network).await else { return plain(StatusCode::SERVICE_UNAVAILABLE) };
    let work = async move {
        let response = next.run(request).await;
        drop(place);
        response
    };
    // A task of its own: who hangs up does not give the place to the next while the work continues.
    tokio::spawn(work).await.unwrap_or_else(|_| plain(StatusCode::INTERNAL_SERVER_ERROR))
}

#[cfg(test)]
mod tests {
    use super::*;
    use futures_util::FutureExt as _;

    #[tokio::test]
    async fn a_network_over_its_limit_waits_and_others_pass() {
        let gate = Gate::default();
        let held = [gate.enter("a").await, gate.enter("a").await];
        let mut third = std::pin::pin!(gate.enter("a"));
        assert!(third.as_mut().now_or_never().is_none(), "it has its share");
        let others: Vec<_> =
            (0..ALL - SHARE).map(|n| gate.enter(&format!("n{n}")).now_or_never().expect("passes")).collect();
        assert!(gate.enter("late").now_or_never().is_none(), "all places are taken");
        drop(held);
        assert!(third.now_or_never().is_some());
        drop(others);
        assert!(gate.enter("b").now_or_never().is_some());
        assert!(gate.networks.lock().unwrap().len() <= 2, "lines that nobody is in are forgotten");
    }
}

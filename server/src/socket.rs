//! The accept loop: what axum's own loop lacks (axum 0.8 has no header-read timeout) and a public server needs.
//!
//! Limits ([`Limits`]): connections at once, in all and from one address; time to send a request's headers (also the longest idle time
//! between requests); size of a request's headers; time without progress while writing an answer, and a lowest mean speed of it, so
//! that nobody holds an answer for ever by taking a byte now and then; time to finish when asked to stop.
//!
//! A client over its address's share is answered 503 at once. When all connections are taken, the one that has waited longest without a
//! request is closed for the new one; where all of them work, the new one waits in the system's queue.

use crate::connections::{Connections, Link};
use crate::ending::Ending;
use crate::metrics::{Closed, Metrics};
use axum::Router;
use axum::body::Body;
use axum::http::header::HOST;
use axum::http::{Request, Response, StatusCode, Version};
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use kilwa_pack::plural::counted;
use std::convert::Infallible;
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, Sleep};
use tower_service::Service as _;

/// What a connection may cost.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Connections at once.
    pub connections: usize,
    /// Connections at once from one address; 0 for no limit of its own (behind a proxy all come from one).
    pub per_address: usize,
    /// A request's headers must be complete within this.
    pub headers: Duration,
    /// A response that makes no progress for this long is dropped.
    pub stall: Duration,
    /// After [`Limits::grace`], a response that was slower than this on the whole is dropped, bytes a second.
    pub floor: u64,
    /// How long a response may be slower than [`Limits::floor`].
    pub grace: Duration,
    /// Responses still running this long after the order to stop are cut.
    pub shutdown: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 4096,
            per_address: 256,
            headers: Duration::from_secs(10),
            stall: Duration::from_secs(30),
            floor: 256,
            grace: Duration::from_secs(60),
            shutdown: Duration::from_secs(5),
        }
    }
}

/// Bytes of a request's line and headers; also what hyper holds of an answer that waits to be written.
const HEADER_BYTES: usize = 16 * 1024;
/// Header lines of a request.
const HEADER_LINES: usize = 64;
/// Bytes that the system holds of an answer that the network has not taken: with less of it, progress shows sooner and a slow
/// reader costs less. What is on its way to the client is not counted, so speed over long distances does not suffer.
#[cfg(target_os = "linux")]
const UNSENT: u32 = 128 * 1024;
/// Answer to an address that has its share of connections.
const REFUSAL: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 2\r\ncontent-length: 0\r\nconnection: close\r\n\r\n";

/// Serve `app` on `listener` until `stop` resolves; then no new connection is taken and those open may finish within
/// [`Limits::shutdown`].
///
/// # Errors
/// Never for a single connection; only when the listener itself is broken.
pub async fn listen(
    listener: TcpListener,
    app: Router,
    metrics: Arc<Metrics>,
    limits: Limits,
    stop: impl Future<Output = ()>,
) -> io::Result<()> {
    let server = Server::new(app, metrics, limits);
    let mut stop = std::pin::pin!(stop);
    loop {
        let accepted = tokio::select! {
            () = &mut stop => break,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, peer)) => {
                tokio::select! {
                    () = &mut stop => break,
                    () = server.take(stream, peer) => {}
                }
            }
            Err(e) => {
                // Too many open files, or a client that left: neither is a reason to stop serving.
                tracing::warn!("cannot accept a connection: {e}");
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        }
    }
    drop(listener);
    server.stop().await;
    Ok(())
}

struct Server {
    app: Router,
    metrics: Arc<Metrics>,
    limits: Limits,
    permits: Arc<Semaphore>,
    links: Arc<Connections>,
    graceful: GracefulShutdown,
    http: hyper::server::conn::http1::Builder,
}

impl Server {
    fn new(app: Router, metrics: Arc<Metrics>, limits: Limits) -> Self {
        let mut http = hyper::server::conn::http1::Builder::new();
        http.timer(TokioTimer::new()).header_read_timeout(limits.headers);
        http.max_buf_size(HEADER_BYTES).max_headers(HEADER_LINES);
        let permits = Arc::new(Semaphore::new(limits.connections));
        Self { app, metrics, limits, permits, links: Connections::new(), graceful: GracefulShutdown::new(), http }
    }

    /// Begin to serve a connection; returns when there is room for it.
    async fn take(&self, stream: TcpStream, peer: SocketAddr) {
        let Some(link) = self.links.enter(peer.ip(), self.limits.per_address) else {
            self.metrics.closed(Closed::Refused);
            tracing::info!(peer = %peer.ip(), "has {}, refused another", counted(self.limits.per_address, "connection", "connections"));
            // It fits an empty socket buffer; where not, closing says enough.
            drop(stream.try_write(REFUSAL));
            return;
        };
        let permit = self.slot().await;
        tune(&stream);
        let guarded = Guarded::new(stream, self.limits, Arc::clone(&link), Arc::clone(&self.metrics));
        let (app, watched) = (self.app.clone(), Arc::clone(&link));
        let service = service_fn(move |request| answer(app.clone(), Arc::clone(&watched), request));
        let connection = self.graceful.watch(self.http.serve_connection(TokioIo::new(guarded), service));
        let metrics = Arc::clone(&self.metrics);
        metrics.connected();
        tokio::spawn(async move {
            tokio::select! {
                ended = connection => match ended {
                    Ok(()) => metrics.closed(Closed::Ended),
                    Err(e) if e.is_timeout() => metrics.closed(Closed::Headers),
                    Err(e) => {
                        metrics.closed(Closed::Broken);
                        tracing::debug!(peer = %peer.ip(), "connection closed: {e}");
                    }
                },
                () = link.closed() => metrics.closed(Closed::Evicted),
            }
            drop((link, permit));
        });
    }

    /// A place for one more connection: a free one, else that of an idle one, else the next that ends.
    async fn slot(&self) -> Option<OwnedSemaphorePermit> {
        loop {
            if let Ok(permit) = Arc::clone(&self.permits).try_acquire_owned() {
                return Some(permit);
            }
            self.links.evict();
            let next = Arc::clone(&self.permits).acquire_owned();
            if let Ok(permit) = tokio::time::timeout(Duration::from_millis(100), next).await {
                return permit.ok();
            }
        }
    }

    async fn stop(self) {
        if tokio::time::timeout(self.limits.shutdown, self.graceful.shutdown()).await.is_err() {
            let cut = self.links.close_all();
            tracing::warn!("responses still running after {} s, and ended: {cut}", self.limits.shutdown.as_secs_f64());
            // Their tasks end at the next turn; nobody waits longer for them.
            let gone = self.permits.acquire_many(u32::try_from(self.limits.connections).unwrap_or(u32::MAX));
            drop(tokio::time::timeout(Duration::from_millis(500), gone).await);
        }
    }
}

/// Options of the socket; a system that lacks them works without.
fn tune(stream: &TcpStream) {
    if let Err(e) = stream.set_nodelay(true) {
        tracing::debug!("no TCP_NODELAY: {e}");
    }
    #[cfg(target_os = "linux")]
    if let Err(e) = socket2::SockRef::from(stream).set_tcp_notsent_lowat(UNSENT) {
        tracing::debug!("no TCP_NOTSENT_LOWAT: {e}");
    }
}

/// Hand a request to the site, with the link it came by; the link is busy until the answer has gone.
async fn answer(mut app: Router, link: Arc<Link>, request: Request<Incoming>) -> Result<Response<Body>, Infallible> {
    link.begin();
    let end = Ending::new({
        let link = Arc::clone(&link);
        move |_| link.end()
    });
    if request.version() == Version::HTTP_11 && request.headers().get_all(HOST).iter().count() != 1 {
        // RFC 9112 section 3.2.
        return Ok(end.wrap(crate::content::plain(StatusCode::BAD_REQUEST)));
    }
    let mut request = request.map(Body::new);
    request.extensions_mut().insert(Peer(link.address));
    let response = app.call(request).await?;
    Ok(end.wrap(response))
}

/// Where a request came from, as the socket knows it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Peer(pub(crate) std::net::IpAddr);

/// A socket whose writes fail when the other side takes nothing for too long, or too little.
struct Guarded {
    stream: TcpStream,
    limits: Limits,
    link: Arc<Link>,
    metrics: Arc<Metrics>,
    waiting: Option<Pin<Box<Sleep>>>,
    /// The request whose answer is counted, when its first byte was offered, and how many were taken.
    answer: (u64, Instant, u64),
}

impl Guarded {
    fn new(stream: TcpStream, limits: Limits, link: Arc<Link>, metrics: Arc<Metrics>) -> Self {
        Self { stream, limits, link, metrics, waiting: None, answer: (0, Instant::now(), 0) }
    }

    /// Progress clears the clock; no progress runs it.
    fn clocked<T>(
        &mut self,
        cx: &mut Context<'_>,
        poll: Poll<io::Result<T>>,
        taken: impl FnOnce(&T) -> usize,
    ) -> Poll<io::Result<T>> {
        let request = self.link.requests.load(Ordering::Relaxed);
        if self.answer.0 != request {
            self.answer = (request, Instant::now(), 0);
        }
        if poll.is_ready() {
            if let Poll::Ready(Ok(value)) = &poll {
                self.answer.2 += taken(value) as u64;
            }
            if self.waiting.take().is_some() {
                self.link.blocked.store(false, Ordering::Relaxed);
            }
            return poll;
        }
        let (_, began, bytes) = self.answer;
        let Limits { stall, floor, grace, .. } = self.limits;
        let link = &self.link;
        let clock = self.waiting.get_or_insert_with(|| {
            link.blocked.store(true, Ordering::Relaxed);
            let earned = Duration::from_millis(bytes.saturating_mul(1000) / floor.max(1));
            let slowest = began.checked_add(grace.saturating_add(earned));
            let stuck = Instant::now() + stall;
            Box::pin(tokio::time::sleep_until(slowest.map_or(stuck, |slowest| stuck.min(slowest))))
        });
        ready!(clock.as_mut().poll(cx));
        self.metrics.slow();
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Guarded {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl AsyncWrite for Guarded {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        let poll = Pin::new(&mut self.stream).poll_write(cx, buf);
        self.clocked(cx, poll, |n| *n)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let poll = Pin::new(&mut self.stream).poll_write_vectored(cx, bufs);
        self.clocked(cx, poll, |n| *n)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let poll = Pin::new(&mut self.stream).poll_flush(cx);
        self.clocked(cx, poll, |()| 0)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}

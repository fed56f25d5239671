//! The HTTP client of the S3 library: HTTP/1.1 over hyper, on the store's own threads, with a timeout for each step and a small, fixed buffer
//! for each response, so that memory grows neither with the size of files nor with slow readers.

use http_body::{Body, Frame, SizeHint};
use hyper::StatusCode;
use hyper::body::{Bytes, Incoming};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector as Tcp;
use hyper_util::rt::TokioTimer;
use object_store::ClientOptions;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpRequestBody, HttpResponse, HttpResponseBody,
    HttpService,
};
use std::error::Error;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::runtime::Handle;
use tokio::time::Sleep;

/// Bytes read at a time for one response.
const BUFFER: usize = 32 * 1024;
/// Maximum number of idle connections; see also `IDLE_FOR`.
const IDLE: usize = 64;
/// Timeout for connecting.
const CONNECT: Duration = Duration::from_secs(10);
const IDLE_FOR: Duration = Duration::from_secs(20);

/// The store's last failure, as a message without addresses or keys.
#[derive(Debug, Default)]
pub struct LastFailure(Mutex<Failure>);

/// An error response of a store, or a missing response.
#[derive(Debug, Default, Clone)]
pub struct Failure {
    /// The message; empty before the first failure.
    pub what: String,
    /// Whether the store answered with a status of 500 or more.
    pub is_server_error: bool,
}

impl LastFailure {
    /// The last failure, with the error code from the store's response `e` if there is one; not the rest, which may repeat signed data.
    pub fn reason(&self, e: &object_store::Error) -> Failure {
        let body = e.to_string();
        let last_failure = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let word = body.split_once("<Code>").and_then(|(_, rest)| rest.split_once("</Code>")).map(|(code, _)| code);
        let what = match word.filter(|code| code.len() <= 64 && code.bytes().all(|b| b.is_ascii_alphanumeric())) {
            Some("NoSuchBucket") => "the store has no such bucket".to_owned(),
            Some(code) => format!("{} ({code})", last_failure.what),
            None if last_failure.what.is_empty() => "the request to the store failed".to_owned(),
            None => last_failure.what,
        };
        Failure { what, is_server_error: last_failure.is_server_error }
    }

    fn note(&self, what: String) {
        self.set(Failure { what, is_server_error: false });
    }

    fn note_status(&self, status: StatusCode) {
        self.set(Failure { what: format!("the store says {status}"), is_server_error: status.is_server_error() });
    }

    fn set(&self, failure: Failure) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = failure;
    }
}

/// Makes clients for the library.
#[derive(Debug)]
pub(crate) struct Connector {
    pub(crate) threads: Handle,
    pub(crate) timeout: Duration,
    pub(crate) is_plain: bool,
    pub(crate) last_failure: Arc<LastFailure>,
}

impl HttpConnector for Connector {
    fn connect(&self, _: &ClientOptions) -> object_store::Result<HttpClient> {
        let generic = |source: io::Error| object_store::Error::Generic { store: "S3", source: Box::new(source) };
        let client = Client::builder(Threads(self.threads.clone()))
            .pool_timer(TokioTimer::new())
            .pool_idle_timeout(IDLE_FOR)
            .pool_max_idle_per_host(IDLE)
            .http1_read_buf_exact_size(BUFFER)
            .build(connector(self.timeout, self.is_plain).map_err(generic)?);
        let (threads, timeout) = (self.threads.clone(), self.timeout);
        Ok(HttpClient::new(Service { client, threads, timeout, last_failure: Arc::clone(&self.last_failure) }))
    }
}

/// With the certificates that the system trusts; a store without TLS needs none of them.
fn connector(timeout: Duration, is_plain: bool) -> io::Result<HttpsConnector<Tcp>> {
    let mut tcp = Tcp::new();
    tcp.enforce_http(false);
    tcp.set_nodelay(true);
    tcp.set_connect_timeout(Some(timeout.min(CONNECT)));
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    if is_plain {
        let tls = rustls::ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(io::Error::other)?
            .with_root_certificates(rustls::RootCertStore::empty())
            .with_no_client_auth();
        return Ok(HttpsConnectorBuilder::new()
            .with_tls_config(tls)
            .https_or_http()
            .enable_http1()
            .wrap_connector(tcp));
    }
    let tls = HttpsConnectorBuilder::new().with_provider_and_platform_verifier(provider)?;
    // Keys may also come from a service of the cloud, at an address of its own without TLS.
    Ok(tls.https_or_http().enable_http1().wrap_connector(tcp))
}

/// Work of the connections goes to the store's own threads.
#[derive(Clone)]
struct Threads(Handle);

impl<F> hyper::rt::Executor<F> for Threads
where
    F: Future + Send + 'static,
    F::Output: Send + 'static,
{
    fn execute(&self, work: F) {
        self.0.spawn(work);
    }
}

#[derive(Debug)]
struct Service {
    client: Client<HttpsConnector<Tcp>, HttpRequestBody>,
    threads: Handle,
    timeout: Duration,
    last_failure: Arc<LastFailure>,
}

#[async_trait::async_trait]
impl HttpService for Service {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let asked = self.client.request(request);
        let (timeout, last_failure) = (self.timeout, Arc::clone(&self.last_failure));
        // A connection belongs to the threads that it was made on.
        let answered = self.threads.spawn(tokio::time::timeout(timeout, asked)).await;
        let response = match answered {
            Ok(Ok(Ok(response))) => response,
            Ok(Ok(Err(e))) => {
                let is_connect = e.is_connect();
                let what = if is_connect { "no connection" } else { "the connection broke" };
                last_failure.note(format!("the store does not answer: {what}: {}", root(&e)));
                let kind = if is_connect { HttpErrorKind::Connect } else { HttpErrorKind::Request };
                return Err(HttpError::new(kind, e));
            }
            Ok(Err(e)) => {
                last_failure.note(silence(timeout));
                return Err(HttpError::new(HttpErrorKind::Timeout, e));
            }
            Err(e) => return Err(HttpError::new(HttpErrorKind::Unknown, e)),
        };
        if !response.status().is_success() {
            last_failure.note_status(response.status());
        }
        Ok(response.map(|body| HttpResponseBody::new(Timed { body, timeout, timer: None, last_failure })))
    }
}

fn silence(timeout: Duration) -> String {
    format!("the store does not answer: nothing within {timeout:?}")
}

/// The innermost reason, which names no address.
fn root(e: &(dyn Error + 'static)) -> String {
    let mut innermost: &dyn Error = e;
    while let Some(source) = innermost.source() {
        innermost = source;
    }
    innermost.to_string()
}

/// An answer whose next bytes are waited for only so long.
struct Timed {
    body: Incoming,
    timeout: Duration,
    timer: Option<Pin<Box<Sleep>>>,
    last_failure: Arc<LastFailure>,
}

impl Body for Timed {
    type Data = Bytes;
    type Error = HttpError;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, HttpError>>> {
        if let Poll::Ready(frame) = Pin::new(&mut self.body).poll_frame(cx) {
            self.timer = None;
            return Poll::Ready(frame.map(|frame| {
                frame.map_err(|e| {
                    self.last_failure.note(format!("the store does not answer: the connection broke: {}", root(&e)));
                    HttpError::new(HttpErrorKind::Interrupted, e)
                })
            }));
        }
        let timeout = self.timeout;
        let timer = self.timer.get_or_insert_with(|| Box::pin(tokio::time::sleep(timeout)));
        if timer.as_mut().poll(cx).is_pending() {
            return Poll::Pending;
        }
        self.last_failure.note(silence(timeout));
        Poll::Ready(Some(Err(HttpError::new(HttpErrorKind::Timeout, io::Error::from(io::ErrorKind::TimedOut)))))
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

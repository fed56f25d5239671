//! Sending a version to a server that takes uploads (tus 1.0.0 for the bytes; [`kilwa_server::upload`] for the rest).
//!
//! Every attempt begins with what is meant; the server says what it lacks, or that it is published already. So whatever broke off (this
//! program, the line, the server) is resumed in the same way, by waiting and trying again, or by running the same command again.
//! Waits grow; what makes progress is not given up. The token goes to the address that was given, to no other, and into no message.
//!
//! Stands by itself (with `distrust`), so that tests can drive it without a command line.

use crate::distrust::{is_distrusted, system_certificates};
use kilwa_archive::checksums::sha256_of;
use kilwa_pack::plural::counted;
use kilwa_server::upload::wire::{AnnouncedFile, Intent, Lacking, State, Status};
use std::cell::Cell;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};
use ureq::http::Response;
use ureq::{Agent, Body};

/// Bytes of one request, at first, at least and at most: as many as take some seconds.
const PIECE: usize = 1 << 20;
const PIECE_MIN: usize = 32 << 10;
const PIECE_MAX: usize = 16 << 20;
/// A piece that takes less is followed by a larger one; one that takes more by a smaller one.
const QUICK: Duration = Duration::from_secs(2);
const SLOW: Duration = Duration::from_secs(15);
/// Longest answer that is read.
const ANSWER_MAX: u64 = 16 << 20;

/// How long is tried.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patience {
    /// Attempts in a row that get nowhere.
    pub(crate) attempts: u32,
    /// Wait after the first of them; it doubles with each.
    pub(crate) first: Duration,
    /// Longest wait.
    pub(crate) longest: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self { attempts: 10, first: Duration::from_millis(500), longest: Duration::from_secs(60) }
    }
}

/// Events while sending.
#[derive(Debug, Clone, Copy)]
pub(crate) enum SendEvent<'a> {
    /// So many of so many bytes are there.
    Sent(u64, u64),
    /// The server has verified so many of so many bytes.
    Verified(u64, u64),
    /// Something passing went wrong; it is tried again after a wait.
    Waits(&'a str, Duration),
}

/// A server that takes uploads.
pub(crate) struct Sender {
    agent: Agent,
    /// Without a `/` at its end.
    base: String,
    token: String,
    patience: Patience,
    piece: Cell<usize>,
    /// The bytes that were missing when the last attempt began: if fewer are missing now, that is progress, however the attempt ended.
    lacking: Cell<u64>,
    /// How often a file arrived with another content than was announced.
    altered: Cell<u32>,
}

/// Why an attempt ended.
enum Failure {
    /// Trying again cannot help.
    Final(String),
    /// It may, after so long at least; whether anything was got done.
    Passing { why: String, after: Option<Duration>, progressed: bool },
    /// A file arrived with another content than was announced, and has to be sent again: nothing was got done.
    Altered(String),
}

fn passing(why: impl Into<String>) -> Failure {
    Failure::Passing { why: why.into(), after: None, progressed: false }
}

/// What was published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Published {
    pub(crate) version: u32,
    /// It was there before.
    pub(crate) already: bool,
}

impl Sender {
    /// For the site at `base`, with a token for publishing.
    pub(crate) fn new(base: &str, token: String, patience: Patience) -> Self {
        let mut agent = Agent::config_builder()
            .http_status_as_error(false)
            .https_only(base.starts_with("https:"))
            // The token goes nowhere else.
            .max_redirects(0)
            .max_redirects_will_error(false)
            .timeout_connect(Some(Duration::from_secs(15)))
            .timeout_send_body(Some(Duration::from_secs(300)))
            .timeout_recv_response(Some(Duration::from_secs(90)))
            .timeout_recv_body(Some(Duration::from_secs(90)))
            .user_agent(concat!("kilwa-publish/", env!("CARGO_PKG_VERSION")))
            .tls_config(system_certificates());
        if is_loopback(base) {
            // No proxy of the environment is between a computer and itself: over http it would read the token.
            agent = agent.proxy(None);
        }
        let agent = agent.build();
        let base = base.trim_end_matches('/').to_owned();
        Self {
            agent: agent.into(),
            base,
            token,
            patience,
            piece: Cell::new(PIECE),
            lacking: Cell::new(u64::MAX),
            altered: Cell::new(0),
        }
    }

    /// A small public file of the site; `None` if there is none.
    ///
    /// # Errors
    /// For people, when it cannot be had.
    pub(crate) fn fetch(&self, path: &str) -> Result<Option<Vec<u8>>, String> {
        self.persist(&|_| (), || {
            let url = format!("{}/{path}", self.base);
            let response = self.agent.get(&url).header("Accept-Encoding", "identity").call();
            let response = response.map_err(|e| passing(format!("{url}: {e}")))?;
            match response.status().as_u16() {
                // A tombstone says what it is.
                200 | 410 => body(response).map(Some),
                404 => Ok(None),
                _ => Err(self.refused(response)),
            }
        })
    }

    /// Whether the token may publish `slug` here: before anything is made that would be of no use.
    ///
    /// # Errors
    /// For people: why not.
    pub(crate) fn greet(&self, slug: &str) -> Result<(), String> {
        self.persist(&|_| (), || {
            let response = self.ask("GET", &format!("uploads/{slug}"), &[], None)?;
            let speaks_tus = response.headers().contains_key("tus-resumable");
            match response.status().as_u16() {
                // It does not matter how the last upload ended, or whether there was one.
                200..=299 | 404 | 409 | 422 | 423 | 507 if speaks_tus => Ok(()),
                200..=299 | 404 => {
                    Err(Failure::Final(format!("{} accepts no uploads; does it run this version of kilwa?", self.base)))
                }
                _ if speaks_tus => {
                    let (parts, content) = response.into_parts();
                    let bytes = body(Response::from_parts(parts.clone(), content))?;
                    // The answer has the status with which the last upload ended. A server that refuses the request itself reports no upload.
                    let last = kilwa_pack::json::from_slice::<Status>(&bytes).ok();
                    if last.is_some_and(|last| last.state == State::Refused) {
                        return Ok(());
                    }
                    Err(self.refused(Response::from_parts(parts, Body::builder().data(bytes))))
                }
                _ => Err(self.refused(response)),
            }
        })
    }

    /// Publish `intent`, whose files lie at `at(file)`.
    ///
    /// # Errors
    /// For people: why it was refused, or what went wrong last.
    pub(crate) fn publish(
        &self,
        intent: &Intent,
        at: &dyn Fn(&AnnouncedFile) -> PathBuf,
        report: &dyn Fn(SendEvent<'_>),
    ) -> Result<Published, String> {
        self.persist(report, || self.attempt(intent, at, report).map_err(|e| self.looked_at(e, intent, at)))
    }

    /// When files arrive altered again, whether they are still what was announced.
    fn looked_at(&self, e: Failure, intent: &Intent, at: &dyn Fn(&AnnouncedFile) -> PathBuf) -> Failure {
        if !matches!(e, Failure::Altered(_)) {
            return e;
        }
        self.altered.set(self.altered.get() + 1);
        if self.altered.get() < 2 {
            return e;
        }
        for file in &intent.files {
            let path = at(file);
            match File::open(&path).and_then(|f| sha256_of(BufReader::with_capacity(1 << 20, f))) {
                Ok((_, sum)) if sum == file.sha256 => {}
                Ok(_) => {
                    let message =
                        "the file changed while it was sent; run the same command again when no program writes to it";
                    return Failure::Final(format!("{}: {message}", path.display()));
                }
                Err(e) => return Failure::Final(format!("{}: {e}", path.display())),
            }
        }
        e
    }

    /// Try until it is done, refused, or nothing gets on for long.
    fn persist<T>(
        &self,
        report: &dyn Fn(SendEvent<'_>),
        attempt: impl Fn() -> Result<T, Failure>,
    ) -> Result<T, String> {
        let (mut tries, mut wait) = (0, self.patience.first);
        loop {
            let (why, after) = match attempt() {
                Ok(done) => return Ok(done),
                Err(Failure::Final(why)) => return Err(why),
                Err(Failure::Altered(why)) => (why, None),
                Err(Failure::Passing { why, after, progressed }) => {
                    if progressed {
                        (tries, wait) = (0, self.patience.first);
                    }
                    (why, after)
                }
            };
            tries += 1;
            if tries >= self.patience.attempts {
                return Err(format!(
                    "{why} ({}). What was sent is kept for some days: run the same command again to continue",
                    counted(tries, "attempt", "attempts")
                ));
            }
            let pause = wait.max(after.unwrap_or_default()).min(self.patience.longest);
            report(SendEvent::Waits(&why, pause));
            sleep(pause);
            wait *= 2;
        }
    }

    fn attempt(
        &self,
        intent: &Intent,
        at: &dyn Fn(&AnnouncedFile) -> PathBuf,
        report: &dyn Fn(SendEvent<'_>),
    ) -> Result<Published, Failure> {
        let text = serde_json::to_vec(intent).map_err(|e| Failure::Final(e.to_string()))?;
        let begun =
            self.status(self.ask("POST", "uploads", &[("Content-Type", "application/json")], Some(&text))?, true)?;
        let all: u64 = intent.files.iter().map(|f| f.bytes).sum();
        let lacking = begun.lacks.iter().map(|l| l.bytes.saturating_sub(l.offset)).sum::<u64>().min(all);
        let mut progressed = lacking < self.lacking.replace(lacking);
        let sent = Cell::new(all - lacking);
        report(SendEvent::Sent(sent.get(), all));
        for lack in &begun.lacks {
            let file = intent.files.iter().find(|f| f.sha256 == lack.sha256);
            let file =
                file.ok_or_else(|| Failure::Final("the server requests a file that does not exist".to_owned()))?;
            let advance = |n: u64| {
                sent.set(sent.get() + n);
                report(SendEvent::Sent(sent.get(), all));
            };
            self.send(&intent.slug, lack, &at(file), &advance).map_err(|e| with_progress(e, &mut progressed))?;
            progressed = true;
        }
        let mut now = begun;
        let address = format!("uploads/{}", intent.slug);
        if matches!(now.state, State::Sending | State::Ready) {
            let answer = self.ask("POST", &address, &[], Some(&[])).and_then(|r| self.status(r, false));
            now = answer.map_err(|e| with_progress(e, &mut progressed))?;
        }
        let mut pause = Duration::from_millis(50);
        loop {
            match now.state {
                State::Published => return Ok(Published { version: now.version, already: now.already }),
                State::Verifying => match &now.waits {
                    Some(why) => report(SendEvent::Waits(why, pause)),
                    None => report(SendEvent::Verified(now.done, now.of)),
                },
                State::Refused => return Err(passing(now.error.unwrap_or_default())),
                State::Sending | State::Ready => return Err(passing("the server started over")),
            }
            sleep(pause);
            pause = (pause * 2).min(Duration::from_secs(2));
            let answer = self.ask("GET", &address, &[], None).and_then(|r| self.status(r, false));
            now = answer.map_err(|e| with_progress(e, &mut progressed))?;
        }
    }

    /// Send what is lacking of a file, piece by piece.
    fn send(&self, slug: &str, lack: &Lacking, from: &Path, advance: &dyn Fn(u64)) -> Result<(), Failure> {
        let unreadable = |e: std::io::Error| Failure::Final(format!("{}: {e}", from.display()));
        let mut file = File::open(from).map_err(unreadable)?;
        file.seek(SeekFrom::Start(lack.offset)).map_err(unreadable)?;
        let (mut at, mut progressed) = (lack.offset, false);
        let address = format!("uploads/{slug}/{}", lack.sha256);
        while at < lack.bytes {
            let length = usize::try_from(lack.bytes - at).unwrap_or(usize::MAX).min(self.piece.get());
            let mut piece = vec![0; length];
            file.read_exact(&mut piece).map_err(unreadable)?;
            let offset = at.to_string();
            let headers = [
                ("Tus-Resumable", "1.0.0"),
                ("Upload-Offset", offset.as_str()),
                ("Content-Type", "application/offset+octet-stream"),
            ];
            let began = Instant::now();
            let response = self.ask("PATCH", &address, &headers, Some(&piece)).map_err(|e| {
                // A proxy that takes no body of this length may say so by hanging up.
                self.smaller();
                with_progress(e, &mut progressed)
            })?;
            match response.status().as_u16() {
                204 => {}
                413 if self.smaller() => {
                    file.seek(SeekFrom::Start(at)).map_err(unreadable)?;
                    continue;
                }
                // The file, or all of the upload, is at another place than was thought.
                460 => return Err(Failure::Altered(text_of(response))),
                404 | 409 => return Err(with_progress(passing(text_of(response)), &mut progressed)),
                _ => return Err(with_progress(self.refused(response), &mut progressed)),
            }
            at += length as u64;
            progressed = true;
            advance(length as u64);
            let took = began.elapsed();
            if took < QUICK && length == self.piece.get() {
                self.piece.set((length * 2).min(PIECE_MAX));
            } else if took > SLOW {
                self.smaller();
            }
        }
        Ok(())
    }

    /// Halve the pieces; whether they can be.
    fn smaller(&self) -> bool {
        let half = self.piece.get() / 2;
        let is_possible = half >= PIECE_MIN;
        if is_possible {
            self.piece.set(half);
        }
        is_possible
    }

    fn ask(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        content: Option<&[u8]>,
    ) -> Result<Response<Body>, Failure> {
        let url = format!("{}/{path}", self.base);
        let mut request = ureq::http::Request::builder().method(method).uri(&url);
        request = request.header("Authorization", format!("Bearer {}", self.token));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let failed = |e: ureq::http::Error| Failure::Final(format!("{url}: {e}"));
        let answer = match content {
            Some(bytes) => self.agent.run(request.body(bytes).map_err(failed)?),
            None => self.agent.run(request.body(()).map_err(failed)?),
        };
        answer.map_err(|e| match e {
            ureq::Error::BadUri(_) | ureq::Error::RequireHttpsOnly(_) | ureq::Error::Tls(_) => {
                Failure::Final(format!("{url}: {e}"))
            }
            e if is_distrusted(&e) => Failure::Final(format!("{url}: {e}")),
            e => passing(format!("{url}: {e}")),
        })
    }

    /// The server's status of the upload; `is_first` if requested for the first time in an attempt.
    fn status(&self, response: Response<Body>, is_first: bool) -> Result<Status, Failure> {
        match response.status().as_u16() {
            200..=202 => {
                let bytes = body(response)?;
                kilwa_pack::json::from_slice(&bytes).map_err(|_| {
                    Failure::Final(format!(
                        "{} does not answer like a kilwa server of this version; was it started with --accept-uploads?",
                        self.base
                    ))
                })
            }
            // After a restart it knows of nothing until it is begun again; what was damaged on the way is sent again.
            460 if !is_first => Err(Failure::Altered(text_of(response))),
            404 if !is_first => Err(passing(text_of(response))),
            _ => Err(self.refused(response)),
        }
    }

    /// Whether an answer is the last word.
    fn refused(&self, response: Response<Body>) -> Failure {
        let status = response.status();
        let header = |name: &str| response.headers().get(name).and_then(|v| v.to_str().ok()).map(str::to_owned);
        let after = header("retry-after").and_then(|s| s.parse().ok()).map(Duration::from_secs);
        if status.is_redirection() {
            let to = header("location").unwrap_or_default();
            return Failure::Final(format!(
                "{} redirects to {to}; use that address with --to if it is right",
                self.base
            ));
        }
        let why = text_of(response);
        match status.as_u16() {
            408 | 423 | 425 | 429 | 500 | 502..=506 | 508..=599 => Failure::Passing { why, after, progressed: false },
            _ => Failure::Final(why),
        }
    }
}

/// An attempt that got something done before it failed is none that got nowhere.
fn with_progress(e: Failure, progressed: &mut bool) -> Failure {
    match e {
        Failure::Passing { why, after, progressed: p } => Failure::Passing { why, after, progressed: p || *progressed },
        other => other,
    }
}

/// Whether an address is one of this computer itself.
pub(crate) fn is_loopback(address: &str) -> bool {
    let rest = address.split_once("://").map_or("", |(_, rest)| rest);
    let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name == "localhost" || name.parse::<std::net::IpAddr>().is_ok_and(|a| a.is_loopback())
}

fn body(mut response: Response<Body>) -> Result<Vec<u8>, Failure> {
    let read = response.body_mut().with_config().limit(ANSWER_MAX).read_to_vec();
    read.map_err(|e| passing(format!("the response was cut off: {e}")))
}

/// What the server says, in its words where it has some.
fn text_of(response: Response<Body>) -> String {
    let status = response.status();
    let value = body(response).ok().and_then(|b| kilwa_pack::json::from_slice::<serde_json::Value>(&b).ok());
    let error = value.as_ref().and_then(|v| v.get("error")).and_then(serde_json::Value::as_str);
    match error {
        // Nothing that a terminal would take for an order.
        Some(error) => error.chars().filter(|c| !c.is_control()).take(2000).collect(),
        None => format!("the server answered {status}"),
    }
}

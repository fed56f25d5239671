//! A network that is simulated: a [`Streamer`] flown over a pack through a link of given speed, delay and failures.
//!
//! What comes in: a pack ([`Store`]: the directory's pages and the patches of chunks), a [`Link`], a camera for every moment
//! ([`Flight`] or anything else). What comes out: every step of the streamer, a log of its commands in order
//! ([`Simulator::log`]) and totals ([`Totals`]). Time is simulated, in whole microseconds; the same calls give the same log, byte by
//! byte, on every machine.
//!
//! The model: an answer's first byte comes `latency_ms` after the request; all answers share one link and pass it in order of
//! request; decoders take chunks in order, each at a fixed rate. What the model leaves out: TCP's slow start and
//! competition by others. An answer that is cancelled before its first byte costs nothing; one that is cancelled later costs what
//! had come by then.
//!
//! Failures: a page or chunk that the store does not have counts as a failed request or a damaged chunk, as on a real network.

mod flight;
mod store;

pub use flight::Flight;
pub use store::{PackStore, Store};

use crate::command::{Command, Event, FetchKind, RequestId, Step, length_of};
use crate::streamer::Streamer;
use crate::view::View;
use std::collections::BTreeMap;
use std::ops::Range;

/// A way to the server.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Bits per second of payload.
    pub bits_per_second: f64,
    /// From a request to the first byte of its answer, milliseconds.
    pub latency_ms: f64,
    /// Requests that fail, in per cent; which ones depends only on their number and the seed.
    pub failures_percent: u32,
    /// From when to when every request fails, milliseconds.
    pub outage_ms: Option<(f64, f64)>,
    /// Chooses which requests fail.
    pub seed: u64,
}

impl Link {
    /// A good line: 1 Gbit/s, 5 ms.
    pub const FAST: Self = Self::new(1e9, 5.0);
    /// A common line: 10 Mbit/s, 50 ms.
    pub const COMMON: Self = Self::new(10e6, 50.0);
    /// A slow line: 2 Mbit/s, 300 ms.
    pub const SLOW: Self = Self::new(2e6, 300.0);

    /// A link without failures.
    pub const fn new(bits_per_second: f64, latency_ms: f64) -> Self {
        Self { bits_per_second, latency_ms, failures_percent: 0, outage_ms: None, seed: 1 }
    }

    /// The same link, with so many requests of a hundred failing.
    #[must_use]
    pub const fn failing(self, percent: u32) -> Self {
        Self { failures_percent: percent, ..self }
    }

    /// The same link, with a server that is away for a while.
    #[must_use]
    pub const fn with_outage(self, from_ms: f64, to_ms: f64) -> Self {
        Self { outage_ms: Some((from_ms, to_ms)), ..self }
    }

    fn fails(&self, request: RequestId, now_us: u64) -> bool {
        let now_ms = now_us as f64 / 1e3;
        let away = self.outage_ms.is_some_and(|(from, to)| (from..to).contains(&now_ms));
        away || fastrand::Rng::with_seed(self.seed ^ (request << 20)).u64(..100) < u64::from(self.failures_percent)
    }
}

/// How chunks are decoded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decoders {
    /// How many work at the same time.
    pub count: usize,
    /// Triangles that one of them decodes in a millisecond.
    pub triangles_per_ms: f64,
}

impl Default for Decoders {
    /// Three workers of a laptop's browser (docs/bench, codec).
    fn default() -> Self {
        Self { count: 3, triangles_per_ms: 4000.0 }
    }
}

/// What a flight cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Totals {
    /// Requests made, the head's not counted.
    pub requests: u64,
    /// Of them for directory pages.
    pub page_requests: u64,
    /// Bytes that came through the link, those of cancelled answers included, the head's not.
    pub bytes: u64,
    /// Bytes of answers that were cancelled on the way.
    pub wasted_bytes: u64,
    /// Requests that failed.
    pub failed: u64,
    /// Requests that were cancelled.
    pub cancelled: u64,
    /// Chunks decoded.
    pub decoded: u64,
    /// Chunks evicted.
    pub evicted: u64,
    /// Steps of the streamer.
    pub steps: u64,
}

/// How often an answer that is on its way is looked at, microseconds.
const PROGRESS_US: u64 = 50_000;

/// An answer on its way.
#[derive(Debug, Clone)]
struct Answer {
    /// Microseconds when its first byte enters the link, and when its last one is there.
    from: u64,
    to: u64,
    length: u64,
    /// Where its event lies in the queue.
    key: (u64, u64),
    /// And those that report progress.
    progress: Vec<(u64, u64)>,
}

/// A streamer, a store and a link.
pub struct Simulator<S> {
    streamer: Streamer,
    store: S,
    link: Link,
    triangles_per_ms: f64,
    queue: BTreeMap<(u64, u64), Event>,
    sequence: u64,
    open: BTreeMap<RequestId, Answer>,
    link_free: u64,
    decoder_free: Vec<u64>,
    /// Chunks whose decoding was called off.
    jobs: BTreeMap<u32, (u64, u64)>,
    log: String,
    totals: Totals,
    start_ms: f64,
}

impl<S: Store> Simulator<S> {
    /// A simulator whose clock begins with the request of the pack's head, `head_bytes` long, by the same link.
    pub fn new(streamer: Streamer, head_bytes: u64, store: S, link: Link, decoders: Decoders) -> Self {
        let start_ms = link.latency_ms + head_bytes as f64 * 8e3 / link.bits_per_second;
        Self {
            streamer,
            store,
            link,
            triangles_per_ms: decoders.triangles_per_ms,
            queue: BTreeMap::new(),
            sequence: 0,
            open: BTreeMap::new(),
            link_free: micros(start_ms),
            decoder_free: vec![0; decoders.count.max(1)],
            jobs: BTreeMap::new(),
            log: String::new(),
            totals: Totals::default(),
            start_ms,
        }
    }

    /// When the head is there, milliseconds.
    pub fn start_ms(&self) -> f64 {
        self.start_ms
    }

    /// The streamer.
    pub fn streamer(&self) -> &Streamer {
        &self.streamer
    }

    /// The streamer, to change its budgets.
    pub fn streamer_mut(&mut self) -> &mut Streamer {
        &mut self.streamer
    }

    /// The pack.
    pub fn store(&self) -> &S {
        &self.store
    }

    /// Change the link; answers that are on their way stay as they are.
    pub fn set_link(&mut self, link: Link) {
        self.link = link;
    }

    /// Every command so far, one line each: time in milliseconds, what, which.
    pub fn log(&self) -> &str {
        &self.log
    }

    /// What it cost so far.
    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Whether nothing is on its way.
    pub fn is_quiet(&self) -> bool {
        self.queue.is_empty()
    }

    /// When the next thing happens by itself, milliseconds.
    pub fn next_event_ms(&self) -> Option<f64> {
        self.queue.keys().next().map(|(at, _)| *at as f64 / 1e3)
    }

    /// Everything that happened until `now_ms`, then one step of the streamer, whose commands are carried out.
    pub fn step(&mut self, now_ms: f64, view: &View) -> Step {
        let now = micros(now_ms);
        let later = self.queue.split_off(&(now + 1, 0));
        let due: Vec<Event> = std::mem::replace(&mut self.queue, later).into_values().collect();
        for event in &due {
            self.account(event);
        }
        let step = self.streamer.step(view, now_ms, due);
        self.totals.steps += 1;
        for command in &step.commands {
            self.write_log(now, command);
            self.carry_out(now, command);
        }
        step
    }

    /// Steps at least every `frame_ms` from `from_ms` until `to_ms` along a flight; each is shown to `each` with its time.
    /// Where nothing moves and nothing is due, the steps between are left out, as a viewer does.
    pub fn fly(&mut self, flight: &Flight, from_ms: f64, to_ms: f64, frame_ms: f64, mut each: impl FnMut(f64, &Step)) {
        let mut now = from_ms.max(self.start_ms);
        while now <= to_ms {
            let step = self.step(now, &flight.at(now));
            each(now, &step);
            let next = now + frame_ms;
            let is_still = step.commands.is_empty() && flight.rests(now, next);
            now = if is_still { next.max(self.wakes_at(&step, now).min(flight.next_move(now))) } else { next };
        }
    }

    /// When something happens without the camera: an answer, or the time to ask again.
    fn wakes_at(&self, step: &Step, now: f64) -> f64 {
        let retry = if step.stats.retry_in_ms >= 0.0 { now + step.stats.retry_in_ms } else { f64::INFINITY };
        self.next_event_ms().unwrap_or(f64::INFINITY).min(retry)
    }

    fn account(&mut self, event: &Event) {
        match event {
            Event::Bytes { request, .. } | Event::PageBytes { request, .. } => {
                if let Some(answer) = self.open.remove(request) {
                    self.totals.bytes += answer.length;
                }
            }
            Event::Failed { request } => {
                self.open.remove(request);
                self.totals.failed += 1;
            }
            Event::Decoded { chunk, .. } | Event::DecodeFailed { chunk } => {
                self.jobs.remove(chunk);
                self.totals.decoded += 1;
            }
            Event::Progress { .. } | Event::GpuLost => {}
        }
    }

    fn carry_out(&mut self, now: u64, command: &Command) {
        match *command {
            Command::Fetch { request, ref ranges, kind } => self.fetch(now, request, ranges, kind),
            Command::Cancel { request } => self.cancel(now, request),
            Command::Decode { chunk, triangles, .. } => {
                let ends = self.decoder_free.iter_mut().min();
                let at = match ends {
                    Some(free) => {
                        *free = (*free).max(now) + 50 + micros(f64::from(triangles) / self.triangles_per_ms);
                        *free
                    }
                    None => now,
                };
                let event = match self.store.patches(chunk) {
                    Some(patches) => Event::Decoded { chunk, patches },
                    None => Event::DecodeFailed { chunk },
                };
                let key = self.push(at, event);
                self.jobs.insert(chunk, key);
            }
            Command::Evict { chunk } => {
                self.totals.evicted += 1;
                if let Some(key) = self.jobs.remove(&chunk) {
                    self.queue.remove(&key);
                }
            }
            Command::Upload { .. } => {}
        }
    }

    fn fetch(&mut self, now: u64, request: RequestId, ranges: &[Range<u64>], kind: FetchKind) {
        let length = length_of(ranges);
        self.totals.requests += 1;
        self.totals.page_requests += u64::from(kind == FetchKind::Pages);
        let latency = micros(self.link.latency_ms);
        let fails = self.link.fails(request, now);
        let event = match kind {
            _ if fails => Event::Failed { request },
            FetchKind::Chunks => Event::Bytes { request, length },
            FetchKind::Pages => {
                let parts = ranges.iter().map(|r| self.store.pages(r.start, r.end - r.start));
                match parts.collect::<Option<Vec<_>>>() {
                    Some(parts) => Event::PageBytes { request, bytes: parts.concat() },
                    None => Event::Failed { request },
                }
            }
        };
        let from = if fails { now + latency } else { self.link_free.max(now + latency) };
        let to = if fails { from } else { from + micros(length as f64 * 8e3 / self.link.bits_per_second) };
        if !fails {
            self.link_free = to;
        }
        let mut progress = Vec::new();
        if kind == FetchKind::Chunks && !fails {
            let mut at = from + PROGRESS_US;
            while at < to {
                let came = (length as f64 * (at - from) as f64 / (to - from) as f64) as u64;
                progress.push(self.push(at, Event::Progress { request, length: came }));
                at += PROGRESS_US;
            }
        }
        let key = self.push(to, event);
        self.open.insert(request, Answer { from, to, length, key, progress });
    }

    /// Bytes that have not arrived by now never will; answers queued behind them do not move up.
    fn cancel(&mut self, now: u64, request: RequestId) {
        let Some(answer) = self.open.remove(&request) else { return };
        self.totals.cancelled += 1;
        for key in answer.progress.iter().chain([&answer.key]) {
            self.queue.remove(key);
        }
        let share = (now.saturating_sub(answer.from)) as f64 / (answer.to - answer.from).max(1) as f64;
        let came = (answer.length as f64 * share.min(1.0)) as u64;
        self.totals.bytes += came;
        self.totals.wasted_bytes += came;
        if self.link_free == answer.to {
            self.link_free = answer.from.max(now); // It was the last one: the link is free.
        }
    }

    fn push(&mut self, at: u64, event: Event) -> (u64, u64) {
        self.sequence += 1;
        self.queue.insert((at, self.sequence), event);
        (at, self.sequence)
    }

    fn write_log(&mut self, now: u64, command: &Command) {
        let time = format!("{}.{:03}", now / 1000, now % 1000);
        let what = match command {
            Command::Fetch { request, ranges, kind } => {
                let ranges: Vec<String> = ranges.iter().map(|r| format!("{}+{}", r.start, r.end - r.start)).collect();
                format!("fetch {request} {kind:?} {}", ranges.join(" "))
            }
            Command::Cancel { request } => format!("cancel {request}"),
            Command::Decode { chunk, request, .. } => format!("decode {chunk} of {request}"),
            Command::Upload { chunk } => format!("upload {chunk}"),
            Command::Evict { chunk } => format!("evict {chunk}"),
        };
        self.log.extend([&time, " ", &what, "\n"]);
    }
}

fn micros(ms: f64) -> u64 {
    (ms * 1e3).max(0.0) as u64
}

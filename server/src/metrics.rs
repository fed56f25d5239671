//! Figures of the running server, for `/metrics`, in the text format of Prometheus (version 0.0.4).
//!
//! Labels have few values by construction: kinds of address and status codes, never addresses of people or models.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Upper ends of the classes of durations, seconds.
const CLASSES: [f64; 10] = [0.001, 0.005, 0.02, 0.1, 0.5, 1.0, 5.0, 20.0, 60.0, 300.0];

/// Why a connection is no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Closed {
    /// By agreement.
    Ended,
    /// Its headers did not come in time.
    Headers,
    /// Anything else that went wrong on the way.
    Broken,
    /// To make room, or because the server stops.
    Evicted,
    /// Not taken at all: its address had its share.
    Refused,
}

const CLOSED: [(Closed, &str); 5] = [
    (Closed::Ended, "ended"),
    (Closed::Headers, "headers_timeout"),
    (Closed::Broken, "broken"),
    (Closed::Evicted, "evicted"),
    (Closed::Refused, "refused"),
];

/// One answer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Answered {
    pub(crate) route: &'static str,
    pub(crate) status: u16,
    pub(crate) bytes: u64,
    pub(crate) took: Duration,
    pub(crate) complete: bool,
}

/// Counters of the server.
#[derive(Debug)]
pub struct Metrics {
    started: SystemTime,
    answers: Mutex<BTreeMap<(&'static str, u16), u64>>,
    bytes: Mutex<BTreeMap<&'static str, u64>>,
    classes: [AtomicU64; CLASSES.len()],
    answered: AtomicU64,
    micros: AtomicU64,
    cut: AtomicU64,
    slow: AtomicU64,
    connected: AtomicU64,
    closed: [AtomicU64; CLOSED.len()],
}

impl Default for Metrics {
    fn default() -> Self {
        Self {
            started: SystemTime::now(),
            answers: Mutex::default(),
            bytes: Mutex::default(),
            classes: Default::default(),
            answered: AtomicU64::default(),
            micros: AtomicU64::default(),
            cut: AtomicU64::default(),
            slow: AtomicU64::default(),
            connected: AtomicU64::default(),
            closed: Default::default(),
        }
    }
}

impl Metrics {
    pub(crate) fn answered(&self, a: Answered) {
        *self.answers.lock().unwrap_or_else(PoisonError::into_inner).entry((a.route, a.status)).or_default() += 1;
        *self.bytes.lock().unwrap_or_else(PoisonError::into_inner).entry(a.route).or_default() += a.bytes;
        let seconds = a.took.as_secs_f64();
        if let Some((_, class)) = CLASSES.iter().zip(&self.classes).find(|(end, _)| seconds <= **end) {
            class.fetch_add(1, Ordering::Relaxed);
        }
        self.answered.fetch_add(1, Ordering::Relaxed);
        self.micros.fetch_add(u64::try_from(a.took.as_micros()).unwrap_or(u64::MAX), Ordering::Relaxed);
        if !a.complete {
            self.cut.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(crate) fn connected(&self) {
        self.connected.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn closed(&self, why: Closed) {
        if let Some((_, counter)) = CLOSED.iter().zip(&self.closed).find(|((w, _), _)| *w == why) {
            counter.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A client took too little for too long.
    pub(crate) fn slow(&self) {
        self.slow.fetch_add(1, Ordering::Relaxed);
    }

    /// All of it, with the number of models that are served.
    pub(crate) fn to_text(&self, models: usize) -> String {
        let mut s = String::new();
        let load = |a: &AtomicU64| a.load(Ordering::Relaxed);
        head(&mut s, "kilwa_answers_total", "counter", "Answers by kind of address and status.");
        for ((route, status), n) in self.answers.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            let _ = writeln!(s, "kilwa_answers_total{{route=\"{route}\",status=\"{status}\"}} {n}");
        }
        head(&mut s, "kilwa_answer_bytes_total", "counter", "Bytes of bodies handed to clients.");
        for (route, n) in self.bytes.lock().unwrap_or_else(PoisonError::into_inner).iter() {
            let _ = writeln!(s, "kilwa_answer_bytes_total{{route=\"{route}\"}} {n}");
        }
        head(&mut s, "kilwa_answer_seconds", "histogram", "From the request's headers to the last byte handed over.");
        let mut below = 0;
        for (end, class) in CLASSES.iter().zip(&self.classes) {
            below += load(class);
            let _ = writeln!(s, "kilwa_answer_seconds_bucket{{le=\"{end}\"}} {below}");
        }
        let answered = load(&self.answered);
        let _ = writeln!(s, "kilwa_answer_seconds_bucket{{le=\"+Inf\"}} {answered}");
        let _ = writeln!(s, "kilwa_answer_seconds_sum {}", load(&self.micros) as f64 / 1e6);
        let _ = writeln!(s, "kilwa_answer_seconds_count {answered}");
        single(
            &mut s,
            "kilwa_answers_cut_total",
            "counter",
            "Answers that ended before their last byte.",
            load(&self.cut),
        );
        single(
            &mut s,
            "kilwa_slow_readers_total",
            "counter",
            "Answers dropped because the client took too little.",
            load(&self.slow),
        );
        let (connected, gone) = (load(&self.connected), CLOSED.iter().zip(&self.closed));
        let gone: u64 = gone.filter(|((why, _), _)| *why != Closed::Refused).map(|(_, n)| load(n)).sum();
        single(&mut s, "kilwa_connections", "gauge", "Connections now.", connected.saturating_sub(gone));
        single(&mut s, "kilwa_connections_total", "counter", "Connections taken.", connected);
        head(
            &mut s,
            "kilwa_connections_closed_total",
            "counter",
            "Connections that ended, by reason; refused ones were not taken.",
        );
        for ((_, why), n) in CLOSED.iter().zip(&self.closed) {
            let _ = writeln!(s, "kilwa_connections_closed_total{{reason=\"{why}\"}} {}", load(n));
        }
        single(&mut s, "kilwa_models", "gauge", "Models served.", models as u64);
        let started = self.started.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        single(&mut s, "process_start_time_seconds", "gauge", "When the server was started.", started);
        if let Some(n) = open_files() {
            single(&mut s, "process_open_fds", "gauge", "File descriptors in use.", n);
        }
        if let Some(n) = resident() {
            single(&mut s, "process_resident_memory_bytes", "gauge", "Memory in use.", n);
        }
        s
    }
}

fn head(s: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(s, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

fn single(s: &mut String, name: &str, kind: &str, help: &str, value: u64) {
    head(s, name, kind, help);
    let _ = writeln!(s, "{name} {value}");
}

/// If the system reports it (Linux).
fn open_files() -> Option<u64> {
    Some(std::fs::read_dir("/proc/self/fd").ok()?.count() as u64)
}

fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_add_up() {
        let m = Metrics::default();
        let one = Answered { route: "pack", status: 206, bytes: 10, took: Duration::from_millis(3), complete: true };
        m.answered(one);
        m.answered(Answered { took: Duration::from_secs(1000), complete: false, ..one });
        m.connected();
        m.connected();
        m.closed(Closed::Headers);
        m.closed(Closed::Refused);
        let text = m.to_text(7);
        for line in [
            "kilwa_answers_total{route=\"pack\",status=\"206\"} 2",
            "kilwa_answer_bytes_total{route=\"pack\"} 20",
            "kilwa_answer_seconds_bucket{le=\"0.001\"} 0",
            "kilwa_answer_seconds_bucket{le=\"0.005\"} 1",
            "kilwa_answer_seconds_bucket{le=\"300\"} 1",
            "kilwa_answer_seconds_bucket{le=\"+Inf\"} 2",
            "kilwa_answer_seconds_count 2",
            "kilwa_answers_cut_total 1",
            "kilwa_connections 1",
            "kilwa_connections_closed_total{reason=\"headers_timeout\"} 1",
            "kilwa_connections_closed_total{reason=\"refused\"} 1",
            "kilwa_models 7",
        ] {
            assert!(text.lines().any(|l| l == line), "{line}\n{text}");
        }
        // Every line is a comment, or a name with a number.
        for line in text.lines().filter(|l| !l.starts_with('#')) {
            assert!(line.rsplit(' ').next().unwrap().parse::<f64>().is_ok(), "{line}");
        }
    }
}

//! Figures of the running server, for `/metrics`, in the text format of Prometheus (version 0.0.4).
//!
//! Labels have few values by construction: kinds of address and status codes, never addresses of people or models.

use prometheus::core::Collector;
use prometheus::{Histogram, HistogramOpts, IntCounter, IntCounterVec, IntGauge, Opts, Registry, TextEncoder};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Upper ends of the classes of durations, seconds.
const CLASSES: [f64; 10] = [0.001, 0.005, 0.02, 0.1, 0.5, 1.0, 5.0, 20.0, 60.0, 300.0];

/// Why a connection ended.
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
    registry: Registry,
    answers: IntCounterVec,
    bytes: IntCounterVec,
    seconds: Histogram,
    cut: IntCounter,
    slow: IntCounter,
    connections: IntGauge,
    connected: IntCounter,
    closed: IntCounterVec,
    models: IntGauge,
    open_files: IntGauge,
    resident: IntGauge,
}

impl Default for Metrics {
    fn default() -> Self {
        let r = &Registry::new();
        let seconds = "From the request's headers to the last byte handed over.";
        let seconds = HistogramOpts::new("kilwa_answer_seconds", seconds).buckets(CLASSES.to_vec());
        let closed = "Connections that ended, by reason; refused ones were not taken.";
        let metrics = Self {
            answers: counters(r, "kilwa_answers_total", "Answers by kind of address and status.", &["route", "status"]),
            bytes: counters(r, "kilwa_answer_bytes_total", "Bytes of bodies handed to clients.", &["route"]),
            seconds: registered(r, true, Histogram::with_opts(seconds)),
            cut: counter(r, "kilwa_answers_cut_total", "Answers that ended before their last byte."),
            slow: counter(r, "kilwa_slow_readers_total", "Answers dropped because the client took too little."),
            connections: gauge(r, true, "kilwa_connections", "Connections now."),
            connected: counter(r, "kilwa_connections_total", "Connections taken."),
            closed: counters(r, "kilwa_connections_closed_total", closed, &["reason"]),
            models: gauge(r, true, "kilwa_models", "Models served."),
            open_files: gauge(r, open_files().is_some(), "process_open_fds", "File descriptors in use."),
            resident: gauge(r, resident().is_some(), "process_resident_memory_bytes", "Memory in use."),
            registry: r.clone(),
        };
        for (_, reason) in CLOSED {
            metrics.closed.with_label_values(&[reason]);
        }
        let started = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
        gauge(r, true, "process_start_time_seconds", "When the server was started.").set(started.cast_signed());
        metrics
    }
}

/// A figure that is in the text, unless this system has no value for it.
fn registered<C: Collector + Clone + 'static>(registry: &Registry, has_value: bool, made: prometheus::Result<C>) -> C {
    let figure = made.expect("the names of figures and labels are valid");
    if has_value {
        registry.register(Box::new(figure.clone())).expect("each figure has a name of its own");
    }
    figure
}

fn counter(registry: &Registry, name: &str, help: &str) -> IntCounter {
    registered(registry, true, IntCounter::new(name, help))
}

fn counters(registry: &Registry, name: &str, help: &str, labels: &[&str]) -> IntCounterVec {
    registered(registry, true, IntCounterVec::new(Opts::new(name, help), labels))
}

fn gauge(registry: &Registry, has_value: bool, name: &str, help: &str) -> IntGauge {
    registered(registry, has_value, IntGauge::new(name, help))
}

impl Metrics {
    pub(crate) fn answered(&self, a: Answered) {
        self.answers.with_label_values(&[a.route, &a.status.to_string()]).inc();
        self.bytes.with_label_values(&[a.route]).inc_by(a.bytes);
        self.seconds.observe(a.took.as_secs_f64());
        if !a.complete {
            self.cut.inc();
        }
    }

    pub(crate) fn connected(&self) {
        self.connected.inc();
        self.connections.inc();
    }

    pub(crate) fn closed(&self, why: Closed) {
        if let Some((_, reason)) = CLOSED.iter().find(|(w, _)| *w == why) {
            self.closed.with_label_values(&[reason]).inc();
        }
        if why != Closed::Refused {
            self.connections.dec();
        }
    }

    /// A client took too little for too long.
    pub(crate) fn slow(&self) {
        self.slow.inc();
    }

    /// All of it, with the number of models that are served.
    pub(crate) fn to_text(&self, models: usize) -> String {
        let set = |gauge: &IntGauge, value: u64| gauge.set(i64::try_from(value).unwrap_or(i64::MAX));
        set(&self.models, models as u64);
        set(&self.open_files, open_files().unwrap_or_default());
        set(&self.resident, resident().unwrap_or_default());
        TextEncoder::new().encode_to_string(&self.registry.gather()).unwrap_or_else(|e| {
            tracing::error!("the figures for /metrics cannot be written: {e}");
            String::new()
        })
    }
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

//! Requests: what is asked for next, joining of neighbours, and when a failed part is tried again.

use crate::command::{Command, FetchKind, RequestId};
use crate::nodes::{Node, Nodes, State};
use crate::select::Wanted;
use crate::streamer::Streamer;
use kilwa_pack::PAGE_BYTES;

/// Shortest and longest wait after a failure, milliseconds.
const BACKOFF_MS: (f64, f64) = (500.0, 30_000.0);
/// Directory pages asked for at once.
const PAGES_PER_REQUEST: u32 = 16;

/// A request in flight.
#[derive(Debug, Clone)]
pub(crate) struct Request {
    pub(crate) kind: FetchKind,
    pub(crate) offset: u64,
    pub(crate) length: u64,
    /// Chunk indices, or page numbers.
    pub(crate) parts: Vec<u32>,
}

/// Failures of a directory page.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PageRetry {
    pub(crate) attempts: u32,
    pub(crate) retry_at: f64,
    pub(crate) in_flight: bool,
}

/// When to try again after `attempts` failures in a row: exponential, with jitter that depends only on `salt` and
/// the number of attempts.
pub(crate) fn retry_time(now_ms: f64, attempts: u32, salt: u64) -> f64 {
    let exponent = attempts.clamp(1, 16) - 1;
    let delay = (BACKOFF_MS.0 * f64::from(1u32 << exponent)).min(BACKOFF_MS.1);
    now_ms + delay * (0.5 + 0.5 * unit_hash(salt ^ (u64::from(attempts) << 40)))
}

/// SplitMix64 (Steele, Lea, Flood 2014), mapped to 0..1.
fn unit_hash(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) as f64 / u64::MAX as f64
}

/// Something that could be asked for.
struct Candidate {
    priority: f64,
    kind: FetchKind,
    index: u32,
}

impl Streamer {
    /// Requests of which nothing is wanted any more are cancelled.
    pub(crate) fn cancel_unwanted(&mut self, wanted: &Wanted, commands: &mut Vec<Command>) {
        let stale: Vec<RequestId> = self
            .requests
            .iter()
            .filter(|(_, r)| r.kind == FetchKind::Chunks && !r.parts.iter().any(|&c| wanted.contains(c)))
            .map(|(&id, _)| id)
            .collect();
        for request in stale {
            if let Some(r) = self.requests.remove(&request) {
                commands.push(Command::Cancel { request });
                for chunk in r.parts {
                    if self.nodes.get(chunk).is_some_and(|n| n.state == State::Requested(request)) {
                        self.release(chunk);
                    }
                }
            }
        }
    }

    /// Start decoding what lies in the head, and requests for the rest, most important first.
    pub(crate) fn schedule(&mut self, wanted: &Wanted, now_ms: f64, commands: &mut Vec<Command>) {
        let mut candidates = self.missing_pages(wanted, now_ms);
        for (&index, &priority) in &wanted.priority {
            let waits = self.nodes.get(index).is_some_and(|n| n.state == State::Absent && n.retry_at <= now_ms);
            if waits {
                candidates.push(Candidate { priority, kind: FetchKind::Chunks, index });
            }
        }
        candidates.sort_by(|a, b| {
            let pages_first = |c: &Candidate| c.kind == FetchKind::Chunks;
            b.priority.total_cmp(&a.priority).then(pages_first(a).cmp(&pages_first(b))).then(a.index.cmp(&b.index))
        });
        for candidate in candidates {
            match candidate.kind {
                FetchKind::Pages => self.request_pages(candidate.index, now_ms, commands),
                FetchKind::Chunks => {
                    let absent = self.nodes.get(candidate.index).is_some_and(|n| n.state == State::Absent);
                    if absent && !self.decode_from_head(candidate.index, wanted, commands) {
                        self.request_chunks(candidate.index, wanted, now_ms, commands);
                    }
                }
            }
        }
    }

    /// Pages that a held chunk refers to, and in the background the first page that is not known yet.
    fn missing_pages(&self, wanted: &Wanted, now_ms: f64) -> Vec<Candidate> {
        let page_count = self.header.page_count();
        if self.nodes.page_count() == page_count as usize {
            return Vec::new();
        }
        let ready = |page: u32| {
            page < page_count
                && !self.nodes.has_page(page)
                && self.page_retries.get(&page).is_none_or(|r| !r.in_flight && r.retry_at <= now_ms)
        };
        let mut priorities = std::collections::BTreeMap::<u32, f64>::new();
        if let Some(first) = (0..page_count).find(|&p| ready(p)) {
            priorities.insert(first, 0.0);
        }
        for &index in &self.held {
            let Some(&priority) = wanted.priority.get(&index) else { continue };
            for patch in self.nodes.get(index).map_or(&[][..], |n| n.patches.as_slice()) {
                let page = Nodes::page_of(patch.diamond);
                if patch.diamond < self.header.entry_count && ready(page) {
                    let best = priorities.entry(page).or_insert(priority);
                    *best = best.max(priority);
                }
            }
        }
        priorities.into_iter().map(|(index, priority)| Candidate { priority, kind: FetchKind::Pages, index }).collect()
    }

    fn request_pages(&mut self, first: u32, now_ms: f64, commands: &mut Vec<Command>) {
        let ready = |s: &Self, page: u32| {
            page < s.header.page_count()
                && !s.nodes.has_page(page)
                && s.page_retries.get(&page).is_none_or(|r| !r.in_flight && r.retry_at <= now_ms)
        };
        if !ready(self, first) || !self.may_request(PAGE_BYTES as u64) {
            return;
        }
        let mut parts = vec![first];
        // Page 0 lies apart from the others.
        while first > 0 && parts.len() < PAGES_PER_REQUEST as usize {
            let next = first + parts.len() as u32;
            let length = (parts.len() as u64 + 1) * PAGE_BYTES as u64;
            if !ready(self, next) || length > self.budgets.request_bytes || !self.may_request(length) {
                break;
            }
            parts.push(next);
        }
        for &page in &parts {
            self.page_retries.entry(page).or_default().in_flight = true;
        }
        let (offset, _) = self.header.page_range(first);
        let length = parts.len() as u64 * PAGE_BYTES as u64;
        self.send(Request { kind: FetchKind::Pages, offset, length, parts }, commands);
    }

    /// Decode a chunk that lies in the head; whether it does.
    fn decode_from_head(&mut self, index: u32, wanted: &Wanted, commands: &mut Vec<Command>) -> bool {
        let Some(node) = self.nodes.get(index) else { return false };
        let end = node.entry.offset.saturating_add(u64::from(node.entry.encoded_bytes));
        if end > self.head_bytes || node.attempts > 0 {
            return false; // After a failure the head itself is suspected: ask for the range again.
        }
        if self.hold(index, State::Decoding, wanted, commands) {
            let offset = self.nodes.get(index).map_or(0, |n| n.entry.offset);
            self.push_decode(index, crate::HEAD_REQUEST, offset, commands);
        }
        true
    }

    /// Ask for a chunk and those wanted ones that follow or precede it in the file without a gap.
    fn request_chunks(&mut self, index: u32, wanted: &Wanted, now_ms: f64, commands: &mut Vec<Command>) {
        let Some((mut start, mut end)) = self.range(index) else { return };
        if !self.may_request(end - start) || !self.hold(index, State::Requested(self.next_request), wanted, commands) {
            return;
        }
        let alone = self.nodes.get(index).is_some_and(|n| n.attempts > 0);
        let mut parts = vec![index];
        for forward in [true, false] {
            let mut at = index;
            while let Some(next) = if forward { at.checked_add(1) } else { at.checked_sub(1) } {
                let Some((from, to)) = self.range(next).filter(|_| !alone && self.may_join(next, wanted, now_ms))
                else {
                    break;
                };
                let touches = if forward { from == end } else { to == start };
                let length = (end - start).saturating_add(to - from);
                if !touches
                    || length > self.budgets.request_bytes
                    || !self.may_request(length)
                    || !self.hold(next, State::Requested(self.next_request), wanted, commands)
                {
                    break;
                }
                (start, end, at) = (start.min(from), end.max(to), next);
                parts.push(next);
            }
        }
        parts.sort_unstable();
        self.send(Request { kind: FetchKind::Chunks, offset: start, length: end - start, parts }, commands);
    }

    /// Whether a chunk may be asked for together with a neighbour: wanted, and not suspected of being damaged.
    fn may_join(&self, index: u32, wanted: &Wanted, now_ms: f64) -> bool {
        let idle = |n: &Node| n.state == State::Absent && n.attempts == 0 && n.retry_at <= now_ms;
        wanted.contains(index) && self.nodes.get(index).is_some_and(idle)
    }

    fn range(&self, index: u32) -> Option<(u64, u64)> {
        let entry = &self.nodes.get(index)?.entry;
        Some((entry.offset, entry.offset.checked_add(u64::from(entry.encoded_bytes))?))
    }

    /// Whether another request of this length keeps the network budgets; a first one always may.
    fn may_request(&self, length: u64) -> bool {
        let requests = self.requests.len();
        let nothing = requests == 0 && self.decoding_bytes == 0;
        nothing
            || (requests < self.budgets.requests
                && self.bytes_in_flight().saturating_add(length) <= self.budgets.bytes_in_flight)
    }

    fn send(&mut self, r: Request, commands: &mut Vec<Command>) {
        let request = self.next_request;
        self.next_request += 1;
        self.requests_made += 1;
        commands.push(Command::Fetch { request, offset: r.offset, length: r.length, kind: r.kind });
        self.requests.insert(request, r);
    }

    /// Bytes asked for and not answered, and bytes being decoded.
    pub(crate) fn bytes_in_flight(&self) -> u64 {
        self.requests.values().map(|r| r.length).sum::<u64>() + self.decoding_bytes
    }
}

//! Requests: what is asked for next, joining of neighbours, and when a failed part is tried again.

use crate::command::{Command, FetchKind, RequestId, length_of};
use crate::nodes::{Node, Nodes, State};
use crate::select::{Rank, Wanted, sorted};
use crate::streamer::Streamer;
use kilwa_pack::PAGE_BYTES;
use std::collections::BTreeMap;
use std::ops::Range;

/// Shortest and longest wait after a failure, milliseconds.
const BACKOFF_MS: (f64, f64) = (500.0, 30_000.0);
/// Directory pages asked for at once.
const PAGES_PER_REQUEST: u32 = 16;
/// Up to this many pages, the whole directory is loaded once the picture is complete, so that a flight never waits for it.
const WHOLE_DIRECTORY: u32 = 64;
/// Pages that are asked for beyond the needed ones: those that the next levels need follow soon.
const READ_AHEAD: u32 = 1;
/// Bytes between two wanted parts that are fetched and thrown away to save a request. Measured in docs/bench: decisions 19 and 23.
const GAP_BYTES: u64 = 16 << 10;
/// While much of the picture is missing, a gap may be this part of it, up to [`WIDE_GAP_BYTES`]: it costs the same share of the time.
const GAP_PART: u64 = 88;
const WIDE_GAP_BYTES: u64 = 32 << 10;
/// Some hosts answer so many requests a minute and no more (docs/bench/2026-11-27-hosts.md): where the missing chunks lie in more stretches than this,
/// wider gaps are read through, the narrowest first...
const STRETCHES: usize = 12;
/// ... while all of them together are at most this part of the missing bytes.
const WASTE_PART: u64 = 3;
/// A chunk right beside those that are asked for comes along if it is wanted at all and has at most so many bytes: later it would need a request of its own.
const SMALL_BYTES: u64 = 12 << 10;
/// A stretch shorter than this waits for directory pages that are on their way: the chunks that they name may lie beside it.
const SHORT_BYTES: u64 = 64 << 10;
/// All gaps of a request together: so many times one gap...
const GAPS: u64 = 4;
/// ... or this part of the bytes that are wanted.
const GAPS_PART: u64 = 8;

/// A request in flight.
#[derive(Debug, Clone)]
pub(crate) struct Request {
    pub(crate) kind: FetchKind,
    /// What it asks for, in the order of the answer.
    pub(crate) ranges: Vec<Range<u64>>,
    /// Chunk indices, or page numbers: these in the order of the answer.
    pub(crate) parts: Vec<u32>,
}

impl Request {
    /// Bytes of the answer.
    pub(crate) fn length(&self) -> u64 {
        length_of(&self.ranges)
    }

    /// Where in the answer the byte `at` of the file is.
    pub(crate) fn place(&self, at: u64) -> Option<u64> {
        let mut before = 0;
        for range in &self.ranges {
            if range.contains(&at) {
                return Some(before + at - range.start);
            }
            before += range.end - range.start;
        }
        None
    }
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
    let mut jitter = fastrand::Rng::with_seed(salt ^ (u64::from(attempts) << 40));
    now_ms + delay * (0.5 + 0.5 * jitter.f64())
}

/// How the chunks of a step are joined into requests.
#[derive(Clone, Copy)]
struct Joining {
    /// Bytes that are read for nothing at most between two wanted chunks.
    widest: u64,
    /// Shorter stretches wait.
    shortest: u64,
}

/// Requests of this step that take more, where the server takes several ranges in one.
#[derive(Default)]
struct Growing {
    pages: Option<RequestId>,
    /// And whether the picture needs what they ask for.
    chunks: Option<(RequestId, bool)>,
}

/// Something that could be asked for.
struct Candidate {
    rank: Rank,
    kind: FetchKind,
    index: u32,
}

impl Streamer {
    /// Requests that are no longer wanted at all are cancelled.
    pub(crate) fn cancel_unwanted(&mut self, wanted: &Wanted, commands: &mut Vec<Command>) {
        let stale: Vec<RequestId> = self
            .requests
            .iter()
            .filter(|(_, r)| r.kind == FetchKind::Chunks && !r.parts.iter().any(|&c| wanted.contains(&self.nodes, c)))
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

    /// Start decoding what lies in the head, and requests for the rest, most urgent first.
    pub(crate) fn schedule(&mut self, wanted: &Wanted, now_ms: f64, commands: &mut Vec<Command>) {
        let mut needed = self.needed_pages(wanted);
        self.pages_cut_off = needed.iter().any(|(&page, rank)| rank.visible && !self.is_page_there(page));
        needed.retain(|&page, _| self.is_page_there(page));
        self.pages_missing = needed.len();
        let mut candidates: Vec<Candidate> = needed
            .iter()
            .filter(|&(&page, _)| self.is_page_ready(page, now_ms))
            .map(|(&index, &rank)| Candidate { rank, kind: FetchKind::Pages, index })
            .collect();
        for &(index, rank) in &wanted.missing {
            let waits = self.nodes.get(index).is_some_and(|n| n.state == State::Absent && n.retry_at <= now_ms);
            if waits {
                candidates.push(Candidate {
                    rank: wanted.urgency(&self.nodes, index, rank),
                    kind: FetchKind::Chunks,
                    index,
                });
            }
        }
        // While something in the picture is on its way, what it shows next is not known yet: the link is kept free for it.
        if self.waits_for_visible(wanted, &needed, now_ms) {
            candidates.retain(|c| c.rank.visible || self.is_in_head(c));
        }
        let joining = self.joining(wanted, &needed, now_ms);
        // Pages come before chunks of the same rank.
        let keys =
            candidates.iter().map(|c| c.rank.key(u64::from(c.kind == FetchKind::Chunks) << 32 | u64::from(c.index)));
        let mut growing = Growing::default();
        for key in sorted(keys) {
            let index = key as u32;
            if key >> 32 & 1 == 0 {
                self.request_pages(index, &needed, now_ms, &mut growing, commands);
            } else if self.nodes.get(index).is_some_and(|n| n.state == State::Absent)
                && !self.decode_from_head(index, wanted, commands)
            {
                self.request_chunks(index, wanted, now_ms, joining, &mut growing, commands);
            }
        }
    }

    fn is_in_head(&self, candidate: &Candidate) -> bool {
        let end = self.range(candidate.index).map_or(u64::MAX, |(_, end)| end);
        candidate.kind == FetchKind::Chunks && end <= self.head_bytes
    }

    /// Whether a visible part is being asked for, on its way, being decoded or uploaded; one that failed and has to wait does not count.
    fn waits_for_visible(&self, wanted: &Wanted, needed: &BTreeMap<u32, Rank>, now_ms: f64) -> bool {
        let chunks = wanted.missing.iter().map(|(i, _)| *i).filter(|&i| wanted.is_visible(&self.nodes, i));
        let chunks = chunks.filter_map(|i| self.nodes.get(i));
        let mut waiting = chunks.filter(|n| match n.state {
            State::Requested(_) | State::Decoding | State::Decoded => true,
            State::Absent => n.retry_at <= now_ms,
            State::Resident => false,
        });
        waiting.next().is_some() || self.waits_for_pages(needed, now_ms)
    }

    /// Whether a page that the picture needs is being asked for or on its way.
    fn waits_for_pages(&self, needed: &BTreeMap<u32, Rank>, now_ms: f64) -> bool {
        needed.iter().any(|(&page, rank)| {
            rank.visible
                && (self.is_page_ready(page, now_ms) || self.page_retries.get(&page).is_some_and(|r| r.in_flight))
        })
    }

    /// Unknown pages with children of a wanted chunk that may be wanted, too, if the chunk is held or the directory lists them; once there are
    /// none of these and nothing else is missing, all unknown pages of a directory that is not large.
    fn needed_pages(&self, wanted: &Wanted) -> BTreeMap<u32, Rank> {
        let page_count = self.header.page_count();
        let mut needed = BTreeMap::<u32, Rank>::new();
        if self.nodes.page_count() == page_count as usize {
            return needed;
        }
        for (index, rank) in wanted.ranks.iter() {
            let Some(node) = self.nodes.get(index) else { continue };
            if !self.nodes.lacks_children(index) || !wanted.may_want_below(index, &self.nodes) {
                continue;
            }
            let of_patches = node.patches.iter().map(|p| p.diamond).filter(|&d| d < self.header.entry_count);
            let of_patches = of_patches.map(Nodes::page_of).filter(|&page| !self.nodes.has_page(page));
            let listed = self.nodes.pages_of_children(index).filter(|&page| page < page_count);
            for page in of_patches.chain(listed) {
                let best = needed.entry(page).or_insert(rank);
                if rank.total_cmp(best).is_gt() {
                    *best = rank;
                }
            }
        }
        if wanted.missing.is_empty() && needed.is_empty() && page_count <= WHOLE_DIRECTORY {
            let rank = Rank { visible: false, priority: 0.0 };
            needed.extend((0..page_count).filter(|&p| !self.nodes.has_page(p)).map(|p| (p, rank)));
        }
        needed
    }

    /// Whether a page lies before the end of the file.
    fn is_page_there(&self, page: u32) -> bool {
        let (offset, length) = self.header.page_range(page);
        self.nodes.is_there(offset.saturating_add(length))
    }

    fn is_page_ready(&self, page: u32, now_ms: f64) -> bool {
        let idle = |r: &PageRetry| !r.in_flight && r.retry_at <= now_ms;
        page < self.header.page_count()
            && self.is_page_there(page)
            && !self.nodes.has_page(page)
            && self.page_retries.get(&page).is_none_or(idle)
    }

    /// Ask for a page and the needed ones next to it; one that lies between two of them comes along.
    fn request_pages(
        &mut self,
        first: u32,
        needed: &BTreeMap<u32, Rank>,
        now_ms: f64,
        growing: &mut Growing,
        commands: &mut Vec<Command>,
    ) {
        let ready = |s: &Self, page: u32| s.is_page_ready(page, now_ms);
        let joined = growing.pages.filter(|&id| self.may_grow(id, PAGE_BYTES as u64));
        if !ready(self, first) || joined.is_none() && !self.may_request(PAGE_BYTES as u64) {
            return;
        }
        let (mut from, mut to) = (first, first);
        let fits = |s: &Self, from: u32, to: u32| {
            let count = to - from + 1;
            let length = u64::from(count) * PAGE_BYTES as u64;
            count <= PAGES_PER_REQUEST && s.fits(joined, length)
        };
        // Page 0 lies apart from the others.
        let neighbours = if first > 0 { PAGES_PER_REQUEST } else { 0 };
        for _ in 0..neighbours {
            let wanted = |s: &Self, page: u32| needed.contains_key(&page) && ready(s, page);
            let forward = if wanted(self, to + 1) {
                to + 1
            } else if self.budgets.ranges == 1 && ready(self, to + 1) && wanted(self, to + 2) {
                to + 2
            } else {
                to
            };
            let backward = if from > 1 && wanted(self, from - 1) { from - 1 } else { from };
            if forward > to && fits(self, from, forward) {
                to = forward;
            } else if backward < from && fits(self, backward, to) {
                from = backward;
            } else {
                break;
            }
        }
        for _ in 0..if first > 0 { READ_AHEAD } else { 0 } {
            if ready(self, to + 1) && fits(self, from, to + 1) {
                to += 1;
            }
        }
        let parts: Vec<u32> = (from..=to).collect();
        for &page in &parts {
            self.page_retries.entry(page).or_default().in_flight = true;
        }
        let (offset, _) = self.header.page_range(from);
        let range = offset..offset + parts.len() as u64 * PAGE_BYTES as u64;
        growing.pages = Some(self.send(joined, FetchKind::Pages, range, parts, commands));
    }

    /// Decode a chunk that lies in the head; whether it does.
    fn decode_from_head(&mut self, index: u32, wanted: &Wanted, commands: &mut Vec<Command>) -> bool {
        let Some(node) = self.nodes.get(index) else { return false };
        if node.end() > self.head_bytes || node.damaged {
            return false; // After a failure the head itself is suspected: ask for the range again.
        }
        if self.hold(index, State::Decoding, wanted, commands) {
            let offset = self.nodes.get(index).map_or(0, |n| n.entry.offset);
            self.push_decode(index, crate::HEAD_REQUEST, offset, commands);
        }
        true
    }

    /// Ask for a chunk and those as urgent ones that follow or precede it in the file, over small gaps.
    fn request_chunks(
        &mut self,
        index: u32,
        wanted: &Wanted,
        now_ms: f64,
        joining: Joining,
        growing: &mut Growing,
        commands: &mut Vec<Command>,
    ) {
        let Some((mut start, mut end)) = self.range(index) else { return };
        let alone = self.nodes.get(index).is_some_and(|n| n.damaged);
        let is_visible = wanted.is_visible(&self.nodes, index);
        let is_like =
            |&(id, visible): &(RequestId, bool)| !alone && visible == is_visible && self.may_grow(id, end - start);
        let joined = growing.chunks.filter(is_like).map(|(id, _)| id);
        let widest = joining.widest;
        if joined.is_none() && !self.may_request(end - start)
            || !alone && index > 0 && self.is_short(index, wanted, now_ms, is_visible, joining)
        {
            return;
        }
        let id = joined.unwrap_or(self.next_request);
        if !self.hold(index, State::Requested(id), wanted, commands) {
            return;
        }
        let mut parts = vec![index];
        let mut useful = end - start;
        let ways: &[bool] = if alone { &[] } else { &[true, false] };
        for &forward in ways {
            let mut at = index;
            while let Some(next) = self.next_in_file(at, forward, wanted, now_ms, is_visible, widest) {
                let Some((from, to)) = self.range(next) else { break };
                let (new_start, new_end) = (start.min(from), end.max(to));
                let length = new_end - new_start;
                let gaps = length.saturating_sub(useful + (to - from));
                if gaps > (GAPS * widest).max(useful / GAPS_PART)
                    || !self.fits(joined, length)
                    || !self.hold(next, State::Requested(id), wanted, commands)
                {
                    break;
                }
                (start, end) = (new_start, new_end);
                let gap = at.min(next) + 1..at.max(next);
                at = next;
                useful += to - from;
                parts.push(next);
                // The chunks in the gap are fetched anyway: where they are wanted beside the picture, they are kept.
                for between in gap {
                    let is_kept = self.may_join(between, wanted, now_ms)
                        && self.hold(between, State::Requested(id), wanted, commands);
                    if is_kept {
                        parts.push(between);
                    }
                }
            }
        }
        parts.sort_unstable();
        let id = self.send(joined, FetchKind::Chunks, start..end, parts, commands);
        growing.chunks = (!alone).then_some((id, is_visible));
    }

    /// How this step joins chunks.
    fn joining(&mut self, wanted: &Wanted, needed: &BTreeMap<u32, Rank>, now_ms: f64) -> Joining {
        if self.budgets.ranges > 1 {
            return Joining { widest: 0, shortest: 0 }; // Another range costs less than any gap.
        }
        // While the camera rests, gaps stay as wide as they were: part of the stretches is on its way, and the others are not to be split again.
        let view = *wanted.view();
        let before = self.widest_gap.filter(|(of, _)| *of == view).map_or(0, |(_, widest)| widest);
        let widest = self.widest_gap(wanted, before);
        self.widest_gap = Some((view, widest));
        let shortest = if self.waits_for_pages(needed, now_ms) { SHORT_BYTES } else { 0 };
        Joining { widest, shortest }
    }

    /// Bytes that are read for nothing at most between two wanted chunks, and at least `before`: by what the picture still needs.
    fn widest_gap(&self, wanted: &Wanted, before: u64) -> u64 {
        let (mut missing, mut end, mut gaps) = (0, None, Vec::new());
        // In order of the file.
        for &(index, _) in wanted.missing.iter().filter(|(i, _)| wanted.is_visible(&self.nodes, *i)) {
            let waits = |n: &&Node| matches!(n.state, State::Absent | State::Requested(_));
            let Some(node) = self.nodes.get(index).filter(waits) else { continue };
            missing += u64::from(node.entry.encoded_bytes);
            if node.state == State::Absent {
                let last = end.replace(node.end());
                gaps.extend(last.map(|last| u128::from(node.entry.offset.saturating_sub(last))));
            }
        }
        let mut widest = (missing / GAP_PART).clamp(GAP_BYTES, WIDE_GAP_BYTES).max(before);
        let (mut stretches, mut waste) = (gaps.len() + 1, 0);
        for gap in sorted(gaps.into_iter()).map(|gap| gap as u64) {
            waste += gap;
            if gap > widest {
                if stretches <= STRETCHES || waste > missing / WASTE_PART {
                    break;
                }
                widest = gap;
            }
            stretches -= 1;
        }
        widest
    }

    /// Whether the chunks that may be asked for together with this one lie in fewer bytes than a request is sent for now.
    fn is_short(&self, index: u32, wanted: &Wanted, now_ms: f64, visible: bool, joining: Joining) -> bool {
        let Some((mut start, mut end)) = self.range(index) else { return false };
        for forward in [true, false] {
            let mut at = index;
            while end - start < joining.shortest {
                let next = self.next_in_file(at, forward, wanted, now_ms, visible, joining.widest);
                let Some((next, (from, to))) = next.and_then(|next| Some((next, self.range(next)?))) else { break };
                (at, start, end) = (next, start.min(from), end.max(to));
            }
        }
        end - start < joining.shortest
    }

    /// The next chunk after (or before) `at` that may be asked for together with it, not farther than a gap.
    fn next_in_file(
        &self,
        at: u32,
        forward: bool,
        wanted: &Wanted,
        now_ms: f64,
        visible: bool,
        widest: u64,
    ) -> Option<u32> {
        let (from, to) = self.range(at)?;
        let mut next = at;
        loop {
            next = if forward { next.checked_add(1)? } else { next.checked_sub(1)? };
            let (next_from, next_to) = self.range(next)?;
            let gap = if forward { next_from.checked_sub(to)? } else { from.checked_sub(next_to)? };
            if gap > widest {
                return None;
            }
            let is_small = gap == 0 && widest > 0 && next_to - next_from <= SMALL_BYTES;
            let is_alike = is_small || wanted.is_visible(&self.nodes, next) >= visible;
            if is_alike && self.may_join(next, wanted, now_ms) {
                return Some(next);
            }
        }
    }

    /// Whether a chunk may be asked for together with a neighbour: wanted, and not suspected of being damaged.
    fn may_join(&self, index: u32, wanted: &Wanted, now_ms: f64) -> bool {
        let idle = |n: &Node| n.state == State::Absent && !n.damaged && n.retry_at <= now_ms;
        wanted.contains(&self.nodes, index) && self.nodes.get(index).is_some_and(idle)
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

    /// Whether a range of this length keeps the budgets, in a request of this step or as a new one.
    fn fits(&self, joined: Option<RequestId>, length: u64) -> bool {
        match joined {
            Some(id) => self.may_grow(id, length),
            None => length <= self.budgets.request_bytes && self.may_request(length),
        }
    }

    /// Whether a request of this step may ask for so many more bytes elsewhere.
    fn may_grow(&self, id: RequestId, length: u64) -> bool {
        let in_flight = self.bytes_in_flight().saturating_add(length);
        let takes = |r: &Request| {
            r.ranges.len() < self.budgets.ranges && r.length().saturating_add(length) <= self.budgets.request_bytes
        };
        in_flight <= self.budgets.bytes_in_flight && self.requests.get(&id).is_some_and(takes)
    }

    /// Ask for a range, in a request of this step or in a new one; which.
    fn send(
        &mut self,
        joined: Option<RequestId>,
        kind: FetchKind,
        range: Range<u64>,
        parts: Vec<u32>,
        commands: &mut Vec<Command>,
    ) -> RequestId {
        let begun = joined.and_then(|id| {
            let command = commands.iter_mut().rev().find_map(|c| match c {
                Command::Fetch { request, ranges, .. } if *request == id => Some(ranges),
                _ => None,
            });
            command.zip(self.requests.get_mut(&id)).map(|(ranges, r)| (id, ranges, r))
        });
        if let Some((id, ranges, r)) = begun {
            ranges.push(range.clone());
            r.ranges.push(range);
            r.parts.extend(parts);
            return id;
        }
        let request = self.next_request;
        self.next_request += 1;
        self.requests_made += 1;
        commands.push(Command::Fetch { request, ranges: vec![range.clone()], kind });
        self.requests.insert(request, Request { kind, ranges: vec![range], parts });
        request
    }

    /// Bytes asked for and not answered, and bytes being decoded.
    pub(crate) fn bytes_in_flight(&self) -> u64 {
        self.requests.values().map(Request::length).sum::<u64>() + self.decoding_bytes
    }
}

//! The state machine itself: events in, commands and a cut out.

use crate::command::{Budgets, Command, Event, RequestId, Stats, Step};
use crate::draw::Lists;
use crate::fetch::{PageRetry, Request, retry_time};
use crate::nodes::{Nodes, State};
use crate::predict::Predictor;
use crate::select::{self, Cameras, Holding, Looks, Wanted, bits, sorted};
use crate::view::{Lens, View};
use kilwa_pack::{DirectoryEntry, Head, Header, NO_DIAMOND, PAGE_BYTES, PatchRange, directory};
use std::collections::{BTreeMap, BTreeSet};

/// When a request that failed is tried again at the latest once another one succeeds, milliseconds.
const SOON_MS: f64 = 250.0;

/// The result of a step that requested nothing, reused for steps with the same view.
#[derive(Debug, Clone)]
struct Rest {
    view: View,
    predicted: Option<View>,
    step: Step,
    /// Whether a second step had the same result; then all further ones will, too.
    is_repeated: bool,
}

/// Streams one pack. See the crate's documentation.
#[derive(Debug, Clone)]
pub struct Streamer {
    pub(crate) header: Header,
    pub(crate) head_bytes: u64,
    pub(crate) budgets: Budgets,
    pub(crate) nodes: Nodes,
    /// Chunks that are not absent.
    pub(crate) held: BTreeSet<u32>,
    pub(crate) requests: BTreeMap<RequestId, Request>,
    pub(crate) next_request: RequestId,
    pub(crate) page_retries: BTreeMap<u32, PageRetry>,
    /// The widest gap that requests of the last step were joined over, and its view.
    pub(crate) widest_gap: Option<(View, u64)>,
    /// A request failed since the last answer that came.
    network_failed: bool,
    pub(crate) requests_made: u64,
    /// Encoded bytes of the chunks being decoded.
    pub(crate) decoding_bytes: u64,
    pinned: Vec<u32>,
    /// The cut of the last step.
    pub(crate) refined: Vec<u32>,
    pub(crate) lists: Lists,
    /// Of the last step.
    looks: Option<Looks>,
    /// As of the last step, unless something has changed since.
    rest: Option<Rest>,
    predictor: Predictor,
    /// Where the camera goes, as of the last frame.
    predicted: Option<View>,
    /// Pages that the view waits for, as of the last step.
    pub(crate) pages_missing: usize,
    /// The view waits for a page beyond the end of a file that is cut off.
    pub(crate) pages_cut_off: bool,
    gpu_bytes: u64,
    cpu_bytes: u64,
    bytes_received: u64,
    failures: u64,
}

impl Streamer {
    /// A streamer for the pack whose head is `head` ([`kilwa_pack::parse_head`]), of which the shell has the first
    /// `head_bytes` bytes: chunks inside them need no request.
    pub fn new(head: &Head, head_bytes: u64, budgets: Budgets) -> Self {
        let mut nodes = Nodes::default();
        nodes.add_page(0, head.entries.clone());
        let mut streamer = Self {
            header: head.header.clone(),
            head_bytes,
            budgets,
            nodes,
            held: BTreeSet::new(),
            requests: BTreeMap::new(),
            next_request: crate::HEAD_REQUEST + 1,
            page_retries: BTreeMap::new(),
            widest_gap: None,
            network_failed: false,
            requests_made: 0,
            decoding_bytes: 0,
            pinned: Vec::new(),
            refined: Vec::new(),
            lists: Lists::default(),
            looks: None,
            rest: None,
            predictor: Predictor::default(),
            predicted: None,
            pages_missing: 0,
            pages_cut_off: false,
            gpu_bytes: 0,
            cpu_bytes: 0,
            bytes_received: 0,
            failures: 0,
        };
        streamer.set_budgets(budgets);
        streamer
    }

    /// The pack's header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The budgets in force.
    pub fn budgets(&self) -> &Budgets {
        &self.budgets
    }

    /// Change the budgets; what is too much goes in the next step.
    pub fn set_budgets(&mut self, budgets: Budgets) {
        self.budgets = budgets;
        self.rest = None;
        self.pinned = select::pinned(&self.nodes, &budgets, self.header.attributes.scalars);
    }

    /// The file has only so many bytes, fewer than its header states: what is there is shown, and nothing beyond is asked for.
    pub fn set_cut_off(&mut self, file_bytes: u64) {
        self.nodes.cut_off = Some(file_bytes);
        self.set_budgets(self.budgets);
    }

    /// Change how many chunks a step uploads at most.
    pub fn set_uploads(&mut self, uploads: usize) {
        self.budgets.uploads = uploads;
    }

    /// A directory entry, where its page is known.
    pub fn entry(&self, index: u32) -> Option<&DirectoryEntry> {
        self.nodes.get(index).map(|n| &n.entry)
    }

    /// The patches of a chunk, where it is decoded.
    pub fn patches(&self, index: u32) -> Option<&[PatchRange]> {
        self.nodes.get(index).filter(|n| !n.patches.is_empty()).map(|n| n.patches.as_slice())
    }

    /// Whether a chunk is in GPU memory.
    pub fn is_resident(&self, index: u32) -> bool {
        self.nodes.get(index).is_some_and(|n| n.state == State::Resident)
    }

    /// Take in what happened, decide, and say what to do and what to draw. `now_ms` is any clock that does not run
    /// backwards.
    pub fn step(&mut self, view: &View, now_ms: f64, events: impl IntoIterator<Item = Event>) -> Step {
        self.predicted = self.predictor.update(now_ms, view);
        self.advance(view, now_ms, events, self.budgets.uploads.max(1))
    }

    /// A step between two frames, for the time in which nothing can be drawn: it asks for what is missing and has it decoded, but uploads
    /// nothing, and takes the camera to go where the last [`Streamer::step`] saw it going.
    pub fn attend(&mut self, view: &View, now_ms: f64, events: impl IntoIterator<Item = Event>) -> Step {
        self.advance(view, now_ms, events, 0)
    }

    fn advance(&mut self, view: &View, now_ms: f64, events: impl IntoIterator<Item = Event>, uploads: usize) -> Step {
        let mut arrived = Vec::new();
        let mut rest = self.rest.take().filter(|r| r.view == *view && r.predicted == self.predicted);
        for event in events {
            rest = None;
            self.apply(event, now_ms, &mut arrived);
        }
        if let Some(rest) = rest.take_if(|r| r.is_repeated) {
            return self.rest.insert(rest).step.clone();
        }
        let step = self.decide(view, now_ms, arrived, uploads);
        if step.commands.is_empty() && step.stats.settled && step.stats.retry_in_ms < 0.0 {
            let is_repeated = rest.is_some_and(|r| r.step == step);
            self.rest = Some(Rest { view: *view, predicted: self.predicted, step: step.clone(), is_repeated });
        }
        step
    }

    fn decide(&mut self, view: &View, now_ms: f64, arrived: Vec<(u32, RequestId, u64)>, uploads: usize) -> Step {
        let mut commands = Vec::new();
        let step = self.header.lattice.step();
        let cameras = Cameras { now: Lens::new(view), predicted: self.predicted.as_ref().map(Lens::new), step };
        let mut looks = Looks::renew(self.looks.take(), &cameras.now, step, &self.nodes);
        let holding = Holding {
            nodes: &self.nodes,
            budgets: &self.budgets,
            scalars: self.header.attributes.scalars,
            pinned: &self.pinned,
            head_bytes: self.head_bytes,
        };
        let wanted = select::wanted(&holding, &cameras, &mut looks);
        // Answers first: their decoding frees no memory, but the bytes are here now.
        for (chunk, request, offset) in arrived {
            self.push_decode(chunk, request, offset, &mut commands);
        }
        self.cancel_unwanted(&wanted, &mut commands);
        self.make_room(0, 0, &wanted, &mut commands);
        self.schedule(&wanted, now_ms, &mut commands);
        self.upload(&wanted, uploads, &mut commands);
        self.refine(&mut looks);
        let (draw, quality) = self.cut(&mut looks);
        self.looks = Some(looks);
        let mut stats = self.stats(&wanted, now_ms);
        stats.patches_drawn = draw.len() as u32;
        stats.triangles_drawn = quality.triangles;
        stats.worst_pixel_error = quality.pixels;
        stats.worst_error_metres = quality.metres;
        stats.chunks_shown = quality.chunks;
        stats.bytes_shown = quality.bytes;
        stats.target_reached = quality.pixels <= view.target_pixels;
        Step { commands, draw, stats }
    }

    fn apply(&mut self, event: Event, now_ms: f64, arrived: &mut Vec<(u32, RequestId, u64)>) {
        match event {
            Event::Progress { request, length } => self.take_progress(request, length, arrived),
            Event::Bytes { request, length } => self.take_bytes(request, length, now_ms, arrived),
            Event::PageBytes { request, bytes } => self.take_pages(request, &bytes, now_ms),
            Event::Failed { request } => {
                if let Some(r) = self.requests.remove(&request) {
                    self.fail_request(request, &r, now_ms);
                }
            }
            Event::Decoded { chunk, patches } => self.take_decoded(chunk, patches, now_ms),
            Event::DecodeFailed { chunk } => {
                if self.nodes.get(chunk).is_some_and(|n| n.state == State::Decoding) {
                    self.fail_chunk(chunk, now_ms, true);
                }
            }
            Event::GpuLost => {
                for chunk in self.held.clone() {
                    if self.nodes.get(chunk).is_some_and(|n| n.state == State::Resident) {
                        self.release(chunk);
                    }
                }
            }
        }
    }

    fn take_bytes(&mut self, request: RequestId, length: u64, now_ms: f64, arrived: &mut Vec<(u32, RequestId, u64)>) {
        let Some(r) = self.requests.remove(&request) else { return };
        self.bytes_received += length;
        if length != r.length() {
            self.fail_request(request, &r, now_ms);
            return;
        }
        self.network_works(now_ms);
        self.decode_parts(request, &r, length, arrived);
    }

    fn take_progress(&mut self, request: RequestId, length: u64, arrived: &mut Vec<(u32, RequestId, u64)>) {
        let Some(r) = self.requests.get(&request).filter(|r| r.kind == crate::FetchKind::Chunks).cloned() else {
            return;
        };
        self.decode_parts(request, &r, length, arrived);
    }

    /// Decode the chunks of a request that lie in its first `length` bytes and are still waited for.
    fn decode_parts(&mut self, request: RequestId, r: &Request, length: u64, arrived: &mut Vec<(u32, RequestId, u64)>) {
        for &chunk in &r.parts {
            let Some(node) = self.nodes.get(chunk) else { continue };
            let Some(at) = r.place(node.entry.offset) else { continue };
            let is_there = at + u64::from(node.entry.encoded_bytes) <= length;
            if is_there && node.state == State::Requested(request) {
                self.decoding_bytes += u64::from(node.entry.encoded_bytes);
                self.nodes.set_state(chunk, State::Decoding);
                arrived.push((chunk, request, at));
            }
        }
    }

    /// An answer came: what failed because of the network is tried again soon instead of waiting its time out.
    fn network_works(&mut self, now_ms: f64) {
        if !std::mem::take(&mut self.network_failed) {
            return;
        }
        for node in self.nodes.iter_mut().filter(|n| n.attempts > 0 && !n.damaged) {
            node.attempts = 1;
            node.retry_at = node.retry_at.min(now_ms + SOON_MS);
        }
        for retry in self.page_retries.values_mut().filter(|r| r.attempts > 0) {
            retry.retry_at = retry.retry_at.min(now_ms + SOON_MS);
        }
    }

    fn take_pages(&mut self, request: RequestId, bytes: &[u8], now_ms: f64) {
        let Some(r) = self.requests.remove(&request) else { return };
        self.bytes_received += bytes.len() as u64;
        for (at, &page) in r.parts.iter().enumerate() {
            let parsed = bytes
                .get(at * PAGE_BYTES..(at + 1) * PAGE_BYTES)
                .and_then(|b| directory::parse_page(b, page, self.header.entry_count).ok());
            match parsed {
                Some(entries) => {
                    self.nodes.add_page(page, entries);
                    self.page_retries.remove(&page);
                }
                None => self.fail_page(page, now_ms),
            }
        }
        self.set_budgets(self.budgets);
    }

    fn take_decoded(&mut self, chunk: u32, patches: Vec<PatchRange>, now_ms: f64) {
        let entry_count = self.header.entry_count;
        let Some(node) = self.nodes.get_mut(chunk) else { return };
        if node.state != State::Decoding {
            return;
        }
        let sound = patches.iter().all(|p| {
            let inside = p.first.checked_add(p.count).is_some_and(|end| end <= node.entry.triangles);
            inside && (p.diamond == NO_DIAMOND || (p.diamond > chunk && p.diamond < entry_count))
        });
        if !sound {
            self.fail_chunk(chunk, now_ms, true);
            return;
        }
        node.attempts = 0;
        node.damaged = false;
        node.patches = patches;
        self.decoding_bytes -= u64::from(node.entry.encoded_bytes);
        self.nodes.set_state(chunk, State::Decoded);
    }

    fn fail_request(&mut self, request: RequestId, r: &Request, now_ms: f64) {
        for &part in &r.parts {
            match r.kind {
                crate::FetchKind::Pages => self.fail_page(part, now_ms),
                crate::FetchKind::Chunks => {
                    if self.nodes.get(part).is_some_and(|n| n.state == State::Requested(request)) {
                        self.fail_chunk(part, now_ms, false);
                    }
                }
            }
        }
    }

    fn fail_page(&mut self, page: u32, now_ms: f64) {
        self.failures += 1;
        self.network_failed = true;
        let retry = self.page_retries.entry(page).or_default();
        retry.attempts = retry.attempts.saturating_add(1);
        retry.retry_at = retry_time(now_ms, retry.attempts, u64::from(page) << 32);
        retry.in_flight = false;
    }

    fn fail_chunk(&mut self, chunk: u32, now_ms: f64, damaged: bool) {
        self.failures += 1;
        self.network_failed |= !damaged;
        self.release(chunk);
        if let Some(node) = self.nodes.get_mut(chunk) {
            node.attempts = node.attempts.saturating_add(1);
            node.damaged = damaged;
            node.retry_at = retry_time(now_ms, node.attempts, u64::from(chunk));
        }
    }

    pub(crate) fn push_decode(&self, chunk: u32, request: RequestId, offset: u64, commands: &mut Vec<Command>) {
        if let Some(node) = self.nodes.get(chunk) {
            commands.push(Command::Decode {
                chunk,
                request,
                offset,
                length: node.entry.encoded_bytes,
                vertices: node.entry.vertices,
                triangles: node.entry.triangles,
                checksum: node.entry.checksum,
            });
        }
    }

    /// Commit memory for an absent chunk, evicting unwanted ones where needed; whether it fits.
    pub(crate) fn hold(&mut self, chunk: u32, state: State, wanted: &Wanted, commands: &mut Vec<Command>) -> bool {
        let scalars = self.header.attributes.scalars;
        let Some((gpu, cpu)) = self.nodes.get(chunk).map(|n| (n.gpu_bytes(), n.cpu_bytes(scalars))) else {
            return false;
        };
        if !self.make_room(gpu, cpu, wanted, commands) && chunk != 0 {
            return false;
        }
        if let Some(node) = self.nodes.get(chunk).filter(|_| state == State::Decoding) {
            self.decoding_bytes += u64::from(node.entry.encoded_bytes);
        }
        self.nodes.set_state(chunk, state);
        self.gpu_bytes += gpu;
        self.cpu_bytes += cpu;
        self.held.insert(chunk);
        true
    }

    /// Back to absent, memory given back.
    pub(crate) fn release(&mut self, chunk: u32) {
        let scalars = self.header.attributes.scalars;
        let Some(node) = self.nodes.get_mut(chunk) else { return };
        if node.state == State::Absent {
            return;
        }
        if node.state == State::Decoding {
            self.decoding_bytes -= u64::from(node.entry.encoded_bytes);
        }
        node.patches = Vec::new();
        self.gpu_bytes -= node.gpu_bytes();
        self.cpu_bytes -= node.cpu_bytes(scalars);
        self.nodes.set_state(chunk, State::Absent);
        self.held.remove(&chunk);
    }

    /// Evict what is not wanted, least important and finest first, until so many more bytes fit; whether they do.
    fn make_room(&mut self, gpu: u64, cpu: u64, wanted: &Wanted, commands: &mut Vec<Command>) -> bool {
        let fits = |s: &Self| s.gpu_bytes + gpu <= s.budgets.gpu_bytes && s.cpu_bytes + cpu <= s.budgets.cpu_bytes;
        if fits(self) {
            return true;
        }
        let victims = self.held.iter().filter(|&&i| !wanted.contains(&self.nodes, i)).filter_map(|&i| {
            let priority = wanted.raw_priority(i, self.nodes.get(i)?);
            Some(u128::from(bits(priority)) << 64 | u128::from(!i))
        });
        for chunk in sorted(victims).map(|key| !(key as u32)) {
            if fits(self) {
                return true;
            }
            let is_loaded = self.nodes.get(chunk).is_some_and(|n| !matches!(n.state, State::Requested(_)));
            self.release(chunk);
            if is_loaded {
                commands.push(Command::Evict { chunk });
            }
        }
        fits(self)
    }

    /// The most urgent of what is decoded goes into GPU memory.
    fn upload(&mut self, wanted: &Wanted, uploads: usize, commands: &mut Vec<Command>) {
        let is_decoded = |i: u32| self.nodes.get(i).is_some_and(|n| n.state == State::Decoded);
        let decoded = wanted.missing.iter().filter(|(i, _)| is_decoded(*i));
        for key in sorted(decoded.map(|(index, rank)| rank.key(u64::from(*index)))).take(uploads) {
            let chunk = key as u32;
            self.nodes.set_state(chunk, State::Resident);
            commands.push(Command::Upload { chunk });
        }
    }

    fn stats(&self, wanted: &Wanted, now_ms: f64) -> Stats {
        let mut stats = Stats {
            chunks_wanted: wanted.ranks.len() as u32,
            bytes_wanted: wanted.bytes,
            chunks_in_flight: self.nodes.on_the_way,
            chunks_resident: self.nodes.resident,
            requests_in_flight: self.requests.len() as u32,
            requests_made: self.requests_made,
            bytes_in_flight: self.bytes_in_flight(),
            pages_missing: self.pages_missing as u32,
            bytes_received: self.bytes_received,
            failures: self.failures,
            gpu_bytes: self.gpu_bytes,
            cpu_bytes: self.cpu_bytes,
            budget_limited: wanted.limited,
            cut_off: wanted.cut_off || self.pages_cut_off,
            entries_known: self.nodes.len() as u32,
            retry_in_ms: -1.0,
            ..Stats::default()
        };
        let mut retry_at = f64::INFINITY;
        let missing = wanted.missing.iter().filter_map(|(i, _)| self.nodes.get(*i));
        for node in missing.filter(|n| n.state != State::Resident) {
            stats.chunks_missing += 1;
            stats.bytes_missing += u64::from(node.entry.encoded_bytes);
            if node.state == State::Absent && node.attempts > 0 {
                retry_at = retry_at.min(node.retry_at);
            }
        }
        for retry in self.page_retries.values().filter(|r| !r.in_flight) {
            retry_at = retry_at.min(retry.retry_at);
        }
        if retry_at.is_finite() {
            stats.retry_in_ms = (retry_at - now_ms).max(0.0);
        }
        stats.settled = stats.chunks_missing == 0
            && self.requests.is_empty()
            && self.decoding_bytes == 0
            && self.pages_missing == 0;
        stats
    }
}

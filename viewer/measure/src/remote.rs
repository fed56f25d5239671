//! The finest surface of a pack whose bytes come by range, some time after they were asked for.
//!
//! Chunks are fetched once per question and kept encoded in a small [`Store`], so that picks next to each other and a section drawn again cost
//! nothing; decoded triangles are dropped at once. Chunks that lie next to each other in the file are one request. A few requests are on
//! their way at a time, in the order in which they are needed. Bytes that do not match their checksum are fetched once more, round every store, before
//! they count as damaged.

use kilwa_geometry::Aabb;
use kilwa_measure::leaves::{finest, part};
use kilwa_measure::{Failure, Leaves, Read};
use kilwa_pack::plural::counted;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{Chunk, DirectoryEntry, Index, PackError};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::future::Future;
use std::rc::Rc;

/// Bytes of encoded chunks that are kept.
pub const STORE_BYTES: usize = 48 << 20;
/// Longest request of several chunks, bytes.
const RUN_BYTES: u64 = 1 << 20;
/// Requests of a sweep that are on their way at a time.
const IN_FLIGHT: usize = 6;

/// Bytes of the file, by range.
pub trait Fetch {
    /// A request that was sent.
    type Sent: Future<Output = Result<Vec<u8>, String>>;

    /// Send a request for `offset .. offset + length`; `fresh` goes round every store on the way.
    fn send(&self, offset: u64, length: u64, fresh: bool) -> Self::Sent;

    /// So many bytes of all that is needed are there; `all` is 0 where nobody knows yet.
    fn report_progress(&self, done: u64, all: u64);
}

/// Encoded chunks, the one used longest ago dropped first; and which chunks hold nothing of the finest surface, where that is known.
#[derive(Debug, Default)]
pub struct Store {
    leafless: BTreeSet<u32>,
    chunks: BTreeMap<u32, (u64, Rc<[u8]>)>,
    held: usize,
    clock: u64,
}

impl Store {
    /// These chunks hold nothing of the finest surface: whoever says so has decoded them.
    pub fn are_leafless(&mut self, chunks: impl IntoIterator<Item = u32>) {
        self.leafless.extend(chunks);
    }

    fn get(&mut self, chunk: u32) -> Option<Rc<[u8]>> {
        self.clock += 1;
        let (used, bytes) = self.chunks.get_mut(&chunk)?;
        *used = self.clock;
        Some(Rc::clone(bytes))
    }

    fn put(&mut self, chunk: u32, bytes: Rc<[u8]>) {
        self.clock += 1;
        self.held += bytes.len();
        if let Some((_, old)) = self.chunks.insert(chunk, (self.clock, bytes)) {
            self.held -= old.len();
        }
        while self.held > STORE_BYTES {
            let oldest = self.chunks.iter().min_by_key(|(_, (used, _))| *used).map(|(chunk, _)| *chunk);
            let Some((_, old)) = oldest.and_then(|chunk| self.chunks.remove(&chunk)) else { return };
            self.held -= old.len();
        }
    }

    /// Bytes that are kept.
    pub fn held(&self) -> usize {
        self.held
    }
}

/// The surface as one question sees it.
pub struct Remote<'a, F: Fetch> {
    index: &'a Index,
    store: &'a RefCell<Store>,
    source: F,
    sent: RefCell<BTreeMap<u32, F::Sent>>,
    fetched: Cell<u64>,
}

impl<'a, F: Fetch> Remote<'a, F> {
    /// The surface of a pack.
    pub fn new(index: &'a Index, store: &'a RefCell<Store>, source: F) -> Self {
        Self { index, store, source, sent: RefCell::default(), fetched: Cell::new(0) }
    }

    /// Bytes that came for this question.
    pub fn fetched(&self) -> u64 {
        self.fetched.get()
    }

    fn entry(&self, chunk: u32) -> Result<&'a DirectoryEntry, Failure> {
        let entries = self.index.entries();
        entries
            .get(chunk as usize)
            .ok_or_else(|| Failure::Source(format!("the pack has {}", counted(entries.len(), "chunk", "chunks"))))
    }

    fn send(&self, chunk: u32) {
        let is_kept = self.store.borrow().chunks.contains_key(&chunk);
        let Ok(entry) = self.entry(chunk) else { return };
        if !is_kept {
            let send = || self.source.send(entry.offset, u64::from(entry.encoded_bytes), false);
            self.sent.borrow_mut().entry(chunk).or_insert_with(send);
        }
    }

    /// The bytes of a chunk, which match their checksum.
    async fn bytes(&self, chunk: u32) -> Result<Rc<[u8]>, Failure> {
        if let Some(bytes) = self.store.borrow_mut().get(chunk) {
            return Ok(bytes);
        }
        self.send(chunk);
        let sent = self.sent.borrow_mut().remove(&chunk);
        let bytes = match sent {
            Some(sent) => sent.await.map_err(Failure::Source)?,
            None => Vec::new(),
        };
        self.fetched.set(self.fetched.get() + bytes.len() as u64);
        self.source.report_progress(self.fetched.get(), 0);
        let bytes = self.sound(chunk, bytes.into()).await?;
        self.store.borrow_mut().put(chunk, Rc::clone(&bytes));
        Ok(bytes)
    }

    /// These bytes, or where they are damaged the same fetched once more.
    async fn sound(&self, chunk: u32, bytes: Rc<[u8]>) -> Result<Rc<[u8]>, Failure> {
        let entry = self.entry(chunk)?;
        if kilwa_pack::checksum(&bytes) == entry.checksum {
            return Ok(bytes);
        }
        let again =
            self.source.send(entry.offset, u64::from(entry.encoded_bytes), true).await.map_err(Failure::Source)?;
        self.fetched.set(self.fetched.get() + again.len() as u64);
        if kilwa_pack::checksum(&again) != entry.checksum {
            return Err(PackError::Checksum { what: format!("chunk {chunk}") }.into());
        }
        Ok(again.into())
    }

    /// Chunks that lie next to each other, not too many of them.
    fn runs(&self, wanted: &[u32]) -> VecDeque<Run> {
        let mut runs: VecDeque<Run> = VecDeque::new();
        for &chunk in wanted {
            let Ok(entry) = self.entry(chunk) else { continue };
            let length = u64::from(entry.encoded_bytes);
            let is_kept = self.store.borrow().chunks.contains_key(&chunk);
            match runs.back_mut() {
                Some(r) if !is_kept && !r.is_kept && r.offset + r.length == entry.offset && r.length < RUN_BYTES => {
                    r.chunks.push(chunk);
                    r.length += length;
                }
                _ => runs.push_back(Run { chunks: vec![chunk], offset: entry.offset, length, is_kept }),
            }
        }
        runs
    }
}

/// Chunks that lie next to each other.
struct Run {
    chunks: Vec<u32>,
    offset: u64,
    length: u64,
    is_kept: bool,
}

impl<F: Fetch> Leaves for Remote<'_, F> {
    fn index(&self) -> &Index {
        self.index
    }

    fn may_hold_leaves(&self, index: u32) -> bool {
        let is_there = self.index.entries().get(index as usize).is_some_and(|e| !e.bounds.is_empty());
        is_there && !self.store.borrow().leafless.contains(&index)
    }

    async fn chunk(&self, index: u32) -> Result<Chunk, Failure> {
        let bytes = self.bytes(index).await?;
        let chunk = decode_checked(&bytes, index, self.entry(index)?, self.index.header())?;
        if finest(&chunk).next().is_none() {
            self.store.borrow_mut().are_leafless([index]);
        }
        Ok(chunk)
    }

    fn ahead(&self, chunks: &[u32]) {
        for chunk in chunks {
            self.send(*chunk);
        }
    }

    async fn sweep<A: Send>(
        &self,
        meets: impl Fn(&Aabb) -> bool,
        empty: impl Fn() -> A + Sync,
        add: impl Fn(&mut A, &Chunk) + Sync,
        mut join: impl FnMut(A),
    ) -> Result<Read, Failure> {
        let wanted = self.wanted(meets);
        let read = Read::of(self.index, &wanted);
        // A measurement larger than the cache would only push out what is kept.
        let keep = read.bytes <= STORE_BYTES as u64 / 2;
        let mut waiting = self.runs(&wanted);
        let mut sent: VecDeque<(Run, Option<F::Sent>)> = VecDeque::new();
        let mut done = 0;
        self.source.report_progress(0, read.bytes);
        loop {
            while sent.len() < IN_FLIGHT
                && let Some(run) = waiting.pop_front()
            {
                let request = (!run.is_kept).then(|| self.source.send(run.offset, run.length, false));
                sent.push_back((run, request));
            }
            let Some((run, request)) = sent.pop_front() else { break };
            let all = match request {
                Some(request) => request.await.map_err(Failure::Source)?,
                None => Vec::new(),
            };
            self.fetched.set(self.fetched.get() + all.len() as u64);
            for chunk in run.chunks {
                let entry = self.entry(chunk)?;
                let bytes = if run.is_kept {
                    self.bytes(chunk).await?
                } else {
                    let from = (entry.offset - run.offset) as usize;
                    let bytes = all.get(from..from + entry.encoded_bytes as usize).unwrap_or_default();
                    self.sound(chunk, bytes.into()).await?
                };
                match part(&bytes, chunk, entry, self.index.header(), &empty, &add)? {
                    Some(a) => join(a),
                    None => self.store.borrow_mut().are_leafless([chunk]),
                }
                if keep && !run.is_kept {
                    self.store.borrow_mut().put(chunk, bytes);
                }
            }
            done += run.length;
            self.source.report_progress(done, read.bytes);
        }
        Ok(read)
    }
}

//! A read-ahead cache for objects that never change. A request to a store takes tens of milliseconds, however little it reads, and tasks read many
//! small pieces one after another: patches, blocks of records, bodies of chunks. So each request reads more than was asked for, and the rest is kept
//! for the next pieces.
//!
//! Memory: [`CAPACITY`] bytes, and one block for each thread that reads.

use bytes::Bytes;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Condvar, Mutex, PoisonError};

/// Size limit of the cache, bytes.
const CAPACITY: usize = 64 << 20;
/// Minimum number of bytes per request.
const BLOCK: u64 = 1 << 20;
/// The same if the piece follows one that was read before.
const NEXT_BLOCK: u64 = 4 << 20;
/// A piece follows another if it begins at most this many bytes before or after its end.
const GAP: u64 = 1 << 18;

/// The cache.
#[derive(Debug, Default)]
pub(super) struct ReadAhead {
    state: Mutex<State>,
    /// Signals that a request has succeeded or failed.
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Least recently used first.
    held: VecDeque<Block>,
    bytes: usize,
    under_way: Vec<(String, Range<u64>)>,
}

#[derive(Debug)]
struct Block {
    name: String,
    at: u64,
    bytes: Bytes,
}

impl Block {
    fn end(&self) -> u64 {
        self.at + self.bytes.len() as u64
    }

    /// A piece of the block.
    fn piece(&self, name: &str, range: &Range<u64>) -> Option<Bytes> {
        let is_inside = self.name == name && self.at <= range.start && range.end <= self.end();
        is_inside.then(|| self.bytes.slice((range.start - self.at) as usize..(range.end - self.at) as usize))
    }
}

impl State {
    fn find(&mut self, name: &str, range: &Range<u64>) -> Option<Bytes> {
        let (i, piece) = self.held.iter().enumerate().rev().find_map(|(i, s)| Some((i, s.piece(name, range)?)))?;
        let used = self.held.remove(i)?;
        self.held.push_back(used);
        Some(piece)
    }

    /// The range to read for a piece; `length` is the length of the object, if it is known.
    fn block_for(&self, name: &str, range: &Range<u64>, length: Option<u64>) -> Range<u64> {
        let follows =
            |s: &Block| s.name == name && (s.end().saturating_sub(GAP)..=s.end() + GAP).contains(&range.start);
        let ahead = if self.held.iter().any(follows) { NEXT_BLOCK } else { BLOCK };
        let end = range.end.max(range.start.saturating_add(ahead));
        match length {
            // Near the end of an object, read back from the end, because its index is there.
            Some(length) if end >= length => length.saturating_sub(ahead).min(range.start)..length.max(range.end),
            _ => range.start..end,
        }
    }

    fn keep(&mut self, block: Block) {
        self.bytes += block.bytes.len();
        self.held.push_back(block);
        while self.bytes > CAPACITY {
            let Some(oldest) = self.held.pop_front() else { break };
            self.bytes -= oldest.bytes.len();
        }
    }
}

impl ReadAhead {
    /// A piece of an object. `fetch` reads a block of it, which is shorter if the object ends. `None` if the object ends before the piece does.
    pub(super) fn read<E>(
        &self,
        name: &str,
        range: Range<u64>,
        length: Option<u64>,
        fetch: impl FnOnce(Range<u64>) -> Result<Bytes, E>,
    ) -> Result<Option<Vec<u8>>, E> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let wanted = loop {
            if let Some(piece) = state.find(name, &range) {
                return Ok(Some(piece.to_vec()));
            }
            // Another thread is reading it.
            let is_coming = |(of, coming): &(String, Range<u64>)| of == name && coming.contains(&range.start);
            if !state.under_way.iter().any(is_coming) {
                break state.block_for(name, &range, length);
            }
            state = self.arrived.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        let mine = (name.to_owned(), wanted.clone());
        state.under_way.push(mine.clone());
        drop(state);
        let fetched = fetch(wanted.clone());
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.under_way.retain(|other| *other != mine);
        self.arrived.notify_all();
        let block = Block { name: name.to_owned(), at: wanted.start, bytes: fetched? };
        let piece = block.piece(name, &range).map(|piece| piece.to_vec());
        state.keep(block);
        Ok(piece)
    }

    /// Forget an object, or all of them.
    pub(super) fn forget(&self, name: Option<&str>) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.held.retain(|s| name.is_some_and(|name| s.name != name));
        state.bytes = state.held.iter().map(|s| s.bytes.len()).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn content(name: &str, range: Range<u64>, length: u64) -> Bytes {
        let first = name.len() as u64;
        (range.start..range.end.min(length)).map(|i| (first + i * 7 + (i >> 11)) as u8).collect::<Vec<u8>>().into()
    }

    #[test]
    fn pieces_have_the_bytes_of_the_object_whatever_any_thread_read_before() {
        let (ahead, requests) = (ReadAhead::default(), AtomicUsize::new(0));
        let length = 9 << 20;
        std::thread::scope(|scope| {
            for seed in 0..4 {
                let (ahead, requests) = (&ahead, &requests);
                scope.spawn(move || {
                    let mut random = fastrand::Rng::with_seed(seed);
                    for _ in 0..500 {
                        let name = ["a", "bc"][random.usize(..2)];
                        let at = random.u64(..length + 10);
                        let range = at..at + random.u64(1..200_000);
                        let known = random.bool().then_some(length);
                        let fetch = |wanted: Range<u64>| {
                            requests.fetch_add(1, Ordering::Relaxed);
                            Ok::<Bytes, ()>(content(name, wanted, length))
                        };
                        let read = ahead.read(name, range.clone(), known, fetch).unwrap();
                        let expected = (range.end <= length).then(|| content(name, range, length).to_vec());
                        assert!(read == expected);
                    }
                });
            }
        });
        let requests = requests.into_inner();
        assert!(requests < 600, "{requests} requests for 2000 pieces");
    }

    #[test]
    fn sequential_pieces_need_one_request_per_few_megabytes_and_memory_is_bounded() {
        let (ahead, mut requests, length) = (ReadAhead::default(), 0, 200u64 << 20);
        for at in (0..length).step_by(1 << 18) {
            let fetch = |wanted: Range<u64>| {
                requests += 1;
                Ok::<Bytes, ()>(vec![0; (wanted.end.min(length) - wanted.start) as usize].into())
            };
            assert_eq!(ahead.read("a", at..at + (1 << 18), None, fetch).unwrap().unwrap().len(), 1 << 18);
            assert!(ahead.state.lock().unwrap().bytes <= CAPACITY);
        }
        assert!(requests <= 52, "{requests}");
        let failed = ahead.read("a", 0..1, None, |_| Err(()));
        assert!(failed.is_err() && ahead.state.lock().unwrap().under_way.is_empty());
        ahead.forget(Some("a"));
        assert_eq!(ahead.state.lock().unwrap().bytes, 0);
    }

    #[test]
    fn reading_the_end_of_an_object_also_reads_the_bytes_before_it() {
        let ahead = ReadAhead::default();
        let length = 5 << 20;
        let fetch = |wanted: Range<u64>| Ok::<Bytes, ()>(content("a", wanted, length));
        assert!(ahead.read("a", length - 20..length, Some(length), fetch).unwrap().is_some());
        let none = |_| Err(());
        let index = ahead.read("a", length - 100_000..length - 20, Some(length), none).unwrap();
        assert!(index.unwrap() == content("a", length - 100_000..length - 20, length));
    }
}

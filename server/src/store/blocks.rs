//! A file of a store, read in small stretches here and there: what of it is asked for is fetched in blocks, and held in a file of bounded length.
//!
//! Inputs: the file as it was listed; it is taken under that ETag and length or not at all. Blocks that follow each other are fetched together, several
//! stretches at once; of the blocks that are held, the least recently used is replaced first. Whether the bytes are right is
//! for whoever reads them to see (every part of a pack has a checksum). Invariants: the file that holds them has no name, so that a crash leaves nothing of
//! it, and never grows beyond what was allowed. Failures: a store that goes away is waited for ([`PATIENCE`]); a full disk, a file that is another
//! by now and one that the store refuses are errors of the read that needs them.

use super::s3::changed;
use super::{Identity, S3, is_away};
use axum::body::Bytes;
use kilwa_pack::Source;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Bytes of a block: a pack's chunk is some tens of thousands.
pub(crate) const BLOCK: u64 = 256 << 10;
/// Blocks that are fetched with one question.
const TOGETHER: u64 = 16;
/// Such questions at once.
pub(super) const AT_ONCE: usize = 8;
/// A store that does not answer is waited for this long.
const PATIENCE: Duration = Duration::from_secs(600);
/// It is looked at so often whether it answers.
const LOOK: Duration = Duration::from_millis(250);

/// See the module.
#[derive(Debug)]
pub(crate) struct Blocks {
    store: Arc<S3>,
    key: String,
    identity: Identity,
    /// Blocks that may be held.
    capacity: u64,
    held: Mutex<Held>,
    /// Bytes that were fetched so far, for whoever waits.
    fetched: Arc<AtomicU64>,
}

/// Blocks in the file, by their number.
#[derive(Debug)]
struct Held {
    file: File,
    /// Where it is in the file, in blocks, and when it was asked for last.
    places: HashMap<u64, (u64, u64)>,
    /// The same the other way round.
    used: BTreeMap<u64, u64>,
    clock: u64,
}

impl Blocks {
    /// The file `key` as it was listed, held in at most `bytes` of `folder`. `fetched` hears how much was fetched.
    ///
    /// # Errors
    /// When no file can be made there.
    pub(crate) fn new(
        (store, key, identity): (&Arc<S3>, &str, &Identity),
        folder: &Path,
        bytes: u64,
        fetched: Arc<AtomicU64>,
    ) -> io::Result<Self> {
        let file = tempfile::tempfile_in(folder)?;
        let held = Held { file, places: HashMap::new(), used: BTreeMap::new(), clock: 0 };
        Ok(Self {
            store: Arc::clone(store),
            key: key.to_owned(),
            identity: identity.clone(),
            capacity: (bytes / BLOCK).max(1),
            held: Mutex::new(held),
            fetched,
        })
    }

    fn block(&self, number: u64) -> Range<u64> {
        let from = number * BLOCK;
        from..(from + BLOCK).min(self.identity.bytes())
    }

    /// Fetch stretches of blocks that follow each other; give each block to `taken`.
    fn fetch(&self, runs: &[Range<u64>], mut taken: impl FnMut(u64, &[u8]) -> io::Result<()>) -> io::Result<()> {
        for runs in runs.chunks(AT_ONCE) {
            let ranges: Vec<Range<u64>> =
                runs.iter().map(|run| self.block(run.start).start..self.block(run.end - 1).end).collect();
            for (run, bytes) in runs.iter().zip(self.stretches(&ranges)?) {
                self.fetched.fetch_add(bytes.len() as u64, Ordering::Relaxed);
                for (number, block) in run.clone().zip(bytes.chunks(BLOCK as usize)) {
                    taken(number, block)?;
                }
            }
        }
        Ok(())
    }

    /// The same stretches of the file; a store that is away is waited for.
    fn stretches(&self, ranges: &[Range<u64>]) -> io::Result<Vec<Bytes>> {
        let began = Instant::now();
        loop {
            match self.store.stretches(&self.key, &self.identity, ranges) {
                Err(e) if is_away(&e) && began.elapsed() < PATIENCE => std::thread::sleep(LOOK),
                Ok(all) if all.iter().zip(ranges).any(|(b, r)| b.len() as u64 != r.end - r.start) => {
                    return Err(changed());
                }
                fetched => return fetched,
            }
        }
    }

    fn with<T>(&self, what: impl FnOnce(&mut Held) -> io::Result<T>) -> io::Result<T> {
        what(&mut self.held.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Held {
    /// A block that is held.
    fn get(&mut self, number: u64, length: usize) -> io::Result<Option<Vec<u8>>> {
        let Some((place, used)) = self.places.get_mut(&number) else { return Ok(None) };
        self.clock += 1;
        self.used.remove(used);
        self.used.insert(self.clock, number);
        *used = self.clock;
        self.file.seek(SeekFrom::Start(*place * BLOCK))?;
        let mut bytes = vec![0; length];
        self.file.read_exact(&mut bytes)?;
        Ok(Some(bytes))
    }

    /// Hold a block, in the place of the one that was asked for longest ago where there is no other.
    fn put(&mut self, number: u64, bytes: &[u8], capacity: u64) -> io::Result<()> {
        if self.places.contains_key(&number) {
            return Ok(());
        }
        let place = if (self.places.len() as u64) < capacity {
            self.places.len() as u64
        } else {
            let oldest = self.used.pop_first().and_then(|(_, oldest)| self.places.remove(&oldest));
            oldest.ok_or_else(|| io::Error::other("no block is held"))?.0
        };
        self.file.seek(SeekFrom::Start(place * BLOCK))?;
        self.file.write_all(bytes)?;
        self.clock += 1;
        self.places.insert(number, (place, self.clock));
        self.used.insert(self.clock, number);
        Ok(())
    }
}

/// Numbers as stretches of numbers that follow each other, none longer than [`TOGETHER`].
fn runs(numbers: impl IntoIterator<Item = u64>) -> Vec<Range<u64>> {
    let mut runs: Vec<Range<u64>> = Vec::new();
    for number in numbers {
        match runs.last_mut() {
            Some(run) if run.end == number && run.end - run.start < TOGETHER => run.end += 1,
            _ => runs.push(number..number + 1),
        }
    }
    runs
}

impl Source for Blocks {
    fn len(&self) -> io::Result<u64> {
        Ok(self.identity.bytes())
    }

    fn read_at(&self, offset: u64, length: usize) -> io::Result<Vec<u8>> {
        let end = offset.checked_add(length as u64).filter(|end| *end <= self.identity.bytes());
        let end = end.ok_or_else(|| io::Error::from(io::ErrorKind::UnexpectedEof))?;
        let mut all = vec![0; length];
        if length == 0 {
            return Ok(all);
        }
        // Copies the part of a block that lies in the stretch to its place there.
        let mut copy = |number: u64, block: &[u8]| {
            let of = self.block(number);
            let (from, to) = (of.start.max(offset), of.end.min(end));
            let target = all.get_mut((from - offset) as usize..(to - offset) as usize);
            if let (Some(target), Some(part)) =
                (target, block.get((from - of.start) as usize..(to - of.start) as usize))
            {
                target.copy_from_slice(part);
            }
        };
        let mut missing = Vec::new();
        for number in offset / BLOCK..end.div_ceil(BLOCK) {
            let of = self.block(number);
            match self.with(|held| held.get(number, (of.end - of.start) as usize))? {
                Some(block) => copy(number, &block),
                None => missing.push(number),
            }
        }
        self.fetch(&runs(missing), |number, block| {
            copy(number, block);
            self.with(|held| held.put(number, block, self.capacity))
        })?;
        Ok(all)
    }

    fn expect(&self, stretches: &[(u64, usize)]) {
        // No more than stays until it is read.
        let max = (self.capacity / 2).max(1) as usize;
        let mut wanted = BTreeSet::new();
        for (offset, length) in stretches {
            let end = offset.saturating_add(*length as u64).min(self.identity.bytes());
            wanted.extend(offset / BLOCK..end.div_ceil(BLOCK));
            if wanted.len() > max {
                break;
            }
        }
        let missing =
            self.with(|held| Ok(wanted.into_iter().take(max).filter(|n| !held.places.contains_key(n)).collect()));
        let missing: Vec<u64> = missing.unwrap_or_default();
        // A single one is fetched as soon when it is read, which also says what goes wrong.
        if missing.len() > 1 {
            let put = |number, block: &[u8]| self.with(|held| held.put(number, block, self.capacity));
            drop(self.fetch(&runs(missing), put));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consecutive_blocks_are_fetched_together_up_to_a_limit() {
        assert_eq!(runs([1, 2, 3, 7, 9, 10]), [1..4, 7..8, 9..11]);
        let long = runs(0..40);
        assert_eq!((long.len(), long.last()), (3, Some(&(32..40))));
        assert_eq!(runs([]), []);
    }

    #[test]
    fn the_block_cache_never_exceeds_its_size_and_keeps_the_latest_blocks() {
        let folder = tempfile::tempdir().unwrap();
        let file = tempfile::tempfile_in(folder.path()).unwrap();
        let mut held = Held { file, places: HashMap::new(), used: BTreeMap::new(), clock: 0 };
        let block = |n: u64| vec![n as u8; BLOCK as usize];
        for n in 0..50 {
            held.put(n, &block(n), 4).unwrap();
            assert_eq!(held.get(0, BLOCK as usize).unwrap(), Some(block(0)), "it is asked for all the time");
            assert!(held.file.metadata().unwrap().len() <= 4 * BLOCK);
            assert!(held.places.len() <= 4 && held.places.len() == held.used.len());
        }
        assert_eq!(held.get(49, 10).unwrap(), Some(vec![49; 10]));
        assert_eq!(held.get(20, 10).unwrap(), None);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "it has no name that a crash would leave");
    }
}

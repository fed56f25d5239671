//! Every byte of one pack, read once from front to back: checksums, chunks decoded and compared with the directory, counts, and on the
//! way the SHA-256 of the file.
//!
//! Several damaged parts are all named. Bytes that cannot be read are a damaged part, and the rest is read on. Memory: the
//! directory, and one batch of chunks.

use super::checksums::hex;
use kilwa_pack::plural::counted;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::verify::Totals;
use kilwa_pack::{DirectoryEntry, PAGE_BYTES, PackError, Reader, Source, footer::FOOTER_BYTES};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io;

/// Chunks decoded at a time, and their bytes: bound memory, and keep all threads busy.
const BATCH: usize = 64;
const BATCH_BYTES: u64 = 16 << 20;
/// Damaged parts that are named; of more only the number is.
const NAMED: usize = 1000;
/// Those of them that a message has.
const SAID: usize = 10;

/// Called with the number of further bytes that were read.
pub type OnRead<'a> = &'a dyn Fn(u64);

/// What was found.
#[derive(Debug, Default)]
pub struct Checked {
    /// Bytes of the file.
    pub bytes: u64,
    /// Of the whole file, if it could be read. A file that does not begin like a pack is not read further.
    pub sha256: Option<String>,
    /// The counts, where it could be opened.
    pub totals: Option<Totals>,
    /// The pack's identity, where it could be opened.
    pub identity: Option<String>,
    /// What the damaged parts are.
    pub damaged: Vec<String>,
    /// How many more there are.
    pub more: u64,
}

impl Checked {
    /// The damage, for people: the first parts, and how many more; `None` where it is sound.
    pub fn damage(&self) -> Option<String> {
        if self.damaged.is_empty() {
            return None;
        }
        let mut message = self.damaged.iter().take(SAID).cloned().collect::<Vec<_>>().join("\n  ");
        let left = self.damaged.len().saturating_sub(SAID) as u64 + self.more;
        if left > 0 {
            let _ = write!(message, "\n  and {}", counted(left, "more damaged part", "more damaged parts"));
        }
        Some(message)
    }

    fn add(&mut self, what: String) {
        if self.damaged.len() < NAMED {
            self.damaged.push(what);
        } else {
            self.more += 1;
        }
    }
}

/// Lends a source to a reader.
struct Lent<'a, S: ?Sized>(&'a S);

impl<S: Source + ?Sized> Source for Lent<'_, S> {
    fn len(&self) -> io::Result<u64> {
        self.0.len()
    }

    fn read_at(&self, offset: u64, length: usize) -> io::Result<Vec<u8>> {
        self.0.read_at(offset, length)
    }
}

/// Check a pack.
///
/// # Errors
/// When not even its length can be read.
pub fn check<S: Source + Sync + ?Sized>(source: &S, on_read: OnRead<'_>) -> io::Result<Checked> {
    let mut checked = Checked { bytes: source.len()?, ..Checked::default() };
    let mut pass = Pass { source, at: 0, hash: Some(Sha256::new()), on_read };
    match Reader::open(Lent(source)) {
        Ok(reader) => {
            checked.identity = Some(reader.identity());
            checked.totals = Some(chunks(&reader, &mut pass, &mut checked));
        }
        // A file that does not begin like a pack is not read further: it may be anything, of any length.
        Err(e @ PackError::Magic) => {
            checked.add(e.to_string());
            on_read(checked.bytes);
            return Ok(checked);
        }
        Err(e) => checked.add(e.to_string()),
    }
    pass.skip_to(checked.bytes, &mut checked);
    checked.sha256 = pass.hash.map(|h| hex(&h.finalize()));
    Ok(checked)
}

/// Reads on and on, and hashes what it reads.
struct Pass<'a, S: ?Sized> {
    source: &'a S,
    at: u64,
    /// Gone when something could not be read.
    hash: Option<Sha256>,
    on_read: OnRead<'a>,
}

impl<S: Source + ?Sized> Pass<'_, S> {
    /// The next bytes, up to `end`.
    fn read_to(&mut self, end: u64, checked: &mut Checked) -> Option<Vec<u8>> {
        let length = end.saturating_sub(self.at);
        let read = usize::try_from(length).map_err(io::Error::other).and_then(|n| self.source.read_at(self.at, n));
        (self.on_read)(length);
        let from = std::mem::replace(&mut self.at, end);
        match read {
            Ok(bytes) => {
                if let Some(hash) = &mut self.hash {
                    hash.update(&bytes);
                }
                Some(bytes)
            }
            Err(e) => {
                self.hash = None;
                checked.add(format!("the bytes from {from} to {end} cannot be read: {e}"));
                None
            }
        }
    }

    /// Hash everything up to `end`.
    fn skip_to(&mut self, end: u64, checked: &mut Checked) {
        while self.at < end {
            self.read_to(end.min(self.at + BATCH_BYTES), checked);
        }
    }
}

/// Every chunk, and what they sum up to.
fn chunks<R: Source, S: Source + ?Sized>(reader: &Reader<R>, pass: &mut Pass<'_, S>, checked: &mut Checked) -> Totals {
    let entries = reader.entries();
    if let Err(e) = kilwa_pack::verify::directory(entries) {
        checked.add(e.to_string());
    }
    if let Err(e) = kilwa_pack::verify::order(reader.header(), entries) {
        checked.add(e.to_string());
    }
    match gaps(reader) {
        Ok(found) => found.into_iter().for_each(|what| checked.add(what)),
        Err(e) => checked.add(format!("the padding before directory page 0 cannot be read: {e}")),
    }
    let mut totals = Totals::default();
    let mut first = 0;
    while let Some(from) = entries.get(first).map(|e| e.offset) {
        let fits = |e: &&DirectoryEntry| end_of(e) - from <= BATCH_BYTES;
        // Directory pages may lie between two chunks: they end a batch.
        let rest = entries.get(first..).unwrap_or_default();
        let joined = rest.windows(2).take_while(|w| w[1].offset == end_of(&w[0])).count() + 1;
        let count = rest.iter().take(joined.min(BATCH)).take_while(fits).count().max(1);
        let batch = rest.get(..count).unwrap_or_default();
        pass.skip_to(from, checked);
        let before = checked.damaged.len();
        if let Some(bytes) = pass.read_to(batch.last().map_or(from, end_of), checked) {
            for result in decode(reader, first, batch, from, &bytes) {
                match result {
                    Ok(part) => totals = totals.plus(part),
                    Err(e) => checked.add(e.to_string()),
                }
            }
        } else {
            // Which of them are still there?
            checked.damaged.truncate(before);
            for (index, entry) in (first..).zip(batch) {
                match reader.chunk(index as u32).and_then(|c| kilwa_pack::verify::chunk(index as u32, &c, entries)) {
                    Ok(part) => totals = totals.plus(part),
                    Err(e) => checked.add(format!("{e} (bytes {} to {})", entry.offset, end_of(entry))),
                }
            }
        }
        first += count;
    }
    if checked.damaged.is_empty()
        && let Err(e) = totals.agree(reader.header(), reader.metadata())
    {
        checked.add(e.to_string());
    }
    totals
}

fn end_of(entry: &DirectoryEntry) -> u64 {
    entry.offset + u64::from(entry.encoded_bytes)
}

/// The chunks of a batch whose bytes begin at `from`.
fn decode<R: Source>(
    reader: &Reader<R>,
    first: usize,
    batch: &[DirectoryEntry],
    from: u64,
    bytes: &[u8],
) -> Vec<Result<Totals, PackError>> {
    let (header, entries) = (reader.header(), reader.entries());
    let one = |(k, entry): (usize, &DirectoryEntry)| {
        let at = (entry.offset - from) as usize;
        let part = bytes.get(at..at + entry.encoded_bytes as usize).unwrap_or_default();
        let index = (first + k) as u32;
        let chunk = decode_checked(part, index, entry, header)?;
        kilwa_pack::verify::chunk(index, &chunk, entries)
    };
    batch.par_iter().enumerate().map(one).collect()
}

/// Bytes between the parts of the file: only zeros before page 0, nothing anywhere else.
fn gaps<R: Source>(reader: &Reader<R>) -> io::Result<Option<String>> {
    let header = reader.header();
    let page = PAGE_BYTES as u64;
    let (metadata, length) = header.metadata;
    let mut parts: Vec<(u64, u64)> = reader.entries().iter().map(|e| (e.offset, u64::from(e.encoded_bytes))).collect();
    parts.push((header.other_pages, page * u64::from(header.page_count() - 1)));
    parts.push((header.file_bytes - FOOTER_BYTES as u64, FOOTER_BYTES as u64));
    parts.sort_unstable();
    let mut end = header.first_page + page;
    for (offset, bytes) in parts {
        if offset != end {
            return Ok(Some(format!("the bytes from {end} to {offset} belong to no part of the pack, or to two")));
        }
        end = offset + bytes;
    }
    let from = metadata + u64::from(length);
    let gap = header.first_page.checked_sub(from).filter(|gap| *gap < 16);
    let Some(gap) = gap else {
        return Ok(Some("directory page 0 does not follow the metadata".to_owned()));
    };
    let padding = reader.source().read_at(from, gap as usize)?;
    Ok(padding.iter().any(|&b| b != 0).then(|| "the padding before directory page 0 is not zero".to_owned()))
}

/// The SHA-256 of a file, in constant memory.
///
/// # Errors
/// When it cannot be read.
pub fn sha256<S: Source + ?Sized>(source: &S, on_read: OnRead<'_>) -> io::Result<(u64, String)> {
    let length = source.len()?;
    let (mut at, mut hash) = (0, Sha256::new());
    while at < length {
        let n = (length - at).min(4 << 20);
        hash.update(source.read_at(at, n as usize)?);
        on_read(n);
        at += n;
    }
    Ok((length, hex(&hash.finalize())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Zeros, and how many of them were read.
    struct Zeros(AtomicU64);

    impl Source for Zeros {
        fn len(&self) -> io::Result<u64> {
            Ok(64 << 20)
        }

        fn read_at(&self, _: u64, length: usize) -> io::Result<Vec<u8>> {
            self.0.fetch_add(length as u64, Ordering::Relaxed);
            Ok(vec![0; length])
        }
    }

    #[test]
    fn a_file_that_does_not_begin_like_a_pack_is_not_read_further() {
        let zeros = Zeros(AtomicU64::new(0));
        let checked = check(&zeros, &|_| {}).unwrap();
        assert!(checked.damage().unwrap().contains("not a Kilwa pack"), "{checked:?}");
        assert!(zeros.0.into_inner() <= 256, "no more than a header is read");
    }
}

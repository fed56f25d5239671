//! The file that a LAZ reader reads: every layered chunk is checked before the crate `laz` reads it.
//!
//! Such a chunk is its first point, its number of points, the length of each layer (4 bytes each), and the layers. `laz` 0.13 allocates whatever the lengths
//! announce. They are compared with what is left of the file first, and a chunk may not be larger than [`LARGEST`].

use super::bounds::Layered;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of a chunk, at most. Programs write chunks of 50,000 points, about a mebibyte.
const LARGEST: u64 = 256 << 20;

/// What is known of the file while it is read.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Points of the chunks that were begun.
    points: AtomicU64,
    /// The byte where the last chunk begins.
    at: AtomicU64,
}

impl Seen {
    pub(super) fn points(&self) -> u64 {
        self.points.load(Ordering::Relaxed)
    }

    pub(super) fn at(&self) -> u64 {
        self.at.load(Ordering::Relaxed)
    }
}

/// See the module.
pub(super) struct Checked<R> {
    inner: R,
    position: u64,
    total: u64,
    layered: Option<Layered>,
    /// Where the next chunk begins.
    next: u64,
    /// The file ended, or has no such place, where the table of chunks was read: `laz` would go on at any byte.
    is_lost: bool,
    seen: Arc<Seen>,
}

impl<R: Read + Seek> Checked<R> {
    /// A file of `total` bytes at its beginning.
    pub(super) fn new(inner: R, total: u64, layered: Option<Layered>, seen: Arc<Seen>) -> Self {
        let next = layered.map_or(u64::MAX, |layered| layered.first);
        Self { inner, position: 0, total, layered, next, is_lost: false, seen }
    }

    /// Look at the chunk that begins here.
    fn enter(&mut self, layered: Layered) -> io::Result<()> {
        self.seen.at.store(self.position, Ordering::Relaxed);
        let head = layered.point + 4 + 4 * layered.layers;
        let left = self.total.saturating_sub(self.position);
        let too_short = |bytes: u64| {
            let text = format!("a chunk of {bytes} bytes, of which {left} are left in the file");
            Err(io::Error::new(io::ErrorKind::InvalidData, text))
        };
        if head > left {
            return too_short(head);
        }
        let mut bytes = vec![0; head as usize];
        self.inner.read_exact(&mut bytes)?;
        self.inner.seek(SeekFrom::Start(self.position))?;
        let mut words = bytes[layered.point as usize..].chunks_exact(4);
        let mut word = || words.next().map_or(0, |b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        let points = word();
        let chunk = head + (0..layered.layers).map(|_| word()).sum::<u64>();
        if chunk > left {
            return too_short(chunk);
        }
        if chunk > LARGEST {
            let text = format!("a chunk of {chunk} bytes; at most {LARGEST} are read");
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        self.seen.points.fetch_add(points, Ordering::Relaxed);
        self.next = self.position + chunk;
        Ok(())
    }
}

impl<R: Read + Seek> Read for Checked<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.is_lost {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        if self.position == self.next
            && let Some(layered) = self.layered
            && !out.is_empty()
        {
            self.enter(layered)?;
        }
        let n = self.inner.read(out)?;
        self.position += n as u64;
        self.is_lost = n == 0 && !out.is_empty() && self.layered.is_some();
        Ok(n)
    }
}

impl<R: Read + Seek> Seek for Checked<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let sought = self.inner.seek(to);
        self.is_lost |= sought.is_err() && self.layered.is_some();
        self.position = sought?;
        Ok(self.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_read_any_more_after_the_end_of_a_layered_file_or_a_place_that_does_not_exist() {
        let layered = Some(Layered { first: 8, point: 4, layers: 1 });
        let file = || Checked::new(io::Cursor::new(vec![0; 64]), 64, layered, Arc::default());
        let mut ends = file();
        ends.seek(SeekFrom::Start(64)).unwrap();
        assert_eq!(ends.read(&mut [0; 4]).unwrap(), 0);
        ends.seek(SeekFrom::Start(20)).unwrap();
        assert!(ends.read(&mut [0; 4]).is_err());
        let mut nowhere = file();
        assert!(nowhere.seek(SeekFrom::Current(-1)).is_err());
        assert!(nowhere.read(&mut [0; 4]).is_err());
        let mut sound = file();
        sound.seek(SeekFrom::Start(20)).unwrap();
        assert_eq!(sound.read(&mut [0; 4]).unwrap(), 4);
    }
}

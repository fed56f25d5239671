//! A table of records of one size that grows with the file but not in memory: beyond a number of pages in memory the
//! rest goes to a scratch file.
//!
//! Invariants: record `i` is what was pushed as the `i`-th; pages in memory never exceed the limit (one more is being
//! filled). Which page leaves is decided by a clock over the pages, so reading in the order of the file costs nothing and reading at
//! random one page of the file each. Fails with the system's reason where the scratch file does.

use crate::read::ReadError;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes of a page, about: as many whole records as fit.
const PAGE: usize = 64 * 1024;

/// Where tables keep what does not fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scratch<'p> {
    /// The folder of the scratch file.
    pub(super) folder: &'p Path,
    /// The mesh file, for messages.
    pub(super) file: &'p Path,
}

impl Scratch<'_> {
    fn cannot(self, what: &'static str) -> impl FnOnce(io::Error) -> ReadError {
        let (file, folder) = (self.file.to_owned(), self.folder.to_owned());
        move |source| ReadError::Scratch { file, folder, what, source }
    }
}

/// Records of `N` bytes.
pub(super) struct Table<'p, const N: usize> {
    scratch: Scratch<'p>,
    len: u64,
    /// The page that is being filled.
    tail: Vec<u8>,
    /// Full pages in memory: number and bytes.
    resident: Vec<(usize, Vec<u8>)>,
    max: usize,
    /// For each full page its slot in `resident`, or `OUT`; and whether it is in the file.
    slots: Vec<u32>,
    written: Vec<bool>,
    /// Where the clock stands.
    hand: usize,
    file: Option<File>,
}

const OUT: u32 = u32::MAX;

impl<'p, const N: usize> Table<'p, N> {
    const RECORDS: usize = PAGE / N;
    const BYTES: usize = Self::RECORDS * N;

    /// An empty table that takes about `memory` bytes at the most.
    pub(super) fn new(scratch: Scratch<'p>, memory: usize) -> Self {
        Self {
            scratch,
            len: 0,
            tail: Vec::new(),
            resident: Vec::new(),
            max: (memory / Self::BYTES).max(2),
            slots: Vec::new(),
            written: Vec::new(),
            hand: 0,
            file: None,
        }
    }

    /// Append a record.
    #[inline]
    pub(super) fn push(&mut self, record: &[u8; N]) -> Result<(), ReadError> {
        self.tail.extend_from_slice(record);
        self.len += 1;
        if self.tail.len() == Self::BYTES {
            let page = self.slots.len();
            self.slots.push(OUT);
            self.written.push(false);
            let bytes = std::mem::take(&mut self.tail);
            let slot = self.free_slot()?;
            self.put(slot, page, bytes);
        }
        Ok(())
    }

    /// Record `i`; `None` beyond the end.
    #[inline]
    pub(super) fn get(&mut self, i: u64) -> Result<Option<[u8; N]>, ReadError> {
        if i >= self.len {
            return Ok(None);
        }
        let (page, at) = ((i / Self::RECORDS as u64) as usize, (i % Self::RECORDS as u64) as usize * N);
        let bytes = match self.slots.get(page) {
            None => &self.tail,
            Some(&OUT) => {
                let bytes = self.read(page)?;
                let slot = self.free_slot()?;
                self.put(slot, page, bytes);
                &self.resident[slot].1
            }
            Some(&slot) => &self.resident[slot as usize].1,
        };
        Ok(bytes[at..].first_chunk().copied())
    }

    fn put(&mut self, slot: usize, page: usize, bytes: Vec<u8>) {
        self.slots[page] = slot as u32;
        if slot == self.resident.len() {
            self.resident.push((page, bytes));
        } else {
            self.resident[slot] = (page, bytes);
        }
    }

    /// A slot for one more page; what stood there is in the file then.
    fn free_slot(&mut self) -> Result<usize, ReadError> {
        if self.resident.len() < self.max {
            return Ok(self.resident.len());
        }
        let slot = self.hand;
        self.hand = (self.hand + 1) % self.max;
        let (page, bytes) = &self.resident[slot];
        if !self.written[*page] {
            let offset = (*page * Self::BYTES) as u64;
            let file = match &mut self.file {
                Some(file) => file,
                none => none.insert(tempfile::tempfile_in(self.scratch.folder).map_err(self.scratch.cannot("made"))?),
            };
            file.seek(SeekFrom::Start(offset))
                .and_then(|_| file.write_all(bytes))
                .map_err(self.scratch.cannot("written"))?;
            self.written[*page] = true;
        }
        self.slots[*page] = OUT;
        Ok(slot)
    }

    fn read(&mut self, page: usize) -> Result<Vec<u8>, ReadError> {
        let mut bytes = vec![0; Self::BYTES];
        if let Some(file) = &mut self.file {
            file.seek(SeekFrom::Start((page * Self::BYTES) as u64))
                .and_then(|_| file.read_exact(&mut bytes))
                .map_err(self.scratch.cannot("read"))?;
        }
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_larger_than_its_memory_gives_back_every_record_in_any_order() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch { folder: folder.path(), file: Path::new("a.obj") };
        let mut table: Table<'_, 12> = Table::new(scratch, 3 * PAGE);
        let record = |i: u64| -> [u8; 12] { std::array::from_fn(|k| (i.wrapping_mul(0x9e37_79b9) >> (k % 8)) as u8) };
        let n = 100_000;
        for i in 0..n {
            table.push(&record(i)).unwrap();
            // While it is written, too.
            if i % 97 == 0 {
                assert_eq!(table.get(i / 2).unwrap(), Some(record(i / 2)));
            }
        }
        assert!(table.resident.len() <= 3 && table.file.is_some());
        for i in 0..n {
            let at = i * 7919 % n;
            assert_eq!(table.get(at).unwrap(), Some(record(at)), "{at}");
        }
        assert_eq!(table.get(n).unwrap(), None);
    }

    #[test]
    fn a_scratch_file_that_cannot_be_created_is_reported_with_its_folder() {
        let scratch = Scratch { folder: Path::new("/nowhere/at/all"), file: Path::new("a.obj") };
        let mut table: Table<'_, 8192> = Table::new(scratch, 0);
        let error = (0..100).find_map(|_| table.push(&[0; 8192]).err()).unwrap().to_string();
        assert!(error.contains("a.obj") && error.contains("/nowhere/at/all cannot be made"), "{error}");
    }
}

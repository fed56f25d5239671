//! Many lists of words in a few files: each list has its own buffer, and its extents are recorded.

use super::words::{append_words, read_words_with_sum};
use crate::scratch::{Scratch, ScratchError, ScratchFile};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Words that all buffers together hold at most, by list: between these.
const BUFFER: std::ops::RangeInclusive<usize> = 256..=1 << 16;
/// Maximum number of open files.
const OPEN: usize = 128;

/// Complete lists.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Lists {
    /// Number of the first list.
    first: u32,
    /// The files, in the order of the lists that they hold.
    pub(super) files: Vec<ListFile>,
    /// Extents of each list in its file: first byte and number of words of each.
    extents: Vec<Vec<(u64, u32)>>,
    /// CRC-32 of each list.
    sums: Vec<u32>,
}

/// A file of consecutive lists.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ListFile {
    pub(super) name: String,
    /// Number of the first list in it.
    pub(super) first: u32,
    /// CRC-32 of the file, which another machine checks as a whole.
    pub(super) crc32: u32,
}

impl Lists {
    /// The extents of a list in its file; empty if there is no such list.
    pub(super) fn extents(&self, list: usize) -> &[(u64, u32)] {
        list.checked_sub(self.first as usize).and_then(|i| self.extents.get(i)).map_or(&[], Vec::as_slice)
    }

    /// CRC-32 of the bytes of a list; 0, that of no bytes, if there is no such list.
    pub(super) fn crc32(&self, list: usize) -> u32 {
        list.checked_sub(self.first as usize).and_then(|i| self.sums.get(i)).copied().unwrap_or(0)
    }

    /// Words of a list.
    pub(super) fn words(&self, list: usize) -> usize {
        self.extents(list).iter().map(|(_, n)| *n as usize).sum()
    }

    /// The numbers of the lists.
    pub(super) fn range(&self) -> Range<u32> {
        self.first..self.first + self.extents.len() as u32
    }

    /// Only the lists of one file; empty if there is no such file.
    pub(super) fn of_file(&self, file: usize) -> Self {
        let Some(one) = self.files.get(file) else { return Self::default() };
        let end = self.files.get(file + 1).map_or(self.range().end, |next| next.first);
        let lists = || (one.first..end).map(|list| list as usize);
        Self {
            first: one.first,
            files: vec![one.clone()],
            extents: lists().map(|list| self.extents(list).to_vec()).collect(),
            sums: lists().map(|list| self.crc32(list)).collect(),
        }
    }

    /// Open the first file, which must be the only one.
    pub(super) fn open(&self, scratch: &Scratch) -> Result<ScratchFile, ScratchError> {
        let only = || ScratchError::damaged(scratch.folder(), "lists in several files instead of one");
        let [file] = self.files.as_slice() else { return Err(only()) };
        scratch.existing(&file.name)
    }

    /// Read a list; it is appended to `into`.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] if it is not what was written, [`ScratchError::Io`].
    pub(super) fn read(&self, file: &ScratchFile, list: usize, into: &mut Vec<u32>) -> Result<(), ScratchError> {
        let (mut at, mut sum) = (into.len(), crc32fast::Hasher::new());
        into.resize(at + self.words(list), 0);
        for &(byte, n) in self.extents(list) {
            read_words_with_sum(file, byte, &mut into[at..at + n as usize], &mut sum)?;
            at += n as usize;
        }
        if sum.finalize() == self.crc32(list) {
            return Ok(());
        }
        Err(ScratchError::damaged(file.path(), format!("the checksum of list {list} does not match")))
    }
}

/// Lists that are being written.
#[derive(Debug)]
pub(super) struct Spill {
    scratch: Scratch,
    files: Vec<ListFile>,
    /// By file, and by list.
    file_sums: Vec<crc32fast::Hasher>,
    list_sums: Vec<crc32fast::Hasher>,
    open: Vec<Option<ScratchFile>>,
    open_now: usize,
    buffers: Vec<Vec<u32>>,
    capacity: usize,
    extents: Vec<Vec<(u64, u32)>>,
}

impl Spill {
    /// Empty lists, numbered from 0; their buffers take about `memory` bytes. `firsts` are the numbers of the lists with
    /// which a new file begins: the file `name`, where it is the only one, otherwise its name with a number.
    pub(super) fn create(
        scratch: &Scratch,
        name: &str,
        lists: usize,
        firsts: &[u32],
        memory: u64,
    ) -> Result<Self, ScratchError> {
        let capacity = ((memory / 4) as usize / lists.max(1)).clamp(*BUFFER.start(), *BUFFER.end());
        let name = |i: usize| if firsts.len() == 1 { name.to_owned() } else { format!("{name}-{i:04}") };
        let files: Vec<ListFile> =
            firsts.iter().enumerate().map(|(i, first)| ListFile { name: name(i), first: *first, crc32: 0 }).collect();
        for file in &files {
            scratch.create(&file.name)?;
        }
        Ok(Self {
            scratch: scratch.clone(),
            file_sums: vec![crc32fast::Hasher::new(); files.len()],
            list_sums: vec![crc32fast::Hasher::new(); lists],
            open: files.iter().map(|_| None).collect(),
            open_now: 0,
            files,
            buffers: vec![Vec::new(); lists],
            capacity,
            extents: vec![Vec::new(); lists],
        })
    }

    /// Append to a list.
    pub(super) fn push(&mut self, list: usize, words: &[u32]) -> Result<(), ScratchError> {
        let buffer = &mut self.buffers[list];
        buffer.extend_from_slice(words);
        if buffer.len() >= self.capacity { self.flush(list) } else { Ok(()) }
    }

    /// Write what is left.
    pub(super) fn finish(mut self) -> Result<Lists, ScratchError> {
        for list in 0..self.buffers.len() {
            if !self.buffers[list].is_empty() {
                self.flush(list)?;
            }
        }
        for (file, sum) in self.files.iter_mut().zip(self.file_sums) {
            file.crc32 = sum.finalize();
        }
        let sums = self.list_sums.into_iter().map(crc32fast::Hasher::finalize).collect();
        Ok(Lists { first: 0, files: self.files, extents: self.extents, sums })
    }

    fn flush(&mut self, list: usize) -> Result<(), ScratchError> {
        let number = self.files.partition_point(|f| f.first as usize <= list).saturating_sub(1);
        if self.open[number].is_none() {
            if self.open_now >= OPEN {
                self.open.iter_mut().for_each(|file| *file = None);
                self.open_now = 0;
            }
            self.open_now += 1;
        }
        let file = match &mut self.open[number] {
            Some(file) => file,
            closed => closed.insert(self.scratch.existing(&self.files[number].name)?),
        };
        let (buffer, extents) = (&mut self.buffers[list], &mut self.extents[list]);
        let n = buffer.len() as u32;
        let at = append_words(file, buffer)?;
        self.file_sums[number].update(bytemuck::cast_slice(buffer));
        self.list_sums[list].update(bytemuck::cast_slice(buffer));
        buffer.clear();
        match extents.last_mut() {
            Some((before, words)) if *before + 4 * u64::from(*words) == at => match words.checked_add(n) {
                Some(sum) => *words = sum,
                None => extents.push((at, n)),
            },
            _ => extents.push((at, n)),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_in_several_files_can_be_read_together_or_file_by_file() {
        let scratch = Scratch::temporary().unwrap();
        let mut spill = Spill::create(&scratch, "lists", 7, &[0, 3, 6], 0).unwrap();
        let mut expected = vec![Vec::new(); 7];
        let mut random = fastrand::Rng::with_seed(3);
        for i in 0..9000u32 {
            let list = random.usize(..6);
            spill.push(list, &[i, i + 1]).unwrap();
            expected[list].extend([i, i + 1]);
        }
        let lists = spill.finish().unwrap();
        assert_eq!((lists.range(), lists.files.len()), (0..7, 3));
        for (number, file) in lists.files.iter().enumerate() {
            let bytes = std::fs::read(scratch.path(&file.name)).unwrap();
            assert_eq!(crc32fast::hash(&bytes), file.crc32);
            let part = lists.of_file(number);
            assert_eq!(part.range(), [0..3, 3..6, 6..7][number]);
            let opened = part.open(&scratch).unwrap();
            for list in part.range() {
                let mut words = Vec::new();
                part.read(&opened, list as usize, &mut words).unwrap();
                assert_eq!(words, expected[list as usize]);
            }
        }
    }
}

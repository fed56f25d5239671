//! Many lists of words in one file: each grows through a buffer of its own, and its extents are remembered.

use super::words::{append_words, read_words};
use crate::scratch::{Scratch, ScratchError, ScratchFile};
use serde::{Deserialize, Serialize};

/// Words that all buffers together hold at most, by list: between these.
const BUFFER: std::ops::RangeInclusive<usize> = 256..=1 << 16;

/// Where each list is: byte and number of words of every piece.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Extents(pub(super) Vec<Vec<(u64, u32)>>);

impl Extents {
    /// Words of a list.
    pub(super) fn words(&self, list: usize) -> usize {
        self.0[list].iter().map(|(_, n)| *n as usize).sum()
    }

    /// Read a list; it is appended to `into`.
    pub(super) fn read(&self, file: &ScratchFile, list: usize, into: &mut Vec<u32>) -> Result<(), ScratchError> {
        let mut at = into.len();
        into.resize(at + self.words(list), 0);
        for &(byte, n) in &self.0[list] {
            read_words(file, byte, &mut into[at..at + n as usize])?;
            at += n as usize;
        }
        Ok(())
    }
}

/// Lists that are being written.
#[derive(Debug)]
pub(super) struct Spill {
    file: ScratchFile,
    buffers: Vec<Vec<u32>>,
    capacity: usize,
    extents: Extents,
}

impl Spill {
    /// Empty lists; their buffers take about `memory` bytes.
    pub(super) fn create(scratch: &Scratch, name: &str, lists: usize, memory: u64) -> Result<Self, ScratchError> {
        let capacity = ((memory / 4) as usize / lists.max(1)).clamp(*BUFFER.start(), *BUFFER.end());
        Ok(Self {
            file: scratch.create(name)?,
            buffers: vec![Vec::new(); lists],
            capacity,
            extents: Extents(vec![Vec::new(); lists]),
        })
    }

    /// Append to a list.
    pub(super) fn push(&mut self, list: usize, words: &[u32]) -> Result<(), ScratchError> {
        let buffer = &mut self.buffers[list];
        buffer.extend_from_slice(words);
        if buffer.len() >= self.capacity {
            flush(&self.file, buffer, &mut self.extents.0[list])?;
        }
        Ok(())
    }

    /// Write what is left.
    pub(super) fn finish(mut self) -> Result<Extents, ScratchError> {
        for (buffer, extents) in self.buffers.iter_mut().zip(&mut self.extents.0) {
            if !buffer.is_empty() {
                flush(&self.file, buffer, extents)?;
            }
        }
        Ok(self.extents)
    }
}

fn flush(file: &ScratchFile, buffer: &mut Vec<u32>, extents: &mut Vec<(u64, u32)>) -> Result<(), ScratchError> {
    let n = buffer.len() as u32;
    let at = append_words(file, buffer)?;
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

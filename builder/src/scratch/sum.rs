//! Lengths and checksums of whole files and of lines of text, so that files of an earlier process are checked before they are used.
//!
//! The checksum of a file is the CRC-32 of the CRC-32s of its blocks. It is computed while the file is written
//! ([`Summing`]), because reading a large file again takes a long time. To check it, all threads read the file in blocks.
//! Failures: [`ScratchError::Damaged`] if a file is missing, or its length or content differs.

use super::{Scratch, ScratchError};
use crate::build::options::BuildError;
use crate::build::work::Stop;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Bytes that a thread reads at a time.
const BLOCK: u64 = 1 << 20;

/// Length of a file, and its checksum unless its parts have their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Sum {
    bytes: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    crc32: Option<u32>,
}

impl Sum {
    /// Only the length of the file `name`; `None` if there is no such file.
    pub(crate) fn length(scratch: &Scratch, name: &str) -> Option<Self> {
        Some(Self { bytes: scratch.length(name)?, crc32: None })
    }

    /// Check that the file `name` still has this length and checksum.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] if it does not; [`BuildError::Stopped`]; [`ScratchError::Io`] if it cannot be read.
    pub(crate) fn check(self, scratch: &Scratch, name: &str, stop: &Stop) -> Result<(), BuildError> {
        let damaged = |why: &str| ScratchError::damaged(&scratch.path(name), why);
        if scratch.length(name) != Some(self.bytes) {
            return Err(damaged("it is missing or its length differs").into());
        }
        match self.crc32 {
            Some(sum) if Self::read(scratch, name, stop)? != sum => Err(damaged("its checksum differs").into()),
            _ => Ok(()),
        }
    }

    fn read(scratch: &Scratch, name: &str, stop: &Stop) -> Result<u32, BuildError> {
        let file = scratch.existing(name)?;
        let bytes = file.len();
        let block = |at: u64| -> Result<[u8; 4], BuildError> {
            stop.check()?;
            Ok(crc32fast::hash(&file.read(at, BLOCK.min(bytes - at))?).to_le_bytes())
        };
        let blocks = (0..bytes.div_ceil(BLOCK)).into_par_iter().map(|i| block(i * BLOCK));
        let blocks: Vec<[u8; 4]> = blocks.collect::<Result<_, _>>()?;
        Ok(crc32fast::hash(blocks.as_flattened()))
    }
}

/// Computes the [`Sum`] of a file that is written from its beginning to its end.
#[derive(Debug, Default)]
pub(crate) struct Summing {
    bytes: u64,
    /// Of the last, incomplete block.
    block: crc32fast::Hasher,
    /// Of the blocks before.
    blocks: crc32fast::Hasher,
}

impl Summing {
    /// The bytes that follow.
    pub(crate) fn update(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let left = (BLOCK - self.bytes % BLOCK).min(bytes.len() as u64) as usize;
            let (head, tail) = bytes.split_at(left);
            self.block.update(head);
            self.bytes += left as u64;
            if self.bytes.is_multiple_of(BLOCK) {
                let block = std::mem::take(&mut self.block);
                self.blocks.update(&block.finalize().to_le_bytes());
            }
            bytes = tail;
        }
    }

    /// The length and checksum of the file.
    pub(crate) fn finish(mut self) -> Sum {
        if !self.bytes.is_multiple_of(BLOCK) {
            self.blocks.update(&self.block.finalize().to_le_bytes());
        }
        Sum { bytes: self.bytes, crc32: Some(self.blocks.finalize()) }
    }
}

/// A line of text: `text`, which must not contain a line break, and its checksum.
pub(crate) fn seal(text: &[u8]) -> Vec<u8> {
    let end = format!(" {:08x}\n", crc32fast::hash(text));
    [text, end.as_bytes()].concat()
}

/// The text of a line, which is given without its line break; `None` if the checksum does not match.
pub(crate) fn unseal(line: &str) -> Option<&str> {
    let (text, sum) = line.rsplit_once(' ')?;
    (sum == format!("{:08x}", crc32fast::hash(text.as_bytes()))).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_of_a_file_does_not_depend_on_how_it_was_written_and_any_change_is_found() {
        let (scratch, stop) = (Scratch::temporary().unwrap(), Stop::default());
        for length in [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK] {
            let mut bytes: Vec<u8> = (0..length).map(|i| (i * 7 + i / 1000) as u8).collect();
            for piece in [999, 1 << 20, 5 << 20] {
                let mut summing = Summing::default();
                bytes.chunks(piece).for_each(|piece| summing.update(piece));
                let sum = summing.finish();
                let write = |bytes: &[u8]| scratch.create("file").unwrap().append(bytes).unwrap();
                write(&bytes);
                sum.check(&scratch, "file", &stop).unwrap();
                if let Some(byte) = bytes.last_mut() {
                    *byte ^= 1;
                    write(&bytes);
                    assert!(sum.check(&scratch, "file", &stop).is_err());
                    *bytes.last_mut().unwrap() ^= 1;
                    write(&bytes[1..]);
                    assert!(sum.check(&scratch, "file", &stop).is_err());
                }
            }
        }
    }
}

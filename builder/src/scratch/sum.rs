//! Lengths and checksums of whole files and of lines of text, so that files of an earlier process are checked before they are used.
//!
//! All threads read a file in blocks; its checksum is the CRC-32 of the CRC-32s of its blocks. Failures:
//! [`ScratchError::Damaged`] if a file is missing, or its length or content differs.

use super::{Scratch, ScratchError};
use crate::build::options::BuildError;
use crate::build::work::Stop;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Bytes that a thread reads at a time.
const BLOCK: u64 = 1 << 20;

/// Length and checksum of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Sum {
    bytes: u64,
    crc32: u32,
}

impl Sum {
    /// The length and checksum of the file `name`. `None` if there is no such file, or if the folder is removed when the process ends.
    ///
    /// # Errors
    /// [`BuildError::Stopped`]; [`ScratchError`] if it cannot be read.
    pub(crate) fn of(scratch: &Scratch, name: &str, stop: &Stop) -> Result<Option<Self>, BuildError> {
        if scratch.space.fleeting || scratch.length(name).is_none() {
            return Ok(None);
        }
        Self::read(scratch, name, stop).map(Some)
    }

    /// Check that the file `name` still has this length and checksum.
    ///
    /// # Errors
    /// [`ScratchError::Damaged`] if it does not; otherwise as [`Sum::of`].
    pub(crate) fn check(self, scratch: &Scratch, name: &str, stop: &Stop) -> Result<(), BuildError> {
        let damaged = |why: &str| ScratchError::damaged(&scratch.path(name), why);
        if scratch.length(name) != Some(self.bytes) {
            return Err(damaged("it is missing or its length differs").into());
        }
        if Self::read(scratch, name, stop)? == self { Ok(()) } else { Err(damaged("its checksum differs").into()) }
    }

    fn read(scratch: &Scratch, name: &str, stop: &Stop) -> Result<Self, BuildError> {
        let file = scratch.existing(name)?;
        let bytes = file.len();
        let block = |at: u64| -> Result<[u8; 4], BuildError> {
            stop.check()?;
            Ok(crc32fast::hash(&file.read(at, BLOCK.min(bytes - at))?).to_le_bytes())
        };
        let blocks = (0..bytes.div_ceil(BLOCK)).into_par_iter().map(|i| block(i * BLOCK));
        let blocks: Vec<[u8; 4]> = blocks.collect::<Result<_, _>>()?;
        Ok(Self { bytes, crc32: crc32fast::hash(blocks.as_flattened()) })
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

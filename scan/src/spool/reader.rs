//! Reads a spool: any stretch of cells, each block checked against its hash.

use super::header::{HEADER_BYTES, Header};
use super::{BLOCK_BYTES, BLOCK_SAMPLES, SAMPLE_BYTES, decode};
use crate::ScanError;
use crate::hashed::{self, HASH_BYTES, short_hash};
use crate::mask::MaskReader;
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::Sample;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A spool that is read.
#[derive(Debug)]
pub struct Reader {
    path: PathBuf,
    file: File,
    header: Header,
    table: Vec<u8>,
    /// The block in memory, and its bytes.
    block: Option<u64>,
    bytes: Vec<u8>,
    masks: Vec<MaskReader>,
}

impl Reader {
    /// Open the spool at `path` and check its header, its length and its table.
    ///
    /// # Errors
    /// [`ScanError::Spool`] where it is damaged or of a later version; [`ReadError::Open`] where it cannot be opened.
    pub fn open(path: &Path) -> Result<Self, ScanError> {
        let cannot = |source| ReadError::Open { file: path.to_owned(), source };
        let damaged = |what: String| ScanError::Spool { file: path.to_owned(), what };
        let mut file = plain_file::open(path).map_err(cannot)?;
        let (head, total) = hashed::header(&mut file).map_err(cannot)?.map_err(damaged)?;
        let header = Header::parse(&head).map_err(damaged)?;
        if total != header.file_bytes() {
            return Err(damaged(format!("it has {total} bytes; {} were written", header.file_bytes())));
        }
        let table = hashed::table(&mut file, header.table_offset(), header.blocks(), header.table_hash);
        let table = table.map_err(cannot)?.map_err(damaged)?;
        let bytes = Vec::with_capacity(BLOCK_BYTES);
        Ok(Self { path: path.to_owned(), file, header, table, block: None, bytes, masks: Vec::new() })
    }

    /// Read samples that one of these masks masks as cells without anything.
    ///
    /// # Errors
    /// [`ScanError::Mask`] for a mask of another scan.
    pub fn set_masks(&mut self, masks: Vec<MaskReader>) -> Result<(), ScanError> {
        masks.iter().try_for_each(|mask| mask.check_scan(&self.header))?;
        self.masks = masks;
        Ok(())
    }

    /// The masks that are applied.
    pub fn masks(&mut self) -> &mut [MaskReader] {
        &mut self.masks
    }

    /// What it holds, masked or not.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Replace `out` by the `count` samples from cell `first` on.
    ///
    /// # Errors
    /// [`ScanError::Spool`] where a block is damaged or a cell does not exist; [`ScanError::Mask`] where a mask is damaged.
    pub fn read(&mut self, first: u64, count: usize, out: &mut Vec<Sample>) -> Result<(), ScanError> {
        out.clear();
        let end = first.checked_add(count as u64).filter(|end| *end <= self.header.grid.cells());
        let end = end.ok_or_else(|| {
            self.damaged(format!("it has no cells {first} to {}", first.saturating_add(count as u64)))
        })?;
        let mut cell = first;
        while cell < end {
            self.load(cell / BLOCK_SAMPLES)?;
            let from = (cell % BLOCK_SAMPLES) as usize;
            let n = (end - cell).min(BLOCK_SAMPLES - from as u64) as usize;
            for bytes in self.bytes[from * SAMPLE_BYTES..(from + n) * SAMPLE_BYTES].chunks_exact(SAMPLE_BYTES) {
                out.push(decode(bytes).ok_or_else(|| self.damaged(format!("cell {cell} holds no valid sample")))?);
            }
            cell += n as u64;
        }
        self.masks.iter_mut().try_for_each(|mask| mask.apply(first, out))
    }

    /// Replace `out` by one line of the grid.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn line(&mut self, line: u32, out: &mut Vec<Sample>) -> Result<(), ScanError> {
        let length = self.header.grid.line_length();
        self.read(u64::from(line) * u64::from(length), length as usize, out)
    }

    fn load(&mut self, block: u64) -> Result<(), ScanError> {
        if self.block == Some(block) {
            return Ok(());
        }
        self.block = None;
        let samples = BLOCK_SAMPLES.min(self.header.grid.cells() - block * BLOCK_SAMPLES);
        let offset = HEADER_BYTES as u64 + block * BLOCK_BYTES as u64;
        self.bytes.resize(samples as usize * SAMPLE_BYTES, 0);
        let read = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.read_exact(&mut self.bytes));
        read.map_err(|source| ReadError::Io { file: self.path.clone(), offset, source })?;
        let at = block as usize * HASH_BYTES;
        if self.table[at..at + HASH_BYTES] != short_hash(&self.bytes) {
            return Err(self.damaged(format!("the block at byte {offset} is damaged")));
        }
        self.block = Some(block);
        Ok(())
    }

    fn damaged(&self, what: String) -> ScanError {
        ScanError::Spool { file: self.path.clone(), what }
    }
}

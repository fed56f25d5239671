//! A file of rows of one width, appended to through a buffer and read by row.

use crate::scratch::{Scratch, ScratchError, ScratchFile, Sum, Summing};

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 20;

/// A file of rows.
#[derive(Debug)]
pub(super) struct Column {
    file: ScratchFile,
    width: usize,
    written: u64,
    buffer: Vec<u8>,
    summing: Summing,
}

impl Column {
    pub(super) fn create(scratch: &Scratch, name: &str, width: usize) -> Result<Self, ScratchError> {
        Ok(Self { file: scratch.create(name)?, width, written: 0, buffer: Vec::new(), summing: Summing::default() })
    }

    /// Rows pushed so far.
    pub(super) fn rows(&self) -> u64 {
        self.written + (self.buffer.len() / self.width) as u64
    }

    /// Append rows of fixed length.
    pub(super) fn push<const N: usize>(&mut self, rows: impl Iterator<Item = [u8; N]>) -> Result<(), ScratchError> {
        for row in rows {
            self.buffer.extend_from_slice(&row);
            if self.buffer.len() >= BUFFER {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Append copies of a row until there are `rows`.
    pub(super) fn fill<const N: usize>(&mut self, row: [u8; N], rows: u64) -> Result<(), ScratchError> {
        let missing = rows.saturating_sub(self.rows()) as usize;
        self.push(std::iter::repeat_n(row, missing))
    }

    /// Append zeros until there are `rows`, without taking disk space for them. They are not part of the checksum.
    #[cfg(test)]
    pub(super) fn skip_to(&mut self, rows: u64) -> Result<(), ScratchError> {
        self.flush()?;
        self.file.truncate(rows * self.width as u64)?;
        self.written = rows;
        Ok(())
    }

    /// Write what was gathered.
    pub(super) fn flush(&mut self) -> Result<(), ScratchError> {
        if !self.buffer.is_empty() {
            self.written = self.rows();
            self.file.append(&self.buffer)?;
            self.summing.update(&self.buffer);
            self.buffer.clear();
        }
        Ok(())
    }

    /// Read rows from row `first` on, among those pushed; they fill `into`.
    pub(super) fn read(&self, first: u64, into: &mut [u8]) -> Result<(), ScratchError> {
        let on_disk = ((self.written.saturating_sub(first)) * self.width as u64).min(into.len() as u64) as usize;
        let (disk, gathered) = into.split_at_mut(on_disk);
        self.file.read_into(first * self.width as u64, disk)?;
        let at = (first.max(self.written) - self.written) as usize * self.width;
        if let Some(from) = self.buffer.get(at..at + gathered.len()) {
            gathered.copy_from_slice(from);
            return Ok(());
        }
        let why = format!(
            "rows up to {} were asked for, {} are there",
            first + (into.len() / self.width) as u64,
            self.rows()
        );
        Err(ScratchError::damaged(self.file.path(), why))
    }

    /// Write what was gathered; the length and checksum of the file.
    pub(super) fn finish(mut self) -> Result<Sum, ScratchError> {
        self.flush()?;
        Ok(self.summing.finish())
    }
}

//! Writes a spool: samples in any order, each cell once, under a temporary name until all is there.

use super::header::{HEADER_BYTES, Header, Statistics};
use super::{BLOCK_BYTES, BLOCK_SAMPLES, SAMPLE_BYTES, encode};
use crate::hashed::{HASH_BYTES, short_hash};
use glam::DVec3;
use kilwa_files::atomic::{Access, AtomicFile, Pending};
use kilwa_scan_core::{Grid, Rays, Sample};
use std::collections::HashMap;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Blocks kept in memory, 40 MiB.
const KEPT: usize = 2048;

/// How the samples lie, which is known only when all of them have come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// The grid.
    pub grid: Grid,
    /// Whether rows and columns mean anything.
    pub is_grid: bool,
    /// How the rays run.
    pub rays: Rays,
    /// What must be added to positions to get the coordinates of the source.
    pub origin: DVec3,
}

/// A block in memory.
struct Block {
    number: u64,
    bytes: Box<[u8]>,
    is_changed: bool,
    used: u64,
}

/// A spool being written. It is removed when this is dropped.
pub struct Writer {
    file: AtomicFile<'static>,
    current: Block,
    others: HashMap<u64, Block>,
    /// Hashes of blocks that were written; `None` for those that were not.
    table: Vec<Option<[u8; HASH_BYTES]>>,
    next: u64,
    clock: u64,
    statistics: Statistics,
}

impl Writer {
    /// Begin the spool that will be at `path`.
    ///
    /// # Errors
    /// The system's.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = AtomicFile::create(path, Access::Default)?;
        let current = Block { number: 0, bytes: vec![0; BLOCK_BYTES].into(), is_changed: false, used: 0 };
        let statistics = Statistics::default();
        Ok(Self { file, current, others: HashMap::new(), table: Vec::new(), next: 0, clock: 0, statistics })
    }

    /// Put a sample into the cell after the last one that was put there in this way.
    ///
    /// # Errors
    /// The system's.
    #[inline]
    pub fn push(&mut self, sample: &Sample) -> io::Result<()> {
        self.put(self.next, sample).map(drop)
    }

    /// Cells filled in order, by [`Self::push`].
    pub fn pushed(&self) -> u64 {
        self.next
    }

    /// Put a sample into a cell. `false` if the cell already has one, which stays.
    ///
    /// # Errors
    /// The system's.
    #[inline]
    pub fn put(&mut self, cell: u64, sample: &Sample) -> io::Result<bool> {
        let number = cell / BLOCK_SAMPLES;
        if number != self.current.number {
            self.turn_to(number)?;
        }
        self.next = cell + 1;
        let at = (cell % BLOCK_SAMPLES) as usize * SAMPLE_BYTES;
        let place = &mut self.current.bytes[at..at + SAMPLE_BYTES];
        if place[SAMPLE_BYTES - 1] != 0 {
            return Ok(false);
        }
        encode(sample, place);
        self.current.is_changed = true;
        self.statistics.add(sample);
        Ok(true)
    }

    /// Samples so far.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Make `number` the current block.
    fn turn_to(&mut self, number: u64) -> io::Result<()> {
        self.clock += 1;
        let block = match self.others.remove(&number) {
            Some(block) => block,
            None => self.load(number)?,
        };
        let mut before = std::mem::replace(&mut self.current, block);
        before.used = self.clock;
        self.others.insert(before.number, before);
        if self.others.len() >= KEPT {
            // The older half at once, so that looking for the oldest costs little for each.
            let mut ages: Vec<u64> = self.others.values().map(|b| b.used).collect();
            let middle = ages.len() / 2;
            let limit = *ages.select_nth_unstable(middle).1;
            let mut old: Vec<u64> = self.others.values().filter(|b| b.used <= limit).map(|b| b.number).collect();
            old.sort_unstable();
            for number in old {
                if let Some(block) = self.others.remove(&number) {
                    self.save(&block)?;
                }
            }
        }
        Ok(())
    }

    fn load(&mut self, number: u64) -> io::Result<Block> {
        let mut bytes = vec![0; BLOCK_BYTES];
        if self.table.get(number as usize).is_some_and(Option::is_some) {
            let file = self.file.file_mut();
            file.seek(SeekFrom::Start(offset(number)))?;
            file.read_exact(&mut bytes)?;
        }
        Ok(Block { number, bytes: bytes.into(), is_changed: false, used: 0 })
    }

    fn save(&mut self, block: &Block) -> io::Result<()> {
        if !block.is_changed {
            return Ok(());
        }
        let file = self.file.file_mut();
        file.seek(SeekFrom::Start(offset(block.number)))?;
        file.write_all(&block.bytes)?;
        let number = block.number as usize;
        if self.table.len() <= number {
            self.table.resize(number + 1, None);
        }
        // The last block may be cut by the end of the grid; its hash is taken again then.
        self.table[number] = Some(short_hash(&block.bytes));
        Ok(())
    }

    /// All samples are there: write table and header. The file still has its temporary name.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::InvalidInput`] if a sample lies outside of the grid.
    pub fn finish(mut self, layout: Layout) -> io::Result<(Pending, Header)> {
        let Layout { grid, is_grid, rays, origin } = layout;
        let current = std::mem::replace(
            &mut self.current,
            Block { number: u64::MAX, bytes: Box::default(), is_changed: false, used: 0 },
        );
        let mut left: Vec<Block> = std::mem::take(&mut self.others).into_values().chain([current]).collect();
        left.sort_unstable_by_key(|block| block.number);
        for block in left {
            self.save(&block)?;
        }
        let mut header = Header { grid, is_grid, rays, origin, statistics: self.statistics, table_hash: [0; 32] };
        let blocks = header.blocks();
        if self.table.len() as u64 > blocks {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a sample lies outside of its grid"));
        }
        let last = grid.cells() - grid.cells().saturating_sub(1) / BLOCK_SAMPLES * BLOCK_SAMPLES;
        let last_bytes = last as usize * SAMPLE_BYTES;
        let empty = short_hash(&vec![0; BLOCK_BYTES]);
        let empty_last = short_hash(&vec![0; last_bytes]);
        let file = self.file.file_mut();
        file.set_len(header.table_offset())?;
        let mut table = Vec::with_capacity(blocks as usize * HASH_BYTES);
        for number in 0..blocks {
            let is_last = number + 1 == blocks;
            let own = match self.table.get(number as usize).copied().flatten() {
                Some(_) if is_last && last < BLOCK_SAMPLES => {
                    let mut bytes = vec![0; last_bytes];
                    file.seek(SeekFrom::Start(offset(number)))?;
                    file.read_exact(&mut bytes)?;
                    short_hash(&bytes)
                }
                Some(own) => own,
                None if is_last => empty_last,
                None => empty,
            };
            table.extend(own);
        }
        header.table_hash = *blake3::hash(&table).as_bytes();
        file.seek(SeekFrom::Start(header.table_offset()))?;
        file.write_all(&table)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&header.to_bytes())?;
        Ok((self.file.close()?, header))
    }
}

fn offset(block: u64) -> u64 {
    HEADER_BYTES as u64 + block * BLOCK_BYTES as u64
}

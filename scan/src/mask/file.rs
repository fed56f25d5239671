//! The file of a mask: one bit for each cell of a station's grid.
//!
//! ```text
//! header    128 bytes: KILWAMSK, version and cells of a block (u32), cells and masked samples (u64), digest of the spool (32 bytes), BLAKE3 of the
//!           table (32 bytes), BLAKE3 of what comes before (32 bytes)
//! blocks    8192 bytes each, for 65,536 cells: bit 0 of the first byte is the first cell; the last block is as long as it must be
//! table     for each block the first 8 bytes of its BLAKE3 hash
//! ```
//!
//! All numbers are little-endian. Blocks without a masked sample are zero, so that a mask of few samples takes little disk as a sparse file. The digest binds
//! a mask to its scan: the mask of another scan is refused.

use crate::ScanError;
use crate::hashed::{self, HASH_BYTES, short_hash};
use crate::spool::Header;
use kilwa_files::atomic::{Access, AtomicFile, Pending};
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::Sample;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"KILWAMSK";
const VERSION: u32 = 1;
/// Bytes of the header, and those that its hash covers.
pub const HEADER_BYTES: usize = 128;
const CHECKED: usize = HEADER_BYTES - 32;
/// Cells of a block, and its bytes.
const BLOCK_CELLS: u64 = 65_536;
const BLOCK_BYTES: usize = BLOCK_CELLS as usize / 8;

/// What the header of a mask holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MaskHeader {
    /// Cells of the grid.
    pub cells: u64,
    /// Samples that it masks.
    pub masked: u64,
    /// Which spool it belongs to: [`Header::digest`].
    pub scan: [u8; 32],
    table_hash: [u8; 32],
}

impl MaskHeader {
    /// What tells this mask from others: the hash of its header, which holds those of the scan and of the masked cells.
    pub fn digest(&self) -> [u8; 32] {
        let mut digest = [0; 32];
        digest.copy_from_slice(&self.to_bytes()[CHECKED..]);
        digest
    }

    fn blocks(&self) -> u64 {
        self.cells.div_ceil(BLOCK_CELLS)
    }

    fn table_offset(&self) -> u64 {
        HEADER_BYTES as u64 + self.cells.div_ceil(8)
    }

    fn file_bytes(&self) -> u64 {
        self.table_offset() + self.blocks() * HASH_BYTES as u64
    }

    fn to_bytes(self) -> Vec<u8> {
        let mut out = Vec::with_capacity(HEADER_BYTES);
        out.extend(MAGIC);
        out.extend(VERSION.to_le_bytes());
        out.extend((BLOCK_CELLS as u32).to_le_bytes());
        out.extend(self.cells.to_le_bytes());
        out.extend(self.masked.to_le_bytes());
        out.extend(self.scan);
        out.extend(self.table_hash);
        let hash = *blake3::hash(&out).as_bytes();
        out.extend(hash);
        out
    }

    /// The header in these bytes, or what is wrong with them.
    ///
    /// # Errors
    /// A sentence about what was found.
    pub fn parse(bytes: &[u8; HEADER_BYTES]) -> Result<Self, String> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        let hash = |at: usize| {
            let mut out = [0; 32];
            out.copy_from_slice(&bytes[at..at + 32]);
            out
        };
        if bytes[..8] != *MAGIC {
            return Err("it is not a Kilwa mask file".to_owned());
        }
        if word(8) != VERSION {
            return Err(format!("it is of version {}; this version of Kilwa reads version {VERSION}", word(8)));
        }
        if blake3::hash(&bytes[..CHECKED]).as_bytes()[..] != bytes[CHECKED..] {
            return Err(format!("its header is damaged (bytes 0 to {})", HEADER_BYTES - 1));
        }
        let header = Self { cells: long(16), masked: long(24), scan: hash(32), table_hash: hash(64) };
        if u64::from(word(12)) != BLOCK_CELLS || header.masked > header.cells || header.cells > u64::MAX / 2 {
            return Err("it was written by a later version of Kilwa".to_owned());
        }
        Ok(header)
    }
}

/// Bytes of a block.
fn block_bytes(cells: u64, block: u64) -> usize {
    BLOCK_CELLS.min(cells - block * BLOCK_CELLS).div_ceil(8) as usize
}

/// A mask being written, cell by cell in their order. It is removed when this is dropped.
#[derive(Debug)]
pub struct MaskWriter {
    file: AtomicFile<'static>,
    cells: u64,
    scan: [u8; 32],
    masked: u64,
    block: u64,
    bytes: Vec<u8>,
    table: Vec<u8>,
}

impl MaskWriter {
    /// Begin the mask that will be at `path`, for the scan with this header.
    ///
    /// # Errors
    /// The system's.
    pub fn create(path: &Path, scan: &Header) -> io::Result<Self> {
        let file = AtomicFile::create(path, Access::Default)?;
        let cells = scan.grid.cells();
        let bytes = vec![0; if cells == 0 { 0 } else { block_bytes(cells, 0) }];
        Ok(Self { file, cells, scan: scan.digest(), masked: 0, block: 0, bytes, table: Vec::new() })
    }

    /// Mask a cell. Cells must come in their order.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::InvalidInput`] for a cell that is not in the grid, or comes after a later one.
    pub fn mask(&mut self, cell: u64) -> io::Result<()> {
        let block = cell / BLOCK_CELLS;
        if cell >= self.cells || block < self.block {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "a cell of a mask is out of order"));
        }
        while self.block < block {
            self.turn()?;
        }
        let at = (cell % BLOCK_CELLS) as usize;
        let byte = &mut self.bytes[at / 8];
        self.masked += u64::from(*byte >> (at % 8) & 1 == 0);
        *byte |= 1 << (at % 8);
        Ok(())
    }

    /// Write the block and begin the next.
    fn turn(&mut self) -> io::Result<()> {
        if self.bytes.iter().any(|byte| *byte != 0) {
            let file = self.file.file_mut();
            file.seek(SeekFrom::Start(HEADER_BYTES as u64 + self.block * BLOCK_BYTES as u64))?;
            file.write_all(&self.bytes)?;
        }
        self.table.extend(short_hash(&self.bytes));
        self.block += 1;
        let more = self.block * BLOCK_CELLS < self.cells;
        self.bytes.clear();
        self.bytes.resize(if more { block_bytes(self.cells, self.block) } else { 0 }, 0);
        Ok(())
    }

    /// All cells were masked: complete the file, which still has its temporary name.
    ///
    /// # Errors
    /// The system's.
    pub fn finish(mut self) -> io::Result<(Pending, MaskHeader)> {
        while self.block * BLOCK_CELLS < self.cells {
            self.turn()?;
        }
        let table_hash = *blake3::hash(&self.table).as_bytes();
        let header = MaskHeader { cells: self.cells, masked: self.masked, scan: self.scan, table_hash };
        let file = self.file.file_mut();
        file.set_len(header.table_offset())?;
        file.seek(SeekFrom::Start(header.table_offset()))?;
        file.write_all(&self.table)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(&header.to_bytes())?;
        Ok((self.file.close()?, header))
    }
}

/// A mask that is read, a block at a time.
#[derive(Debug)]
pub struct MaskReader {
    path: PathBuf,
    name: String,
    file: File,
    header: MaskHeader,
    table: Vec<u8>,
    block: Option<u64>,
    bytes: Vec<u8>,
}

impl MaskReader {
    /// Open the mask `name` at `path` and check its header, its length and its table.
    ///
    /// # Errors
    /// [`ScanError::Mask`] where it is damaged, missing, or of a later version.
    pub fn open(path: &Path, name: &str) -> Result<Self, ScanError> {
        let wrong = |what: String| ScanError::Mask { file: path.to_owned(), mask: name.to_owned(), what };
        let mut file = plain_file::open(path).map_err(|e| wrong(format!("it cannot be opened ({e})")))?;
        let cannot = |source| ReadError::Open { file: path.to_owned(), source };
        let (head, total) = hashed::header(&mut file).map_err(cannot)?.map_err(wrong)?;
        let header = MaskHeader::parse(&head).map_err(wrong)?;
        if total != header.file_bytes() {
            return Err(wrong(format!("it has {total} bytes; {} were written", header.file_bytes())));
        }
        let table = hashed::table(&mut file, header.table_offset(), header.blocks(), header.table_hash);
        let table = table.map_err(cannot)?.map_err(wrong)?;
        let (path, name) = (path.to_owned(), name.to_owned());
        Ok(Self { path, name, file, header, table, block: None, bytes: Vec::new() })
    }

    /// What it holds.
    pub fn header(&self) -> &MaskHeader {
        &self.header
    }

    /// Refuse the mask of another scan.
    ///
    /// # Errors
    /// [`ScanError::Mask`].
    pub fn check_scan(&self, scan: &Header) -> Result<(), ScanError> {
        if self.header.scan == scan.digest() && self.header.cells == scan.grid.cells() {
            return Ok(());
        }
        Err(self.wrong("it was made for another scan, or for this one before it was imported again".to_owned()))
    }

    /// Call `masked` with the place of every masked cell among `count` cells from `first` on.
    ///
    /// # Errors
    /// [`ScanError::Mask`] where a block is damaged or a cell does not exist.
    pub fn cells(&mut self, first: u64, count: usize, masked: &mut dyn FnMut(usize)) -> Result<(), ScanError> {
        let end = first.checked_add(count as u64).filter(|end| *end <= self.header.cells);
        let end = end.ok_or_else(|| self.wrong(format!("it has no cells {first} to {}", first + count as u64)))?;
        let mut cell = first;
        while cell < end {
            let block = cell / BLOCK_CELLS;
            self.load(block)?;
            let stop = end.min((block + 1) * BLOCK_CELLS);
            while cell < stop {
                let at = (cell % BLOCK_CELLS) as usize;
                let byte = self.bytes[at / 8] >> (at % 8);
                if byte == 0 {
                    // Nothing more in this byte.
                    cell += 8 - (at % 8) as u64;
                    continue;
                }
                if byte & 1 == 1 {
                    masked((cell - first) as usize);
                }
                cell += 1;
            }
            cell = cell.min(stop);
        }
        Ok(())
    }

    /// Make masked samples among those from cell `first` on empty.
    pub(crate) fn apply(&mut self, first: u64, samples: &mut [Sample]) -> Result<(), ScanError> {
        self.cells(first, samples.len(), &mut |at| samples[at] = Sample::EMPTY)
    }

    fn load(&mut self, block: u64) -> Result<(), ScanError> {
        if self.block == Some(block) {
            return Ok(());
        }
        self.block = None;
        let offset = HEADER_BYTES as u64 + block * BLOCK_BYTES as u64;
        self.bytes.resize(block_bytes(self.header.cells, block), 0);
        let read = self.file.seek(SeekFrom::Start(offset)).and_then(|_| self.file.read_exact(&mut self.bytes));
        read.map_err(|source| ReadError::Io { file: self.path.clone(), offset, source })?;
        let at = block as usize * HASH_BYTES;
        if self.table[at..at + HASH_BYTES] != short_hash(&self.bytes) {
            return Err(self.wrong(format!("the block at byte {offset} is damaged")));
        }
        self.block = Some(block);
        Ok(())
    }

    fn wrong(&self, what: String) -> ScanError {
        ScanError::Mask { file: self.path.clone(), mask: self.name.clone(), what }
    }
}

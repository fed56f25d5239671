//! LAZ of point formats 6 to 10, whose chunks are layered: one layer for each type of value, so that values that are not kept need not be decoded.
//!
//! A chunk consists of its first point, its number of points, the length of each layer (4 bytes each), and the layers (LASzip, "lasreadpoint.cpp" and
//! "lasreaditemcompressed_v3.cpp"). Its head is checked here before `laz` decodes it, because `laz` 0.13 allocates whatever the lengths state.
//! The layer of GPS times must never be decoded: on damaged bytes `laz` recurses without limit (`read_gps_time`) and overflows its stack.

use super::bounds::Layers;
use las::{Header, PointData, PointDataBuilder};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor};
use laz::{DecompressionSelection, LazVlr};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

/// What is decoded in addition to x, y and returns, which always are.
const KEPT: DecompressionSelection =
    DecompressionSelection(DecompressionSelection::Z | DecompressionSelection::INTENSITY | DecompressionSelection::RGB);
/// Maximum number of bytes of a chunk. Programs write chunks of 50,000 points, about 1 MiB.
const LARGEST: u64 = 256 << 20;
/// Bytes read at a time when layers are skipped.
const BUFFER: usize = 1 << 16;

/// Reads the points of such a file, one chunk after another. The chunk table is not needed.
pub(super) struct Layered {
    decoder: LayeredPointRecordDecompressor<'static, BufReader<File>>,
    header: Header,
    record: LazVlr,
    layers: Layers,
    /// Bytes of the file.
    total: u64,
    /// Where the chunk that is being read begins, and the next one.
    at: u64,
    next: u64,
    /// Points of this chunk that have not been read yet.
    left: u64,
    /// Points of the chunks that have been entered.
    begun: u64,
}

impl Layered {
    /// Start reading a file of `total` bytes with such layers.
    pub(super) fn new(file: File, total: u64, layers: Layers) -> las::Result<Self> {
        let mut buffered = BufReader::with_capacity(BUFFER, file);
        let header = Header::new(&mut buffered)?;
        let record = header.laz_vlr()?;
        let decoder = LayeredPointRecordDecompressor::new(buffered);
        Ok(Self { decoder, header, record, layers, total, at: layers.first, next: layers.first, left: 0, begun: 0 })
    }

    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// The first byte of the chunk that is being read.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// Points of the chunks that have been entered, as their heads state.
    pub(super) fn begun(&self) -> u64 {
        self.begun
    }

    /// The next `count` points.
    pub(super) fn read_points(&mut self, count: u64) -> las::Result<PointData> {
        let point = self.layers.point as usize;
        let mut bytes = vec![0; point * count as usize];
        for record in bytes.chunks_exact_mut(point) {
            if self.left == 0 {
                self.enter()?;
            }
            self.decoder.decompress_next(record)?;
            self.left -= 1;
        }
        PointDataBuilder::new().for_header(&self.header).build_from_bytes(bytes)
    }

    /// Enter the next chunk, if the rest of the file is as long as its head states.
    fn enter(&mut self) -> las::Result<()> {
        self.at = self.next;
        let invalid = |text: String| Err(io::Error::new(io::ErrorKind::InvalidData, text).into());
        let left = self.total.saturating_sub(self.at);
        let head = self.layers.point + 4 + 4 * self.layers.count;
        if head > left {
            return invalid(format!("the head of a chunk of {head} bytes, of which {left} are left in the file"));
        }
        let mut bytes = vec![0; head as usize];
        let file = self.decoder.get_mut();
        file.seek(SeekFrom::Start(self.at))?;
        file.read_exact(&mut bytes)?;
        file.seek_relative(-(head as i64))?;
        let mut words = bytes[self.layers.point as usize..].chunks_exact(4);
        let mut word = || words.next().map_or(0, |b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
        self.left = word();
        let chunk = head + (0..self.layers.count).map(|_| word()).sum::<u64>();
        if self.left == 0 {
            return invalid("a chunk without points".to_owned());
        }
        if chunk > left {
            return invalid(format!("a chunk of {chunk} bytes, of which {left} are left in the file"));
        }
        if chunk > LARGEST {
            return invalid(format!("a chunk of {chunk} bytes; at most {LARGEST} are read"));
        }
        self.begun += self.left;
        self.next = self.at + chunk;
        self.decoder.reset();
        self.decoder.set_fields_from(self.record.items())?;
        self.decoder.set_selection(KEPT);
        Ok(())
    }
}

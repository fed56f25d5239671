//! TIFF 6.0 and BigTIFF: red, green and blue, 8 bits each, in deflated strips; plans as GeoTIFF (OGC 19-008r4).
//!
//! The strips go to the file as they come; the directory follows them, and where it is goes to the front at the end. A file whose
//! picture might pass the 4 GiB that classic offsets reach is a BigTIFF.

use super::SheetError;
use super::file::Ending;
use super::georeference::GeoReference;

/// Types of fields: their number, bytes of a value.
const SHORT: (u16, u64) = (3, 2);
const LONG: (u16, u64) = (4, 4);
const RATIONAL: (u16, u64) = (5, 8);
const DOUBLE: (u16, u64) = (12, 8);
const LONG8: (u16, u64) = (16, 8);

/// Adobe's deflate: a zlib stream for each strip.
const DEFLATE: u16 = 8;
/// Bytes of a picture from which on it is a BigTIFF: deflate cannot make more than a little of less.
const CLASSIC_BYTES: u64 = 3_900_000_000;

/// What is known of a file whose strips are being written.
#[derive(Debug, Clone)]
pub(super) struct Tiff {
    size: [u32; 2],
    dpi: u32,
    rows_per_strip: u32,
    place: Option<GeoReference>,
    is_big: bool,
    /// Bytes so far.
    at: u64,
    offsets: Vec<u64>,
    lengths: Vec<u32>,
}

/// A field of the directory: tag, type, how many values, their bytes.
type Field = (u16, (u16, u64), u64, Vec<u8>);

impl Tiff {
    pub(super) fn new(size: [u32; 2], dpi: u32, rows_per_strip: u32, place: Option<GeoReference>) -> Self {
        let is_big = u64::from(size[0]) * u64::from(size[1]) * 3 >= CLASSIC_BYTES;
        Self { size, dpi, rows_per_strip, place, is_big, at: 0, offsets: Vec::new(), lengths: Vec::new() }
    }

    /// The file's head; where the directory is comes at the end.
    fn head(&self, directory: u64) -> Vec<u8> {
        if self.is_big {
            [&b"II\x2b\0\x08\0\0\0"[..], &directory.to_le_bytes()].concat()
        } else {
            [&b"II\x2a\0"[..], &(directory as u32).to_le_bytes()].concat()
        }
    }

    /// What stands before the next strip, which has so many bytes.
    pub(super) fn strip(&mut self, length: u64) -> Result<Vec<u8>, SheetError> {
        let before = if self.at == 0 { self.head(0) } else { self.padding() };
        self.at += before.len() as u64;
        self.offsets.push(self.at);
        self.lengths.push(u32::try_from(length).map_err(|_| SheetError::TooLong)?);
        self.at += length;
        Ok(before)
    }

    /// Everything begins at an even offset.
    fn padding(&self) -> Vec<u8> {
        vec![0; (self.at % 2) as usize]
    }

    /// The directory, and where it is.
    pub(super) fn end(mut self) -> Result<Ending, SheetError> {
        let mut tail = if self.at == 0 { self.head(0) } else { self.padding() };
        self.at += tail.len() as u64;
        let fields = self.fields();
        let room = if self.is_big { 8 } else { 4 };
        let mut entries = Vec::new();
        for (tag, (kind, _), count, bytes) in fields {
            entries.extend(tag.to_le_bytes());
            entries.extend(kind.to_le_bytes());
            if self.is_big {
                entries.extend(count.to_le_bytes());
            } else {
                entries.extend((count as u32).to_le_bytes());
            }
            if bytes.len() <= room {
                entries.extend(&bytes);
                entries.resize(entries.len() + room - bytes.len(), 0);
                continue;
            }
            // Values that do not fit stand before the directory.
            entries.extend(&self.at.to_le_bytes()[..room]);
            self.at += bytes.len() as u64;
            tail.extend(bytes);
            let padding = self.padding();
            self.at += padding.len() as u64;
            tail.extend(padding);
        }
        if !self.is_big && self.at > u64::from(u32::MAX) {
            return Err(SheetError::TooLong);
        }
        let patch = self.head(self.at);
        if self.is_big {
            tail.extend((entries.len() as u64 / 20).to_le_bytes());
        } else {
            tail.extend((entries.len() as u16 / 12).to_le_bytes());
        }
        tail.extend(entries);
        tail.resize(tail.len() + room, 0);
        Ok(Ending { tail, head: Some(patch) })
    }

    /// In the order of their tags.
    fn fields(&self) -> Vec<Field> {
        let shorts = |tag, values: &[u16]| -> Field {
            (tag, SHORT, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
        };
        let longs = |tag, values: &[u32]| -> Field {
            (tag, LONG, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
        };
        let doubles = |tag, values: &[f64]| -> Field {
            (tag, DOUBLE, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
        };
        let dots = |tag| -> Field { (tag, RATIONAL, 1, [self.dpi.to_le_bytes(), 1u32.to_le_bytes()].concat()) };
        let offsets = if self.is_big {
            (273, LONG8, self.offsets.len() as u64, self.offsets.iter().flat_map(|v| v.to_le_bytes()).collect())
        } else {
            longs(273, &self.offsets.iter().map(|v| *v as u32).collect::<Vec<u32>>())
        };
        let mut fields = vec![
            longs(256, &[self.size[0]]),
            longs(257, &[self.size[1]]),
            shorts(258, &[8, 8, 8]),
            shorts(259, &[DEFLATE]),
            // Red, green, blue.
            shorts(262, &[2]),
            offsets,
            shorts(277, &[3]),
            longs(278, &[self.rows_per_strip]),
            longs(279, &self.lengths),
            dots(282),
            dots(283),
            shorts(284, &[1]),
            // Dots per inch.
            shorts(296, &[2]),
        ];
        if let Some(place) = &self.place {
            let pixel = place.metres_per_pixel;
            let keys = place.keys();
            fields.push(doubles(33550, &[pixel, pixel, 0.0]));
            fields.push(doubles(33922, &[0.0, 0.0, 0.0, place.corner[0], place.corner[1], 0.0]));
            fields.push(shorts(34735, &keys));
        }
        fields
    }
}

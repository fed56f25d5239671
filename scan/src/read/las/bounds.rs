//! Counts and lengths for which the crates `las` and `laz` would allocate more than the file can hold. Whatever else is wrong they find
//! themselves.

use std::io::{Read, Seek, SeekFrom};

/// Bytes of a variable length record before its data, and of an extended one.
const RECORD: u64 = 54;
const EXTENDED: u64 = 60;
/// The record of LAZ: its number, its compressor of chunks in layers, and the first kind of items that are in layers (LASzip, "laszip.hpp").
const LASZIP: u64 = 22_204;
const LAYERED: u64 = 3;
const POINT14: u64 = 10;

/// What a file announces and cannot have.
pub(super) struct Excess {
    /// The byte where it is announced.
    pub(super) at: u64,
    /// What is announced.
    pub(super) found: String,
    /// What there can be.
    pub(super) expected: String,
}

fn too_many(at: u64, found: u64, what: &str, most: u64) -> Option<Excess> {
    let expected =
        || format!("at most {most} in a file of this length; it is truncated or damaged: copy or export it again");
    (found > most).then(|| Excess { at, found: format!("{found} {what}"), expected: expected() })
}

/// The first number in a file of `total` bytes that it cannot hold; none if there is none, or if the file ends before it.
pub(super) fn excess(file: &mut (impl Read + Seek), total: u64) -> Option<Excess> {
    let records_at = number(file, 94, 2)?;
    let (points_at, records) = (number(file, 96, 4)?, number(file, 100, 4)?);
    let (format, point) = (number(file, 104, 1)?, number(file, 105, 2)?);
    too_many(96, points_at, "bytes before the points", total)
        .or_else(|| too_many(100, records, "variable length records", total / RECORD))
        .or_else(|| if number(file, 25, 1)? >= 4 { extended(file, total) } else { None })
        .or_else(|| {
            if format & 0xc0 == 0 { None } else { compressed(file, total, [records_at, records, points_at, point]) }
        })
}

/// Extended records (version 1.4): their length is in bytes 20 to 27.
fn extended(file: &mut (impl Read + Seek), total: u64) -> Option<Excess> {
    let (mut at, count) = (number(file, 235, 8)?, number(file, 243, 4)?);
    if let Some(excess) = too_many(243, count, "extended variable length records", total / EXTENDED) {
        return Some(excess);
    }
    for _ in 0..count {
        let length = number(file, at.checked_add(20)?, 8)?;
        let rest = total.saturating_sub(at).saturating_sub(EXTENDED);
        if let Some(excess) = too_many(at, length, "bytes in an extended record", rest) {
            return Some(excess);
        }
        at += EXTENDED + length;
    }
    None
}

/// The record of LAZ, and the table of chunks.
fn compressed(file: &mut (impl Read + Seek), total: u64, head: [u64; 4]) -> Option<Excess> {
    let [records_at, _, points_at, point] = head;
    let damaged = |at, found: &str, expected: &str| {
        let expected = format!("{expected}; the file is damaged: copy or export it again");
        Some(Excess { at, found: found.to_owned(), expected })
    };
    // The crate reads the whole header of the version, whatever length it states, and the records behind that.
    let least = match number(file, 25, 1)? {
        0..=2 => 227,
        3 => 235,
        _ => 375,
    };
    if records_at < least {
        return damaged(94, &format!("a header of {records_at} bytes"), &format!("{least} or more in this version"));
    }
    let Some(record) = laszip(file, head) else {
        return damaged(records_at, "no LASzip record", "one, because the points are compressed");
    };
    if record.is_layered {
        // `laz` 0.13 calls itself without end on some damaged layers, which ends the program.
        let expected =
            "LAS of these formats, LAZ of point formats 0 to 5, or E57: convert it, for example with LAStools or PDAL";
        let found = "points compressed in layers (LAZ of point formats 6 to 10), which are not read";
        return Some(Excess { at: record.at, found: found.to_owned(), expected: expected.to_owned() });
    }
    if let Some(at) = record.contradicts {
        return damaged(at, "an item of points of another size", "that of its kind");
    }
    if let Some(at) = record.again {
        // It is not known which of them the crate reads.
        return damaged(at, "a second LASzip record", "one");
    }
    if let Some(excess) = too_many(record.at + 32, record.point, "bytes in a point", point) {
        return Some(excess);
    }
    // The points begin with the place of the table; where it was not known when they were written, the file ends with it.
    let table = number(file, points_at, 8)?;
    let is_known = table > points_at && table >> 63 == 0;
    let table = if is_known { table } else { number(file, total.checked_sub(8)?, 8)? };
    // From a place beyond the file, `laz` returns to another byte than that where the chunks begin.
    if let Some(excess) = too_many(points_at, table, "bytes before the table of chunks", total.saturating_sub(8)) {
        return Some(excess);
    }
    let at = table.checked_add(4)?;
    // Each chunk begins with a point as it is.
    too_many(at, number(file, at, 4)?, "chunks", total / point.max(1))
}

/// What the record of LAZ says.
struct LasZip {
    /// The byte where its data begin.
    at: u64,
    /// Those of a second record.
    again: Option<u64>,
    /// The byte of an item whose size is not that of its kind.
    contradicts: Option<u64>,
    /// Whether chunks are in layers.
    is_layered: bool,
    /// Bytes of a point.
    point: u64,
}

/// The record of LAZ, by what the header says of records and points.
fn laszip(file: &mut (impl Read + Seek), [mut at, records, _, _]: [u64; 4]) -> Option<LasZip> {
    let mut first = None;
    for _ in 0..records {
        let length = number(file, at + 20, 2)?;
        if number(file, at + 18, 2)? == LASZIP {
            let at = at + RECORD;
            let is_layered = number(file, at, 2)? == LAYERED;
            let mut found = LasZip { at, again: None, contradicts: None, is_layered, point: 0 };
            for item in 0..number(file, at + 32, 2)? {
                let place = at + 34 + 6 * item;
                let (kind, bytes, version) =
                    (number(file, place, 2)?, number(file, place + 2, 2)?, number(file, place + 4, 2)?);
                // `laz` goes by the kind, whatever size is stated.
                let size = match kind {
                    6 => 20,
                    7 => 8,
                    8 => 6,
                    9 => 29,
                    _ => bytes,
                };
                found.is_layered |= kind >= POINT14 || version >= 3;
                if bytes != size {
                    found.contradicts = found.contradicts.or(Some(place));
                }
                found.point += bytes;
            }
            match &mut first {
                None => first = Some(found),
                Some(first) => first.again = Some(at),
            }
        }
        at += RECORD + length;
    }
    first
}

/// A little-endian number at a place of a file, if it is there.
pub(super) fn number(file: &mut (impl Read + Seek), at: u64, bytes: usize) -> Option<u64> {
    let mut field = [0; 8];
    file.seek(SeekFrom::Start(at)).ok()?;
    file.read_exact(field.get_mut(..bytes)?).ok()?;
    Some(u64::from_le_bytes(field))
}

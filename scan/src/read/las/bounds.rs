//! Counts and lengths for which the crates `las` and `laz` would allocate more than the file can hold. Whatever else is wrong they find
//! themselves.

use std::io::{Read, Seek, SeekFrom};

/// Bytes of a variable length record before its data, and of an extended one.
const RECORD: u64 = 54;
const EXTENDED: u64 = 60;
/// The record of LAZ: its number, its compressor of chunks in layers, and kinds of items; those from that of point format 6 on are in layers (LASzip,
/// "laszip.hpp").
const LASZIP: u64 = 22_204;
const LAYERED: u64 = 3;
const BYTE: u64 = 0;
const POINT14: u64 = 10;
const RGB14: u64 = 11;
const RGBNIR14: u64 = 12;
const WAVEPACKET14: u64 = 13;
const BYTE14: u64 = 14;
/// Bytes that a program adds to its points, at most, where they are in layers: `laz` takes 10 kB of memory for each.
const ADDED: u64 = 4096;

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
    if let Some(at) = record.contradicts {
        return damaged(at, "an item of points of another size or version", "those of its kind and of the compressor");
    }
    if let Some(at) = record.repeats {
        return damaged(at, "a second item of points of one kind", "one of each");
    }
    if let Some(at) = record.again {
        // It is not known which of them the crate reads.
        return damaged(at, "a second LASzip record", "one");
    }
    if record.point != point {
        let found = format!("items of {} bytes in a point", record.point);
        return damaged(record.at + 32, &found, &format!("{point}, as the header states"));
    }
    if record.is_layered {
        // What their chunks announce is checked as they are read; the table of chunks is not used.
        let expected = || format!("at most {ADDED}; leave some out, or convert it to LAS");
        let found = || format!("{} bytes of a program's own in each point", record.added);
        return (record.added > ADDED).then(|| Excess { at: record.at + 34, found: found(), expected: expected() });
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
#[derive(Default)]
struct LasZip {
    /// The byte where its data begin.
    at: u64,
    /// Those of a second record.
    again: Option<u64>,
    /// The byte of an item whose size or version is not that of its kind, or of the compressor: `laz` goes by the kind.
    contradicts: Option<u64>,
    /// The byte of an item whose kind came before: `laz` would take memory for each.
    repeats: Option<u64>,
    /// Whether chunks are in layers.
    is_layered: bool,
    /// Bytes of a point, and those among them that a program added.
    point: u64,
    added: u64,
    /// Layers of a chunk, where there are any.
    layers: u64,
}

/// The record of LAZ, by what the header says of records and points.
fn laszip(file: &mut (impl Read + Seek), [mut at, records, _, _]: [u64; 4]) -> Option<LasZip> {
    let mut first = None;
    for _ in 0..records {
        let length = number(file, at + 20, 2)?;
        if number(file, at + 18, 2)? == LASZIP {
            let at = at + RECORD;
            let is_layered = number(file, at, 2)? == LAYERED;
            let mut found = LasZip { at, is_layered, ..LasZip::default() };
            let mut kinds = 0_u32;
            for item in 0..number(file, at + 32, 2)? {
                let place = at + 34 + 6 * item;
                let (kind, bytes, version) =
                    (number(file, place, 2)?, number(file, place + 2, 2)?, number(file, place + 4, 2)?);
                let (size, layers) = match kind {
                    6 => (20, 0),
                    7 => (8, 0),
                    8 => (6, 0),
                    9 => (29, 0),
                    POINT14 => (30, 9),
                    RGB14 => (6, 1),
                    RGBNIR14 => (8, 2),
                    WAVEPACKET14 => (29, 1),
                    BYTE14 => (bytes, bytes),
                    _ => (bytes, 0),
                };
                if bytes != size || is_layered != (kind >= POINT14) || is_layered != (version >= 3) {
                    found.contradicts = found.contradicts.or(Some(place));
                }
                let bit = 1_u32.checked_shl(kind as u32).unwrap_or(0);
                if kinds & bit != 0 {
                    found.repeats = found.repeats.or(Some(place));
                }
                kinds |= bit;
                found.point += bytes;
                found.layers += layers;
                if kind == BYTE || kind == BYTE14 {
                    found.added += bytes;
                }
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

/// How the chunks of a file are in layers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layers {
    /// The byte where the first chunk begins.
    pub(super) first: u64,
    /// Bytes of a point.
    pub(super) point: u64,
    /// Layers of a chunk.
    pub(super) count: u64,
}

/// The layers of a file in which [`excess`] found nothing; none if it has none.
pub(super) fn layers(file: &mut (impl Read + Seek)) -> Option<Layers> {
    let (format, point) = (number(file, 104, 1)?, number(file, 105, 2)?);
    let head = [number(file, 94, 2)?, number(file, 100, 4)?, number(file, 96, 4)?, point];
    let record = laszip(file, head).filter(|record| format & 0xc0 != 0 && record.is_layered)?;
    // Before the chunks comes the place of their table.
    Some(Layers { first: head[2] + 8, point: record.point, count: record.layers })
}

/// A little-endian number at a place of a file, if it is there.
pub(super) fn number(file: &mut (impl Read + Seek), at: u64, bytes: usize) -> Option<u64> {
    let mut field = [0; 8];
    file.seek(SeekFrom::Start(at)).ok()?;
    file.read_exact(field.get_mut(..bytes)?).ok()?;
    Some(u64::from_le_bytes(field))
}

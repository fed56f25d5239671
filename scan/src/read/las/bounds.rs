//! Counts and lengths for which the crates `las` and `laz` would allocate more than the file can hold. Whatever else is wrong they find
//! themselves.

use std::io::{Read, Seek, SeekFrom};

/// Bytes of a variable length record before its data, and of an extended one.
const RECORD: u64 = 54;
const EXTENDED: u64 = 60;
/// The LAZ record: its number, the compressor for layered chunks, and item types; those of point format 6 and later are layered (LASzip, "laszip.hpp").
const LASZIP: u64 = 22_204;
/// Its user ID.
const USER_ID: &[u8] = b"laszip encoded";
const LAYERED: u64 = 3;
/// The compressor of LASzip 1, without chunks.
const POINTWISE: u64 = 1;
const BYTE: u64 = 0;
const POINT14: u64 = 10;
const RGB14: u64 = 11;
const RGBNIR14: u64 = 12;
const WAVEPACKET14: u64 = 13;
const BYTE14: u64 = 14;
/// Items of a point, at most: one of each kind from [`BYTE`] to [`BYTE14`].
const ITEMS: u64 = 15;
/// Maximum number of extra bytes per point in layered chunks: `laz` takes 10 kB of memory for each.
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

fn too_many(at: u64, found: u64, what: &str, most: u64) -> Result<(), Excess> {
    if found <= most {
        return Ok(());
    }
    let expected =
        format!("at most {most} in a file of this length; it is truncated or damaged: copy or export it again");
    Err(Excess { at, found: format!("{found} {what}"), expected })
}

fn damaged(at: u64, found: impl Into<String>, expected: &str) -> Excess {
    let expected = format!("{expected}; the file is damaged: copy or export it again");
    Excess { at, found: found.into(), expected }
}

/// The layered chunks of a file of `total` bytes, if it has any.
///
/// # Errors
/// The first number in it that it cannot hold. A file that ends before such a number is left to the crates.
pub(super) fn layers(file: &mut (impl Read + Seek), total: u64) -> Result<Option<Layers>, Excess> {
    let mut head = || {
        Some(Head {
            version: number(file, 25, 1)?,
            records_at: number(file, 94, 2)?,
            points_at: number(file, 96, 4)?,
            records: number(file, 100, 4)?,
            format: number(file, 104, 1)?,
            point: number(file, 105, 2)?,
        })
    };
    let Some(head) = head() else { return Ok(None) };
    too_many(96, head.points_at, "bytes before the points", total)?;
    too_many(100, head.records, "variable length records", total / RECORD)?;
    if head.version >= 4 {
        extended(file, total)?;
    }
    if head.format & 0xc0 == 0 { Ok(None) } else { compressed(file, total, &head) }
}

/// What the header of a file says.
struct Head {
    /// The second part of its version.
    version: u64,
    /// Bytes of the header, behind which the records begin, and their number.
    records_at: u64,
    records: u64,
    /// The byte where the points begin.
    points_at: u64,
    /// The point format, with the bits of compression, and bytes of a point.
    format: u64,
    point: u64,
}

/// Extended records (version 1.4): their length is in bytes 20 to 27.
fn extended(file: &mut (impl Read + Seek), total: u64) -> Result<(), Excess> {
    let (Some(mut at), Some(count)) = (number(file, 235, 8), number(file, 243, 4)) else { return Ok(()) };
    too_many(243, count, "extended variable length records", total / EXTENDED)?;
    for _ in 0..count {
        let length = at.checked_add(20).and_then(|at| number(file, at, 8));
        let Some(length) = length else { return Ok(()) };
        let rest = total.saturating_sub(at).saturating_sub(EXTENDED);
        too_many(at, length, "bytes in an extended record", rest)?;
        at += EXTENDED + length;
    }
    Ok(())
}

/// The record of LAZ, and the table of chunks.
fn compressed(file: &mut (impl Read + Seek), total: u64, head: &Head) -> Result<Option<Layers>, Excess> {
    // The crate reads the whole header of the version, whatever length it states, and the records behind that.
    let least = match head.version {
        0..=2 => 227,
        3 => 235,
        _ => 375,
    };
    if head.records_at < least {
        let found = format!("a header of {} bytes", head.records_at);
        return Err(damaged(94, found, &format!("{least} or more in this version")));
    }
    let Some(record) = laszip(file, head)? else {
        return Err(damaged(head.records_at, "no LASzip record", "one, because the points are compressed"));
    };
    if record.point != head.point {
        let found = format!("items of {} bytes in a point", record.point);
        return Err(damaged(record.at + 32, found, &format!("{}, as the header states", head.point)));
    }
    if record.is_layered {
        // The lengths in the chunks are checked as they are read; the chunk table is not used.
        if record.added > ADDED {
            let expected = format!("at most {ADDED}; leave some out, or convert it to LAS");
            let found = format!("{} extra bytes in each point", record.added);
            return Err(Excess { at: record.at + 34, found, expected });
        }
        // The chunks are preceded by the offset of their table.
        return Ok(Some(Layers { first: head.points_at + 8, point: record.point, count: record.layers }));
    }
    table_of_chunks(file, total, head)?;
    Ok(None)
}

/// Check the number of chunks, at the beginning of their table.
fn table_of_chunks(file: &mut (impl Read + Seek), total: u64, head: &Head) -> Result<(), Excess> {
    // The points begin with the place of the table; where it was not known when they were written, the file ends with it.
    let Some(table) = number(file, head.points_at, 8) else { return Ok(()) };
    let is_known = table > head.points_at && table >> 63 == 0;
    let table = if is_known { Some(table) } else { total.checked_sub(8).and_then(|at| number(file, at, 8)) };
    let Some(table) = table else { return Ok(()) };
    // From a place beyond the file, `laz` returns to another byte than that where the chunks begin.
    too_many(head.points_at, table, "bytes before the table of chunks", total.saturating_sub(8))?;
    let at = table.saturating_add(4);
    let Some(chunks) = number(file, at, 4) else { return Ok(()) };
    // Each chunk begins with a point as it is.
    too_many(at, chunks, "chunks", total / head.point.max(1))
}

/// What the record of LAZ says.
struct LasZip {
    /// The byte where its data begin.
    at: u64,
    /// Whether chunks are in layers.
    is_layered: bool,
    /// Bytes of a point, and how many of them are extra bytes.
    point: u64,
    added: u64,
    /// Layers of a chunk, if there are any.
    layers: u64,
}

/// The LASzip record, unless the file ends before it.
fn laszip(file: &mut (impl Read + Seek), head: &Head) -> Result<Option<LasZip>, Excess> {
    let (mut at, mut found) = (head.records_at, None);
    for _ in 0..head.records {
        let (Some(kind), Some(length)) = (number(file, at + 18, 2), number(file, at + 20, 2)) else { return Ok(None) };
        if kind == LASZIP && is_of_laszip(file, at) {
            if found.is_some() {
                // It is unknown which of them the crate reads.
                return Err(damaged(at, "a second LASzip record", "one"));
            }
            let Some(record) = items(file, at + RECORD, length)? else { return Ok(None) };
            found = Some(record);
        }
        at += RECORD + length;
    }
    Ok(found)
}

/// Whether the record at byte `at` has the user ID of LASzip. Other records may have the same number, for example that of the compatibility mode.
fn is_of_laszip(file: &mut (impl Read + Seek), at: u64) -> bool {
    let mut id = [0; 16];
    let read = file.seek(SeekFrom::Start(at + 2)).and_then(|_| file.read_exact(&mut id));
    read.is_ok() && id.split(|b| *b == 0).next() == Some(USER_ID)
}

/// The LASzip record whose data begin at byte `at`: 34 bytes and 6 for each item, `length` bytes in total. `None` if the file ends inside it.
fn items(file: &mut (impl Read + Seek), at: u64, length: u64) -> Result<Option<LasZip>, Excess> {
    let (Some(compressor), Some(count)) = (number(file, at, 2), number(file, at + 32, 2)) else { return Ok(None) };
    if 34 + 6 * count > length {
        let found = format!("{count} items of points in a LASzip record of {length} bytes");
        return Err(damaged(at + 32, found, "34 bytes and 6 more for each item"));
    }
    if count > ITEMS {
        return Err(damaged(
            at + 32,
            format!("{count} items of points"),
            &format!("at most {ITEMS}, one of each kind"),
        ));
    }
    if compressor == POINTWISE {
        let found = "points that are not divided into chunks (LASzip 1)".to_owned();
        let expected = "chunks; write the file again with LASzip 2 or later, laspy or PDAL".to_owned();
        return Err(Excess { at, found, expected });
    }
    let is_layered = compressor == LAYERED;
    let mut found = LasZip { at, is_layered, point: 0, added: 0, layers: 0 };
    let mut kinds = 0_u32;
    for item in 0..count {
        let place = at + 34 + 6 * item;
        let mut word = |k| number(file, place + k, 2);
        let (Some(kind), Some(bytes), Some(version)) = (word(0), word(2), word(4)) else { return Ok(None) };
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
        // `laz` goes by the kind.
        if bytes != size || is_layered != (kind >= POINT14) || is_layered != (version >= 3) {
            let found = "an item of points of another size or version";
            return Err(damaged(place, found, "those of its kind and of the compressor"));
        }
        // `laz` would take memory for each.
        let bit = 1_u32.checked_shl(kind as u32).unwrap_or(0);
        if kinds & bit != 0 {
            return Err(damaged(place, "two point items of the same type", "at most one of each type"));
        }
        kinds |= bit;
        found.point += bytes;
        found.layers += layers;
        if kind == BYTE || kind == BYTE14 {
            found.added += bytes;
        }
    }
    Ok(Some(found))
}

/// The layered chunks of a file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layers {
    /// The byte where the first chunk begins.
    pub(super) first: u64,
    /// Bytes of a point.
    pub(super) point: u64,
    /// Layers of a chunk.
    pub(super) count: u64,
}

/// A little-endian number at a place of a file, if it is there.
pub(super) fn number(file: &mut (impl Read + Seek), at: u64, bytes: usize) -> Option<u64> {
    let mut field = [0; 8];
    file.seek(SeekFrom::Start(at)).ok()?;
    file.read_exact(field.get_mut(..bytes)?).ok()?;
    Some(u64::from_le_bytes(field))
}

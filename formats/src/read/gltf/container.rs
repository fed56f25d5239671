//! The outer form: GLB (header of 12 bytes, chunks of type and length) or a text file that is the JSON itself.

use super::super::{Bytes, Place, ReadError};
use super::{Context, tally};
use kilwa_pack::plural::counted;
use std::io::{Read, SeekFrom};

/// First bytes of a GLB.
pub(super) const MAGIC: &[u8] = b"glTF";
const HEADER: u64 = 12;
const CHUNK_HEADER: u64 = 8;
const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

/// The JSON, and where the binary chunk lies in the file.
pub(super) struct Container {
    pub(super) json: Vec<u8>,
    /// Offset and length.
    pub(super) binary: Option<(u64, u64)>,
    /// Bytes behind the end that the header gives.
    pub(super) trailing: u64,
}

/// Take the file apart.
///
/// The JSON is held whole; one of more than `most` bytes is refused before it is read.
pub(super) fn open(
    source: &mut dyn Bytes,
    total: u64,
    max: u64,
    context: &Context<'_>,
) -> Result<Container, ReadError> {
    let start = piece(source, 0, total.min(HEADER), context)?;
    if !start.starts_with(MAGIC) {
        tally::check_length(total, max, context)?;
        return Ok(Container { json: piece(source, 0, total, context)?, binary: None, trailing: 0 });
    }
    let malformed = |at: u64, found: String, expected: &str| ReadError::Malformed {
        file: context.path.to_owned(),
        place: Place::Byte(at),
        found,
        expected: expected.to_owned(),
    };
    let (Some(version), Some(length)) = (word(&start, 4), word(&start, 8)) else {
        let found = format!("a file of {}", counted(total, "byte", "bytes"));
        return Err(malformed(total, found, "a header of 12 bytes; the file is truncated: copy or export it again"));
    };
    if version != 2 {
        return Err(context.version(&format!("{version}")));
    }
    let length = u64::from(length);
    if length > total {
        let found = format!("{} in all", counted(total, "byte", "bytes"));
        return Err(malformed(
            total,
            found,
            &format!("{length}, as the header says; the file is truncated: copy it again"),
        ));
    }
    let mut container = Container { json: Vec::new(), binary: None, trailing: total - length };
    let (mut at, mut chunks) = (HEADER, 0);
    while length - at.min(length) >= CHUNK_HEADER {
        let header = piece(source, at, CHUNK_HEADER, context)?;
        let (bytes, kind) = (u64::from(word(&header, 0).unwrap_or(0)), word(&header, 4).unwrap_or(0));
        let first = at + CHUNK_HEADER;
        if bytes > length - first {
            let found = format!("a chunk of {}", counted(bytes, "byte", "bytes"));
            let expected = format!("at most {}, the rest of the file; it is truncated: copy it again", length - first);
            return Err(malformed(at, found, &expected));
        }
        match (chunks, kind) {
            (0, JSON) => {
                tally::check_length(bytes, max, context)?;
                container.json = piece(source, first, bytes, context)?;
            }
            (0, _) => return Err(malformed(at, format!("a chunk of type {kind:#010x}"), "the JSON chunk first")),
            (1, BIN) => container.binary = Some((first, bytes)),
            // Chunks of other types are for extensions: the specification says to pass over them.
            _ => {}
        }
        chunks += 1;
        at = first + bytes;
    }
    if chunks == 0 {
        return Err(malformed(
            at,
            "no chunk".to_owned(),
            "the JSON chunk; the file is truncated: copy or export it again",
        ));
    }
    Ok(container)
}

/// Bytes of the file that were checked to lie in it.
fn piece(source: &mut dyn Bytes, at: u64, length: u64, context: &Context<'_>) -> Result<Vec<u8>, ReadError> {
    let io = |source| ReadError::Io { file: context.path.to_owned(), offset: at, source };
    source.seek(SeekFrom::Start(at)).map_err(io)?;
    let mut bytes = Vec::new();
    source.take(length).read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

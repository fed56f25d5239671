//! What the files of samples and of masks have in common: a header of fixed length, data in blocks, and at the end a table with a hash of each
//! block, whose own hash is in the header.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};

/// Bytes of the hash of a block.
pub(crate) const HASH_BYTES: usize = 8;

/// The first bytes of a block's BLAKE3.
pub(crate) fn short_hash(block: &[u8]) -> [u8; HASH_BYTES] {
    let mut short = [0; HASH_BYTES];
    short.copy_from_slice(&blake3::hash(block).as_bytes()[..HASH_BYTES]);
    short
}

/// The header and the length of the file; inside, a sentence about a file that is too short to have one.
///
/// # Errors
/// The system's.
pub(crate) fn header<const N: usize>(file: &mut File) -> io::Result<Result<([u8; N], u64), String>> {
    let total = file.metadata()?.len();
    if total < N as u64 {
        return Ok(Err(format!("it has {total} bytes; a header has {N}")));
    }
    let mut head = [0; N];
    file.read_exact(&mut head)?;
    Ok(Ok((head, total)))
}

/// The table of so many blocks, at this byte, with this hash; inside, a sentence about one that is damaged. The length of the file has been checked.
///
/// # Errors
/// The system's.
pub(crate) fn table(file: &mut File, at: u64, blocks: u64, hash: [u8; 32]) -> io::Result<Result<Vec<u8>, String>> {
    let mut table = vec![0; blocks as usize * HASH_BYTES];
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(&mut table)?;
    if *blake3::hash(&table).as_bytes() != hash {
        return Ok(Err(format!("its table is damaged (from byte {at})")));
    }
    Ok(Ok(table))
}

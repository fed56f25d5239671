//! Reading and writing little-endian fields without ever indexing past the end.

use crate::PackError;
use crate::plural::counted;

/// A read position in a byte slice; every read is checked.
pub(crate) struct Cursor<'a> {
    bytes: &'a [u8],
    read: usize,
    what: &'a str,
}

impl<'a> Cursor<'a> {
    /// Read `bytes`, which errors will call `what`.
    pub(crate) fn new(bytes: &'a [u8], what: &'a str) -> Self {
        Self { bytes, read: 0, what }
    }

    /// The next `n` bytes.
    pub(crate) fn take(&mut self, n: usize) -> Result<&'a [u8], PackError> {
        let rest = self.bytes.get(self.read..).unwrap_or_default();
        let Some(taken) = rest.get(..n) else {
            return Err(PackError::Truncated {
                what: self.what.to_owned(),
                needed: (self.read as u64).saturating_add(n as u64),
                available: self.bytes.len() as u64,
            });
        };
        self.read += n;
        Ok(taken)
    }

    /// The next `N` bytes as an array.
    pub(crate) fn array<const N: usize>(&mut self) -> Result<[u8; N], PackError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, PackError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    pub(crate) fn u16(&mut self) -> Result<u16, PackError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    pub(crate) fn u32(&mut self) -> Result<u32, PackError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(crate) fn i32(&mut self) -> Result<i32, PackError> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    pub(crate) fn u64(&mut self) -> Result<u64, PackError> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub(crate) fn f32(&mut self) -> Result<f32, PackError> {
        Ok(f32::from_le_bytes(self.array()?))
    }

    pub(crate) fn f64(&mut self) -> Result<f64, PackError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// An unsigned LEB128 number of at most 32 bits.
    pub(crate) fn varint(&mut self) -> Result<u32, PackError> {
        let mut value = 0u64;
        for shift in (0..35).step_by(7) {
            let byte = self.u8()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return u32::try_from(value).map_err(|_| self.invalid("a number has more than 32 bits"));
            }
        }
        Err(self.invalid("a number has more than 32 bits"))
    }

    /// Bytes not read yet.
    pub(crate) fn remaining(&self) -> usize {
        self.bytes.len().saturating_sub(self.read)
    }

    /// Fails when bytes are left over.
    pub(crate) fn end(&self) -> Result<(), PackError> {
        if self.remaining() == 0 {
            return Ok(());
        }
        Err(self.invalid(&format!("{} left over at its end", counted(self.remaining(), "byte is", "bytes are"))))
    }

    /// An error about this part.
    pub(crate) fn invalid(&self, why: &str) -> PackError {
        PackError::Invalid { what: self.what.to_owned(), why: why.to_owned() }
    }
}

/// Append an unsigned LEB128 number.
pub(crate) fn push_varint(out: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        out.push((value & 0x7f) as u8 | 0x80);
        value >>= 7;
    }
    out.push((value & 0x7f) as u8);
}

/// The first 16 bytes of a BLAKE3 hash: the checksum used throughout a pack.
pub fn checksum(bytes: &[u8]) -> [u8; 16] {
    let hash = blake3::hash(bytes);
    let mut out = [0; 16];
    for (to, from) in out.iter_mut().zip(hash.as_bytes()) {
        *to = *from;
    }
    out
}

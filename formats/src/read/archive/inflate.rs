//! The bytes of an entry: inflated, counted and compared with its checksum.

use super::directory::{Archive, Entry, relative};
use flate2::bufread::DeflateDecoder;
use kilwa_pack::plural::counted;
use rawzip::{CompressionMethod, Crc32};
use std::borrow::Cow;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use tempfile::{SpooledTempFile, spooled_tempfile_in};

/// Bytes of all entries that are ever inflated into memory while an archive is open; whatever comes after goes to scratch files.
pub(super) const IN_MEMORY: u64 = 16 << 20;
/// Bytes of one of them.
const SMALL: u64 = 1 << 20;
/// Bytes that deflate can yield for one.
pub(super) const RATIO_MAX: u64 = 1032;
/// Bytes per compressed byte that no mesh or picture reaches; checked for entries of [`BOMB`] bytes and more.
const RATIO: u64 = 250;
const BOMB: u64 = 16 << 20;
/// Bytes read at a time.
const BLOCK: usize = 64 << 10;
/// The longest name and extra fields of an entry.
const LOCAL_NAMES: usize = 2 << 16;

const DAMAGED: &str = "what the list of files in the archive states; the archive is damaged: download or copy it again";

/// Why an entry cannot be read.
#[derive(Debug)]
pub(super) enum Fault {
    /// It is damaged or refused.
    Bad { found: String, expected: &'static str },
    /// A scratch file failed.
    Scratch { what: &'static str, source: io::Error },
}

impl Fault {
    fn bad(found: impl Into<String>, expected: &'static str) -> Self {
        Self::Bad { found: found.into(), expected }
    }

    /// For readers that take a companion as a file.
    pub(super) fn into_io(self) -> io::Error {
        match self {
            Self::Bad { found, expected } => {
                io::Error::new(io::ErrorKind::InvalidData, format!("{found}; expected {expected}"))
            }
            Self::Scratch { what, source } => {
                io::Error::new(source.kind(), format!("a scratch file cannot be {what}: {source}"))
            }
        }
    }
}

impl Archive<'_> {
    /// All bytes of an entry, in memory if it is small, else in a scratch file without a name; at its beginning.
    ///
    /// # Errors
    /// [`Fault`]
    pub(super) fn spooled(&self, entry: &Entry) -> Result<SpooledTempFile, Fault> {
        let held = self.in_memory.get();
        let is_small = entry.bytes <= SMALL && held + entry.bytes <= IN_MEMORY;
        if is_small {
            self.in_memory.set(held + entry.bytes);
        }
        let mut file = spooled_tempfile_in(if is_small { SMALL as usize } else { 0 }, &self.scratch);
        self.inflated(entry, &mut |block| {
            file.write_all(block).map_err(|source| Fault::Scratch { what: "written", source })
        })?;
        file.seek(SeekFrom::Start(0)).map_err(|source| Fault::Scratch { what: "read", source })?;
        Ok(file)
    }

    /// All bytes of an entry of at most `max`.
    ///
    /// # Errors
    /// What [`Fault`] says; [`io::ErrorKind::FileTooLarge`] if it states more.
    pub(super) fn bytes(&self, entry: &Entry, max: u64) -> io::Result<Vec<u8>> {
        if entry.bytes > max {
            return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("it is longer than {max} bytes")));
        }
        let mut bytes = Vec::new();
        let keep = &mut |block: &[u8]| {
            bytes.extend_from_slice(block);
            Ok(())
        };
        self.inflated(entry, keep).map_err(Fault::into_io)?;
        Ok(bytes)
    }

    /// The first bytes of an entry, at most `max`, which are not compared with the checksum.
    ///
    /// # Errors
    /// [`Fault`]
    pub(super) fn beginning(&self, entry: &Entry, max: u64) -> Result<Vec<u8>, Fault> {
        let mut start = Vec::new();
        self.stream(entry)?.take(max.min(entry.bytes)).read_to_end(&mut start).map_err(|e| broken(&e))?;
        Ok(start)
    }

    /// Hand on all bytes in blocks, then compare their number and checksum.
    ///
    /// # Errors
    /// [`Fault`], and what `each` returns.
    pub(super) fn inflated(
        &self,
        entry: &Entry,
        each: &mut dyn FnMut(&[u8]) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        // One byte more, to see whether there is more.
        let mut stream = self.stream(entry)?.take(entry.bytes.saturating_add(1));
        let (mut sum, mut count) = (Crc32::new(), 0);
        let mut buffer = vec![0; BLOCK];
        loop {
            let n = match stream.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => continue,
                Err(e) => return Err(broken(&e)),
            };
            count += n as u64;
            if count > entry.bytes {
                return Err(Fault::bad(format!("more than {}", counted(entry.bytes, "byte", "bytes")), DAMAGED));
            }
            sum.update(&buffer[..n]);
            each(&buffer[..n])?;
        }
        if count < entry.bytes {
            let found = format!("{} of {}", count, counted(entry.bytes, "byte", "bytes"));
            return Err(Fault::bad(found, DAMAGED));
        }
        if sum.checksum() != entry.crc {
            return Err(Fault::bad("another checksum", DAMAGED));
        }
        Ok(())
    }

    /// Begin to inflate an entry.
    fn stream(&self, entry: &Entry) -> Result<Box<dyn Read + '_>, Fault> {
        let is_stored = match entry.method {
            CompressionMethod::STORE => true,
            CompressionMethod::DEFLATE => false,
            other => {
                let name = other.name().map_or(Cow::Owned(format!("number {}", other.as_u16())), Cow::Borrowed);
                let expected = "deflate or no compression; unpack the archive and give the mesh, or compress it again";
                return Err(Fault::bad(format!("the compression method {name}"), expected));
            }
        };
        if is_stored && entry.packed != entry.bytes {
            let found = format!("{} for {}, not compressed", counted(entry.packed, "byte", "bytes"), entry.bytes);
            return Err(Fault::bad(found, DAMAGED));
        }
        if entry.bytes > entry.at_most() || entry.bytes >= BOMB && entry.bytes / RATIO > entry.packed {
            let found = format!("{} that inflate to {}", counted(entry.packed, "byte", "bytes"), entry.bytes);
            let expected = "at most 250 bytes for each compressed byte, as in meshes and pictures; if you trust the archive, unpack it and give the mesh";
            return Err(Fault::bad(found, expected));
        }
        let lies = |what: &str| Fault::bad(format!("a different {what} in front of its data"), DAMAGED);
        let found = self.zip.get_entry(entry.way).map_err(|_| lies("header"))?;
        let (_, end) = found.compressed_data_range();
        if end > entry.end {
            return Err(Fault::bad("bytes that belong to the next file", DAMAGED));
        }
        let mut buffer = vec![0; LOCAL_NAMES];
        let header = found.local_header(&mut buffer).map_err(|_| lies("header"))?;
        if header.compression_method() != entry.method || header.flags().is_encrypted() {
            return Err(lies("method"));
        }
        if relative(header.file_path().as_bytes()).ok().as_deref() != Some(&entry.name) {
            return Err(lies("name"));
        }
        let packed = BufReader::with_capacity(BLOCK, found.reader());
        Ok(if is_stored { Box::new(packed) } else { Box::new(DeflateDecoder::new(packed)) })
    }
}

/// An entry that cannot be inflated, or whose bytes cannot be read.
fn broken(e: &io::Error) -> Fault {
    match e.kind() {
        io::ErrorKind::UnexpectedEof => Fault::bad("the end of the file", DAMAGED),
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => Fault::bad("a damaged deflate stream", DAMAGED),
        _ => Fault::bad(format!("an error of the system ({e})"), "a file that can be read"),
    }
}

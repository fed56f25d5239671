//! The list of the entries of an archive, and what is refused before anything is inflated.
//!
//! Invariants of an open archive: names are unique, relative, with `/` between their parts and without `.` and `..`; no entry is encrypted, a
//! link or a special file; no two entries have bytes in common, nor any with the list of entries.

use super::inflate::{Fault, RATIO_MAX};
use crate::read::{Bytes, Place, ReadError, ReadOptions};
use kilwa_pack::plural::counted;
use kilwa_pack::visible::visible;
use rawzip::{
    CompressionMethod, ErrorKind, MAX_CENTRAL_DIRECTORY_RECORD_SIZE, RECOMMENDED_BUFFER_SIZE, ReaderAt, ZipArchive,
    ZipArchiveEntryWayfinder, ZipFileHeaderRecord, ZipLocator,
};
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::fmt;
use std::io::{self, SeekFrom};
use std::path::{Path, PathBuf};

/// The most bytes of the list of entries; downloads have some hundred entries of about a hundred bytes.
const DIRECTORY_MAX: u64 = 4 << 20;
/// The longest name, bytes: what systems allow in a path.
const NAME_MAX: usize = 4096;
/// Bytes of the header in front of an entry, without its name.
const LOCAL_HEADER: u64 = 30;
/// Bytes of a record in the list of entries, without its name.
const RECORD: u64 = 46;

const AGAIN: &str = "download or copy the archive again";

/// The bytes of the file, from any place.
pub(super) struct Shared<'s>(RefCell<&'s mut dyn Bytes>);

impl ReaderAt for Shared<'_> {
    fn read_at(&self, into: &mut [u8], offset: u64) -> io::Result<usize> {
        let mut source = self.0.borrow_mut();
        source.seek(SeekFrom::Start(offset))?;
        source.read(into)
    }
}

/// A file in an archive.
#[derive(Debug)]
pub(super) struct Entry {
    /// Its name, without `./`.
    pub(super) name: String,
    /// Where it is.
    pub(super) way: ZipArchiveEntryWayfinder,
    /// How it is compressed.
    pub(super) method: CompressionMethod,
    /// Bytes that it takes.
    pub(super) packed: u64,
    /// Bytes that it inflates to, as stated.
    pub(super) bytes: u64,
    /// The checksum of these.
    pub(super) crc: u32,
    /// Where it begins.
    header: u64,
    /// Where the next entry, or the list of entries, begins.
    pub(super) end: u64,
}

impl Entry {
    /// Its name for a message.
    pub(super) fn shown(&self) -> String {
        shown(&self.name)
    }

    /// Bytes that it can inflate to: no more than deflate can yield.
    pub(super) fn at_most(&self) -> u64 {
        self.bytes.min(self.packed.saturating_mul(RATIO_MAX).saturating_add(RATIO_MAX))
    }

    /// The part of the name after the last dot, in lower case.
    pub(super) fn extension(&self) -> String {
        let last = self.name.rsplit('/').next().unwrap_or_default();
        last.rsplit_once('.').map_or_else(String::new, |(_, end)| end.to_ascii_lowercase())
    }

    /// Whether it belongs to the content: macOS and others add hidden files.
    pub(super) fn is_content(&self) -> bool {
        !self.name.split('/').any(|part| part.starts_with('.') || part == "__MACOSX")
    }
}

/// An open archive.
pub(super) struct Archive<'s> {
    path: PathBuf,
    /// Where entries are inflated to if they are large.
    pub(super) scratch: PathBuf,
    pub(super) zip: ZipArchive<Shared<'s>>,
    /// Sorted by name.
    files: Vec<Entry>,
    by_lower_case: HashMap<String, usize>,
    /// Bytes of entries that were inflated into memory.
    pub(super) in_memory: Cell<u64>,
}

impl fmt::Debug for Archive<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Archive").field("path", &self.path).field("files", &self.files).finish_non_exhaustive()
    }
}

impl<'s> Archive<'s> {
    /// Read the list of entries.
    ///
    /// # Errors
    /// [`ReadError`]: the archive is truncated or damaged, or has entries that are refused.
    pub(super) fn open(
        source: &'s mut dyn Bytes,
        total: u64,
        path: &Path,
        options: &ReadOptions,
    ) -> Result<Self, ReadError> {
        let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
        let shared = Shared(RefCell::new(source));
        let zip = ZipLocator::new()
            .locate_in_reader(shared, &mut buffer, total)
            .map_err(|(_, e)| damaged(path, e.into_kind(), total))?;
        let mut files = entries(&zip, total, path)?;
        files.sort_by(|a, b| a.name.cmp(&b.name));
        if let Some((entry, _)) = files.iter().zip(files.iter().skip(1)).find(|(a, b)| a.name == b.name) {
            let found = "a name that occurs twice".to_owned();
            return Err(part(path, &entry.name, found, "each name once; unpack the archive and check the files"));
        }
        let mut by_lower_case = HashMap::with_capacity(files.len());
        for (number, file) in files.iter().enumerate() {
            by_lower_case.entry(file.name.to_lowercase()).or_insert(number);
        }
        let (path, scratch) = (path.to_owned(), options.scratch.clone());
        Ok(Self { path, scratch, zip, files, by_lower_case, in_memory: Cell::new(0) })
    }

    /// All files, sorted by name.
    pub(super) fn files(&self) -> &[Entry] {
        &self.files
    }

    /// The file of this name.
    pub(super) fn named(&self, name: &str) -> Option<&Entry> {
        self.files.binary_search_by(|entry| entry.name.as_str().cmp(name)).ok().map(|number| &self.files[number])
    }

    /// The first file of this name in lower case.
    pub(super) fn named_in_any_case(&self, lower: &str) -> Option<&Entry> {
        self.by_lower_case.get(lower).map(|number| &self.files[*number])
    }

    /// The file of the archive.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// An entry in messages: its name behind that of the archive.
    pub(super) fn path_of(&self, entry: &Entry) -> PathBuf {
        self.path.join(&entry.name)
    }

    /// The error for an archive that needs what is not supported.
    pub(super) fn needs(&self, needs: String, way_out: &'static str) -> ReadError {
        ReadError::Needs { file: self.path.clone(), needs, way_out }
    }

    /// The error for an entry that cannot be read.
    pub(super) fn refusal(&self, entry: &Entry, fault: Fault) -> ReadError {
        match fault {
            Fault::Bad { found, expected } => part(&self.path, &entry.name, found, expected),
            Fault::Scratch { what, source } => {
                ReadError::Scratch { file: self.path.clone(), folder: self.scratch.clone(), what, source }
            }
        }
    }
}

/// All files, in the order of the list.
fn entries(zip: &ZipArchive<Shared<'_>>, total: u64, path: &Path) -> Result<Vec<Entry>, ReadError> {
    let mut buffer = vec![0; MAX_CENTRAL_DIRECTORY_RECORD_SIZE];
    let (mut files, mut ranges) = (Vec::new(), Vec::new());
    let mut left = DIRECTORY_MAX;
    let mut records = zip.entries(&mut buffer);
    while let Some(record) = records.next_entry().map_err(|e| damaged(path, e.into_kind(), total))? {
        let name = record.file_path().as_bytes().len() as u64;
        left = left.checked_sub(RECORD + name).ok_or_else(|| {
            let what =
                format!("its list of files has more than {} MiB; unpack it and give the mesh", DIRECTORY_MAX >> 20);
            ReadError::TooLarge { file: path.to_owned(), what }
        })?;
        let header = record.local_header_offset();
        let end = header.saturating_add(LOCAL_HEADER + name).saturating_add(record.compressed_size_hint());
        ranges.push((header, end));
        files.extend(entry(&record, path)?);
    }
    let stated = zip.entries_hint();
    if stated != ranges.len() as u64 && stated & 0xffff != ranges.len() as u64 & 0xffff {
        let found = format!("{} in its list", counted(ranges.len() as u64, "file", "files"));
        let expected = format!("{stated}, as its end states; {AGAIN}");
        return Err(ReadError::Malformed {
            file: path.to_owned(),
            place: Place::Byte(zip.directory_offset()),
            found,
            expected,
        });
    }
    refuse_overlaps(&mut files, ranges, zip.directory_offset(), path)?;
    Ok(files)
}

/// A file; `None` for a folder.
fn entry(record: &ZipFileHeaderRecord<'_>, path: &Path) -> Result<Option<Entry>, ReadError> {
    const KIND: u32 = 0o170_000;
    const FILE: u32 = 0o100_000;
    const LINK: u32 = 0o120_000;
    let raw = record.file_path();
    let refused =
        |found: &str, expected: &str| part(path, &String::from_utf8_lossy(raw.as_bytes()), found.to_owned(), expected);
    let name = relative(raw.as_bytes()).map_err(|found| {
        refused(found, "a relative name without \"..\", backslashes or a drive letter; make the archive again")
    })?;
    let flags = record.flags();
    let is_encrypted = flags.is_encrypted() || flags.has_strong_encryption() || flags.is_masked();
    if is_encrypted || record.compression_method() == CompressionMethod::AES {
        return Err(refused(
            "an encrypted file",
            "no encryption; unpack the archive with its password and give the mesh",
        ));
    }
    if record.is_dir() {
        return Ok(None);
    }
    let kind = record.mode().value() & KIND;
    if kind != 0 && kind != FILE {
        let found = if kind == LINK { "a link" } else { "a folder, a pipe or a device with the name of a file" };
        return Err(refused(found, "files and folders alone; unpack the archive and give the mesh"));
    }
    Ok(Some(Entry {
        name,
        way: record.wayfinder(),
        method: record.compression_method(),
        packed: record.compressed_size_hint(),
        bytes: record.uncompressed_size_hint(),
        crc: record.crc32(),
        header: record.local_header_offset(),
        end: 0,
    }))
}

/// A name without `.` and empty parts.
///
/// # Errors
/// What is wrong with it.
pub(super) fn relative(raw: &[u8]) -> Result<String, &'static str> {
    if raw.len() > NAME_MAX {
        return Err("a name of more than 4096 bytes");
    }
    // Names in another encoding must stay distinct, and files are not found by them: each byte becomes a character.
    let name = String::from_utf8(raw.to_vec()).unwrap_or_else(|_| raw.iter().copied().map(char::from).collect());
    if name.starts_with('/') {
        return Err("an absolute name");
    }
    if name.contains('\\') {
        return Err("a name with a backslash");
    }
    if name.as_bytes().get(1) == Some(&b':') {
        return Err("a name with a drive letter");
    }
    if name.contains('\0') {
        return Err("a name with a zero byte");
    }
    let parts: Vec<&str> = name.split('/').filter(|part| !part.is_empty() && *part != ".").collect();
    if parts.contains(&"..") {
        return Err("a name that leads upwards (\"..\")");
    }
    if parts.is_empty() { Err("no name") } else { Ok(parts.join("/")) }
}

/// Note where each file ends at the latest; refuse those that share bytes.
///
/// `ranges` are the places of all entries, folders as well.
fn refuse_overlaps(
    files: &mut [Entry],
    mut ranges: Vec<(u64, u64)>,
    directory: u64,
    path: &Path,
) -> Result<(), ReadError> {
    ranges.sort_unstable();
    ranges.push((directory, directory));
    let mut neighbours = ranges.iter().zip(ranges.iter().skip(1));
    if let Some(((_, end), (next, _))) = neighbours.find(|((_, end), (next, _))| end > next) {
        let found = format!("a file that ends at byte {end}, behind the beginning of the next at byte {next}");
        let expected = format!("files one after another; {AGAIN}, and do not trust it if that does not help");
        return Err(ReadError::Malformed { file: path.to_owned(), place: Place::Byte(*next), found, expected });
    }
    for file in files {
        let next = ranges.partition_point(|(begin, _)| *begin <= file.header);
        file.end = ranges.get(next).map_or(directory, |(begin, _)| *begin);
    }
    Ok(())
}

/// The error for an archive whose list of entries cannot be read.
fn damaged(path: &Path, kind: ErrorKind, total: u64) -> ReadError {
    let file = path.to_owned();
    let malformed = |found: String| ReadError::Malformed {
        file: path.to_owned(),
        place: Place::Byte(total),
        found,
        expected: format!("the list of files at the end of a ZIP archive; it is truncated or damaged: {AGAIN}"),
    };
    match kind {
        ErrorKind::IO(e) if e.kind() == io::ErrorKind::UnexpectedEof => malformed("the end of the file".to_owned()),
        ErrorKind::IO(source) => ReadError::Io { file, offset: 0, source },
        ErrorKind::Eof | ErrorKind::MissingEndOfCentralDirectory => malformed("the end of the file".to_owned()),
        other => malformed(visible(&other.to_string()).into_owned()),
    }
}

/// The error for an entry.
fn part(path: &Path, name: &str, found: String, expected: &str) -> ReadError {
    let part = format!("entry \"{}\"", shown(name));
    ReadError::Part { file: path.to_owned(), part, found, expected: expected.to_owned() }
}

/// A name for a message.
pub(super) fn shown(name: &str) -> String {
    visible(&name.chars().take(80).collect::<String>()).into_owned()
}

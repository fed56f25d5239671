//! Opening packs that are files.

use anyhow::Context;
pub(crate) use kilwa_archive::source::FileSource;
use kilwa_files::plain_file;
use kilwa_pack::Reader;
use std::path::Path;

/// All of a plain file that a person named, of at most `max` bytes.
///
/// # Errors
/// When it cannot be read, is longer, or is a pipe or a device, which could be read without end; the message names the file.
pub(crate) fn read_named(path: &Path, max: u64) -> anyhow::Result<Vec<u8>> {
    let read = plain_file::open(path).and_then(|file| plain_file::read(file, max));
    read.with_context(|| format!("cannot read {}", path.display()))
}

/// The same, as text.
///
/// # Errors
/// As [`read_named`], and where it is not UTF-8.
pub(crate) fn read_named_text(path: &Path, max: u64) -> anyhow::Result<String> {
    String::from_utf8(read_named(path, max)?).with_context(|| format!("{} is not UTF-8", path.display()))
}

/// Open and check a pack.
///
/// # Errors
/// When the file cannot be read or is not a sound pack; the message names the file.
pub(crate) fn open_pack(path: &Path) -> anyhow::Result<Reader<FileSource>> {
    // Opening a pipe would wait for whoever writes to it.
    let is_special = std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir());
    anyhow::ensure!(!is_special, "{} is not a regular file; give the path of a pack", path.display());
    Reader::open(FileSource::open(path)?).with_context(|| path.display().to_string())
}

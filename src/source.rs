//! Opening packs that are files.

use anyhow::Context;
use kilwa_pack::Reader;
pub(crate) use kilwa_server::object::source::FileSource;
use std::path::Path;

/// Open and check a pack.
///
/// # Errors
/// When the file cannot be read or is no sound pack; the message names the file.
pub(crate) fn open_pack(path: &Path) -> anyhow::Result<Reader<FileSource>> {
    // Opening a pipe would wait for whoever writes to it.
    let is_special = std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir());
    anyhow::ensure!(!is_special, "{} is not a regular file; give the path of a pack", path.display());
    Reader::open(FileSource::open(path)?).with_context(|| path.display().to_string())
}

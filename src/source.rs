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
    Reader::open(FileSource::open(path)?).with_context(|| path.display().to_string())
}

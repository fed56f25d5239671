//! The file on the disk: read with its hash, checked for whether it may be written, replaced whole.

use kilwa_archive::Metadata;
use kilwa_archive::metadata::document::Document;
use kilwa_files::atomic::{self, Access, folder_of};
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Largest metadata file that is read, bytes: as `kilwa metadata check` reads.
const FILE_MAX: u64 = 1 << 20;
/// Used instead of a hash if there is no file.
const NOTHING: &str = "none";

/// Why a file cannot be edited.
#[derive(Debug, Error)]
pub enum FileError {
    /// It is a folder.
    #[error("{} is a folder; give the name of a file, for example {}", .0.display(), .0.join("metadata.toml").display())]
    Folder(PathBuf),
    /// It is a pipe or a device.
    #[error("{} is a pipe or a device; give the name of a file", .0.display())]
    Special(PathBuf),
    /// It is a link to a file that does not exist.
    #[error("{} is a link to a file that does not exist; give the name of the file itself", .0.display())]
    BrokenLink(PathBuf),
    /// Its folder does not exist.
    #[error("{} does not exist; make this folder first, or give another name", .0.display())]
    NoFolder(PathBuf),
    /// It is larger than any metadata file.
    #[error("{} is too long for a metadata file: {bytes} bytes; the limit is {FILE_MAX}", .path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// It is not text.
    #[error("{}: line {line}: the file is not UTF-8; save it as UTF-8 with a text editor (in Notepad: Save as, Encoding)", .path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// From 1.
        line: usize,
    },
    /// It is text, but not TOML; the text has file and line.
    #[error("{0}")]
    NotToml(String),
    /// The system refused.
    #[error("cannot read {}: {source}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Its error.
        source: io::Error,
    },
    /// The system gives no random numbers.
    #[error("{0}")]
    Secret(String),
}

/// What is at a path.
#[derive(Debug)]
pub(super) enum Content {
    /// A file.
    Text(String),
    /// No file.
    Nothing,
}

impl Content {
    pub(super) fn is_new(&self) -> bool {
        matches!(self, Self::Nothing)
    }

    pub(super) fn is(&self, other: &str) -> bool {
        matches!(self, Self::Text(text) if text == other)
    }

    pub(super) fn hash(&self) -> String {
        match self {
            Self::Text(text) => hash_of(text),
            Self::Nothing => NOTHING.to_owned(),
        }
    }
}

/// A state of the file that a page was made from.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Of the file on the disk.
    pub(super) hash: String,
    pub(super) document: Document,
    /// Its name, without the folder.
    pub(super) name: String,
}

impl Seen {
    pub(super) fn new(is_new: bool, document: Document, path: &Path) -> Self {
        let hash = if is_new { NOTHING.to_owned() } else { hash_of(document.text()) };
        Self { hash, document, name: name_of(path) }
    }

    /// Whether the file does not exist yet.
    pub(super) fn is_new(&self) -> bool {
        self.hash == NOTHING
    }
}

fn hash_of(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// 128 bits from the system's generator, in hexadecimal.
pub(super) fn secret() -> Result<String, String> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|e| format!("the system provides no random numbers: {e}"))?;
    Ok(blake3::Hash::from_bytes(bytes).to_hex().as_str()[..32].to_owned())
}

/// Whether a file can be at a path.
pub(super) fn check_place(path: &Path) -> Result<(), FileError> {
    match std::fs::metadata(path) {
        Ok(about) if about.is_dir() => Err(FileError::Folder(path.to_owned())),
        Ok(about) if !about.is_file() => Err(FileError::Special(path.to_owned())),
        Err(_) if !folder_of(path).is_dir() => Err(FileError::NoFolder(folder_of(path).to_owned())),
        _ => Ok(()),
    }
}

/// The file, which must be TOML.
pub(super) fn read(path: &Path) -> Result<Content, FileError> {
    let unreadable = |source| FileError::Unreadable { path: path.to_owned(), source };
    let about = match std::fs::metadata(path) {
        Ok(about) => about,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Content::Nothing),
        Err(e) => return Err(unreadable(e)),
    };
    check_place(path)?;
    check_length(path, about.len())?;
    let bytes = std::fs::read(path).map_err(unreadable)?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes().iter().take(e.utf8_error().valid_up_to()).filter(|b| **b == b'\n').count() + 1;
        FileError::NotText { path: path.to_owned(), line }
    })?;
    if let Err(e) = Document::parse(&text) {
        // The check says more about what people write by mistake.
        let why = Metadata::parse(&text).err().map_or_else(|| e.to_string(), |problems| problems.to_string());
        return Err(FileError::NotToml(format!("{} is not a metadata file: {why}", path.display())));
    }
    Ok(Content::Text(text))
}

/// Whether a text could be read again as a metadata file.
pub(super) fn check_size(path: &Path, text: &str) -> Result<(), FileError> {
    check_length(path, text.len() as u64)
}

fn check_length(path: &Path, bytes: u64) -> Result<(), FileError> {
    if bytes > FILE_MAX { Err(FileError::TooLarge { path: path.to_owned(), bytes }) } else { Ok(()) }
}

/// Whether a file may not be written, as far as its permissions say.
pub(super) fn is_read_only(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|about| about.permissions().readonly())
}

/// Write the file whole; `replace`: it is there.
pub(super) fn write(path: &Path, text: &str, replace: bool) -> io::Result<()> {
    let named = |e: io::Error| io::Error::new(e.kind(), format!("cannot write {}: {e}", path.display()));
    if !replace {
        return atomic::write(path, text.as_bytes(), Access::Default, false).map_err(named);
    }
    let about = std::fs::metadata(path)?;
    // A rename would replace even a read-only file.
    if about.permissions().readonly() {
        let why = format!("{} is read-only; allow writing it, and save again", path.display());
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
    }
    atomic::write(path, text.as_bytes(), Access::Like(&about), true).map_err(named)
}

/// The name of a file, without its folder.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// A name beside a file that is not in use: `gereza-2.toml`.
pub(super) fn copy_of(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let names = (2_u32..).map(|n| path.with_file_name(format!("{stem}-{n}{extension}")));
    // There is always one more.
    names.into_iter().find(|name| !name.exists()).unwrap_or_else(|| path.with_extension("copy"))
}

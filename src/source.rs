//! Byte sources for packs: files, read by position so that threads can share one.

use anyhow::Context;
use kilwa_pack::{Reader, Source};
use std::fs::File;
use std::path::Path;

/// A pack in a file.
pub(crate) struct FileSource {
    file: File,
    #[cfg(not(unix))]
    cursor: std::sync::Mutex<()>,
}

impl FileSource {
    /// Open a file for reading.
    ///
    /// # Errors
    /// When it cannot be opened, or is a folder.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let source = Self::new(path).with_context(|| format!("cannot open {}", path.display()))?;
        let kind = source.file.metadata().with_context(|| format!("cannot read {}", path.display()))?;
        if kind.is_dir() {
            anyhow::bail!("{} is a folder; give the .kilwa file in it", path.display());
        }
        Ok(source)
    }

    /// The same, with the system's own error.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub(crate) fn new(path: &Path) -> std::io::Result<Self> {
        Ok(Self {
            file: File::open(path)?,
            #[cfg(not(unix))]
            cursor: std::sync::Mutex::new(()),
        })
    }
}

/// Open and check a pack.
///
/// # Errors
/// When the file cannot be read or is no sound pack; the message names the file.
pub(crate) fn open_pack(path: &Path) -> anyhow::Result<Reader<FileSource>> {
    Reader::open(FileSource::open(path)?).with_context(|| path.display().to_string())
}

impl Source for FileSource {
    fn len(&self) -> std::io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    #[cfg(unix)]
    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        std::os::unix::fs::FileExt::read_exact_at(&self.file, &mut bytes, offset)?;
        Ok(bytes)
    }

    #[cfg(not(unix))]
    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        use std::io::{Read, Seek, SeekFrom};
        // One file position for all threads: seek and read belong together.
        let _held = self.cursor.lock().map_err(|_| std::io::Error::other("another reader failed"))?;
        let mut file = &self.file;
        file.seek(SeekFrom::Start(offset))?;
        let mut bytes = vec![0; length];
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

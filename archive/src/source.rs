//! A file as the bytes of a pack: read by position, so that threads can share it.

use kilwa_files::plain_file;
use kilwa_pack::Source;
use std::fs::File;
use std::io;
use std::path::Path;

/// A pack in a file.
pub struct FileSource {
    file: File,
    #[cfg(not(unix))]
    cursor: std::sync::Mutex<()>,
}

impl FileSource {
    /// Open a file for reading.
    ///
    /// # Errors
    /// When it cannot be opened, or is not a regular file; the message names it.
    pub fn open(path: &Path) -> io::Result<Self> {
        plain_file::open(path).map(Self::of).map_err(|e| {
            let message = match e.kind() {
                io::ErrorKind::IsADirectory => format!("{} is a folder; give the .kilwa file in it", path.display()),
                _ => format!("cannot open {}: {e}", path.display()),
            };
            io::Error::new(e.kind(), message)
        })
    }

    /// A file that is open.
    pub fn of(file: File) -> Self {
        Self {
            file,
            #[cfg(not(unix))]
            cursor: std::sync::Mutex::new(()),
        }
    }
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

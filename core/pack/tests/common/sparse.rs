//! A large file that takes little space, because most of it is holes.

use kilwa_pack::Source;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;

/// A file that is removed at the end.
pub(crate) struct Sparse {
    pub(crate) file: File,
    path: PathBuf,
}

impl Sparse {
    /// An empty file in the system's temporary folder.
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("kilwa-{name}-{}.kilwa", std::process::id()));
        let file = File::options().read(true).write(true).create(true).truncate(true).open(&path).expect("opens");
        Self { file, path }
    }
}

impl Drop for Sparse {
    fn drop(&mut self) {
        // A leftover file in the system's temporary folder takes little space.
        let _ = std::fs::remove_file(&self.path);
    }
}

impl Source for &Sparse {
    fn len(&self) -> std::io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        self.file.read_exact_at(&mut bytes, offset)?;
        Ok(bytes)
    }
}

//! Writing a file so that its name never shows a half of it.

use super::ExtractError;
use kilwa_files::atomic::{Access, AtomicFile, Pending, folder_of};
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::output;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Where a result goes.
#[derive(Debug)]
pub struct Output {
    path: PathBuf,
    /// Something that is not a file (a device, a pipe) is written to directly: there is nothing to rename.
    direct: bool,
    replace: bool,
    /// Folders that were missing; made when the first file in them is begun.
    folders: OnceLock<MadeFolders>,
}

impl Output {
    /// Check that the output can be written.
    ///
    /// # Errors
    /// When it exists and may not be replaced, is a folder, or something else is where its folder should be.
    pub fn prepare(path: &Path, replace: bool) -> Result<Self, ExtractError> {
        let direct = output::is_special(path);
        if !direct {
            output::check(path, replace).map_err(|e| ExtractError::Output(e.to_string()))?;
        }
        Ok(Self { path: path.to_owned(), direct, replace, folders: OnceLock::new() })
    }

    /// Make the folder of the output.
    fn make_folders(&self) -> std::io::Result<()> {
        if !self.direct && self.folders.get().is_none() {
            // Nobody else can have filled it in between.
            let _ = self.folders.set(MadeFolders::for_file(&self.path)?);
        }
        Ok(())
    }

    /// The scratch files, beside the output where it is a file: what is written there is as large as the output.
    ///
    /// # Errors
    /// When they cannot be made.
    pub(super) fn scratch(&self) -> Result<Scratch, ExtractError> {
        let folder = if self.direct { std::env::temp_dir() } else { folder_of(&self.path).to_owned() };
        let made = self.make_folders();
        made.map_err(|source| ExtractError::MakeScratch { folder: folder.clone(), source })?;
        let open = || {
            let file = tempfile::tempfile_in(&folder);
            file.map(|f| BufWriter::with_capacity(1 << 20, f))
                .map_err(|source| ExtractError::MakeScratch { folder: folder.clone(), source })
        };
        Ok(Scratch { vertices: open()?, triangles: open()?, packed: open()? })
    }

    /// Write with `body` and return the number of bytes; after a failure or a signal nothing is left.
    ///
    /// # Errors
    /// What the system says, naming the file.
    pub(super) fn write(&self, body: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<u64, ExtractError> {
        let cannot = |source| ExtractError::Write { path: self.path.clone(), source };
        if self.direct {
            let file = File::options().write(true).open(&self.path).map_err(cannot)?;
            return fill(&file, body).map_err(cannot);
        }
        let write = || {
            self.make_folders()?;
            let file = AtomicFile::create(&self.path, Access::Default)?;
            let bytes = fill(file.file(), body)?;
            file.commit(self.replace).map(|()| bytes)
        };
        write().map_err(cannot)
    }

    /// Write a complete file in the folder of the output with `body`, without giving it its name `path` yet; returns its number of bytes too.
    ///
    /// # Errors
    /// What the system says, naming the file.
    pub(super) fn write_pending(
        &self,
        path: &Path,
        body: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(u64, Pending), ExtractError> {
        let write = || {
            self.make_folders()?;
            let file = AtomicFile::create(path, Access::Default)?;
            let bytes = fill(file.file(), body)?;
            file.close().map(|pending| (bytes, pending))
        };
        write().map_err(|source| ExtractError::Write { path: path.to_owned(), source })
    }
}

/// The parts of the output while they grow. The files have no name, so that nothing is left of them.
pub(super) struct Scratch {
    /// The vertices.
    pub(super) vertices: BufWriter<File>,
    /// The triangles.
    pub(super) triangles: BufWriter<File>,
    /// What an encoder makes of both once they are complete.
    pub(super) packed: BufWriter<File>,
}

impl Scratch {
    /// Copy the vertices to the output.
    pub(super) fn copy_vertices(&mut self, out: &mut dyn Write) -> std::io::Result<()> {
        copy(&mut self.vertices, out)
    }

    /// Copy the triangles to the output.
    pub(super) fn copy_triangles(&mut self, out: &mut dyn Write) -> std::io::Result<()> {
        copy(&mut self.triangles, out)
    }

    /// Copy what was made of both to the output.
    pub(super) fn copy_packed(&mut self, out: &mut dyn Write) -> std::io::Result<()> {
        copy(&mut self.packed, out)
    }
}

fn copy(part: &mut BufWriter<File>, out: &mut dyn Write) -> std::io::Result<()> {
    part.flush()?;
    let file = part.get_mut();
    file.seek(SeekFrom::Start(0))?;
    std::io::copy(file, out).map(drop)
}

/// Run `body` on a buffered, counted file.
fn fill(file: &File, body: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<u64> {
    let mut counted = Counted { inner: file, bytes: 0 };
    let mut buffered = BufWriter::with_capacity(1 << 20, &mut counted);
    body(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    Ok(counted.bytes)
}

struct Counted<W> {
    inner: W,
    bytes: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.inner.flush()
    }
}

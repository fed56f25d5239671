//! Writing a file so that its name never shows a half of it.

use super::ExtractError;
use kilwa_files::unfinished;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Where a result goes.
#[derive(Debug)]
pub struct Output {
    path: PathBuf,
    /// Something that is not a file (a device, a pipe) is written to directly: there is nothing to rename.
    direct: bool,
    replace: bool,
}

impl Output {
    /// Check that the output can be written.
    ///
    /// # Errors
    /// When it exists and may not be replaced, is a folder, or lies in a missing folder.
    pub fn prepare(path: &Path, replace: bool) -> Result<Self, ExtractError> {
        let shown = path.display();
        let refused = |why: String| Err(ExtractError::Output(why));
        let kind = std::fs::metadata(path).ok();
        if kind.as_ref().is_some_and(std::fs::Metadata::is_dir) {
            return refused(format!("{shown} is a folder; give a file name in it"));
        }
        let direct = kind.as_ref().is_some_and(|k| !k.is_file());
        if kind.is_some() && !direct && !replace {
            return refused(format!("{shown} exists already; give --force to replace it"));
        }
        let output = Self { path: path.to_owned(), direct, replace };
        let folder = output.folder();
        if !folder.is_dir() {
            return refused(format!("{shown}: the folder {} does not exist; make it first", folder.display()));
        }
        Ok(output)
    }

    fn folder(&self) -> &Path {
        self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
    }

    /// Two scratch files, beside the output where it is a file: what is written there is as large as the output.
    ///
    /// # Errors
    /// When they cannot be made.
    pub(super) fn scratch(&self) -> Result<Scratch, ExtractError> {
        let folder = if self.direct { std::env::temp_dir() } else { self.folder().to_owned() };
        let open = || {
            let file = tempfile::tempfile_in(&folder);
            file.map(|f| BufWriter::with_capacity(1 << 20, f))
                .map_err(|source| ExtractError::MakeScratch { folder: folder.clone(), source })
        };
        Ok(Scratch { vertices: open()?, triangles: open()? })
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
        let mut builder = tempfile::Builder::new();
        builder.prefix(".kilwa-").suffix(".part");
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let made = unfinished::make(|| builder.tempfile_in(self.folder()), tempfile::NamedTempFile::path);
        let (file, _unfinished) = made.map_err(cannot)?;
        let bytes = fill(file.as_file(), body).map_err(cannot)?;
        file.as_file().sync_all().map_err(cannot)?;
        let renamed = if self.replace { file.persist(&self.path) } else { file.persist_noclobber(&self.path) };
        renamed.map_err(|e| cannot(e.error))?;
        Ok(bytes)
    }
}

/// The two parts of the output while they grow. The files have no name, so that nothing is left of them.
pub(super) struct Scratch {
    /// The vertices.
    pub(super) vertices: BufWriter<File>,
    /// The triangles.
    pub(super) triangles: BufWriter<File>,
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

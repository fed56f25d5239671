//! Streams a mesh of unknown size into a binary little-endian PLY.
//!
//! PLY wants all vertices before the first face and both counts before everything. So vertices go to the file behind a
//! header of fixed length, faces to a second temporary file that is appended at the end, and the header is written
//! last. Both are temporary files in the folder of the target, removed on any failure and by a signal; [`Finished::keep`] renames.

use super::SynthError;
use super::piece::Sink;
use glam::DVec3;
use kilwa_files::atomic::{Access, AtomicFile, Pending, folder_of};
use kilwa_files::output;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const BUFFER: usize = 1 << 20;

/// The names of the files: `out`, or with blocks `NAME_000.EXT` and so on.
pub(super) fn file_names(out: &Path, blocks: Option<u32>) -> Result<Vec<PathBuf>, SynthError> {
    let name = |why| SynthError::Name { path: out.to_owned(), why };
    let stem = out.file_stem().ok_or_else(|| name("is no file name: give one such as fort.ply"))?;
    if out.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
        return Err(name("synth writes PLY: give a name that ends in .ply"));
    }
    let Some(blocks) = blocks else {
        return Ok(vec![out.to_owned()]);
    };
    let extension = out.extension().unwrap_or_default();
    let numbered = |k: u32| {
        let mut file = stem.to_owned();
        file.push(format!("_{k:03}."));
        file.push(extension);
        out.with_file_name(file)
    };
    Ok((0..blocks.min(super::MAX_BLOCKS)).map(numbered).collect())
}

/// Refuse early what would fail late: a target that exists or is a folder.
pub(super) fn check_targets(files: &[PathBuf], force: bool) -> Result<(), SynthError> {
    files.iter().try_for_each(|path| output::check(path, force)).map_err(SynthError::Output)
}

/// A PLY being written.
pub(super) struct Writer {
    path: PathBuf,
    origin: Option<DVec3>,
    comments: Vec<String>,
    vertices: BufWriter<AtomicFile<'static>>,
    faces: BufWriter<File>,
    header_bytes: usize,
    vertex_count: u64,
    face_count: u64,
}

impl Writer {
    /// Begin a file; doubles at `origin` where one is given, else floats.
    pub(super) fn create(path: &Path, origin: Option<DVec3>, comments: &[String]) -> Result<Self, SynthError> {
        let fail = |source| SynthError::Io { path: folder_of(path).to_owned(), source };
        let target = AtomicFile::create(path, Access::Default).map_err(fail)?;
        let faces = tempfile::tempfile_in(folder_of(path)).map_err(fail)?;
        let mut writer = Self {
            path: path.to_owned(),
            origin,
            comments: comments.to_vec(),
            vertices: BufWriter::with_capacity(BUFFER, target),
            faces: BufWriter::with_capacity(BUFFER, faces),
            header_bytes: 0,
            vertex_count: 0,
            face_count: 0,
        };
        writer.header_bytes = writer.header(u64::MAX, u64::MAX, 0).len() + 1;
        let room = vec![b' '; writer.header_bytes];
        writer.vertices.write_all(&room).map_err(|e| writer.error(e))?;
        Ok(writer)
    }

    fn error(&self, source: io::Error) -> SynthError {
        SynthError::Io { path: self.path.clone(), source }
    }

    /// The header with `padding` further characters in its last comment.
    fn header(&self, vertices: u64, faces: u64, padding: usize) -> String {
        let real = if self.origin.is_some() { "double" } else { "float" };
        let mut lines = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
        lines.extend(self.comments.iter().map(|line| format!("comment {line}")));
        lines.push(format!("comment {}", ".".repeat(padding)));
        lines.push(format!("element vertex {vertices}"));
        lines.extend(["x", "y", "z"].map(|axis| format!("property {real} {axis}")));
        lines.extend(["red", "green", "blue"].map(|channel| format!("property uchar {channel}")));
        lines.push(format!("element face {faces}"));
        lines.push("property list uchar int vertex_indices\nend_header\n".to_owned());
        lines.join("\n")
    }

    /// Append the faces, write the header, and hand over a complete file that still has a temporary name.
    pub(super) fn finish(mut self) -> Result<Finished, SynthError> {
        let bytes = self.join().map_err(|e| self.error(e))?;
        let path = self.path;
        // Closed here: a thousand blocks must not need a thousand open files.
        let closed = self.vertices.into_inner().map_err(io::IntoInnerError::into_error).and_then(AtomicFile::close);
        let file = closed.map_err(|source| SynthError::Io { path: path.clone(), source })?;
        Ok(Finished { path, file, vertices: self.vertex_count, triangles: self.face_count, bytes })
    }

    fn join(&mut self) -> io::Result<u64> {
        self.vertices.flush()?;
        self.faces.flush()?;
        let faces = self.faces.get_mut();
        faces.seek(SeekFrom::Start(0))?;
        let target = self.vertices.get_mut().file_mut();
        io::copy(faces, target)?;
        let bytes = target.stream_position()?;
        let bare = self.header(self.vertex_count, self.face_count, 0).len();
        let header = self.header(self.vertex_count, self.face_count, self.header_bytes - bare);
        let target = self.vertices.get_mut().file_mut();
        target.seek(SeekFrom::Start(0))?;
        target.write_all(header.as_bytes())?;
        Ok(bytes)
    }
}

impl Sink for Writer {
    type Error = SynthError;

    fn vertex(&mut self, p: DVec3, color: [u8; 3]) -> Result<(), SynthError> {
        let mut record = [0_u8; 27];
        let size = if let Some(origin) = self.origin {
            for (k, out) in record.chunks_exact_mut(8).take(3).enumerate() {
                out.copy_from_slice(&(p[k] + origin[k]).to_le_bytes());
            }
            24
        } else {
            for (k, out) in record.chunks_exact_mut(4).take(3).enumerate() {
                out.copy_from_slice(&(p[k] as f32).to_le_bytes());
            }
            12
        };
        record[size..size + 3].copy_from_slice(&color);
        self.vertex_count += 1;
        self.vertices.write_all(&record[..size + 3]).map_err(|e| self.error(e))
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), SynthError> {
        let mut record = [3_u8; 13];
        for (out, corner) in record[1..].chunks_exact_mut(4).zip(corners) {
            out.copy_from_slice(&corner.to_le_bytes());
        }
        self.face_count += 1;
        self.faces.write_all(&record).map_err(|e| self.error(e))
    }
}

/// A complete PLY under a temporary name.
pub(super) struct Finished {
    path: PathBuf,
    file: Pending,
    pub(super) vertices: u64,
    pub(super) triangles: u64,
    pub(super) bytes: u64,
}

impl Finished {
    /// Give it its final name; without `force` never over a file that has appeared meanwhile.
    pub(super) fn keep(self, force: bool) -> Result<(), SynthError> {
        let Self { path, file, .. } = self;
        file.commit(force).map_err(|source| SynthError::Io { path, source })
    }
}

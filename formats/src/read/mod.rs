//! Mesh readers: a file on disk is handed on in blocks to a [`MeshSink`].
//!
//! The format is recognised by the content of the file, never by its name, so `SCAN.PLY` and `scan.dat` read alike. The table
//! [`FORMATS`] lists what is read; every other format that can be recognised is refused by its name, with the way out.
//!
//! Invariants: a reader delivers vertices and triangles in the order of the file and holds nothing that grows with the
//! mesh; at least one triangle is delivered, or the file is refused. [`read_mesh`] keeps all in memory, with what
//! [`MemorySink`] promises. Whatever was dropped or repaired is in the diagnostics, with a count and the first places.
//!
//! Failures: the file cannot be opened or read; it is of another format; it is damaged or cut; it has no triangles.
//! Memory is bounded by what the file really holds, never by what its header claims.

pub mod archive;
mod companions;
mod error;
mod faces;
pub mod gltf;
mod memory;
pub mod nexus;
mod number;
pub mod obj;
mod place;
pub mod ply;
pub mod sink;
mod sniff;
mod source;
pub mod stl;
pub mod texture;
pub mod tiles;

pub use companions::{Replaced, open_regular};
pub use error::{Place, ReadError};
pub use memory::MemorySink;
pub use place::{Placed, Placement};
pub use sink::{MeshSink, VertexBlock, VertexSink};

use crate::RawMesh;
use crate::Up;
use archive::Archived;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use texture::detail::Detail;

/// How much of the beginning is looked at to recognise the format.
const SNIFFED: u64 = 16 * 1024;

/// Called with (bytes done, bytes in all).
pub type OnProgress<'a> = dyn FnMut(u64, u64) + 'a;

/// Any source of bytes that can be read twice.
pub trait Bytes: Read + Seek {}

impl<T: Read + Seek> Bytes for T {}

/// One input in the hands of a reader.
pub struct Input<'a> {
    /// Its name in messages; files that it names are looked for in its folder.
    pub path: &'a Path,
    /// Bytes in all.
    pub total: u64,
    /// The bytes, at the beginning.
    pub source: &'a mut dyn Bytes,
    /// To be called about once a mebibyte and once at the end.
    pub progress: &'a mut OnProgress<'a>,
    /// What the user can choose.
    pub options: &'a ReadOptions,
    /// The archive that it is in, where files that it names are looked for instead.
    pub archive: Option<Archived<'a>>,
}

/// What the user can choose about reading.
#[derive(Debug, Clone)]
pub struct ReadOptions {
    /// The folder for scratch files, of which OBJ with pictures or normals needs some beyond a few million vertices.
    pub scratch: PathBuf,
    /// The most bytes that one decoded picture may take; larger ones are left out. Shapes what is read.
    pub texture_bytes: u64,
    /// Bytes that tables and decoded pictures may take together, about, beside one picture; the rest goes to scratch
    /// files or is decoded again. Never changes what is read.
    pub memory: u64,
    /// The most bytes that a picture may take while it is decoded, with its file and the pictures that are kept; beyond
    /// them the mesh is refused, for what is read must not depend on the memory.
    pub picture: u64,
    /// The most bytes that the JSON of a glTF and what is made of it may take, about; beyond them the file is refused.
    pub document: u64,
    /// Whether files outside of the folder of the mesh file may be read where it names them. What they hold ends up in
    /// the pack: only for meshes that are trusted.
    pub allow_outside: bool,
    /// How far triangles are split for their pictures, where they are. Each input must have gone through
    /// [`note_detail`] before the first is read.
    pub detail: Option<Arc<Detail>>,
    /// The file that the output will replace. If a mesh refers to it, it is not read.
    pub replaced: Option<Arc<Replaced>>,
}

/// The default.
const MEMORY: u64 = 1 << 30;

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            scratch: std::env::temp_dir(),
            texture_bytes: texture::TEXTURE_BYTES,
            memory: MEMORY,
            picture: 4 * texture::TEXTURE_BYTES,
            document: MEMORY,
            allow_outside: false,
            detail: None,
            replaced: None,
        }
    }
}

/// Notes how many texels the edges of an input span.
type NoteDetail = fn(Input<'_>, &Detail) -> Result<(), ReadError>;

/// A format that is read.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Its name for people.
    pub name: &'static str,
    /// The axis that points up in it where nobody says otherwise.
    pub up: Up,
    /// Whether a file of so many bytes that begins with these is of this format.
    is: fn(start: &[u8], total: u64) -> bool,
    /// Delivers it.
    read: fn(Input<'_>, &mut dyn MeshSink) -> Result<(), ReadError>,
    /// Notes how many texels its edges span, where it can have pictures.
    note_detail: Option<NoteDetail>,
}

impl Format {
    /// Whether it is a tileset, whose tiles are in other files.
    pub fn is_tileset(&self) -> bool {
        self.name == TILES
    }

    /// Whether it is an archive with a mesh in it.
    pub fn is_archive(&self) -> bool {
        self.name == ARCHIVE
    }
}

/// The name of 3D Tiles.
const TILES: &str = "3D Tiles";
/// The name of ZIP archives.
const ARCHIVE: &str = "ZIP archive";

/// Extensions of the mesh files that are read, beside `tileset.json` and archives.
pub const MESH_EXTENSIONS: [&str; 7] = ["ply", "obj", "stl", "glb", "gltf", "nxs", "nxz"];

/// Asked in this order.
const FORMATS: &[Format] = &[
    Format { name: "PLY", up: Up::Z, is: |start, _| ply::is_ply(start), read: ply::read, note_detail: None },
    Format { name: TILES, up: Up::Z, is: tiles::is_tileset, read: tiles::read, note_detail: Some(tiles::note_detail) },
    Format { name: "glTF", up: Up::Y, is: gltf::is_gltf, read: gltf::read, note_detail: Some(gltf::note_detail) },
    Format { name: "Nexus", up: Up::Z, is: |start, _| nexus::is_nexus(start), read: nexus::read, note_detail: None },
    // The axis is that of the mesh inside: see `recognise`.
    Format {
        name: ARCHIVE,
        up: Up::Y,
        is: archive::is_zip,
        read: archive::read,
        note_detail: Some(archive::note_detail),
    },
    Format { name: "STL", up: Up::Z, is: stl::is_stl, read: stl::read, note_detail: None },
    Format {
        name: "OBJ",
        up: Up::Z,
        is: |start, _| obj::is_obj(start),
        read: obj::read,
        note_detail: Some(obj::note_detail),
    },
];

/// Deliver the mesh in the file at `path` to `sink`.
///
/// `progress` is called with (bytes done, bytes in all) about once a mebibyte and once at the end.
///
/// # Errors
/// [`ReadError`], whose text names the file, the place and what to do; what `sink` returns.
pub fn read_into(path: &Path, sink: &mut dyn MeshSink, progress: &mut OnProgress<'_>) -> Result<(), ReadError> {
    read_into_with(path, &ReadOptions::default(), sink, progress)
}

/// As [`read_into`], with options.
///
/// # Errors
/// As [`read_into`].
pub fn read_into_with(
    path: &Path,
    options: &ReadOptions,
    sink: &mut dyn MeshSink,
    progress: &mut OnProgress<'_>,
) -> Result<(), ReadError> {
    let (mut file, total) = open(path)?;
    dispatch(
        Input { path, total, source: &mut file, progress: &mut |a, b| progress(a, b), options, archive: None },
        sink,
    )
}

/// First pass of [`ReadOptions::detail`]: note how many texels the edges of the mesh at `path` span.
///
/// # Errors
/// As [`read_into`]. A file that cannot have pictures is not read.
pub fn note_detail(path: &Path, options: &ReadOptions, progress: &mut OnProgress<'_>) -> Result<(), ReadError> {
    let (mut file, total) = open(path)?;
    let format = format_of(&mut file, total, path)?;
    match (format.note_detail, &options.detail) {
        (Some(note), Some(detail)) => {
            let progress = &mut |a, b| progress(a, b);
            note(Input { path, total, source: &mut file, progress, options, archive: None }, detail)
        }
        _ => Ok(()),
    }
}

/// As [`read_into`], from any source of `total` bytes; `path` is its name in messages.
///
/// # Errors
/// As [`read_into`].
pub fn read_into_from(
    source: &mut dyn Bytes,
    total: u64,
    path: &Path,
    sink: &mut dyn MeshSink,
    progress: &mut OnProgress<'_>,
) -> Result<(), ReadError> {
    let options = &ReadOptions::default();
    dispatch(Input { path, total, source, progress: &mut |a, b| progress(a, b), options, archive: None }, sink)
}

/// The format of the file at `path`, recognised by its content; of an archive with the axis of the mesh in it.
///
/// # Errors
/// [`ReadError`] where it cannot be opened or is of no format that is read.
pub fn recognise(path: &Path) -> Result<Format, ReadError> {
    let (mut file, total) = open(path)?;
    let format = format_of(&mut file, total, path)?;
    if !format.is_archive() {
        return Ok(format);
    }
    let (options, progress) = (&ReadOptions::default(), &mut |_, _| ());
    let inside = archive::format_inside(Input { path, total, source: &mut file, progress, options, archive: None })?;
    Ok(Format { up: inside.up, ..format })
}

fn dispatch(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let format = format_of(input.source, input.total, input.path)?;
    (format.read)(input, sink)
}

/// The format of what `source` delivers; it is left at its beginning.
fn format_of(source: &mut dyn Bytes, total: u64, path: &Path) -> Result<Format, ReadError> {
    let cannot = |source| ReadError::Io { file: path.to_owned(), offset: 0, source };
    let mut start = Vec::new();
    (&mut *source).take(SNIFFED).read_to_end(&mut start).map_err(cannot)?;
    source.seek(SeekFrom::Start(0)).map_err(cannot)?;
    let format = FORMATS.iter().find(|format| (format.is)(&start, total));
    format.copied().ok_or_else(|| sniff::refusal(&start, total, path))
}

/// Read the mesh in the file at `path` into memory.
///
/// # Errors
/// As [`read_into`]; [`ReadError::NoTriangles`] also where no triangle is left.
pub fn read_mesh(path: &Path, progress: &mut OnProgress<'_>) -> Result<RawMesh, ReadError> {
    let (file, total) = open(path)?;
    read_mesh_from(file, total, path, progress)
}

/// Read a mesh of `total` bytes from any source of bytes; `path` is only its name in messages.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_from(
    mut source: impl Bytes,
    total: u64,
    path: &Path,
    progress: &mut OnProgress<'_>,
) -> Result<RawMesh, ReadError> {
    let mut sink = MemorySink::new(path);
    read_into_from(&mut source, total, path, &mut sink, progress)?;
    sink.into_mesh()
}

fn open(path: &Path) -> Result<(File, u64), ReadError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        let what = if about.is_dir() { "a folder" } else { "not a regular file" };
        return Err(ReadError::NotAFile { file: path.to_owned(), what });
    }
    open_regular(path).map_err(cannot)
}

//! What can go wrong while a mesh is read. Every text names the file, the place, what was found, what was expected
//! and, where there is something to do, what to do.

use crate::Diagnostics;
use kilwa_pack::plural::counted;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Where in a file something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file or of a text header; the first line is 1.
    Line(u64),
    /// An offset in bytes from the beginning of the file.
    Byte(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(n) => write!(f, "line {n}"),
            Self::Byte(n) => write!(f, "byte {n}"),
        }
    }
}

/// Why a mesh file was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened; the cause is the source of this error.
    #[error("{} cannot be opened", file.display())]
    Open {
        /// The file.
        file: PathBuf,
        /// Why the system refused.
        source: io::Error,
    },
    /// The path names a folder, a pipe or a device.
    #[error("{} is {what}; give the path of a mesh file", file.display())]
    NotAFile {
        /// The path given.
        file: PathBuf,
        /// What it is.
        what: &'static str,
    },
    /// The file names another that lies outside of the folder of the mesh.
    #[error("{}, {place}: the file name \"{name}\" leads to {}, outside the folder {}; copy that file into the folder and correct the name, or use --allow-outside if you trust the mesh", file.display(), target.display(), folder.display())]
    Outside {
        /// The file that names the other.
        file: PathBuf,
        /// Where it does.
        place: String,
        /// The name as it stands there.
        name: String,
        /// Where that leads.
        target: PathBuf,
        /// The folder of the mesh, links resolved.
        folder: PathBuf,
    },
    /// The mesh refers to the file that the output would replace.
    #[error("{} refers to the file that the output would replace; choose another name for the output", file.display())]
    Replaced {
        /// The mesh file.
        file: PathBuf,
    },
    /// The system failed to deliver bytes; the cause is the source of this error.
    #[error("{} cannot be read at byte {offset}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Where reading stopped.
        offset: u64,
        /// Why the system refused.
        source: io::Error,
    },
    /// The file is of a format that is not read.
    #[error("{} is {what}; this version of Kilwa reads PLY, OBJ, STL, glTF, Nexus and 3D Tiles, also in ZIP archives. {way_out}", file.display())]
    Format {
        /// The file.
        file: PathBuf,
        /// The format, with its article, for example "a Wavefront OBJ mesh".
        what: &'static str,
        /// What the user can do.
        way_out: &'static str,
    },
    /// The file is damaged, cut or not what its header says.
    #[error("{}, {place}: found {found}; expected {expected}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// Where.
        place: Place,
        /// What stands there.
        found: String,
        /// What should stand there and, where that helps, what to do.
        expected: String,
    },
    /// A part of a file of named parts (glTF) is damaged or names what does not exist.
    #[error("{}, {part}: found {found}; expected {expected}", file.display())]
    Part {
        /// The file.
        file: PathBuf,
        /// The part, for example "accessors[3]".
        part: String,
        /// What stands there.
        found: String,
        /// What should stand there and, where that helps, what to do.
        expected: String,
    },
    /// The file needs something that is not supported.
    #[error("{} {needs}. {way_out}", file.display())]
    Needs {
        /// The file.
        file: PathBuf,
        /// A verb and what it needs, for example "requires the glTF extension X, which is not read".
        needs: String,
        /// What the user can do.
        way_out: &'static str,
    },
    /// The file is sound but has no triangle to build from.
    #[error("{} has no triangles: {found}. {way_out}", file.display())]
    NoTriangles {
        /// The file.
        file: PathBuf,
        /// What it has instead.
        found: String,
        /// What the user can do.
        way_out: &'static str,
    },
    /// A scratch file failed; the cause is the source of this error.
    #[error("while {} was read: a scratch file in {} cannot be {what}", file.display(), folder.display())]
    Scratch {
        /// The mesh file in hand.
        file: PathBuf,
        /// Where the scratch file is.
        folder: PathBuf,
        /// "made", "written" or "read".
        what: &'static str,
        /// Why the system refused, for example that the disk is full.
        source: io::Error,
    },
    /// Two inputs are the same surface at the same place.
    #[error("{} has the same content as {}, so the surface would be included twice; omit one of them", file.display(), other.display())]
    Twice {
        /// The file.
        file: PathBuf,
        /// The other one.
        other: PathBuf,
    },
    /// The file is sound but beyond a limit of this version.
    #[error("{}: {what}", file.display())]
    TooLarge {
        /// The file.
        file: PathBuf,
        /// The limit, what the file needs, and what to do.
        what: String,
    },
    /// A triangle names a vertex that the file does not have.
    #[error("{}: triangle {triangle} (the first is 0) refers to vertex {vertex}, but the file has {vertices}; it is truncated or damaged: copy or export it again", file.display())]
    Index {
        /// The file.
        file: PathBuf,
        /// The triangle, in the order of the file.
        triangle: u64,
        /// The number it names; the first vertex is 0.
        vertex: u64,
        /// Vertices in the file.
        vertices: u64,
    },
    /// The sink could not keep what was delivered, for example because its disk is full.
    #[error(transparent)]
    Sink(Box<dyn std::error::Error + Send + Sync>),
}

impl ReadError {
    /// A file whose faces were all dropped, and why.
    pub(super) fn no_face_left(file: &Path, faces: u64, dropped: &Diagnostics) -> Self {
        let reasons: Vec<String> = dropped.iter().map(|(kind, n, _)| format!("{kind}: {n}")).collect();
        Self::NoTriangles {
            file: file.to_owned(),
            found: format!("of its {} none is left ({})", counted(faces, "face", "faces"), reasons.join("; ")),
            way_out: "Export the mesh again and give that",
        }
    }
}

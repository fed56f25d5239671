//! The metadata block: JSON, for people and archives as much as for programs. FORMAT section 6.

use crate::header::MAX_METADATA_BYTES;
use crate::plural::counted;
use crate::{Header, PackError};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// One scalar channel carried per vertex.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScalarChannel {
    /// The name in the source, for example `confidence`, `quality`, `intensity`, `alpha`.
    pub name: String,
    /// Smallest value at the finest level.
    pub min: f32,
    /// Largest value at the finest level.
    pub max: f32,
}

/// One source file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceFile {
    /// File name without folders.
    pub name: String,
    /// Bytes.
    pub bytes: u64,
    /// SHA-256, lower-case hexadecimal.
    pub sha256: String,
}

const FURTHER: [&str; 2] = ["further file", "further files"];
const OF_THEIR_LIST: &str = " (SHA-256 of their list as sha256sum prints it)";

impl SourceFile {
    /// An entry that stands for several files, the last ones of a pack with many sources: their number, their bytes, and the SHA-256 of their
    /// [`sum_lines`].
    pub fn of_further(count: usize, bytes: u64, sha256: String) -> Self {
        Self { name: format!("{}{OF_THEIR_LIST}", counted(count, FURTHER[0], FURTHER[1])), bytes, sha256 }
    }

    /// The number of files that the entry stands for, if it is one of [`SourceFile::of_further`].
    pub fn stands_for(&self) -> Option<usize> {
        let (count, noun) = self.name.strip_suffix(OF_THEIR_LIST)?.split_once(' ')?;
        FURTHER.contains(&noun).then(|| count.parse().ok())?
    }
}

/// Lines for files, given as SHA-256 and name, as sha256sum prints them.
pub fn sum_lines<'a>(files: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    files.fold(String::new(), |lines, (sha256, name)| lines + sha256 + "  " + name + "\n")
}

/// The name of the scalar channel with the part of the capture accuracy that is due to registration, metres.
pub const REGISTRATION: &str = "registration";

/// What the pack says of itself. Lengths in metres, world coordinates, f64.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Title, or the file name it was built from.
    pub title: String,
    /// Units of the source, for example `m`; the pack itself is in metres.
    pub source_units: String,
    /// Up axis of the source: `z` or `y`; the pack itself is z-up.
    pub source_up: String,
    /// Coordinate reference system, an EPSG code or WKT, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crs: Option<String>,
    /// Lattice spacing in metres.
    pub lattice_step: f64,
    /// Smallest corner of the model, metres.
    pub bounds_min: DVec3,
    /// Largest corner of the model, metres.
    pub bounds_max: DVec3,
    /// Median edge length at the finest level, metres.
    pub median_edge: f64,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Distinct lattice positions of the finest level.
    pub vertices: u64,
    /// True-border edges of the finest level.
    pub border_edges: u64,
    /// Scalar channels, in the order of `Mesh::scalars`.
    #[serde(default)]
    pub scalars: Vec<ScalarChannel>,
    /// Source files.
    pub sources: Vec<SourceFile>,
    /// Program and version that wrote the pack.
    pub tool: String,
    /// Options that shaped it (not thread counts or paths).
    pub options: std::collections::BTreeMap<String, String>,
    /// Standard uncertainty of the capture, metres, where known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture_accuracy: Option<f64>,
    /// The part of it due to the poses of the stations, metres, if known. The channel [`REGISTRATION`], if present, contains it for every vertex.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture_registration: Option<f64>,
    /// The part of it due to instrument noise, metres, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture_instrument: Option<f64>,
    /// What reading and building repaired or dropped: reason to count. Empty means nothing.
    #[serde(default)]
    pub repairs: std::collections::BTreeMap<String, u64>,
}

/// The option that only packs of points have: the largest number of points in a leaf.
pub const LEAF_POINTS: &str = "leaf-points";

impl Metadata {
    /// The parts of the capture accuracy that are due to registration and to the instruments, metres, where both are known.
    pub fn capture_parts(&self) -> Option<[f64; 2]> {
        self.capture_accuracy.and(Some([self.capture_registration?, self.capture_instrument?]))
    }

    /// Whether the pack is one of points; its header says so too.
    pub fn is_of_points(&self) -> bool {
        self.options.contains_key(LEAF_POINTS)
    }

    /// Parse the metadata block and check it against the header.
    ///
    /// # Errors
    /// [`PackError`] when the checksum fails, it is no JSON of this shape, or it contradicts the header.
    pub fn parse(bytes: &[u8], header: &Header) -> Result<Self, PackError> {
        if crate::checksum(bytes) != header.metadata_checksum {
            return Err(PackError::checksum("metadata"));
        }
        let metadata: Self =
            crate::json::from_slice(bytes).map_err(|e| PackError::invalid("metadata", e.to_string()))?;
        metadata.check(header)?;
        Ok(metadata)
    }

    /// Serialise for a pack with this header.
    ///
    /// # Errors
    /// [`PackError::Invalid`] when it contradicts the header, has numbers that are not finite, or is too long.
    pub(crate) fn to_bytes(&self, header: &Header) -> Result<Vec<u8>, PackError> {
        self.check(header)?;
        let bytes = serde_json::to_vec(self).map_err(|e| PackError::invalid("metadata", e.to_string()))?;
        if bytes.len() > MAX_METADATA_BYTES as usize {
            return Err(PackError::invalid(
                "metadata",
                format!(
                    "it would take {} bytes, at most {MAX_METADATA_BYTES} are allowed: shorten the title, the names and the \
                     number of sources",
                    bytes.len()
                ),
            ));
        }
        // JSON has no NaN or infinity: serde writes null for them, which would not read back.
        match serde_json::from_slice::<Self>(&bytes) {
            Ok(back) if back == *self => Ok(bytes),
            _ => Err(PackError::invalid("metadata", "a number in it is not finite")),
        }
    }

    fn check(&self, header: &Header) -> Result<(), PackError> {
        let bad = |why: String| Err(PackError::invalid("metadata", why));
        if self.lattice_step != header.lattice.step() {
            return bad(format!(
                "lattice spacing {} m, but {} m in the header",
                self.lattice_step,
                header.lattice.step()
            ));
        }
        if self.scalars.len() != usize::from(header.attributes.scalars) {
            return bad(format!(
                "{}, but {} in the header",
                counted(self.scalars.len(), "scalar channel", "scalar channels"),
                header.attributes.scalars
            ));
        }
        if self.triangles != header.triangles {
            return bad(format!(
                "{}, but {} in the header",
                counted(self.triangles, "triangle", "triangles"),
                header.triangles
            ));
        }
        Ok(())
    }
}

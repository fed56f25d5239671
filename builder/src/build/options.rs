//! What the user can choose about a build, and everything that can go wrong in one.

use glam::DVec3;
use kilwa_formats::{ReadError, Up};
use kilwa_geometry::LengthUnit;
use kilwa_simplify::Precision;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use thiserror::Error;

/// Largest number of triangles in a leaf tetrahedron that is not split further. With about seven non-empty child
/// patches in a diamond this gives chunks of some ten thousand triangles.
pub const LEAF_TRIANGLES: usize = 2048;

/// Bits that a channel of a colour may keep: with fewer than 4, sixteen shades, no colour is what it was.
pub const COLOR_BITS: RangeInclusive<u8> = 4..=8;
/// Bits that an octahedral coordinate of a normal may keep: 6 are two degrees, 16 all there are.
pub const NORMAL_BITS: RangeInclusive<u8> = 6..=16;

/// As the journals of interrupted builds have it: the name of the variant.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde gives references")]
fn by_name<S: serde::Serializer>(unit: &LengthUnit, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{unit:?}"))
}

/// Everything that shapes a pack, beside its inputs. A build is resumed only with the same.
#[derive(Debug, Clone, serde::Serialize)]
pub struct BuildOptions {
    /// Title for the metadata; the caller gives the file name when the user gave none.
    pub title: String,
    /// Worker threads; 0 means one per core. Never changes the bytes.
    #[serde(skip)]
    pub threads: usize,
    /// Lattice spacing in metres, a power of two; `None` derives it from the mesh.
    pub step: Option<f64>,
    /// Units of the source.
    #[serde(serialize_with = "by_name")]
    pub units: LengthUnit,
    /// Up axis of the source.
    pub up: Up,
    /// EPSG code or WKT, stored as given.
    pub crs: Option<String>,
    /// Standard uncertainty of the capture, metres.
    pub capture_accuracy: Option<f64>,
    /// Largest leaf, see [`LEAF_TRIANGLES`].
    pub leaf_triangles: usize,
    /// Keep only triangles whose centroid lies in this box: smallest and largest corner, metres, axes of the pack.
    pub crop: Option<[DVec3; 2]>,
    /// Drop triangles with a corner whose `confidence` or `quality` is below this.
    pub min_confidence: Option<f32>,
    /// Drop components of fewer triangles than this.
    pub drop_islands_below: Option<u64>,
    /// Bits that each channel of a colour keeps, [`COLOR_BITS`]; 8 is exact.
    pub color_bits: u8,
    /// Bits that each octahedral coordinate of a normal keeps, [`NORMAL_BITS`].
    pub normal_bits: u8,
    /// Files that the mesh came from, for the metadata.
    #[serde(skip)]
    pub sources: Vec<kilwa_pack::metadata::SourceFile>,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            title: String::new(),
            threads: 0,
            step: None,
            units: LengthUnit::Metre,
            up: Up::Z,
            crs: None,
            capture_accuracy: None,
            leaf_triangles: LEAF_TRIANGLES,
            crop: None,
            min_confidence: None,
            drop_islands_below: None,
            color_bits: Precision::default().color_bits,
            normal_bits: Precision::default().normal_bits,
            sources: Vec::new(),
        }
    }
}

impl BuildOptions {
    /// Bits of colours and normals.
    pub(crate) fn precision(&self) -> Precision {
        Precision { color_bits: self.color_bits, normal_bits: self.normal_bits }
    }

    /// Whether a build can have them.
    ///
    /// # Errors
    /// [`BuildError::Bits`], naming the option.
    pub(crate) fn check(&self) -> Result<(), BuildError> {
        let options = [("--color-bits", self.color_bits, COLOR_BITS), ("--normal-bits", self.normal_bits, NORMAL_BITS)];
        for (option, bits, range) in options {
            if !range.contains(&bits) {
                let (min, max) = range.into_inner();
                return Err(BuildError::Bits { option, bits, min, max });
            }
        }
        Ok(())
    }
}

/// Why a pack could not be built.
#[derive(Debug, Error)]
pub enum BuildError {
    /// An input could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The inputs contradict each other or changed while they were read.
    #[error("{why}")]
    Inputs {
        /// What was found and what to do.
        why: String,
    },
    /// The mesh has no triangles, or none that has an area on the lattice.
    #[error("nothing to build: {why}")]
    Empty {
        /// What was found and what to do.
        why: String,
    },
    /// A step that cannot be used.
    #[error("--step {step} m cannot be used: {why}")]
    Step {
        /// The step asked for, metres.
        step: f64,
        /// The reason and what to do.
        why: String,
    },
    /// So many bits cannot be kept.
    #[error("{option} {bits} cannot be used: give {min} to {max}")]
    Bits {
        /// Name of the option.
        option: &'static str,
        /// The bits asked for.
        bits: u8,
        /// Fewest.
        min: u8,
        /// Most.
        max: u8,
    },
    /// The mesh is too small for any lattice.
    #[error("the mesh is too small: {why}")]
    TooSmall {
        /// The lengths that do not fit, and what to do.
        why: String,
    },
    /// More than the format holds.
    #[error("the mesh is too large for this version: {why}")]
    TooLarge {
        /// What exceeds what.
        why: String,
    },
    /// The pack could not be laid out.
    #[error(transparent)]
    Pack(#[from] kilwa_pack::PackError),
    /// The output could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A scratch file could not be used.
    #[error(transparent)]
    Scratch(#[from] crate::scratch::ScratchError),
    /// A file that several machines share could not be used.
    #[error("cannot {doing} {place}: {why}")]
    Shared {
        /// What was being done: "read", "write" …
        doing: &'static str,
        /// The file or object.
        place: String,
        /// The reason.
        why: String,
    },
    /// There is a build to continue with, but it is another one.
    #[error(
        "cannot resume what is in {}: {why}; build without --resume to start over",
        folder.display()
    )]
    Resume {
        /// The scratch folder.
        folder: PathBuf,
        /// What is different.
        why: String,
    },
    /// The build was asked to stop.
    #[error("stopped")]
    Stopped,
    /// Worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

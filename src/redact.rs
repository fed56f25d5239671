//! A pack whose place on earth is taken out: for rock art, graves and other places that are not to be found.
//!
//! The model is moved so that its middle is at zero and its lowest point at height zero, or, with a cell, so that its middle
//! is the middle of the cell of that size which holds it: everything in one cell looks the same. What is left out with
//! it: the reference system (kept with a cell), and names and hashes of the source files, which are often named after the
//! place and can be compared with files found elsewhere. Scalar channels are left out, because scans are exported with their coordinates as
//! channels (`scalar_X`, `Elevation`), unless they are named; [`checked_channels`] looks at those that are. The old pack's identity is named nowhere: chunks are the same, so
//! that whoever guesses the place could make the old header and see whether its hash is the one named.

use crate::source::open_pack;
use anyhow::{Context, bail, ensure};
use glam::DVec3;
use kilwa_archive::location::{Location, channels};
use kilwa_files::atomic::folder_of;
use kilwa_geometry::Aabb;
use kilwa_pack::{Metadata, Reader, Source, relocate_with_channels};
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// How much of the place is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Place {
    /// Nothing.
    Nowhere,
    /// In which cell of a grid of this many metres the middle of the model lies; heights are taken out all the same.
    Cell(f64),
}

/// What was taken out: for the operator's eyes, and for tests that look for it. Never to be published.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TakenOut {
    /// The reference system that the old pack named.
    pub(crate) crs: Option<String>,
    /// What has to be added to the new coordinates to get the old ones, metres.
    pub(crate) offset: DVec3,
}

/// Write the pack at `from` to `to`, a new file, with its place taken out, `title` in place of its own, and of its scalar channels those that `keep`
/// names. Channels are encoded into a file beside `to` that goes with its handle.
///
/// # Errors
/// When the pack cannot be read or is damaged, the cell hides nothing, or the file cannot be written; what was begun is
/// for the caller to remove.
pub(crate) fn redact(from: &Path, to: &Path, place: Place, title: &str, keep: &[String]) -> anyhow::Result<TakenOut> {
    let reader = open_pack(from)?;
    let old = reader.header().lattice.origin;
    let origin = origin(&reader, place)?;
    let file = File::create_new(to).with_context(|| format!("cannot write {}", to.display()))?;
    let crs = reader.metadata().crs.clone();
    let kept: Vec<usize> =
        (0..).zip(&reader.metadata().scalars).filter(|(_, s)| keep.contains(&s.name)).map(|(k, _)| k).collect();
    let folder = folder_of(to);
    let mut scratch = Scratch::new(folder)?;
    let out = BufWriter::with_capacity(1 << 20, file);
    let written = relocate_with_channels(&reader, out, &mut scratch, &kept, origin, |m| revise(m, place, title));
    let file = written.with_context(|| format!("{} without its place", from.display()))?;
    let file = file.into_inner().map_err(std::io::IntoInnerError::into_error);
    file.and_then(|f| f.sync_all()).with_context(|| format!("cannot write {}", to.display()))?;
    Ok(TakenOut { crs, offset: old - origin })
}

/// What is published of a pack's metadata.
fn revise(metadata: &mut Metadata, place: Place, title: &str) {
    title.clone_into(&mut metadata.title);
    metadata.sources.clear();
    if place == Place::Nowhere {
        metadata.crs = None;
    }
}

/// The metadata of a pack as they are published, without the channels that `keep` does not name: for who looks at their texts before anything is
/// written.
pub(crate) fn published_metadata(of_pack: &Metadata, place: Place, title: &str, keep: &[String]) -> Metadata {
    let mut metadata = of_pack.clone();
    metadata.scalars.retain(|s| keep.contains(&s.name));
    revise(&mut metadata, place, title);
    metadata
}

/// Whether the channels that are to be kept are there and hold no coordinates; every value of them is read.
///
/// # Errors
/// A name that no channel has, with those that there are; or a channel that gives `location` away, and how.
pub(crate) fn checked_channels<S: Source + Sync>(
    reader: &Reader<S>,
    keep: &[String],
    location: &Location,
) -> anyhow::Result<()> {
    let there: Vec<&str> = reader.metadata().scalars.iter().map(|s| s.name.as_str()).collect();
    for name in keep {
        ensure!(
            there.contains(&name.as_str()),
            "--keep-channel {name}: the pack has {}",
            if there.is_empty() {
                "no scalar channels".to_owned()
            } else {
                format!("the channels {}", there.join(", "))
            }
        );
    }
    if keep.is_empty() {
        return Ok(());
    }
    for channel in channels::survey(reader)?.iter().filter(|c| keep.contains(&c.name)) {
        if let Some(why) = channel.gives_away(location) {
            bail!("--keep-channel {}: the channel {why}; omit it, or build the pack again without it", channel.name);
        }
    }
    Ok(())
}

/// A file without a name, buffered for reading and for writing.
enum Scratch {
    Writing(BufWriter<File>),
    Reading(BufReader<File>),
}

impl Scratch {
    fn new(folder: &Path) -> anyhow::Result<Self> {
        let file = tempfile::tempfile_in(folder).with_context(|| format!("cannot write to {}", folder.display()))?;
        Ok(Self::Writing(BufWriter::with_capacity(1 << 20, file)))
    }
}

impl Write for Scratch {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self {
            Self::Writing(file) => file.write(bytes),
            Self::Reading(_) => Err(std::io::ErrorKind::Unsupported.into()),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match self {
            Self::Writing(file) => file.flush(),
            Self::Reading(_) => Ok(()),
        }
    }
}

impl Read for Scratch {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Self::Writing(_) => Err(std::io::ErrorKind::Unsupported.into()),
            Self::Reading(file) => file.read(bytes),
        }
    }
}

impl Seek for Scratch {
    /// Goes over to reading.
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let mut file = match self {
            Self::Writing(file) => {
                file.flush()?;
                file.get_ref().try_clone()?
            }
            Self::Reading(file) => file.get_ref().try_clone()?,
        };
        let at = file.seek(to)?;
        *self = Self::Reading(BufReader::with_capacity(1 << 20, file));
        Ok(at)
    }
}

/// Where the lattice begins in the new pack, metres: whole steps, so that world coordinates stay exact.
fn origin<S: Source>(reader: &Reader<S>, place: Place) -> anyhow::Result<DVec3> {
    let lattice = reader.header().lattice;
    let all = reader.entries().iter().fold(Aabb::EMPTY, |sum, e| sum.union(&e.bounds));
    anyhow::ensure!(!all.is_empty(), "the pack contains no triangles");
    let step = lattice.step();
    let middle: [f64; 2] = std::array::from_fn(|k| i64::midpoint(i64::from(all.min[k]), i64::from(all.max[k])) as f64);
    let lowest = f64::from(all.min[2]);
    let to = match place {
        Place::Nowhere => [0.0; 2],
        Place::Cell(cell) => {
            let widest = (0..2).map(|k| f64::from(all.max[k] - all.min[k]) * step).fold(0.0, f64::max);
            anyhow::ensure!(
                cell.is_finite() && cell > widest && cell <= 1e7,
                "a cell of {cell} m does not hide a model {widest:.0} m wide; give one larger than the model, 10000 for example"
            );
            let world = lattice.world_from_steps(DVec3::new(middle[0], middle[1], lowest));
            [0, 1].map(|k| ((world[k] / cell).floor() + 0.5) * cell)
        }
    };
    // Steps are powers of two: whole multiples below 2^53 are exact.
    let axis = |k: usize| ((to[k] / step).round() - middle[k]) * step;
    Ok(DVec3::new(axis(0), axis(1), -lowest * step))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_builder::{BuildOptions, build_pack};
    use kilwa_formats::RawMesh;

    fn far_pack(folder: &Path) -> std::path::PathBuf {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 2.0]];
        let far = corners.map(|p: [f64; 3]| [p[0] + 524_288.5, p[1] + 9_012_345.25, p[2] + 17.5]);
        let mesh = RawMesh {
            positions: far.map(DVec3::from).to_vec(),
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
            ..RawMesh::default()
        };
        let options = BuildOptions {
            title: "cave at 524288".to_owned(),
            crs: Some("EPSG:32737".to_owned()),
            ..BuildOptions::default()
        };
        let path = folder.join("far.kilwa");
        let built = build_pack(mesh, &options, &kilwa_builder::Silent).expect("builds");
        std::fs::write(&path, built.bytes).expect("writes");
        path
    }

    #[test]
    fn redaction_moves_the_centre_to_zero_and_removes_the_reference_system() {
        let work = tempfile::tempdir().expect("a folder");
        let (from, to) = (far_pack(work.path()), work.path().join("near.kilwa"));
        let out = redact(&from, &to, Place::Nowhere, "A cave", &[]).expect("redacts");
        assert_eq!(out.crs.as_deref(), Some("EPSG:32737"));
        assert!((out.offset[0] - 524_290.5).abs() < 0.01 && (out.offset[1] - 9_012_346.75).abs() < 0.01, "{out:?}");
        let pack = open_pack(&to).expect("a sound pack");
        let m = pack.metadata();
        assert_eq!((m.crs.as_deref(), m.title.as_str(), m.sources.len()), (None, "A cave", 0));
        assert!((m.bounds_min[0] + 2.0).abs() < 0.01 && m.bounds_min[2] == 0.0, "{:?}", m.bounds_min);
        let bytes = std::fs::read(&to).expect("reads");
        for hidden in ["524288", "9012345", "32737", "far.ply"] {
            assert!(!bytes.windows(hidden.len()).any(|w| w == hidden.as_bytes()), "{hidden} is in the file");
        }
    }

    #[test]
    fn two_models_redacted_to_one_cell_have_the_same_position() {
        let work = tempfile::tempdir().expect("a folder");
        let from = far_pack(work.path());
        let to = work.path().join("cell.kilwa");
        redact(&from, &to, Place::Cell(10_000.0), "A cave", &[]).expect("redacts");
        let m = open_pack(&to).expect("a sound pack").metadata().clone();
        let middle = [0, 1].map(|k| f64::midpoint(m.bounds_min[k], m.bounds_max[k]));
        assert!((middle[0] - 525_000.0).abs() < 0.01 && (middle[1] - 9_015_000.0).abs() < 0.01, "{middle:?}");
        assert_eq!((m.crs.as_deref(), m.bounds_min[2]), (Some("EPSG:32737"), 0.0));
        let to = work.path().join("x");
        let message = redact(&from, &to, Place::Cell(2.0), "A cave", &[]).expect_err("too small").to_string();
        assert!(message.contains("larger than the model"), "{message}");
    }
}

//! A pack whose place on earth is taken out: for rock art, graves and other places that are not to be found.
//!
//! The model is moved so that its middle is at zero and its lowest point at height zero, or, with a cell, so that its middle
//! is the middle of the cell of that size which holds it: everything in one cell looks the same. What is left out with
//! it: the reference system (kept with a cell), and names and hashes of the source files, which are often named after the
//! place and can be compared with files found elsewhere. The old pack's identity is named nowhere: chunks are the same, so
//! that whoever guesses the place could make the old header and see whether its hash is the one named.

use crate::source::open_pack;
use anyhow::Context;
use kilwa_geometry::Aabb;
use kilwa_pack::{Reader, Source, relocate};
use std::fs::File;
use std::io::BufWriter;
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
    pub(crate) offset: [f64; 3],
}

/// Write the pack at `from` to `to`, a new file, with its place taken out and `title` in place of its own.
///
/// # Errors
/// When the pack cannot be read or is damaged, the cell hides nothing, or the file cannot be written; what was begun is
/// for the caller to remove.
pub(crate) fn redact(from: &Path, to: &Path, place: Place, title: &str) -> anyhow::Result<TakenOut> {
    let reader = open_pack(from)?;
    let old = reader.header().lattice.origin;
    let origin = origin(&reader, place)?;
    let file = File::create_new(to).with_context(|| format!("cannot write {}", to.display()))?;
    let crs = reader.metadata().crs.clone();
    let written = relocate(&reader, BufWriter::with_capacity(1 << 20, file), origin, |metadata| {
        title.clone_into(&mut metadata.title);
        metadata.sources.clear();
        if place == Place::Nowhere {
            metadata.crs = None;
        }
    });
    let file = written.with_context(|| format!("{} without its place", from.display()))?;
    let file = file.into_inner().map_err(std::io::IntoInnerError::into_error);
    file.and_then(|f| f.sync_all()).with_context(|| format!("cannot write {}", to.display()))?;
    Ok(TakenOut { crs, offset: std::array::from_fn(|k| old[k] - origin[k]) })
}

/// Where the lattice begins in the new pack, metres: whole steps, so that world coordinates stay exact.
fn origin<S: Source>(reader: &Reader<S>, place: Place) -> anyhow::Result<[f64; 3]> {
    let lattice = reader.header().lattice;
    let all = reader.entries().iter().fold(Aabb::EMPTY, |sum, e| sum.union(&e.bounds));
    anyhow::ensure!(!all.is_empty(), "the pack holds no triangle");
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
            let world = lattice.world_from_steps([middle[0], middle[1], lowest]);
            [0, 1].map(|k| ((world[k] / cell).floor() + 0.5) * cell)
        }
    };
    // Steps are powers of two: whole multiples below 2^53 are exact.
    let axis = |k: usize| ((to[k] / step).round() - middle[k]) * step;
    Ok([axis(0), axis(1), -lowest * step])
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_builder::{BuildOptions, RawMesh, build_pack};

    fn far_pack(folder: &Path) -> std::path::PathBuf {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 2.0]];
        let far = corners.map(|p: [f64; 3]| [p[0] + 524_288.5, p[1] + 9_012_345.25, p[2] + 17.5]);
        let mesh = RawMesh {
            positions: far.to_vec(),
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
    fn the_middle_goes_to_zero_and_the_reference_system_goes() {
        let work = tempfile::tempdir().expect("a folder");
        let (from, to) = (far_pack(work.path()), work.path().join("near.kilwa"));
        let out = redact(&from, &to, Place::Nowhere, "A cave").expect("redacts");
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
    fn two_models_in_one_cell_stand_at_the_same_place() {
        let work = tempfile::tempdir().expect("a folder");
        let from = far_pack(work.path());
        let to = work.path().join("cell.kilwa");
        redact(&from, &to, Place::Cell(10_000.0), "A cave").expect("redacts");
        let m = open_pack(&to).expect("a sound pack").metadata().clone();
        let middle = [0, 1].map(|k| f64::midpoint(m.bounds_min[k], m.bounds_max[k]));
        assert!((middle[0] - 525_000.0).abs() < 0.01 && (middle[1] - 9_015_000.0).abs() < 0.01, "{middle:?}");
        assert_eq!((m.crs.as_deref(), m.bounds_min[2]), (Some("EPSG:32737"), 0.0));
        let said =
            redact(&from, &work.path().join("x"), Place::Cell(2.0), "A cave").expect_err("too small").to_string();
        assert!(said.contains("larger than the model"), "{said}");
    }
}

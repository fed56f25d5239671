//! The reader of 3D Tiles (OGC, "3D Tiles Specification 1.1", 22-025r4; also 1.0 and its drafts), as written by Metashape, RealityCapture and iTwin Capture.
//!
//! Stages: `schema` (the JSON) → `tree` (the finest tiles and their transforms; `names` finds their files) → `content` (b3dm, glTF) → the reader of
//! glTF → the sink.
//!
//! Only the finest surface is read: tiles without children, and tiles with additive refinement. Coarser tiles are counted and never
//! opened, so they may be missing. Positions are in the frame of the first tileset, in f64: tile transforms are multiplied from the
//! root down, and z is up in all tiles (y in their glTF, unless `gltfUpAxis` states otherwise). Geocentric coordinates (EPSG:4978) are kept
//! and counted.
//!
//! Refused: implicit tiling; tiles of points, instances and vectors; tilesets that name each other in a circle or twice; files that stand at the same place twice; addresses, absolute names and those
//! that leave the folder; files of the finest tiles that are missing, before anything is delivered.
//!
//! Memory: the JSON of the nested tilesets that are open, a few hundred bytes for each of the finest tiles, one gzipped tile, and what the glTF
//! reader needs for one tile.

mod content;
mod names;
mod schema;
mod sizes;
#[cfg(test)]
mod tests;
mod tree;

pub use sizes::sizes;

use super::companions::Companions;
use super::gltf::{Detailing, Nowhere};
use super::texture::detail::Detail;
use super::{Input, MeshSink, ReadError};
use content::Delivery;
use flate2::read::GzDecoder;
use glam::{DAffine3, DMat3, DVec3};
use names::Names;
use std::io::Read;

/// The axis that points up in the glTF of tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum UpAxis {
    X,
    Y,
    Z,
}

impl UpAxis {
    fn of(name: &str) -> Option<Self> {
        match name {
            "X" | "x" => Some(Self::X),
            "Y" | "y" => Some(Self::Y),
            "Z" | "z" => Some(Self::Z),
            _ => None,
        }
    }

    /// Rotates it to z, as CesiumJS does.
    fn tile_from_gltf(self) -> DAffine3 {
        DAffine3::from_mat3(match self {
            Self::X => DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X),
            Self::Y => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            Self::Z => DMat3::IDENTITY,
        })
    }
}

/// Whether a file that starts with these bytes is a tileset, compressed or not.
pub fn is_tileset(start: &[u8], _total: u64) -> bool {
    let mut unpacked = Vec::new();
    let mut text = start;
    if content::is_gzip(start) {
        // A truncated stream ends with an error, but its beginning is decompressed.
        let _ = GzDecoder::new(start).take(super::SNIFFED).read_to_end(&mut unpacked);
        text = &unpacked;
    }
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text).trim_ascii_start();
    let has = |key: &str| memchr::memmem::find(text, key.as_bytes()).is_some();
    text.starts_with(b"{") && has("\"geometricError\"") && !has("\"accessors\"") && !has("\"bufferViews\"")
}

/// Deliver the finest surface.
///
/// # Errors
/// [`ReadError`] for a tileset or a tile that is damaged, missing or needs unsupported features, or if no tile has a triangle; errors of the sink.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let detailing = input.options.detail.as_deref().map(|detail| Detailing { detail, notes: false });
    deliver(input, sink, detailing)
}

/// First pass of [`super::ReadOptions::detail`]: note how many texels the edges of the surface span.
///
/// # Errors
/// As [`read`].
pub fn note_detail(input: Input<'_>, detail: &Detail) -> Result<(), ReadError> {
    deliver(input, &mut Nowhere::default(), Some(Detailing { detail, notes: true }))
}

fn deliver(input: Input<'_>, sink: &mut dyn MeshSink, detailing: Option<Detailing<'_>>) -> Result<(), ReadError> {
    let Input { path, total, source, progress, options, .. } = input;
    let companions = &Companions::of(path, options, None);
    let json = tree::whole(source, total, path, options.document)?;
    let plan = tree::plan(json, path, Names { companions, options })?;
    let diagnostics = sink.diagnostics();
    diagnostics.add_many("tiles of the finest level read", plan.leaves.len() as u64);
    diagnostics.add_many("coarser tiles left out, because finer ones replace them", plan.coarser);
    let kind = "coarser tiles left out, although nothing finer has content";
    diagnostics.add_many(kind, plan.replaced_by_nothing);
    diagnostics.add_many("external tilesets read", plan.external);
    let mut delivery = Delivery { companions, options, detailing, sink, geocentric: 0 };
    let all = plan.leaves.iter().fold(0u64, |sum, leaf| sum.saturating_add(leaf.bytes));
    let (mut before, mut triangles) = (0u64, 0u64);
    for leaf in &plan.leaves {
        let share = |done: u64, of: u64| (leaf.bytes as f64 * done as f64 / of.max(1) as f64) as u64;
        let of_tile = delivery.leaf(leaf, &mut |done, of| progress((before + share(done, of)).min(all), all))?;
        if of_tile == 0 && !detailing.is_some_and(|d| d.notes) {
            let kind = "tiles without triangles";
            delivery.sink.diagnostics().add(kind, || leaf.path.display().to_string());
        }
        triangles += of_tile;
        before += leaf.bytes;
    }
    progress(all, all);
    let geocentric = delivery.geocentric;
    sink.diagnostics().add_many("tiles in geocentric coordinates (EPSG:4978), kept as they are", geocentric);
    if triangles > 0 || detailing.is_some_and(|d| d.notes) { Ok(()) } else { Err(plan.nothing(path)) }
}

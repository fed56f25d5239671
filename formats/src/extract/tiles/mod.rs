//! The hierarchy of a pack as 3D Tiles 1.1 (`kilwa extract --to tiles`), for CesiumJS and other clients that know nothing of packs.
//!
//! `groups` (which diamonds a client refines together, so that whatever it shows has no cracks) → `content` (which patches a tile has) → `glb` (a tile) →
//! `tree` and `tileset` (the JSON that names the tiles); `frame` is where they lie, and `folder` where they are written. Chunks are decoded once, those of a
//! group at a time: memory follows the number of patches and the size of tiles, not the size of the model.

mod content;
mod folder;
mod frame;
mod glb;
mod groups;
mod tileset;
mod tree;

pub use folder::Folder;
pub use frame::{AFFINE_RESIDUAL, Earth};
pub use tileset::PIXELS;

use super::ExtractError;
use content::Piece;
use frame::Frame;
use groups::{Group, Groups};
use kilwa_pack::{Reader, Source};
use rayon::prelude::*;
use serde_json::json;
use tree::Tree;

/// How tiles are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// Compressed with `EXT_meshopt_compression`.
    Web,
    /// Floats, for programs without extensions.
    Plain,
}

impl Profile {
    /// As on the command line and in the tileset.
    pub fn name(self) -> &'static str {
        match self {
            Self::Web => "web",
            Self::Plain => "plain",
        }
    }
}

/// How large the parts are.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Triangles of a tile.
    pub triangles: usize,
    /// Vertices of a tile: at most 65,535, which 16 bits can number.
    pub vertices: usize,
    /// Tiles of a JSON file.
    pub tiles_of_file: usize,
}

impl Default for Limits {
    /// A tile has at most 2 MB, also if its triangles share no vertices.
    fn default() -> Self {
        Self { triangles: 32_768, vertices: 49_152, tiles_of_file: 512 }
    }
}

/// What to write.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// How tiles are stored.
    pub profile: Profile,
    /// How large the parts are.
    pub limits: Limits,
    /// Where the model is on the earth; `None` if it shall keep the coordinates of the pack.
    pub earth: Option<&'a dyn Earth>,
    /// The coordinate reference system that `earth` knows, for the record.
    pub crs: Option<&'a str>,
}

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Tileset {
    /// Tiles that show something.
    pub tiles: u64,
    /// JSON files.
    pub tilesets: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// Bytes of the largest tile.
    pub largest_tile: u64,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Triangles of all levels.
    pub stored_triangles: u64,
    /// Vertices of all levels.
    pub stored_vertices: u64,
    /// Spacing of the grid that all vertices are on, metres.
    pub spacing: f64,
    /// Whether every vertex was converted to geocentric coordinates by itself.
    pub is_curved: bool,
    /// If not, but the model has a place on the earth: how far the affine map is from the exact one at most, metres.
    pub residual: Option<f64>,
    /// Parts of the pack that were left out.
    pub left_out: Vec<String>,
}

/// Write the hierarchy of a pack as 3D Tiles to `folder`. `progress` is called with chunks done and chunks in all.
///
/// # Errors
/// [`ExtractError`]; nothing is left then.
pub fn write_tiles<S: Source + Sync>(
    reader: &Reader<S>,
    request: &Request<'_>,
    folder: &Folder,
    progress: &dyn Fn(u64, u64),
) -> Result<Tileset, ExtractError> {
    if reader.header().is_of_points() {
        return Err(ExtractError::PointsAsTiles);
    }
    let frame = Frame::new(reader, request.earth)?;
    let tables = groups::tables(reader)?;
    let groups = Groups::new(reader.entries(), &tables, request.limits.triangles as u64, &frame)?;
    drop(tables);
    let filling = folder.begin()?;
    let all = reader.entries().len() as u64;
    let (mut done, mut pieces) = (0, Vec::new());
    progress(0, all);
    // So many at a time: bounds memory, and keeps all threads busy.
    let batch = 2 * rayon::current_num_threads();
    let numbered: Vec<(u32, &Group)> = (0u32..).zip(&groups.all).collect();
    for groups_of_batch in numbered.chunks(batch) {
        let chunks: Vec<u32> = groups_of_batch.iter().flat_map(|(_, g)| g.entries.iter().copied()).collect();
        reader.source().expect(&super::choose::stretches(reader, &chunks));
        let written: Vec<Result<Vec<Piece>, ExtractError>> = groups_of_batch
            .par_iter()
            .map(|(number, _)| write_group(reader, request, (&groups, *number), &frame, &filling))
            .collect();
        for written in written {
            pieces.extend(written?);
        }
        done += chunks.len() as u64;
        progress(done, all);
    }
    if pieces.is_empty() {
        return Err(ExtractError::Empty);
    }
    finish(reader, request, (pieces, &groups), &frame, filling)
}

/// The tiles that a group shows.
fn write_group<S: Source>(
    reader: &Reader<S>,
    request: &Request<'_>,
    (groups, number): (&Groups, u32),
    frame: &Frame<'_>,
    filling: &folder::Filling,
) -> Result<Vec<Piece>, ExtractError> {
    let group = &groups.all[number as usize];
    let meshes = content::meshes(reader, groups, group, request.limits, keeps_normals(reader, request.profile))?;
    let write = |(part, (replaced_by, mesh)): (usize, (Option<u32>, _))| {
        let tile = content::tile(&mesh, frame)?;
        let error = replaced_by.map_or(0.0, |g| groups.all[g as usize].error);
        let bytes = tile.bytes(request.profile, error)?;
        let file = format!("tiles/{}/{number}-{part}.glb", group.level);
        filling.write(&file, &bytes)?;
        Ok(Piece {
            group: number,
            replaced_by,
            file: Some(file),
            sphere: tile.sphere(),
            triangles: tile.triangles() as u64,
            vertices: tile.vertices() as u64,
            bytes: bytes.len() as u64,
        })
    };
    meshes.into_iter().enumerate().map(write).collect()
}

/// Colours of scans contain the light; a model without colours needs normals to be seen.
fn keeps_normals<S: Source>(reader: &Reader<S>, profile: Profile) -> bool {
    profile == Profile::Plain || !reader.header().attributes.colors
}

/// The JSON files, and the name of the folder.
fn finish<S: Source>(
    reader: &Reader<S>,
    request: &Request<'_>,
    (pieces, groups): (Vec<Piece>, &Groups),
    frame: &Frame<'_>,
    filling: folder::Filling,
) -> Result<Tileset, ExtractError> {
    let sum = |of: fn(&Piece) -> u64| pieces.iter().map(of).sum::<u64>();
    let mut written = Tileset {
        tiles: pieces.len() as u64,
        tilesets: 0,
        bytes: sum(|p| p.bytes),
        largest_tile: pieces.iter().map(|p| p.bytes).max().unwrap_or(0),
        triangles: sum(|p| if p.replaced_by.is_none() { p.triangles } else { 0 }),
        stored_triangles: sum(|p| p.triangles),
        stored_vertices: sum(|p| p.vertices),
        spacing: frame.spacing(),
        is_curved: frame.is_curved(),
        residual: frame.residual,
        left_out: reader.metadata().scalars.iter().map(|s| format!("the channel {}", s.name)).collect(),
    };
    let about = json!({
        "title": reader.metadata().title,
        "pack": reader.identity(),
        "crs": request.crs,
        "profile": request.profile.name(),
        "pixels_of_error": PIXELS,
        "grid_spacing_m": frame.spacing(),
    });
    let tree = Tree::new(pieces, groups);
    for file in tileset::files(&tree, groups, frame, request.limits.tiles_of_file, &about) {
        let bytes = file.json.to_string().into_bytes();
        filling.write(&file.name, &bytes)?;
        written.bytes += bytes.len() as u64;
        written.tilesets += 1;
    }
    filling.finish()?;
    Ok(written)
}

//! What tiles show: the patches of a group's chunks, split by the group that replaces them.
//!
//! A tile belongs to the group whose refinement shows it. It has the patches whose diamonds are in one other group, and is replaced when that
//! is refined, or leaf patches, which nothing replaces. A tile that would be too large is split into several, which are replaced together.

use super::glb::Tile;
use super::groups::{Group, Groups};
use super::{Limits, frame::Frame};
use crate::extract::{ExtractError, meshopt};
use kilwa_geometry::{Mesh, Sphere};
use kilwa_pack::{NO_DIAMOND, PatchRange, Reader, Source};
use kilwa_simplify::Welder;
use std::collections::BTreeMap;

/// A tile that was written, or one that shows nothing.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// The group whose refinement shows it.
    pub(super) group: u32,
    /// The group whose refinement replaces it; `None` at the finest level.
    pub(super) replaced_by: Option<u32>,
    /// Its file, relative to the folder; `None` if it shows nothing.
    pub(super) file: Option<String>,
    /// Round what it shows, metres in the frame.
    pub(super) sphere: Sphere,
    pub(super) triangles: u64,
    pub(super) vertices: u64,
    pub(super) bytes: u64,
}

/// A patch, and the number of its chunk among those of the group.
type PatchOf = (usize, PatchRange);

/// The meshes of the tiles that a group shows, each with the group that replaces it: those that are replaced first, by group.
///
/// # Errors
/// If a chunk cannot be read.
pub(super) fn meshes<S: Source>(
    reader: &Reader<S>,
    groups: &Groups,
    group: &Group,
    limits: Limits,
    keeps_normals: bool,
) -> Result<Vec<(Option<u32>, Mesh)>, ExtractError> {
    let mut chunks = Vec::new();
    let mut targets: BTreeMap<(bool, Option<u32>), Vec<PatchOf>> = BTreeMap::new();
    for i in &group.entries {
        let mut chunk = reader.chunk(*i)?;
        chunk.mesh.scalars.clear();
        if !keeps_normals {
            chunk.mesh.normals.clear();
        }
        for patch in chunk.patches.iter().filter(|p| p.count > 0) {
            let target = (patch.diamond != NO_DIAMOND).then(|| groups.of[patch.diamond as usize]);
            targets.entry((target.is_none(), target)).or_default().push((chunks.len(), *patch));
        }
        chunks.push(chunk.mesh);
    }
    let mut all = Vec::new();
    for ((_, target), patches) in targets {
        let triangles: usize = patches.iter().map(|(_, p)| p.count as usize).sum();
        // As many tiles as are needed, all of about the same size.
        let size = triangles.div_ceil(triangles.div_ceil(limits.triangles));
        let mut tile = Joined::new(size, limits);
        for (chunk, patch) in patches {
            for t in patch.first..patch.first + patch.count {
                if tile.is_full() {
                    all.push((target, std::mem::replace(&mut tile, Joined::new(size, limits)).finish()));
                }
                tile.add(&chunks[chunk], t as usize);
            }
        }
        all.push((target, tile.finish()));
    }
    Ok(all)
}

/// Triangles of several meshes in one.
struct Joined {
    welder: Welder,
    size: usize,
    vertices: usize,
}

impl Joined {
    fn new(size: usize, limits: Limits) -> Self {
        Self { welder: Welder::new(size / 2, 0), size, vertices: limits.vertices }
    }

    fn is_full(&self) -> bool {
        self.welder.mesh.triangle_count() >= self.size || self.welder.mesh.vertex_count() + 3 > self.vertices
    }

    fn add(&mut self, mesh: &Mesh, t: usize) {
        let corners = mesh.triangles[t].map(|v| self.welder.vertex(mesh, v as usize));
        self.welder.mesh.triangles.push(corners);
    }

    fn finish(self) -> Mesh {
        self.welder.mesh
    }
}

/// A mesh as a tile: its vertices on the grid, in the order in which triangles that lie side by side use them.
///
/// # Errors
/// If a vertex has no place on the earth, or the tile is too wide for floats.
pub(super) fn tile(mesh: &Mesh, frame: &Frame<'_>) -> Result<Tile, ExtractError> {
    let ordered = meshopt::ordered(mesh.triangles.as_flattened(), mesh.vertex_count());
    let (indices, order) = ordered.map_err(|e| ExtractError::Encode(e.to_string()))?;
    let points = order.iter().map(|v| frame.point(mesh.positions[*v])).collect::<Result<Vec<_>, _>>()?;
    let normal = |v: &usize| frame.normal(kilwa_geometry::normal::decode(mesh.normals[*v]));
    let has = |attributes: usize| attributes == mesh.vertex_count();
    let normals = if has(mesh.normals.len()) { order.iter().map(normal).collect() } else { Vec::new() };
    let colors = if has(mesh.colors.len()) { order.iter().map(|v| mesh.colors[*v]).collect() } else { Vec::new() };
    Tile::new(points, normals, colors, indices, frame.grid_log2)
}

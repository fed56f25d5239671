//! From the leaves to the root, finest level first: the points of the quarters of a diamond's tetrahedra are its chunk, and thinned, tetrahedron by
//! tetrahedron, they are the patches of the next coarser level.

use super::Placement;
use super::coarsen::{Coarse, thinned};
use super::leaves::Ingested;
use super::runs::ByTetrahedron;
use super::splat::{BYTES, Splat};
use crate::assemble::{Kind, RootChunk};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::Surface;
use crate::levels::{CHUNKS, Levels, Refined, diamonds_of, level_count};
use crate::partition::Partition;
use crate::scratch::ScratchFile;
use kilwa_geometry::{Aabb, LatticePoint, Sphere};
use kilwa_pack::chunk::PatchRange;
use kilwa_pack::chunk::splat::{self, Splats, TRIANGLES, VERTICES};
use kilwa_pack::verify::Totals;
use kilwa_pack::{Attributes, NO_DIAMOND};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that a point takes while it is thinned and encoded: an estimate on the safe side.
const BYTES_PER_POINT: u64 = 10 * BYTES as u64;

/// All levels.
pub(super) fn levels(
    ingested: Ingested,
    surface: Surface,
    place: &Placement,
    work: &Work<'_>,
) -> Result<Levels, BuildError> {
    let Ingested { tree, leaves, points, .. } = ingested;
    let chunks = work.scratch.create(CHUNKS)?;
    let attributes = Attributes { colors: surface.colors, scalars: surface.scalars.len() as u8 };
    let mut below: Option<(ByTetrahedron, String)> = None;
    let mut refined = Vec::new();
    let done = AtomicU64::new(0);
    // A point is thinned once, then a third of it, then a ninth …
    let total = points * 3 / 2;
    for level in (0..level_count(&tree)).rev() {
        let diamonds = diamonds_of(&tree, level);
        let name = format!("level-{level:02}");
        let out = ByTetrahedron::create(work.scratch, &name)?;
        let stage = Stage {
            tree: &tree,
            leaves: &leaves,
            below: below.as_ref().map(|(file, _)| file),
            out: &out,
            chunks: &chunks,
            attributes,
            place,
        };
        let results = work.run_jobs(
            diamonds.len(),
            work.memory / 8 * 5,
            |i| stage.points(diamonds[i]) * BYTES_PER_POINT,
            |i| {
                let one = stage.refine(diamonds[i])?;
                let now = stage.points(diamonds[i]);
                let now = done.fetch_add(now, Ordering::Relaxed) + now;
                work.progress.update("thinning", now.min(total), total);
                Ok(one)
            },
        )?;
        refined.extend(results.into_iter().flatten());
        if let Some((_, name)) = below.replace((out, name)) {
            work.scratch.remove(&name)?;
        }
    }
    let mut root = Chunk::new(attributes);
    for t in 0..6 {
        let is_split = tree.tetrahedra[t as usize].children.is_some();
        let from = below.as_ref().filter(|_| is_split).map_or(&leaves, |(file, _)| file);
        root.add(&tree, t, &from.read(t)?);
    }
    let (sphere, bounds, vertices) = (Sphere::of(&root.corners), Aabb::of(&root.corners), root.vertices());
    let (triangles, body, patches) = (root.triangles(), root.encode()?, root.patches);
    let root = RootChunk { triangles, vertices, sphere, bounds, patches, body, decoded: Totals::default() };
    Ok(Levels { surface, tree, refined, root, attributes, chunks: Box::new(chunks), kind: Kind::Points })
}

/// One level being done.
struct Stage<'a> {
    tree: &'a Partition,
    leaves: &'a ByTetrahedron,
    below: Option<&'a ByTetrahedron>,
    out: &'a ByTetrahedron,
    chunks: &'a ScratchFile,
    attributes: Attributes,
    place: &'a Placement,
}

impl Stage<'_> {
    /// The quarters of a tetrahedron, each with the file that its points are in.
    fn quarters(&self, tetrahedron: u32) -> impl Iterator<Item = (u32, &ByTetrahedron)> {
        let children = self.tree.tetrahedra[tetrahedron as usize].children;
        children.into_iter().flatten().filter_map(|c| {
            let is_leaf = self.tree.tetrahedra[c as usize].children.is_none();
            Some((c, if is_leaf { self.leaves } else { self.below? }))
        })
    }

    fn points(&self, diamond: u32) -> u64 {
        let tetrahedra = &self.tree.diamonds[diamond as usize].tetrahedra;
        tetrahedra.iter().flat_map(|t| self.quarters(*t)).map(|(c, file)| u64::from(file.count(c))).sum()
    }

    /// The chunk of a diamond, and the patches of its tetrahedra; `None` where it has no points.
    fn refine(&self, diamond: u32) -> Result<Option<Refined>, BuildError> {
        let mut chunk = Chunk::new(self.attributes);
        let mut coarse_corners = Vec::new();
        let (mut error, mut color_squares, mut coarse_points) = (0f32, 0.0, 0);
        for &t in &self.tree.diamonds[diamond as usize].tetrahedra {
            let mut all = Vec::new();
            for (c, file) in self.quarters(t) {
                let splats = file.read(c)?;
                chunk.add(self.tree, c, &splats);
                all.extend(splats);
            }
            if all.is_empty() {
                continue;
            }
            let Coarse { splats, error: of_part, color_squares: squares } = thinned(&all, self.place);
            error = error.max(of_part);
            color_squares += squares;
            coarse_points += splats.len() as u32;
            coarse_corners.extend(splats.iter().flat_map(corners_of));
            self.out.append(t, &splats)?;
        }
        if chunk.corners.is_empty() {
            return Ok(None);
        }
        let body = chunk.encode()?;
        let at = self.chunks.append(&body)?;
        let count = chunk.splats.len() as f64;
        Ok(Some(Refined {
            diamond,
            file: 0,
            error,
            color_error: if self.attributes.colors {
                (color_squares / 3.0 / count).sqrt().min(255.0) as f32
            } else {
                0.0
            },
            sphere: Sphere::of(&chunk.corners).union(&Sphere::of(&coarse_corners)),
            triangles: (chunk.triangles(), TRIANGLES * coarse_points),
            vertices: chunk.vertices(),
            bounds: Aabb::of(&chunk.corners),
            at,
            bytes: body.len() as u32,
            sum: crc32fast::hash(&body),
            patches: chunk.patches,
        }))
    }
}

fn corners_of(s: &Splat) -> [LatticePoint; 4] {
    splat::corners(s.center(), s.normal, s.radius)
}

/// A chunk being put together.
struct Chunk {
    attributes: Attributes,
    splats: Splats,
    patches: Vec<PatchRange>,
    corners: Vec<LatticePoint>,
}

impl Chunk {
    fn new(attributes: Attributes) -> Self {
        let splats = Splats { scalars: vec![Vec::new(); attributes.scalars.into()], ..Splats::default() };
        Self { attributes, splats, patches: Vec::new(), corners: Vec::new() }
    }

    /// The patch of a tetrahedron, if it is not empty; its diamond by its index in the tree.
    fn add(&mut self, tree: &Partition, tetrahedron: u32, splats: &[Splat]) {
        if splats.is_empty() {
            return;
        }
        let node = &tree.tetrahedra[tetrahedron as usize];
        let diamond = node.children.map_or(NO_DIAMOND, |_| node.diamond);
        let (first, count) = (self.triangles(), TRIANGLES * splats.len() as u32);
        self.patches.push(PatchRange { first, count, diamond });
        for s in splats {
            self.splats.positions.push(s.center());
            self.splats.normals.push(s.normal);
            self.splats.radii.push(s.radius);
            self.corners.extend(corners_of(s));
        }
        if self.attributes.colors {
            self.splats.colors.extend(splats.iter().map(|s| s.color));
        }
        // There is one channel at most.
        if let Some(channel) = self.splats.scalars.first_mut() {
            channel.extend(splats.iter().map(|s| s.intensity));
        }
    }

    fn triangles(&self) -> u32 {
        TRIANGLES * self.splats.len() as u32
    }

    fn vertices(&self) -> u32 {
        VERTICES * self.splats.len() as u32
    }

    fn encode(&self) -> Result<Vec<u8>, BuildError> {
        Ok(splat::encode_body(&self.splats, &self.patches, self.attributes)?)
    }
}

//! From the leaves to the root, finest level first: merge the patches of the quarters of a diamond's
//! tetrahedra, lock what others
//! share, simplify, certify, split among the diamond's own tetrahedra.
//!
//! A level is one stage over files. In: the patches of tetrahedra one level below (`level-NN.patches`) and of leaves, and
//! the records of points that several tetrahedra use (`level-NN.shared`). Out: the patches of this level's
//! tetrahedra, the records as they are then, the encoded chunks of this level's diamonds appended to `chunks`, and
//! `level-NN.results`, one entry per diamond. NN is the level of the diamonds.
//!
//! Diamonds of one level are independent and run in parallel, as many as the memory allows; what they give depends on
//! their input alone, so the results are the same for any number of threads and any memory. Only the order of patches,
//! records and chunks inside their files differs, and nothing depends on that.

mod encode;
pub mod fragment;
mod locks;
pub(crate) mod results;

pub use results::Refined;

use crate::assemble::{Kind, RootChunk};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::{Ingested, LEAVES, SHARED, Surface};
use crate::levels::fragment::{Patch, REDUCTION, coarsen};
use crate::partition::{Partition, tree_level};
use crate::scratch::{PatchFile, Records, ScratchFile, record};
pub(crate) use encode::too_large;
use encode::{Encoded, decode_again, encode_chunk};
use fragment::merge;
use kilwa_geometry::{Aabb, Sphere};
use kilwa_pack::Attributes;
use kilwa_pack::chunk::MAX_CHUNK_TRIANGLES;
use kilwa_pack::verify::Totals;
use kilwa_simplify::Precision;
use locks::Locks;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Name of the file of encoded chunks.
pub const CHUNKS: &str = "chunks";

/// Bytes that one triangle of a fragment takes while it is merged, simplified, certified and encoded: an estimate on the
/// safe side (a build of 2 M triangles suggests 900).
const BYTES_PER_TRIANGLE: u64 = 1500;

/// Name of a level's patches.
pub fn patches_name(level: u8) -> String {
    format!("level-{level:02}.patches")
}

/// Name of the records after a level.
pub fn shared_name(level: u8) -> String {
    format!("level-{level:02}.shared")
}

/// Name of a level's results.
pub fn results_name(level: u8) -> String {
    format!("level-{level:02}.results")
}

/// Levels of diamonds in a tree: they are numbered from 0, the coarsest, to one less.
pub fn level_count(tree: &Partition) -> u8 {
    tree.diamonds.iter().filter(|d| d.split).map(|d| tree_level(d.key.level) + 1).max().unwrap_or(0)
}

/// The state between two levels: everything that coarser levels need.
pub struct Hierarchy {
    surface: Surface,
    tree: Partition,
    leaves: PatchFile,
    /// Patches of the tetrahedra of the last level done, `None` before the first.
    patches: Option<PatchFile>,
    shared: Records,
    chunks: ScratchFile,
    /// Results of the levels done, finest level first, each in the order of the pack.
    results: Vec<Vec<Refined>>,
    /// The next level to do plus 1; 0 when all are done.
    left: u8,
    /// Triangles to be simplified in all, for the display of progress.
    total: u64,
    /// The counts of the chunks encoded here, if each is to be decoded again.
    decoded: Option<Totals>,
}

/// A triangle of the finest level is simplified once, then a part of it, then that part of the part …
fn total_to_simplify(surface: &Surface) -> u64 {
    surface.triangles * REDUCTION / (REDUCTION - 1)
}

impl Hierarchy {
    /// Before the first level.
    ///
    /// # Errors
    /// [`BuildError::Scratch`] where the file of chunks cannot be made.
    pub fn begin(work: &Work<'_>, ingested: Ingested) -> Result<Self, BuildError> {
        let Ingested { surface, tree, leaves, shared } = ingested;
        let left = level_count(&tree);
        let chunks = work.scratch.create(CHUNKS)?;
        let total = total_to_simplify(&surface);
        Ok(Self {
            surface,
            tree,
            leaves,
            patches: None,
            shared,
            chunks,
            results: Vec::new(),
            left,
            total,
            decoded: None,
        })
    }

    /// A hierarchy whose levels from `left` on are done, from their patches and records; `triangles` is about how many are
    /// still to be simplified. Every chunk is decoded again.
    pub(crate) fn above(
        ingested: Ingested,
        patches: Option<PatchFile>,
        chunks: ScratchFile,
        left: u8,
        triangles: u64,
    ) -> Self {
        let Ingested { surface, tree, leaves, shared } = ingested;
        let (results, decoded) = (Vec::new(), Some(Totals::default()));
        Self { surface, tree, leaves, patches, shared, chunks, results, left, total: triangles, decoded }
    }

    /// The counts of the chunks encoded here, if they were decoded again.
    pub(crate) fn decoded(&self) -> Option<Totals> {
        self.decoded
    }

    /// The results of the levels done here.
    pub(crate) fn results(&self) -> impl Iterator<Item = &Refined> {
        self.results.iter().flatten()
    }

    /// After the level `done`, from the files that it left, `chunks` cut to the length that it had then.
    ///
    /// # Errors
    /// [`BuildError::Scratch`] where a file is not whole.
    pub fn resume(
        work: &Work<'_>,
        surface: Surface,
        tree: Partition,
        done: Option<u8>,
        chunks: u64,
    ) -> Result<Self, BuildError> {
        let leaves = PatchFile::open(work.scratch, LEAVES)?;
        let shared = Records::open(work.scratch, &done.map_or_else(|| SHARED.to_owned(), shared_name))?;
        let Some(done) = done else { return Self::begin(work, Ingested { surface, tree, leaves, shared }) };
        let file = work.scratch.existing(CHUNKS)?;
        file.truncate(chunks)?;
        let levels = (done..level_count(&tree)).rev();
        let results = levels.map(|l| results::read(work.scratch, &results_name(l))).collect::<Result<_, _>>()?;
        let patches = Some(PatchFile::open(work.scratch, &patches_name(done))?);
        let total = total_to_simplify(&surface);
        Ok(Self { surface, tree, leaves, patches, shared, chunks: file, results, left: done, total, decoded: None })
    }

    /// The level to do next, `None` when all are done.
    pub fn next(&self) -> Option<u8> {
        self.left.checked_sub(1)
    }

    /// Bytes of `chunks` so far.
    pub fn chunk_bytes(&self) -> u64 {
        self.chunks.len()
    }

    /// What is known of the finest surface.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// What every chunk carries.
    pub fn attributes(&self) -> Attributes {
        attributes_of(&self.surface)
    }

    /// Do the next level. All its files are on the disk when it returns.
    ///
    /// # Errors
    /// [`BuildError`]: a scratch file cannot be written or read, a diamond is too large for a chunk, a stop was asked for.
    pub fn coarsen_next(&mut self, work: &Work<'_>, precision: Precision) -> Result<(), BuildError> {
        let Some(level) = self.next() else { return Ok(()) };
        let before = self.results.iter().flatten().map(|r| u64::from(r.triangles.0)).sum();
        let batch = Batch {
            surface: &self.surface,
            tree: &self.tree,
            level,
            diamonds: &diamonds_of(&self.tree, level),
            leaves: &self.leaves,
            below: self.patches.as_ref(),
            shared: &self.shared,
            chunks: &self.chunks,
            precision,
            decode_again: self.decoded.is_some(),
            progress: (before, self.total),
        };
        let Coarsened { patches, shared, results, decoded } = batch.coarsen(work)?;
        self.decoded = self.decoded.map(|before| before.plus(decoded));
        self.shared = shared;
        self.patches = Some(patches);
        self.results.push(results);
        self.left = level;
        Ok(())
    }

    /// Names of the files that coarser levels, or the pack, need from here on.
    pub fn files(&self) -> Vec<String> {
        let mut names = vec![LEAVES.to_owned()];
        let levels = self.left..level_count(&self.tree);
        if levels.is_empty() {
            names.push(SHARED.to_owned());
        } else {
            names.extend([patches_name(self.left), shared_name(self.left), CHUNKS.to_owned()]);
        }
        names.extend(levels.map(results_name));
        names
    }

    /// The finished hierarchy, all levels done.
    ///
    /// # Errors
    /// [`BuildError::Scratch`] where the patches of the root cannot be read.
    pub fn finish(self) -> Result<Levels, BuildError> {
        let roots = self.roots()?;
        let refined = self.results.into_iter().flatten().collect();
        Levels::of_surface(self.surface, self.tree, refined, &roots, Box::new(self.chunks))
    }

    /// The patches of the root tetrahedra that are not empty, all levels done.
    ///
    /// # Errors
    /// [`BuildError::Scratch`] where they cannot be read.
    pub fn roots(&self) -> Result<Vec<(u32, Patch)>, BuildError> {
        let mut roots = Vec::new();
        for t in 0..6 {
            let from = if self.tree.tetrahedra[t as usize].children.is_some() { self.patches.as_ref() } else { None };
            if let Some(patch) = from.unwrap_or(&self.leaves).read(t)? {
                roots.push((t, patch));
            }
        }
        Ok(roots)
    }
}

/// What every chunk of a surface carries.
fn attributes_of(surface: &Surface) -> Attributes {
    Attributes { colors: surface.colors, scalars: surface.scalars.len() as u8 }
}

/// The split diamonds of a level in the order of the pack.
pub fn diamonds_of(tree: &Partition, level: u8) -> Vec<u32> {
    let of_level = tree.diamonds.numbered().filter(|(_, node)| node.split && tree_level(node.key.level) == level);
    let mut diamonds: Vec<u32> = of_level.map(|(d, _)| d).collect();
    diamonds.sort_by_cached_key(|d| crate::assemble::order_key(&tree.diamonds[*d as usize].key));
    diamonds
}

/// The tetrahedra that a diamond merges.
pub fn merged_by(tree: &Partition, diamond: u32) -> impl Iterator<Item = u32> + '_ {
    let tetrahedra = tree.diamonds[diamond as usize].tetrahedra.iter();
    tetrahedra.filter_map(|t| tree.tetrahedra[*t as usize].children).flatten()
}

/// Diamonds of one level to be coarsened, with all that they need: a whole level, or the share of a task.
pub struct Batch<'a> {
    /// What is known of the finest surface.
    pub surface: &'a Surface,
    /// The tree.
    pub tree: &'a Partition,
    /// The level of the diamonds.
    pub level: u8,
    /// The diamonds, in the order of the pack.
    pub diamonds: &'a [u32],
    /// The patches of leaves that they merge.
    pub leaves: &'a PatchFile,
    /// The other patches that they merge.
    pub below: Option<&'a PatchFile>,
    /// The records of every point that they use and another tetrahedron may use as well.
    pub shared: &'a Records,
    /// Where the bodies of their chunks go.
    pub chunks: &'a ScratchFile,
    /// Bits of colours and normals.
    pub precision: Precision,
    /// Whether to decode every chunk again, to check it.
    pub decode_again: bool,
    /// Triangles that were simplified before, and in all, for the display of progress.
    pub progress: (u64, u64),
}

/// What coarsening leaves, its files complete and on the disk.
pub struct Coarsened {
    /// Patches of the tetrahedra of the diamonds.
    pub patches: PatchFile,
    /// The records as they are then.
    pub shared: Records,
    /// One entry per diamond with geometry, in the order of the pack; also in the file of [`results_name`].
    pub results: Vec<Refined>,
    /// The counts of the chunks, if they were decoded again.
    pub decoded: Totals,
}

impl Batch<'_> {
    /// Merge, simplify, certify and encode every diamond.
    ///
    /// # Errors
    /// As [`Hierarchy::coarsen_next`].
    pub fn coarsen(&self, work: &Work<'_>) -> Result<Coarsened, BuildError> {
        let (tree, level, diamonds) = (self.tree, self.level, self.diamonds);
        let shared = Records::create(work.scratch, &shared_name(level))?;
        let stage = Stage {
            tree,
            locks: Locks::of_level(work, tree, level, diamonds, self.shared, &shared)?,
            leaves: self.leaves,
            below: self.below,
            out: PatchFile::create(work.scratch, &patches_name(level))?,
            shared: &shared,
            chunks: self.chunks,
            surface: self.surface,
            attributes: attributes_of(self.surface),
            precision: self.precision,
            decode_again: self.decode_again,
        };
        let (before, total) = self.progress;
        let done = AtomicU64::new(before);
        work.progress.update("simplifying", before.min(total), total);
        let results = work.run_jobs(
            diamonds.len(),
            memory_for_fragments(work.memory),
            |i| stage.triangles(diamonds[i]) * BYTES_PER_TRIANGLE,
            |i| {
                let refined = stage.refine(i as u32, diamonds[i])?;
                let now = stage.triangles(diamonds[i]);
                let now = done.fetch_add(now, Ordering::Relaxed) + now;
                work.progress.update("simplifying", now.min(total), total);
                Ok(refined)
            },
        )?;
        let Stage { locks, out, .. } = stage;
        locks.remove(work)?;
        let patches = out.finish()?;
        let decoded = results.iter().flatten().fold(Totals::default(), |sum, (_, totals)| sum.plus(*totals));
        let results: Vec<Refined> = results.into_iter().flatten().map(|(refined, _)| refined).collect();
        results::write(work.scratch, &results_name(level), &results)?;
        self.chunks.sync()?;
        Ok(Coarsened { patches, shared: shared.finish()?, results, decoded })
    }
}

/// The finished hierarchy.
pub struct Levels {
    /// What is known of the finest surface.
    pub surface: Surface,
    /// The tree.
    pub tree: Partition,
    /// Every diamond with geometry, in no particular order.
    pub refined: Vec<Refined>,
    /// The chunk of the root.
    pub root: RootChunk,
    /// What every chunk carries.
    pub attributes: Attributes,
    /// The bodies of all chunks but the root's.
    pub chunks: Box<dyn Bodies>,
    /// What the chunks hold.
    pub kind: Kind,
}

impl Levels {
    /// A surface with these results, whose coarsest form are the patches `roots` of root tetrahedra.
    ///
    /// # Errors
    /// [`BuildError::TooLarge`] where a chunk cannot hold the coarsest form.
    pub fn of_surface(
        surface: Surface,
        tree: Partition,
        refined: Vec<Refined>,
        roots: &[(u32, Patch)],
        chunks: Box<dyn Bodies>,
    ) -> Result<Self, BuildError> {
        let attributes = attributes_of(&surface);
        let root = root_of(roots, &tree, &surface, attributes)?;
        Ok(Self { surface, tree, refined, root, attributes, chunks, kind: Kind::Surface })
    }
}

/// Where the bodies of chunks are.
pub trait Bodies: Sync {
    /// The body of the chunk of a diamond; its checksum is not compared.
    ///
    /// # Errors
    /// [`BuildError`] where it cannot be read.
    fn body(&self, of: &Refined) -> Result<Vec<u8>, BuildError>;

    /// The place to name where a body is not what was written.
    fn path(&self, of: &Refined) -> &Path;
}

impl Bodies for ScratchFile {
    fn body(&self, of: &Refined) -> Result<Vec<u8>, BuildError> {
        Ok(self.read(of.at, u64::from(of.bytes))?)
    }

    fn path(&self, _: &Refined) -> &Path {
        Self::path(self)
    }
}

/// The chunk of the root, of the patches of the root tetrahedra that are not empty.
fn root_of(
    roots: &[(u32, Patch)],
    tree: &Partition,
    surface: &Surface,
    attributes: Attributes,
) -> Result<RootChunk, BuildError> {
    let count: u64 = roots.iter().map(|(_, p)| p.mesh.triangle_count() as u64).sum();
    let mut sphere = Sphere::EMPTY;
    let mut bounds = Aabb::EMPTY;
    for (_, p) in roots {
        sphere = sphere.union(&Sphere::of(&p.mesh.positions));
        bounds = bounds.union(&p.mesh.bounds());
    }
    if count > u64::from(MAX_CHUNK_TRIANGLES) {
        return Err(too_large(count, surface.lattice.world_from_lattice(bounds.min)));
    }
    let merged = merge(roots, attributes.scalars);
    let counts = roots.iter().map(|(t, p)| (*t, p.mesh.triangle_count()));
    let encoded = encode_chunk(merged.mesh, counts, tree, attributes)?;
    let decoded = decode_again(&encoded, count as u32, &sphere, attributes)?;
    let Encoded { body, patches, vertices, bounds } = encoded;
    Ok(RootChunk { triangles: count as u32, vertices, sphere, bounds, patches, body, decoded })
}

/// The share of the budget that fragments being simplified may take; the rest is for the tree, results and indices.
fn memory_for_fragments(memory: u64) -> u64 {
    memory / 8 * 5
}

/// One level being done.
struct Stage<'a> {
    tree: &'a Partition,
    locks: Locks,
    leaves: &'a PatchFile,
    below: Option<&'a PatchFile>,
    out: PatchFile,
    shared: &'a Records,
    chunks: &'a ScratchFile,
    surface: &'a Surface,
    attributes: Attributes,
    precision: Precision,
    decode_again: bool,
}

impl Stage<'_> {
    /// The tetrahedra that a diamond merges, each with the file that its patch is in.
    fn children(&self, diamond: u32) -> impl Iterator<Item = (u32, &PatchFile)> {
        merged_by(self.tree, diamond).filter_map(|c| {
            let is_leaf = self.tree.tetrahedra[c as usize].children.is_none();
            Some((c, if is_leaf { self.leaves } else { self.below? }))
        })
    }

    /// Triangles of a diamond's fragment.
    fn triangles(&self, diamond: u32) -> u64 {
        self.children(diamond).map(|(c, file)| u64::from(file.triangles(c))).sum()
    }

    /// Coarsen the `rank`-th diamond of the level; `None` where it has no geometry.
    fn refine(&self, rank: u32, diamond: u32) -> Result<Option<(Refined, Totals)>, BuildError> {
        let count = self.triangles(diamond);
        if count > u64::from(MAX_CHUNK_TRIANGLES) {
            let key = self.tree.diamonds[diamond as usize].key;
            return Err(too_large(count, self.surface.lattice.world_from_lattice(key.midpoint)));
        }
        let mut input: Vec<(u32, Patch)> = Vec::new();
        for (c, file) in self.children(diamond) {
            if let Some(patch) = file.read(c)? {
                input.push((c, patch));
            }
        }
        if input.is_empty() {
            return Ok(None);
        }
        let (locked, supplied) = (self.locks.of(rank)?, self.surface.supplied_normals);
        let fragment = merge(&input, self.attributes.scalars);
        let counts: Vec<(u32, usize)> = input.iter().map(|(t, p)| (*t, p.mesh.triangle_count())).collect();
        drop(input);
        let coarse = coarsen(&fragment, &locked, (self.tree, diamond), self.precision, supplied);
        let encoded = encode_chunk(fragment.mesh, counts.into_iter(), self.tree, self.attributes)?;
        let mut totals = Totals::default();
        if self.decode_again {
            totals = decode_again(&encoded, coarse.triangles.0 as u32, &coarse.sphere, self.attributes)?;
        }
        let at = self.chunks.append(&encoded.body)?;
        for (t, patch) in &coarse.output {
            self.out.append(*t, patch)?;
        }
        let records: Vec<u128> =
            coarse.records.iter().map(|(key, t)| record(crate::scratch::point_of(key << 32), *t)).collect();
        self.shared.append(&records)?;
        let refined = Refined {
            diamond,
            file: 0,
            error: coarse.error,
            color_error: coarse.color_error,
            sphere: coarse.sphere,
            triangles: (coarse.triangles.0 as u32, coarse.triangles.1 as u32),
            vertices: encoded.vertices,
            bounds: encoded.bounds,
            patches: encoded.patches,
            at,
            bytes: encoded.body.len() as u32,
            sum: crc32fast::hash(&encoded.body),
        };
        Ok(Some((refined, totals)))
    }
}

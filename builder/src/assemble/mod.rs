//! From the finished hierarchy to the file: number the diamonds coarse to fine and along a space-filling curve, saturate
//! errors and spheres, give every chunk its patch table, and copy the chunks in their order from the scratch file to the
//! output. No more than the directory and one chunk per thread are held.

mod spread;

pub use spread::Spread;

use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::levels::{Bodies, Levels, Refined};
use crate::partition::{Partition, tree_level};
use crate::scratch::ScratchError;
use kilwa_geometry::{Aabb, DiamondKey, Sphere};
use kilwa_pack::chunk::{self, PatchRange};
use kilwa_pack::directory::link_children;
use kilwa_pack::verify::Totals;
use kilwa_pack::{DirectoryEntry, Header, Metadata, NO_DIAMOND, PackWriter};
use rustc_hash::FxHashMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// What the report says of the finished file.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct PackSummary {
    /// Bytes of the file.
    pub bytes: u64,
    /// Chunks, the root included.
    pub chunks: u64,
    /// Levels of diamonds.
    pub levels: u32,
    /// Triangles stored, all levels.
    pub stored_triangles: u64,
    /// Triangles of the coarsest form.
    pub root_triangles: u64,
    /// Triangles per patch.
    pub patch_triangles: Spread,
    /// Triangles per chunk.
    pub chunk_triangles: Spread,
    /// Largest certified error, metres: of the coarsest form.
    pub root_error: f64,
}

/// Write the pack to `out`.
///
/// # Errors
/// [`BuildError::Pack`] when the format cannot hold it or writing fails; [`BuildError::Scratch`] when a chunk is not what
/// was written.
pub fn assemble<W: std::io::Write>(
    levels: Levels,
    work: &Work<'_>,
    header: Header,
    metadata: &Metadata,
    out: W,
) -> Result<(W, PackSummary), BuildError> {
    let Levels { tree, mut refined, chunks, root, kind, .. } = levels;
    refined.sort_by_cached_key(|r| order_key(&tree.diamonds[r.diamond as usize].key));
    let number: FxHashMap<u32, u32> = refined.iter().zip(1u32..).map(|(r, i)| (r.diamond, i)).collect();
    let step = header.lattice.step();
    let mut entries = vec![root.entry()];
    entries.extend(refined.iter().map(|r| entry_of(r, &tree, &number, step)));
    saturate(&mut entries);
    let parts =
        Parts { refined: &refined, root: (root.patches, root.body), number: &number, chunks: chunks.as_ref(), kind };
    link_children(&mut entries, |i| parts.patches(i).iter().all(|p| p.count == 0 || number.contains_key(&p.diamond)));
    let total = entries.len() as u64;
    let done = AtomicU64::new(0);
    let announced = work.run_jobs(
        entries.len(),
        work.memory / 2,
        |i| parts.bytes(i) * 3,
        |i| {
            let bytes = parts.chunk(i)?;
            work.progress.update("numbering", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            let length = u32::try_from(bytes.len());
            let length = length.map_err(|_| BuildError::TooLarge { why: "a chunk of more than 4 GiB".into() })?;
            Ok((length, kilwa_pack::checksum(&bytes)))
        },
    )?;
    for (entry, (bytes, sum)) in entries.iter_mut().zip(announced) {
        (entry.encoded_bytes, entry.checksum) = (bytes, sum);
    }
    let mut summary = summarise(&entries, &parts);
    let mut writer = PackWriter::begin(Counting { out, bytes: 0 }, header, metadata, entries)?;
    for i in 0..=refined.len() {
        work.stop.check()?;
        writer.chunk(&parts.chunk(i)?)?;
        work.progress.update("writing", i as u64 + 1, total);
    }
    let counting = writer.finish()?;
    summary.bytes = counting.bytes;
    Ok((counting.out, summary))
}

fn summarise(entries: &[DirectoryEntry], parts: &Parts<'_>) -> PackSummary {
    PackSummary {
        bytes: 0,
        chunks: entries.len() as u64,
        levels: entries.last().map_or(0, |e| u32::from(e.level) + u32::from(entries.len() > 1)),
        stored_triangles: entries.iter().map(|e| u64::from(e.triangles)).sum(),
        root_triangles: u64::from(entries[0].triangles),
        patch_triangles: Spread::of((0..entries.len()).flat_map(|i| parts.patches(i)).map(|p| u64::from(p.count))),
        chunk_triangles: Spread::of(entries.iter().map(|e| u64::from(e.triangles))),
        root_error: entries.get(1).map_or(0.0, |e| f64::from(e.error)),
    }
}

/// Where the chunks come from, by their number in the pack.
struct Parts<'a> {
    refined: &'a [Refined],
    root: (Vec<PatchRange>, Vec<u8>),
    /// Number in the pack of a diamond of the tree.
    number: &'a FxHashMap<u32, u32>,
    chunks: &'a dyn Bodies,
    kind: Kind,
}

impl Parts<'_> {
    fn refined(&self, i: usize) -> Option<&Refined> {
        i.checked_sub(1).and_then(|i| self.refined.get(i))
    }

    fn bytes(&self, i: usize) -> u64 {
        self.refined(i).map_or(self.root.1.len() as u64, |r| u64::from(r.bytes))
    }

    fn patches(&self, i: usize) -> &[PatchRange] {
        self.refined(i).map_or(&self.root.0, |r| &r.patches)
    }

    /// The finished chunk.
    fn chunk(&self, i: usize) -> Result<Vec<u8>, BuildError> {
        let numbered = |p: &PatchRange| {
            let diamond = if p.diamond == NO_DIAMOND { None } else { self.number.get(&p.diamond) };
            PatchRange { diamond: diamond.copied().unwrap_or(NO_DIAMOND), ..*p }
        };
        let patches: Vec<PatchRange> = self.patches(i).iter().map(numbered).collect();
        let Some(r) = self.refined(i) else { return Ok(self.kind.chunk(&patches, &self.root.1)) };
        let body = self.chunks.body(r)?;
        if crc32fast::hash(&body) != r.sum {
            let why = format!("the chunk at byte {} is not whole", r.at);
            return Err(ScratchError::damaged(self.chunks.path(r), why).into());
        }
        Ok(self.kind.chunk(&patches, &body))
    }
}

/// Counts what passes through.
struct Counting<W> {
    out: W,
    bytes: u64,
}

impl<W: std::io::Write> std::io::Write for Counting<W> {
    fn write(&mut self, b: &[u8]) -> std::io::Result<usize> {
        let n = self.out.write(b)?;
        self.bytes += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

/// Coarse to fine, then along the Hilbert curve of the midpoints: what a view needs of a level lies in fewer stretches of the file than
/// in Morton's order (docs/decisions/0019-chunk-order-and-gaps.md).
pub(crate) fn order_key(key: &DiamondKey) -> (u8, u128) {
    (key.level, kilwa_geometry::hilbert::code(key.midpoint.to_array().map(|x| x as u32)))
}

/// What the chunks of a pack hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Triangles of a surface.
    Surface,
    /// Splats.
    Points,
}

impl Kind {
    /// A body with its patch table.
    fn chunk(self, patches: &[PatchRange], body: &[u8]) -> Vec<u8> {
        match self {
            Self::Surface => chunk::with_patches(patches, body),
            Self::Points => chunk::of_points_with_patches(patches, body),
        }
    }
}

/// The chunk of the root, always refined, without parents: the coarsest form, which is shown before anything is refined.
pub struct RootChunk {
    /// Triangles.
    pub triangles: u32,
    /// Vertices.
    pub vertices: u32,
    /// Round it, in lattice units.
    pub sphere: Sphere,
    /// Its box.
    pub bounds: Aabb,
    /// Its patches, diamonds by their index in the tree.
    pub patches: Vec<PatchRange>,
    /// All but the patch table.
    pub body: Vec<u8>,
    /// Its counts, found by decoding it again; empty for a pack of points.
    pub decoded: Totals,
}

impl RootChunk {
    fn entry(&self) -> DirectoryEntry {
        DirectoryEntry {
            offset: 0,
            encoded_bytes: 0,
            vertices: self.vertices,
            triangles: self.triangles,
            level: 0,
            error: f32::INFINITY,
            color_error: 0.0,
            sphere: self.sphere,
            bounds: self.bounds,
            parents: [NO_DIAMOND; 4],
            checksum: [0; 16],
            children: None,
        }
    }
}

fn entry_of(r: &Refined, tree: &Partition, number: &FxHashMap<u32, u32>, step: f64) -> DirectoryEntry {
    let key = tree.diamonds[r.diamond as usize].key;
    let mut parents = [NO_DIAMOND; 4];
    let above =
        tree.diamonds[r.diamond as usize].tetrahedra.iter().map(|t| tree.tetrahedra[*t as usize].parent_diamond);
    let numbers = above.filter_map(|d| number.get(&d)).copied();
    let mut numbers: Vec<u32> = if key.level == 0 { vec![0] } else { numbers.collect() };
    numbers.sort_unstable();
    numbers.dedup();
    for (slot, n) in parents.iter_mut().zip(numbers) {
        *slot = n;
    }
    let metres = f64::from(r.error) * step;
    let error = if f64::from(metres as f32) < metres { (metres as f32).next_up() } else { metres as f32 };
    DirectoryEntry {
        offset: 0,
        encoded_bytes: 0,
        vertices: r.vertices,
        triangles: r.triangles.0,
        level: tree_level(key.level),
        error,
        color_error: r.color_error,
        sphere: r.sphere,
        bounds: r.bounds,
        parents,
        checksum: [0; 16],
        children: None,
    }
}

/// Errors never grow and spheres never stick out from a parent to a child: then "refined iff its projected error is too
/// large" closes every cut by itself.
fn saturate(entries: &mut [DirectoryEntry]) {
    let mut balls: FxHashMap<u32, Vec<Sphere>> = FxHashMap::default();
    for i in (0..entries.len()).rev() {
        if let Some(mut below) = balls.remove(&(i as u32)) {
            below.insert(0, entries[i].sphere);
            entries[i].sphere = enclose(&below);
            debug_assert!(below.iter().all(|s| contains(&entries[i].sphere, s)), "{:?} {below:?}", entries[i].sphere);
        }
        let (error, color, sphere) = (entries[i].error, entries[i].color_error, entries[i].sphere);
        for p in entries[i].parents {
            if p == NO_DIAMOND {
                continue;
            }
            let parent = &mut entries[p as usize];
            parent.error = parent.error.max(error);
            if p != 0 {
                parent.color_error = parent.color_error.max(color);
            }
            balls.entry(p).or_default().push(sphere);
        }
    }
}

/// Whether a sphere contains another, up to rounding.
fn contains(outer: &Sphere, inner: &Sphere) -> bool {
    let reach = outer.center.distance(inner.center) + inner.radius;
    inner.radius < 0.0 || reach <= outer.radius * (1.0 + 1e-9) + 1e-6
}

/// A bounding sphere of spheres, the first of which bounds the entry's own geometry: centred on that one, or the running union, whichever
/// is smaller.
fn enclose(balls: &[Sphere]) -> Sphere {
    let union = balls.iter().fold(Sphere::EMPTY, |a, b| a.union(b));
    let Some(own) = balls.iter().find(|b| b.radius >= 0.0) else { return union };
    let reach = |b: &Sphere| (0..3).map(|i| (b.center[i] - own.center[i]).powi(2)).sum::<f64>().sqrt() + b.radius;
    let radius = balls.iter().filter(|b| b.radius >= 0.0).map(reach).fold(0.0, f64::max) * (1.0 + 1e-12) + 1e-6;
    if radius < union.radius { Sphere { center: own.center, radius } } else { union }
}

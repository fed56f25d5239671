//! From the finished hierarchy to the file: number the diamonds coarse to fine and along a space-filling curve, saturate
//! errors and spheres, weld each diamond's patches into a chunk, encode, write.

use crate::fragment::VertexKey;
use crate::levels::{Levels, Refined};
use crate::options::BuildError;
use crate::partition::Partition;
use crate::progress::Progress;
use kilwa_geometry::{Aabb, DiamondKey, Mesh, Sphere};
use kilwa_pack::chunk::{self, Chunk, PatchRange};
use kilwa_pack::{DirectoryEntry, Header, Metadata, NO_DIAMOND, PackWriter};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Patches of overfull leaves are cut into runs of this many triangles.
const LARGEST_PATCH: usize = 16_384;

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
    /// Triangles per patch: smallest, median, 95th percentile, largest.
    pub patch_triangles: [u64; 4],
    /// Largest certified error, metres: of the coarsest form.
    pub root_error: f64,
}

/// Write the pack to `out`.
///
/// # Errors
/// [`BuildError::Pack`] when the format cannot hold it or writing fails.
pub fn assemble<W: std::io::Write>(
    levels: Levels,
    tree: &Partition,
    header: Header,
    metadata: &Metadata,
    out: W,
    progress: &dyn Progress,
) -> Result<(W, PackSummary), BuildError> {
    let mut refined = levels.refined;
    refined.sort_by_cached_key(|r| order_key(&tree.diamonds[r.diamond as usize].key));
    let number: FxHashMap<u32, u32> = refined.iter().zip(1u32..).map(|(r, i)| (r.diamond, i)).collect();
    let lattice = header.lattice;
    let step = lattice.step();
    let mut entries = vec![root_entry(&levels.roots)];
    for r in &refined {
        let key = tree.diamonds[r.diamond as usize].key;
        entries.push(entry_of(r, &key, tree, &number, step));
    }
    saturate(&mut entries);
    let total = entries.len() as u64;
    let done = AtomicU64::new(0);
    let attributes = header.attributes;
    let mut patch_sizes: Vec<u64> = Vec::new();
    let chunk_of = |patches: &[(u32, Mesh)]| weld_chunk(patches, tree, &number);
    let encoded: Vec<(Vec<u8>, Counts)> = std::iter::once(&levels.roots)
        .chain(refined.iter().map(|r| &r.patches))
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|patches| {
            let chunk = chunk_of(patches);
            let counts = Counts::of(&chunk);
            if counts.triangles > chunk::MAX_CHUNK_TRIANGLES {
                let at = lattice.world_from_lattice(counts.bounds.min);
                let why = format!(
                    "{} triangles near {at:?} m can neither be divided nor simplified (loose triangles, or all at one \
                     place); a chunk holds {}: remove small components, or weld the mesh first",
                    counts.triangles,
                    chunk::MAX_CHUNK_TRIANGLES
                );
                return Err(BuildError::TooLarge { why });
            }
            let bytes = chunk::encode(&chunk, attributes)?;
            progress.update("encoding", done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok((bytes, counts))
        })
        .collect::<Result<_, BuildError>>()?;
    for (entry, (bytes, counts)) in entries.iter_mut().zip(&encoded) {
        entry.encoded_bytes = u32::try_from(bytes.len())
            .map_err(|_| BuildError::TooLarge { why: "a chunk of more than 4 GiB".into() })?;
        entry.vertices = counts.vertices;
        entry.triangles = counts.triangles;
        entry.bounds = counts.bounds;
        entry.checksum = kilwa_pack::checksum(bytes);
        patch_sizes.extend(&counts.patches);
    }
    patch_sizes.sort_unstable();
    let at = |p: f64| patch_sizes.get(((patch_sizes.len().max(1) - 1) as f64 * p) as usize).copied().unwrap_or(0);
    let mut summary = PackSummary {
        bytes: 0,
        chunks: total,
        levels: entries.last().map_or(0, |e| u32::from(e.level) + u32::from(total > 1)),
        stored_triangles: entries.iter().map(|e| u64::from(e.triangles)).sum(),
        root_triangles: u64::from(entries[0].triangles),
        patch_triangles: [at(0.0), at(0.5), at(0.95), at(1.0)],
        root_error: entries.get(1).map_or(0.0, |e| f64::from(e.error)),
    };
    let mut writer = PackWriter::begin(Counting { out, bytes: 0 }, header, metadata, entries)?;
    for (i, (bytes, _)) in encoded.iter().enumerate() {
        writer.chunk(bytes)?;
        progress.update("writing", i as u64 + 1, total);
    }
    let counting = writer.finish()?;
    summary.bytes = counting.bytes;
    Ok((counting.out, summary))
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

/// Coarse to fine, then along the Morton curve of the midpoints.
fn order_key(key: &DiamondKey) -> (u8, u128) {
    let mut code = 0u128;
    for bit in (0..31).rev() {
        for axis in 0..3 {
            code = (code << 1) | u128::from((key.midpoint[axis] as u32 >> bit) & 1);
        }
    }
    (key.level, code)
}

struct Counts {
    vertices: u32,
    triangles: u32,
    bounds: Aabb,
    patches: Vec<u64>,
}

impl Counts {
    fn of(chunk: &Chunk) -> Self {
        Self {
            vertices: chunk.mesh.vertex_count() as u32,
            triangles: chunk.mesh.triangle_count() as u32,
            bounds: chunk.mesh.bounds(),
            patches: chunk.patches.iter().map(|p| u64::from(p.count)).collect(),
        }
    }
}

/// One vertex array for all patches of a chunk; a patch's `diamond` is the number of the diamond that splits its
/// tetrahedron, if that diamond has geometry.
fn weld_chunk(patches: &[(u32, Mesh)], tree: &Partition, number: &FxHashMap<u32, u32>) -> Chunk {
    let mut chunk = Chunk::default();
    let mut index: FxHashMap<VertexKey, u32> = FxHashMap::default();
    if let Some((_, first)) = patches.first() {
        chunk.mesh.scalars = vec![Vec::new(); first.scalars.len()];
    }
    for (t, mesh) in patches {
        let node = &tree.tetrahedra[*t as usize];
        let diamond = node.children.and_then(|_| number.get(&node.diamond)).copied().unwrap_or(NO_DIAMOND);
        let mut first = chunk.mesh.triangles.len() as u32;
        for (tri, border) in mesh.triangles.iter().zip(&mesh.borders) {
            let tri = tri.map(|v| {
                let next = chunk.mesh.positions.len() as u32;
                let i = *index.entry(VertexKey::of(mesh, v as usize)).or_insert(next);
                if i == next {
                    chunk.mesh.push_vertex_of(mesh, v as usize);
                }
                i
            });
            chunk.mesh.triangles.push(tri);
            chunk.mesh.borders.push(*border);
        }
        let mut left = mesh.triangle_count();
        while left > 0 {
            let count = if left > LARGEST_PATCH * 3 / 2 { LARGEST_PATCH } else { left };
            chunk.patches.push(PatchRange { first, count: count as u32, diamond });
            first += count as u32;
            left -= count;
        }
    }
    chunk
}

/// The entry of the root: always refined, no parents.
fn root_entry(roots: &[(u32, Mesh)]) -> DirectoryEntry {
    let mut sphere = Sphere::EMPTY;
    for (_, m) in roots {
        sphere = sphere.union(&Sphere::of(&m.positions));
    }
    DirectoryEntry {
        offset: 0,
        encoded_bytes: 0,
        vertices: 0,
        triangles: 0,
        level: 0,
        error: f32::INFINITY,
        color_error: 0.0,
        sphere,
        bounds: Aabb::EMPTY,
        parents: [NO_DIAMOND; 4],
        checksum: [0; 16],
    }
}

fn entry_of(
    r: &Refined,
    key: &DiamondKey,
    tree: &Partition,
    number: &FxHashMap<u32, u32>,
    step: f64,
) -> DirectoryEntry {
    let mut parents = [NO_DIAMOND; 4];
    let found = key.parents(tree.cube_log2);
    let numbers = found.iter().filter_map(|p| tree.by_key.get(p)).filter_map(|d| number.get(d)).copied();
    let mut numbers: Vec<u32> = if key.level == 0 { vec![0] } else { numbers.collect() };
    numbers.sort_unstable();
    for (slot, n) in parents.iter_mut().zip(numbers) {
        *slot = n;
    }
    let metres = f64::from(r.error) * step;
    let error = if f64::from(metres as f32) < metres { (metres as f32).next_up() } else { metres as f32 };
    DirectoryEntry {
        offset: 0,
        encoded_bytes: 0,
        vertices: 0,
        triangles: 0,
        level: key.level,
        error,
        color_error: r.color_error,
        sphere: r.sphere,
        bounds: Aabb::EMPTY,
        parents,
        checksum: [0; 16],
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

/// A ball round balls, the first of which is the entry's own geometry: centred on that, or the running union, whichever
/// is smaller.
fn enclose(balls: &[Sphere]) -> Sphere {
    let union = balls.iter().fold(Sphere::EMPTY, |a, b| a.union(b));
    let Some(own) = balls.iter().find(|b| b.radius >= 0.0) else { return union };
    let reach = |b: &Sphere| (0..3).map(|i| (b.center[i] - own.center[i]).powi(2)).sum::<f64>().sqrt() + b.radius;
    let radius = balls.iter().filter(|b| b.radius >= 0.0).map(reach).fold(0.0, f64::max) * (1.0 + 1e-12) + 1e-6;
    if radius < union.radius { Sphere { center: own.center, radius } } else { union }
}

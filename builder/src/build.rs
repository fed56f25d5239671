//! The whole build: a mesh in memory, a pack out, by way of scratch files.

use crate::assemble::{PackSummary, assemble};
use crate::certify::Bound;
use crate::fragment::{Patch, canonical_key, submesh};
use crate::levels::{Hierarchy, Levels};
use crate::options::{BuildError, BuildOptions, Up};
use crate::partition::partition;
use crate::prepare::{Prepared, prepare};
use crate::progress::Progress;
use crate::raw::RawMesh;
use crate::scratch::{PatchFile, Records, Scratch, record};
use crate::surface::{Finding, Ingested, LEAVES, SHARED, Surface, findings_of};
use crate::work::{Stop, Work};
use kilwa_pack::metadata::ScalarChannel;
use kilwa_pack::{Header, Metadata};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A finished pack.
pub struct Built {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// What was read, repaired and made.
    pub report: BuildReport,
}

/// What a build reports.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BuildReport {
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Distinct lattice positions.
    pub vertices: u64,
    /// Lattice step, metres.
    pub step: f64,
    /// Size of the model, metres.
    pub extent: [f64; 3],
    /// Median edge length, metres.
    pub median_edge: f64,
    /// Edges used by one triangle.
    pub border_edges: u64,
    /// Edges used by more than two triangles.
    pub non_manifold_edges: u64,
    /// Findings of reading and preparing: kind, count and first places.
    pub findings: BTreeMap<String, Finding>,
    /// Leaves that space could not split down to the patch size.
    pub overfull_leaves: u64,
    /// Diamonds that kept more than nine tenths of their triangles.
    pub stuck_diamonds: u64,
    /// Triangles in them.
    pub stuck_triangles: u64,
    /// The file.
    pub pack: PackSummary,
}

/// Build a pack from a mesh.
///
/// The bytes depend on the mesh and on `options` (threads excepted), on nothing else.
///
/// # Errors
/// [`BuildError`] with what is wrong and what to do.
pub fn build_pack(raw: RawMesh, options: &BuildOptions, progress: &dyn Progress) -> Result<Built, BuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    let (scratch, stop) = (Scratch::temporary()?, Stop::default());
    let work = Work { scratch: &scratch, memory: u64::MAX, threads: pool.current_num_threads(), stop: &stop, progress };
    pool.install(|| build_in_pool(raw, options, &work))
}

fn build_in_pool(raw: RawMesh, options: &BuildOptions, work: &Work<'_>) -> Result<Built, BuildError> {
    work.progress.update("snapping and welding", 0, 1);
    let prepared = prepare(raw, options)?;
    work.progress.update("snapping and welding", 1, 1);
    work.progress.update("partitioning", 0, 1);
    let ingested = ingest_in_memory(&prepared, options, work)?;
    work.progress.update("partitioning", 1, 1);
    let mut hierarchy = Hierarchy::begin(work, ingested)?;
    while hierarchy.next().is_some() {
        hierarchy.coarsen_next(work)?;
    }
    let levels = hierarchy.finish()?;
    let mut report = BuildReport::of(&levels);
    let metadata = metadata(&levels.surface, options);
    let header = header_of(&levels);
    let (bytes, pack) = assemble(levels, work, header, &metadata, Vec::new())?;
    report.pack = pack;
    Ok(Built { bytes, report })
}

/// The finest surface as the levels want it, from a mesh in memory.
fn ingest_in_memory(p: &Prepared, options: &BuildOptions, work: &Work<'_>) -> Result<Ingested, BuildError> {
    let tree = partition(&p.mesh, p.cube_log2, options.leaf_triangles);
    let leaves = PatchFile::create(work.scratch, LEAVES)?;
    let shared = Records::create(work.scratch, SHARED)?;
    let numbers: Vec<u32> = tree.leaves().filter(|t| !tree.tetrahedra[*t as usize].range.is_empty()).collect();
    numbers.into_par_iter().try_for_each(|leaf| {
        let mut triangles = tree.order[tree.tetrahedra[leaf as usize].range.clone()].to_vec();
        triangles.sort_by_cached_key(|t| canonical_key(&p.mesh, *t as usize));
        let mesh = submesh(&p.mesh, &triangles);
        let patch = Patch { bounds: vec![Bound::default(); mesh.triangle_count()], mesh };
        leaves.append(leaf, &patch)?;
        shared.append(&patch.mesh.positions.iter().map(|x| record(*x, leaf)).collect::<Vec<_>>())
    })?;
    let bounds = p.mesh.bounds();
    let scalars = p.scalar_names.iter().zip(&p.mesh.scalars).map(|(name, values)| {
        let finite = values.iter().copied().filter(|v| v.is_finite());
        let (min, max) = finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (min, max) = if min <= max { (min, max) } else { (0.0, 0.0) };
        ScalarChannel { name: name.clone(), min, max }
    });
    let surface = Surface {
        lattice: p.lattice,
        cube_log2: p.cube_log2,
        bounds: [bounds.min, bounds.max],
        colors: !p.mesh.colors.is_empty(),
        scalars: scalars.collect(),
        triangles: p.mesh.triangle_count() as u64,
        points: p.points,
        border_edges: p.border_edges,
        non_manifold_edges: p.non_manifold_edges,
        median_edge: p.median_edge,
        sources: options.sources.clone(),
        findings: findings_of(&p.findings),
    };
    Ok(Ingested { surface, tree, leaves: leaves.finish()?, shared: shared.finish()? })
}

impl BuildReport {
    /// All but the file.
    fn of(levels: &Levels) -> Self {
        let s = &levels.surface;
        let [min, max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
        let stuck = || levels.refined.iter().map(|r| r.triangles).filter(|(fine, coarse)| coarse * 10 > fine * 9);
        Self {
            triangles: s.triangles,
            vertices: s.points,
            step: s.lattice.step(),
            extent: std::array::from_fn(|i| max[i] - min[i]),
            median_edge: s.median_edge,
            border_edges: s.border_edges,
            non_manifold_edges: s.non_manifold_edges,
            findings: s.findings.clone(),
            overfull_leaves: levels.tree.overfull_leaves,
            stuck_diamonds: stuck().count() as u64,
            stuck_triangles: stuck().map(|(_, coarse)| u64::from(coarse)).sum(),
            pack: PackSummary::default(),
        }
    }
}

fn header_of(levels: &Levels) -> Header {
    Header {
        lattice: levels.surface.lattice,
        cube_log2: levels.surface.cube_log2,
        file_bytes: 0,
        metadata: (0, 0),
        metadata_checksum: [0; 16],
        entry_count: 0,
        first_page: 0,
        other_pages: 0,
        triangles: levels.surface.triangles,
        stored_triangles: 0,
        stored_vertices: 0,
        attributes: levels.attributes,
    }
}

fn metadata(s: &Surface, options: &BuildOptions) -> Metadata {
    let mut shaped = BTreeMap::new();
    shaped.insert("step".to_owned(), if options.step.is_some() { "given" } else { "derived" }.to_owned());
    shaped.insert("leaf-triangles".to_owned(), options.leaf_triangles.to_string());
    let [bounds_min, bounds_max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
    Metadata {
        title: options.title.clone(),
        source_units: options.units.name().to_owned(),
        source_up: if options.up == Up::Z { "z" } else { "y" }.to_owned(),
        crs: options.crs.clone(),
        lattice_step: s.lattice.step(),
        bounds_min,
        bounds_max,
        median_edge: s.median_edge,
        triangles: s.triangles,
        vertices: s.points,
        border_edges: s.border_edges,
        scalars: s.scalars.clone(),
        sources: s.sources.clone(),
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
        options: shaped,
        capture_accuracy: options.capture_accuracy,
        repairs: s.findings.iter().map(|(kind, f)| (kind.clone(), f.count)).collect(),
    }
}

//! The whole build, in memory: raw mesh in, pack out.

use crate::assemble::{PackSummary, assemble};
use crate::levels::coarsen_all;
use crate::options::{BuildError, BuildOptions, Up};
use crate::partition::partition;
use crate::prepare::{Prepared, prepare};
use crate::progress::Progress;
use crate::raw::RawMesh;
use kilwa_pack::metadata::ScalarChannel;
use kilwa_pack::{Attributes, Header, Metadata};
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

/// One kind of finding.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Finding {
    /// How often.
    pub count: u64,
    /// The first few places.
    pub places: Vec<String>,
}

/// Build a pack from a mesh.
///
/// The bytes depend on the mesh and on `options` (threads excepted), on nothing else.
///
/// # Errors
/// [`BuildError`] with what is wrong and what to do.
pub fn build_pack(raw: RawMesh, options: &BuildOptions, progress: &dyn Progress) -> Result<Built, BuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    pool.install(|| build_in_pool(raw, options, progress))
}

fn build_in_pool(raw: RawMesh, options: &BuildOptions, progress: &dyn Progress) -> Result<Built, BuildError> {
    progress.update("snapping and welding", 0, 1);
    let prepared = prepare(raw, options)?;
    progress.update("snapping and welding", 1, 1);
    progress.update("partitioning", 0, 1);
    let tree = partition(&prepared.mesh, prepared.cube_log2, options.leaf_triangles);
    progress.update("partitioning", 1, 1);
    let levels = coarsen_all(&prepared.mesh, &tree, progress);
    let metadata = metadata(&prepared, options);
    let header = Header {
        lattice: prepared.lattice,
        cube_log2: prepared.cube_log2,
        file_bytes: 0,
        metadata: (0, 0),
        metadata_checksum: [0; 16],
        entry_count: 0,
        first_page: 0,
        other_pages: 0,
        triangles: metadata.triangles,
        stored_triangles: 0,
        stored_vertices: 0,
        attributes: Attributes { colors: !prepared.mesh.colors.is_empty(), scalars: prepared.scalar_names.len() as u8 },
    };
    let (stuck_diamonds, stuck_triangles) = (levels.stuck, levels.stuck_triangles);
    let (bytes, pack) = assemble(levels, &tree, header, &metadata, Vec::new(), progress)?;
    let report = BuildReport {
        triangles: metadata.triangles,
        vertices: prepared.points,
        step: prepared.lattice.step(),
        extent: std::array::from_fn(|i| metadata.bounds_max[i] - metadata.bounds_min[i]),
        median_edge: prepared.median_edge,
        border_edges: prepared.border_edges,
        non_manifold_edges: prepared.non_manifold_edges,
        findings: prepared
            .findings
            .iter()
            .map(|(kind, count, places)| (kind.to_owned(), Finding { count, places: places.to_vec() }))
            .collect(),
        overfull_leaves: tree.overfull_leaves,
        stuck_diamonds,
        stuck_triangles,
        pack,
    };
    Ok(Built { bytes, report })
}

fn metadata(p: &Prepared, options: &BuildOptions) -> Metadata {
    let bounds = p.mesh.bounds();
    let scalars = p.scalar_names.iter().zip(&p.mesh.scalars).map(|(name, values)| {
        let finite = values.iter().copied().filter(|v| v.is_finite());
        let (min, max) = finite.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let (min, max) = if min <= max { (min, max) } else { (0.0, 0.0) };
        ScalarChannel { name: name.clone(), min, max }
    });
    let mut shaped = BTreeMap::new();
    shaped.insert("step".to_owned(), if options.step.is_some() { "given" } else { "derived" }.to_owned());
    shaped.insert("leaf-triangles".to_owned(), options.leaf_triangles.to_string());
    Metadata {
        title: options.title.clone(),
        source_units: options.units.name().to_owned(),
        source_up: if options.up == Up::Z { "z" } else { "y" }.to_owned(),
        crs: options.crs.clone(),
        lattice_step: p.lattice.step(),
        bounds_min: p.lattice.world_from_lattice(bounds.min),
        bounds_max: p.lattice.world_from_lattice(bounds.max),
        median_edge: p.median_edge,
        triangles: p.mesh.triangle_count() as u64,
        vertices: p.points,
        border_edges: p.border_edges,
        scalars: scalars.collect(),
        sources: options.sources.clone(),
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
        options: shaped,
        capture_accuracy: options.capture_accuracy,
        repairs: p.findings.iter().map(|(kind, n, _)| (kind.to_owned(), n)).collect(),
    }
}

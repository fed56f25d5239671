//! What is known of the finest surface once it lies in scratch files: everything that later stages need beside the files
//! themselves. Kept in the journal, so that a resumed build need not read its inputs again.

use crate::build::Capture;
use crate::partition::Partition;
use crate::scratch::{PatchFile, Records};
use glam::DVec3;
use kilwa_formats::{Diagnostics, Pictures};
use kilwa_geometry::{Lattice, LatticePoint};
use kilwa_pack::metadata::{ScalarChannel, SourceFile};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name of the file of leaf patches.
pub const LEAVES: &str = "leaves.patches";
/// Name of the file of records (point, tetrahedron) of the leaves.
pub const SHARED: &str = "leaves.shared";

/// The finest surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// The lattice of all positions.
    pub lattice: Lattice,
    /// The root cube is `0..=2^cube_log2`.
    pub cube_log2: u32,
    /// Smallest and largest lattice coordinates of used vertices.
    pub bounds: [LatticePoint; 2],
    /// Whether vertices have colours.
    pub colors: bool,
    /// Where these come from.
    pub colored_by: ColoredBy,
    /// The mean of the normals of the triangles, weighted by area, axes of the pack: 0 for a closed surface. That of an open one points away from its
    /// openings: up, for ground or a statue on its base.
    pub facing: DVec3,
    /// Whether the inputs supplied the normals; otherwise they follow from the triangles.
    pub supplied_normals: bool,
    /// Scalar channels with their ranges.
    pub scalars: Vec<ScalarChannel>,
    /// Triangles.
    pub triangles: u64,
    /// Distinct lattice positions.
    pub points: u64,
    /// Edges used by exactly one triangle.
    pub border_edges: u64,
    /// Edges used by more than two triangles.
    pub non_manifold_edges: u64,
    /// Edges of two triangles that run along it the same way: neighbours that face apart.
    pub inconsistent_edges: u64,
    /// Duplicates of another triangle, whichever way they face.
    pub duplicate_triangles: u64,
    /// Connected components, triangles joined by points.
    pub components: u64,
    /// Triangles of the largest component.
    pub largest_component: u64,
    /// Median edge length in metres.
    pub median_edge: f64,
    /// The length that one edge in a hundred is shorter than, metres.
    pub short_edge: f64,
    /// Estimated standard deviation of the noise along the normal, metres: from the distances of sampled points to the
    /// plane through the mean of their neighbours at right angles to their normal. Curvature and relief of the size of
    /// an edge count as noise, so it is an upper estimate on rough stone.
    pub noise: f64,
    /// The files that it came from.
    pub sources: Vec<SourceFile>,
    /// The accuracy of the capture, if the inputs state it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture: Option<Capture>,
    /// What reading and preparing found: kind, count and first places.
    #[serde(rename = "findings")]
    pub diagnostics: BTreeMap<String, Diagnostic>,
}

/// Where the colours of vertices come from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColoredBy {
    /// There are none.
    Nothing,
    /// The vertices of the inputs, or their materials.
    Vertices,
    /// The triangles of the inputs.
    Triangles,
    /// Pictures: each vertex has the colour at its place.
    Pictures(Pictures),
    /// A scalar channel, as grey.
    Channel(String),
}

/// One kind of diagnostic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnostic {
    /// How often.
    pub count: u64,
    /// The first few places.
    pub places: Vec<String>,
}

/// Diagnostics as they are reported and kept.
pub fn diagnostics_of(diagnostics: &Diagnostics) -> BTreeMap<String, Diagnostic> {
    let entry = |(kind, count, places): (&str, u64, &[String])| {
        (kind.to_owned(), Diagnostic { count, places: places.to_vec() })
    };
    diagnostics.iter().map(entry).collect()
}

/// The finest surface in scratch files: what ingest hands to the levels.
pub struct Ingested {
    /// What is known of it.
    pub surface: Surface,
    /// The tree; ranges of its tetrahedra are not used from here on.
    pub tree: Partition,
    /// [`LEAVES`], finished: the patch of every leaf that is not empty, triangles and vertices in canonical order.
    pub leaves: PatchFile,
    /// [`SHARED`], finished: a record for every point that more than one leaf uses, once for each of these leaves. More
    /// records than these, and repeated ones, do no harm.
    pub shared: Records,
}

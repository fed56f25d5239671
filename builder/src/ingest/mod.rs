//! Out-of-core ingest.
mod buckets;
mod column;
mod lattice;
mod resolve;
mod scatter;
mod spill;
pub mod spool;
mod tally;
mod topology;
mod weld;
mod wishes;
mod words;

/// What the user can choose.
#[derive(Debug, Clone)]
pub struct IngestOptions {
    /// Largest leaf in triangles.
    pub leaf_triangles: usize,
    /// Lattice step in metres, a power of two; `None` derives it from the mesh.
    pub step: Option<f64>,
    /// Keep only triangles whose centroid lies in this box: smallest and largest corner, metres, axes of the pack.
    pub crop: Option<[[f64; 3]; 2]>,
    /// Drop triangles with a corner whose `confidence` or `quality` is below this.
    pub min_confidence: Option<f32>,
}

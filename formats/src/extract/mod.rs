//! Extracting the mesh of a pack, at full or lower detail, as one crack-free PLY, OBJ, STL or GLB.
//!
//! Stages: `choose` (which diamonds are refined) → `stream` (chunk by chunk through space; `reduce` simplifies to a number of triangles; vertices that are equal in
//! position and every attribute become one again, so that patches join exactly; on the pack's lattice this is equality
//! of integers) → two scratch files, vertices and triangles in the form of the format → `output` (header and both, under a
//! temporary name, renamed when complete). Memory follows the cross-section of the model and not its size.

mod choose;
mod compressed;
mod error;
mod format;
mod glb;
mod gltf;
mod meshopt;
mod obj;
mod output;
mod plain;
mod ply;
mod preview;
mod reduce;
mod region;
mod stl;
mod stream;
pub mod tiles;

pub use error::ExtractError;
pub use format::Format;
pub use output::Output;
pub use plain::{About, MeshWriter, PlainVertex, Written};
pub use preview::{Preview, preview};
pub use reduce::WINDOW;
pub use region::Region;

use format::Target;
use glam::DVec3;
use kilwa_pack::{Chunk, Reader, Source};

/// What to extract.
#[derive(Debug, Clone, Copy)]
pub struct Request {
    /// The format.
    pub format: Format,
    /// The coarsest surface whose certified error is at most this many metres.
    pub max_error: Option<f64>,
    /// A surface of this many triangles, or a few less: a finer cut, simplified. Used if no error is given.
    pub max_triangles: Option<u64>,
    /// Only the triangles whose centroid lies in this box.
    pub region: Option<Region>,
    /// How many triangles are simplified at once, at about a kilobyte each: [`WINDOW`].
    pub window: usize,
}

/// What was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Extraction {
    /// Length of the file.
    pub bytes: u64,
    /// Triangles in it.
    pub triangles: u64,
    /// Vertices in it.
    pub vertices: u64,
    /// Certified error against the finest surface, metres.
    pub error: f32,
    /// Whether every triangle of the finest surface (in the box) was written.
    pub is_finest: bool,
    /// Chunks that are refined in the cut.
    pub refined_chunks: usize,
    /// Type of the coordinates: `float`, `double` or `text`.
    pub coordinates: &'static str,
    /// What must be added to the coordinates to get world coordinates, if they are relative; metres.
    pub offset: Option<DVec3>,
    /// Parts of the pack that the format cannot store.
    pub left_out: Vec<String>,
}

/// Changes the vertices of the finest surface while it is extracted.
///
/// A vertex that several chunks share must be changed identically in all of them; otherwise the surface cracks.
pub trait Repaint: Sync {
    /// Names of the scalars that each vertex gets in addition to those of the pack.
    fn scalars(&self) -> Vec<String>;

    /// Give the vertices of chunk `number` their colours, and append the additional scalars.
    ///
    /// # Errors
    /// Why that is impossible.
    fn repaint(&self, number: u32, chunk: &mut Chunk) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

/// Write the mesh of a pack to `output`. `progress` is called with chunks done and chunks in all.
///
/// # Errors
/// [`ExtractError`]; no files are left then.
pub fn extract<S: Source + Sync>(
    reader: &Reader<S>,
    request: &Request,
    output: &Output,
    progress: &dyn Fn(u64, u64),
) -> Result<Extraction, ExtractError> {
    extracted(reader, request, None, output, progress)
}

/// Write the finest surface of a pack with other colours to `output`. Chunks are decoded on the threads of `pool`.
///
/// # Errors
/// As [`extract`], and [`ExtractError::Repaint`].
pub fn extract_repainted<S: Source + Sync>(
    reader: &Reader<S>,
    format: Format,
    repaint: &dyn Repaint,
    output: &Output,
    pool: &rayon::ThreadPool,
    progress: &dyn Fn(u64, u64),
) -> Result<Extraction, ExtractError> {
    let request = Request { format, max_error: None, max_triangles: None, region: None, window: WINDOW };
    let mut extraction = extracted(reader, &request, Some((repaint, pool)), output, progress)?;
    if !format.has_scalars() {
        extraction.left_out.extend(repaint.scalars());
    }
    Ok(extraction)
}

fn extracted<S: Source + Sync>(
    reader: &Reader<S>,
    request: &Request,
    repaint: Option<(&dyn Repaint, &rayon::ThreadPool)>,
    output: &Output,
    progress: &dyn Fn(u64, u64),
) -> Result<Extraction, ExtractError> {
    let format = request.format;
    let region = request.region.as_ref().map(|region| region.on(&reader.header().lattice));
    let chosen = choose::choose(reader, request.max_error, request.max_triangles, request.window, region.as_ref())?;
    let mut target = Target::new(reader, &chosen, region.as_ref(), format)?;
    if let Some((repaint, _)) = repaint {
        target.repainted(&repaint.scalars());
    }
    let mut encoder = format.encoder(&target);
    let mut scratch = output.scratch()?;
    let source = stream::Chunks { reader, repaint };
    let counts = stream::stream(&source, &chosen, region.as_ref(), &mut *encoder, &mut scratch, progress)?;
    if counts.triangles == 0 && counts.vertices == 0 {
        return Err(ExtractError::Empty);
    }
    let bytes = output.write(|out| encoder.assemble(out, &mut scratch, counts))?;
    Ok(Extraction {
        bytes,
        triangles: counts.triangles,
        vertices: counts.vertices,
        error: counts.error,
        is_finest: chosen.is_finest && chosen.reduction.is_none(),
        refined_chunks: chosen.cut.refined().count(),
        coordinates: format.coordinate_type(&target),
        offset: format.offset(&target),
        left_out: format.left_out(reader),
    })
}

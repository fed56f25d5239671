//! A diamond's patches as one encoded chunk, all but the numbers of diamonds: those follow from which diamonds of all
//! levels have geometry, and a coarser diamond may still turn out to have none. Until then a patch names the diamond by
//! its index in the tree.

use crate::build::options::BuildError;
use crate::partition::Partition;
use glam::DVec3;
use kilwa_geometry::{Aabb, Mesh, Sphere};
use kilwa_pack::chunk::{self, Chunk, Declared, MAX_CHUNK_TRIANGLES, PatchRange};
use kilwa_pack::plural::counted;
use kilwa_pack::verify::{self, Totals};
use kilwa_pack::{Attributes, NO_DIAMOND};

/// Patches of overfull leaves are cut into runs of this many triangles.
const LARGEST_PATCH: usize = 16_384;

/// A chunk without its patch table.
pub(crate) struct Encoded {
    /// What [`chunk::encode_body`] gives.
    pub(crate) body: Vec<u8>,
    /// The table; diamonds by their index in the tree.
    pub(crate) patches: Vec<PatchRange>,
    pub(crate) vertices: u32,
    pub(crate) bounds: Aabb,
}

/// Encode a mesh; `patches` are the tetrahedra of its triangles and how many each has, in their order.
///
/// # Errors
/// [`BuildError::Pack`] when the format cannot hold it.
pub(crate) fn encode_chunk(
    mesh: Mesh,
    patches: impl Iterator<Item = (u32, usize)>,
    tree: &Partition,
    attributes: Attributes,
) -> Result<Encoded, BuildError> {
    let chunk = Chunk { mesh, patches: ranges(patches, tree) };
    let body = chunk::encode_body(&chunk, attributes)?;
    if u32::try_from(body.len()).is_err() {
        return Err(BuildError::TooLarge { why: "a chunk of more than 4 GiB".into() });
    }
    let (vertices, bounds) = (chunk.mesh.vertex_count() as u32, chunk.mesh.bounds());
    Ok(Encoded { body, patches: chunk.patches, vertices, bounds })
}

/// Decode a chunk again and check its counts, its box, and that `sphere`, in lattice units, contains all vertices. Returns what
/// [`verify::geometry`] counts.
///
/// # Errors
/// [`BuildError::Inputs`] if the check fails: the fault is in this machine or in the program.
pub(crate) fn decode_again(
    encoded: &Encoded,
    triangles: u32,
    sphere: &Sphere,
    attributes: Attributes,
) -> Result<Totals, BuildError> {
    let bytes = chunk::with_patches(&encoded.patches, &encoded.body);
    let decoded = chunk::decode(&bytes, Declared { vertices: encoded.vertices, triangles }, attributes);
    let checked = decoded.and_then(|chunk| verify::geometry("chunk", &chunk, &encoded.bounds, sphere));
    checked.map_err(|e| {
        let why = format!(
            "a chunk that was just encoded is not right when it is decoded again ({e}); run the same command again; if it fails again, test the memory of this machine or report the error"
        );
        BuildError::Inputs { why }
    })
}

/// More triangles in one diamond than a chunk holds.
pub(crate) fn too_large(triangles: u64, near: DVec3) -> BuildError {
    let near = near.to_array();
    let why = format!(
        "{} near {near:?} m can neither be divided nor simplified (loose triangles, or all at one \
         place); a chunk holds {MAX_CHUNK_TRIANGLES}: remove small components, or weld the mesh first",
        counted(triangles, "triangle", "triangles")
    );
    BuildError::TooLarge { why }
}

/// The patches of a chunk; a patch's `diamond` is the index of the diamond that splits its tetrahedron, where it is split.
fn ranges(patches: impl Iterator<Item = (u32, usize)>, tree: &Partition) -> Vec<PatchRange> {
    let mut ranges = Vec::new();
    let mut first = 0;
    for (t, mut left) in patches {
        let node = &tree.tetrahedra[t as usize];
        let diamond = node.children.map_or(NO_DIAMOND, |_| node.diamond);
        while left > 0 {
            let count = if left > LARGEST_PATCH * 3 / 2 { LARGEST_PATCH } else { left };
            ranges.push(PatchRange { first, count: count as u32, diamond });
            first += count as u32;
            left -= count;
        }
    }
    ranges
}

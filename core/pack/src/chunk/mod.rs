//! A chunk: all child patches of one diamond, which is what one refinement loads. FORMAT section 5.

mod attributes;
mod border;
mod number;
mod ops;
mod order;
mod payload;
mod predict;
mod range;
mod second;
/// Only where something may read it: the modules of the page for surfaces do without.
#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
pub mod splat;

use crate::error::PackError;
use crate::plural::counted;
use kilwa_geometry::Mesh;
use kilwa_geometry::lattice::MAX_COORDINATE;

/// Most triangles of one chunk.
pub const MAX_CHUNK_TRIANGLES: u32 = 1 << 20;
/// Most vertices of one chunk.
pub const MAX_CHUNK_VERTICES: u32 = 3 << 20;
/// Most encoded bytes of one chunk.
pub const MAX_CHUNK_BYTES: u32 = 1 << 29;
/// Most triangles per encoded byte: a chunk that would be denser is padded, so that a decoder can bound what it
/// allocates by what is there.
const MAX_PER_BYTE: usize = 64;
/// Most scalar channels.
pub const MAX_SCALARS: u8 = 16;

/// A run of triangles of a chunk that belongs to one tetrahedron.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PatchRange {
    /// First triangle in the chunk.
    pub first: u32,
    /// Number of triangles.
    pub count: u32,
    /// Directory index of the diamond that splits this patch's tetrahedron, or [`crate::NO_DIAMOND`] for a leaf: the
    /// patch is drawn while that diamond is not refined.
    pub diamond: u32,
}

/// A decoded chunk.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chunk {
    /// The geometry of all patches, with one shared vertex array.
    pub mesh: Mesh,
    /// The patches; they tile `0..mesh.triangle_count()` in order.
    pub patches: Vec<PatchRange>,
}

impl Chunk {
    /// The content of the chunk, whatever its triangle, corner and vertex order: two chunks with equal canonical forms are
    /// the same geometry with the same attributes and patches.
    pub fn canonical(&self) -> Canonical {
        let mesh = &self.mesh;
        let vertex = |v: u32| {
            let v = v as usize;
            CanonicalVertex {
                position: mesh.positions.get(v).copied().unwrap_or_default().to_array(),
                color: mesh.colors.get(v).copied(),
                normal: mesh.normals.get(v).copied().unwrap_or_default(),
                scalars: mesh.scalars.iter().filter_map(|s| s.get(v)).map(|x| x.to_bits()).collect(),
            }
        };
        let patches = self.patches.iter().map(|patch| {
            let both = mesh.triangles.iter().zip(&mesh.borders);
            let mut triangles: Vec<_> = both
                .skip(patch.first as usize)
                .take(patch.count as usize)
                .map(|(&[a, b, c], &bits)| {
                    let [p, q, r] = [a, b, c].map(vertex);
                    let rotations = [
                        ([p.clone(), q.clone(), r.clone()], bits),
                        ([q.clone(), r.clone(), p.clone()], (bits >> 1 | bits << 2) & 7),
                        ([r, p, q], (bits << 1 | bits >> 2) & 7),
                    ];
                    rotations.into_iter().min()
                })
                .collect();
            triangles.sort();
            (patch.diamond, triangles.into_iter().flatten().collect())
        });
        Canonical(patches.collect())
    }
}

/// A vertex with all its attributes, comparable (scalars by their bits).
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CanonicalVertex {
    /// Lattice position.
    pub position: [i32; 3],
    /// Colour, where the pack has them.
    pub color: Option<[u8; 3]>,
    /// Normal.
    pub normal: [i16; 2],
    /// Bits of the scalars.
    pub scalars: Vec<u32>,
}

/// A triangle rotated to its smallest form, with its border bits.
pub type CanonicalTriangle = ([CanonicalVertex; 3], u8);

/// See [`Chunk::canonical`]: per patch its diamond and its sorted triangles, each rotated to its smallest form, with
/// border bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canonical(pub Vec<(u32, Vec<CanonicalTriangle>)>);

/// Which attributes every chunk of a pack carries; from the metadata.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attributes {
    /// Colours are present.
    pub colors: bool,
    /// Number of scalar channels (at most 16).
    pub scalars: u8,
}

/// The directory's declaration of a chunk; decoding checks it and never allocates more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Declared {
    /// Vertices.
    pub vertices: u32,
    /// Triangles.
    pub triangles: u32,
}

/// Encode a chunk. Triangle order inside a patch and vertex order may change (for the vertex cache); what each triangle
/// is, its corner order up to rotation, border bits and attributes do not. Deterministic.
///
/// # Errors
/// [`PackError::Invalid`] when the mesh contradicts itself or `attributes`.
pub fn encode(chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    Ok(with_patches(&chunk.patches, &encode_body(chunk, attributes)?))
}

/// Encode all of a chunk but its patch table, for a builder that does not know the numbers of diamonds yet: they come
/// to it by [`with_patches`].
///
/// # Errors
/// As [`encode`].
pub fn encode_body(chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    check(chunk, attributes)?;
    Ok(second::encode_body(chunk, attributes)?.0)
}

/// Encode a chunk as [`encode`] does, and return how many bytes each part takes, for measurements.
///
/// # Errors
/// As [`encode`].
pub fn encode_parts(chunk: &Chunk, attributes: Attributes) -> Result<(Vec<u8>, PartBytes), PackError> {
    check(chunk, attributes)?;
    let (body, coded) = second::encode_body(chunk, attributes)?;
    let bytes = with_patches(&chunk.patches, &body);
    let [connectivity, borders, positions, colors, normals, scalars] = coded.bytes();
    let sum = connectivity + borders + positions + colors + normals + scalars;
    let other = bytes.len().saturating_sub(sum);
    let parts = PartBytes { connectivity, borders, positions, colors, normals, scalars, other };
    Ok((bytes, parts))
}

/// Bytes of an encoded chunk by what they are for. One entropy coder runs through all parts, so that each is right to a
/// byte or two.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PartBytes {
    /// Triangles and the patches that they belong to.
    pub connectivity: usize,
    /// Border bits.
    pub borders: usize,
    /// Positions.
    pub positions: usize,
    /// Colours.
    pub colors: usize,
    /// Normals.
    pub normals: usize,
    /// Scalars.
    pub scalars: usize,
    /// Patch table, lengths, padding.
    pub other: usize,
}

/// First byte of a chunk in codec 2.
pub(crate) const CODEC_2: u8 = second::CODEC;
/// First byte of a chunk of points.
pub(crate) const CODEC_3: u8 = 3;

/// Encode a chunk with codec 1, which earlier versions wrote: to compare with.
///
/// # Errors
/// As [`encode`].
#[doc(hidden)]
pub fn encode_first(chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    check(chunk, attributes)?;
    Ok(payload::with_patches(payload::CODEC, &chunk.patches, &payload::encode_body(chunk, attributes)?.0))
}

/// Complete a chunk: `patches` are those of the chunk that `body` was made from, each with the final number of its
/// diamond. The result is what [`encode`] gives for that chunk.
pub fn with_patches(patches: &[PatchRange], body: &[u8]) -> Vec<u8> {
    payload::with_patches(second::CODEC, patches, body)
}

/// Complete a chunk of points: as [`with_patches`], of a body that [`splat::encode_body`] made.
#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
pub fn of_points_with_patches(patches: &[PatchRange], body: &[u8]) -> Vec<u8> {
    payload::with_patches(splat::CODEC, patches, body)
}

/// Decode a chunk that [`encode`] wrote.
///
/// # Errors
/// [`PackError`] for bytes that break a rule of FORMAT; never panics, never allocates more than a small
/// multiple of what `declared` implies, which is itself checked against a hard cap and against `bytes.len()`.
pub fn decode(bytes: &[u8], declared: Declared, attributes: Attributes) -> Result<Chunk, PackError> {
    let bad = |why: String| Err(PackError::invalid("chunk", why));
    if declared.triangles > MAX_CHUNK_TRIANGLES || declared.vertices > MAX_CHUNK_VERTICES {
        return bad(format!("{} triangles and {} vertices are too many", declared.triangles, declared.vertices));
    }
    if attributes.scalars > MAX_SCALARS {
        return bad(format!("{} scalar channels; at most 16 are allowed", attributes.scalars));
    }
    // Never allocate for more triangles and vertices than the bytes can hold.
    if (declared.triangles as usize).div_ceil(MAX_PER_BYTE) > bytes.len()
        || declared.vertices as usize > 3 * declared.triangles as usize
    {
        return bad(format!(
            "{} and {} cannot be in {}",
            counted(declared.triangles, "triangle", "triangles"),
            counted(declared.vertices, "vertex", "vertices"),
            counted(bytes.len(), "byte", "bytes")
        ));
    }
    let chunk = payload::decode(bytes, declared, attributes)?;
    check(&chunk, attributes)?;
    Ok(chunk)
}

/// The patch table of an encoded chunk, without decoding its geometry.
///
/// # Errors
/// [`PackError`] when the bytes do not begin with one.
pub fn patch_table(bytes: &[u8]) -> Result<Vec<PatchRange>, PackError> {
    Ok(payload::read_patches(&mut crate::bytes::Cursor::new(bytes, "chunk"))?.1)
}

/// Whether a chunk is what it should be: attributes complete, indices inside, patches tiling the triangles.
fn check(chunk: &Chunk, attributes: Attributes) -> Result<(), PackError> {
    let bad = |why: String| Err(PackError::invalid("chunk", why));
    let mesh = &chunk.mesh;
    let vertices = mesh.positions.len();
    if vertices > MAX_CHUNK_VERTICES as usize || mesh.triangles.len() > MAX_CHUNK_TRIANGLES as usize {
        return bad(format!("{} triangles and {vertices} vertices are too many", mesh.triangles.len()));
    }
    if vertices > mesh.triangles.len().saturating_mul(3) {
        return bad(format!(
            "{}, more than its {} can use",
            counted(vertices, "vertex", "vertices"),
            counted(mesh.triangles.len(), "triangle", "triangles")
        ));
    }
    if mesh.normals.len() != vertices
        || mesh.colors.len() != if attributes.colors { vertices } else { 0 }
        || mesh.scalars.len() != usize::from(attributes.scalars)
        || mesh.scalars.iter().any(|s| s.len() != vertices)
        || mesh.borders.len() != mesh.triangles.len()
    {
        return bad("a vertex or triangle attribute is missing or too long".to_owned());
    }
    if mesh.borders.iter().any(|&b| b > 7) {
        return bad("border bits above 7".to_owned());
    }
    if !bytemuck::cast_slice::<_, i32>(&mesh.positions).iter().all(|x| (0..=MAX_COORDINATE).contains(x)) {
        return bad("a position lies outside the lattice".to_owned());
    }
    if mesh.triangles.as_flattened().iter().any(|&v| v as usize >= vertices) {
        return bad(format!("a triangle names a vertex outside of {vertices}"));
    }
    let mut next = 0u32;
    for patch in &chunk.patches {
        if patch.first != next {
            return bad(format!("a patch begins at triangle {}, not {next}", patch.first));
        }
        next = next.saturating_add(patch.count);
    }
    if next as usize != mesh.triangles.len() {
        return bad(format!("its patches hold {} of {}", counted(next, "triangle", "triangles"), mesh.triangles.len()));
    }
    Ok(())
}

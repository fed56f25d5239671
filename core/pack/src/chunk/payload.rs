//! The bytes of a chunk. FORMAT section 5: `codec | patch table | length | body | padding`; and the body of codec 1: a coded
//! stream and raw bits, read side by side: `connectivity | borders | positions | colours | normals | scalars`.

use super::attributes;
use super::border::{Connectivity, Limits, Link, Machine, NONE, Placed, Source, Unknown};
use super::ops::Models;
use super::order::Unused;
use super::range::{Bit, Coder, Decoder, Encoder};
use super::{Attributes, Chunk, Declared, MAX_PER_BYTE, PatchRange, second};
use crate::bytes::{Cursor, push_varint};
use crate::{NO_DIAMOND, PackError};
use kilwa_geometry::{LatticePoint, Mesh};

/// Number of the codec described here.
pub(super) const CODEC: u8 = 1;

/// Codec and patch table, then what `encode_body` of that codec made, then padding.
pub(super) fn with_patches(codec: u8, patches: &[PatchRange], body: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + patches.len() * 8 + body.len());
    out.push(codec);
    push_varint(&mut out, u32::try_from(patches.len()).unwrap_or(u32::MAX));
    for patch in patches {
        push_varint(&mut out, patch.count);
        push_varint(&mut out, patch.diamond.wrapping_add(1));
    }
    push_varint(&mut out, u32::try_from(body.len()).unwrap_or(u32::MAX));
    out.extend_from_slice(body);
    // A decoder allocates for no more than so many triangles per byte: an absurdly regular chunk is padded.
    let triangles: u64 = patches.iter().map(|p| u64::from(p.count)).sum();
    let min = usize::try_from(triangles.div_ceil(MAX_PER_BYTE as u64)).unwrap_or(0);
    out.resize(out.len().max(min), 0);
    out
}

/// Where the parts of a chunk's coded part end, in bytes: connectivity, borders, positions, colours, normals, scalars.
pub(super) type Ends = [usize; 6];

/// The coded part.
pub(super) fn encode_body(chunk: &Chunk, attributes: Attributes) -> Result<(Vec<u8>, Ends), PackError> {
    let mut ends = [0; 6];
    if chunk.mesh.triangles.is_empty() {
        return Ok((Vec::new(), ends));
    }
    let mut coder = Encoder::new();
    let mut source = Unused::new(chunk);
    let limits = limits(&chunk.mesh.positions, &chunk.mesh.triangles, &chunk.patches)?;
    let mut made = machine(&mut coder, &mut source, limits)?;
    let mut mesh = source.reordered();
    let links = links(&mut made, &chunk.mesh);
    let mut parts = Parts { coder: &mut coder, made: &made, mesh: &mut mesh, links };
    let fine: Vec<bool> = chunk.patches.iter().map(|p| p.diamond == NO_DIAMOND).collect();
    for (part, end) in (0..).zip(&mut ends) {
        parts.code(part, attributes, &fine)?;
        *end = parts.coder.bytes();
    }
    let (coded, raw) = coder.finish();
    let mut body = Vec::with_capacity(coded.len() + raw.len() + 5);
    push_varint(&mut body, u32::try_from(coded.len()).unwrap_or(u32::MAX));
    body.extend(coded);
    body.extend(raw);
    Ok((body, ends))
}

/// Decode; the caller checks the result.
pub(super) fn decode(bytes: &[u8], declared: Declared, attributes: Attributes) -> Result<Chunk, PackError> {
    let mut c = Cursor::new(bytes, "chunk");
    let (codec, patches) = read_patches(&mut c)?;
    let length = c.varint()? as usize;
    let body = c.take(length)?;
    let (vertices, triangles) = (declared.vertices as usize, declared.triangles as usize);
    let padding = c.take(c.remaining())?;
    if padding.iter().any(|&b| b != 0) || (!padding.is_empty() && bytes.len() > triangles.div_ceil(MAX_PER_BYTE)) {
        return Err(c.invalid("bytes are left over at its end"));
    }
    if codec == second::CODEC && triangles > 0 {
        return Ok(Chunk { mesh: second::decode_body(body, declared, attributes, &patches)?, patches });
    }
    #[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
    if codec == super::splat::CODEC && triangles > 0 {
        return Ok(Chunk { mesh: super::splat::decode_body(body, declared, attributes, &patches)?, patches });
    }
    let mut parts = Cursor::new(body, "chunk");
    let coded_length = if triangles == 0 { 0 } else { parts.varint()? as usize };
    let coded = parts.take(coded_length)?;
    let mut coder = Decoder::new(coded, parts.take(parts.remaining())?);
    let mut mesh =
        Mesh { positions: vec![LatticePoint::ZERO; vertices], normals: vec![[0; 2]; vertices], ..Mesh::default() };
    if triangles > 0 {
        let limits = limits(&mesh.positions, &[(); 0], &patches)?;
        let mut made = machine(&mut coder, &mut Unknown, Limits { triangles: declared.triangles, ..limits })?;
        if coder.is_past_end() {
            coder.end(&c)?;
        }
        mesh.triangles = made.triangles.iter().map(|t| t.corners).collect();
        mesh.borders = vec![0; triangles];
        mesh.colors = vec![[0; 3]; if attributes.colors { vertices } else { 0 }];
        let links = links(&mut made, &mesh);
        let mut parts = Parts { coder: &mut coder, made: &made, mesh: &mut mesh, links };
        for part in 0..6 {
            parts.code(part, attributes, &vec![false; patches.len()])?;
            if parts.coder.is_past_end() {
                parts.coder.end(&c)?;
            }
        }
        by_patch(&mut mesh, &made.triangles, &patches).ok_or_else(|| c.invalid("its patches have other triangles"))?;
    }
    mesh.scalars.resize(attributes.scalars.into(), Vec::new());
    coder.end(&c)?;
    Ok(Chunk { mesh, patches })
}

/// Only the patch table at the beginning of a chunk.
pub(super) fn read_patches(c: &mut Cursor<'_>) -> Result<(u8, Vec<PatchRange>), PackError> {
    let codec = c.u8()?;
    if codec != CODEC && codec != second::CODEC && !is_of_points(codec) {
        return Err(c.invalid("its codec is unknown: install a newer kilwa"));
    }
    let mut patches = Vec::new();
    let mut first = 0u32;
    for _ in 0..c.varint()? {
        let (count, diamond) = (c.varint()?, c.varint()?.wrapping_sub(1));
        patches.push(PatchRange { first, count, diamond });
        first = first.saturating_add(count);
    }
    Ok((codec, patches))
}

/// Whether this is the codec of points, and it can be read here.
fn is_of_points(codec: u8) -> bool {
    cfg!(any(not(target_arch = "wasm32"), feature = "points")) && codec == super::CODEC_3
}

pub(super) fn limits<P, T>(vertices: &[P], triangles: &[T], patches: &[PatchRange]) -> Result<Limits, PackError> {
    let number = |n: usize| u32::try_from(n).map_err(|_| PackError::invalid("chunk", "it has more than 2^32 parts"));
    let (vertices, triangles) = (number(vertices.len())?, number(triangles.len())?);
    Ok(Limits { vertices, triangles, patches: number(patches.len())? })
}

fn machine<C: Coder, S: Source>(coder: &mut C, source: &mut S, limits: Limits) -> Result<Connectivity, PackError> {
    let impossible = |_| PackError::invalid("chunk", "its triangles are coded in a way that none can be");
    let (made, back) = Machine::new(Models::new(coder.taken()), source, limits).run().map_err(impossible)?;
    *coder = back.coder;
    Ok(made)
}

/// One for every vertex; those that no triangle uses lie near the one before.
pub(super) fn links(made: &mut Connectivity, mesh: &Mesh) -> Vec<Link> {
    let mut links = std::mem::take(&mut made.links);
    for v in (0u32..).take(mesh.vertex_count()).skip(links.len()) {
        links.push(Link::near(v.checked_sub(1).unwrap_or(NONE)));
    }
    links
}

/// The parts that are coded after the connectivity; triangles are in the order of the machine.
struct Parts<'a, C> {
    coder: &'a mut C,
    made: &'a Connectivity,
    mesh: &'a mut Mesh,
    links: Vec<Link>,
}

impl<C: Coder> Parts<'_, C> {
    /// Code one part, by its place in [`Ends`]; the first is done.
    fn code(&mut self, part: u8, attributes: Attributes, fine: &[bool]) -> Result<(), PackError> {
        let mesh = &mut *self.mesh;
        match part {
            1 => borders(self.coder, self.made, mesh),
            2 => {
                let points = mesh.positions.iter().map(glam::IVec3::to_array);
                let grains = if C::ENCODES { attributes::grains(points) } else { None };
                attributes::positions(self.coder, &self.links, &mut mesh.positions, grains);
            }
            3 if attributes.colors => {
                let colors = mesh.colors.iter().map(|c| c.map(i32::from));
                let grains = if C::ENCODES { attributes::grains(colors) } else { None };
                attributes::colors(self.coder, &self.links, &mut mesh.colors, grains);
            }
            4 => self.normals(fine)?,
            5 => self.scalars(attributes.scalars),
            _ => {}
        }
        Ok(())
    }

    fn normals(&mut self, fine: &[bool]) -> Result<(), PackError> {
        let bad = |why| PackError::invalid("chunk", why);
        let coarse: Vec<bool> = fine.iter().map(|&fine| self.coder.raw(1, u32::from(!fine)) == 1).collect();
        let kinds = kinds(&coarse, self.made, self.links.len());
        let values = &mut self.mesh.normals;
        let bits = if C::ENCODES { attributes::normal_bits(values) } else { 2 };
        let bits = u8::try_from(self.coder.raw(4, u32::from(bits) - 1) + 1).unwrap_or(0);
        if bits < 2 {
            return Err(bad("normals have 2 to 16 bits"));
        }
        let grains = if C::ENCODES { attributes::grains(attributes::levels(values, bits)) } else { None };
        let mut values = std::mem::take(values);
        let predicted = super::predict::normals(self.mesh);
        let about = (predicted.as_slice(), kinds.as_slice());
        let coded = attributes::normals(self.coder, &self.links, &mut values, about, (bits, grains));
        self.mesh.normals = values;
        coded.map_err(|_| bad("a normal is out of range"))
    }

    fn scalars(&mut self, channels: u8) {
        self.mesh.scalars.resize(channels.into(), Vec::new());
        for channel in &mut self.mesh.scalars {
            channel.resize(self.links.len(), 0.0);
            let mut ordered: Vec<i32> = channel.iter().map(|x| attributes::ordered_bits(*x)).collect();
            attributes::scalars(self.coder, &self.links, &mut ordered);
            *channel = ordered.into_iter().map(attributes::from_ordered_bits).collect();
        }
    }
}

/// Border bits. Of edges that two triangles of the chunk share they are coded only where one is set, which no sound mesh has.
fn borders<C: Coder>(coder: &mut C, made: &Connectivity, mesh: &mut Mesh) {
    let mut models = [Bit::NEW; 9];
    let everywhere = |coder: &mut C, yes| coder.raw(1, u32::from(yes)) == 1;
    let bit = |coder: &mut C, context: usize, yes| models.get_mut(context).is_some_and(|model| coder.bit(model, yes));
    borders_with(coder, C::ENCODES, (everywhere, bit), made, mesh);
}

/// Border bits, by two functions: whether there are any but on open edges, and a bit in one of nine contexts.
pub(super) fn borders_with<C>(
    coder: &mut C,
    encodes: bool,
    (everywhere, mut bit): (impl Fn(&mut C, bool) -> bool, impl FnMut(&mut C, usize, bool) -> bool),
    made: &Connectivity,
    mesh: &mut Mesh,
) {
    let inside = encodes && {
        let mut shared = mesh.borders.clone();
        made.open.iter().for_each(|&edge| set(&mut shared, edge, false));
        shared.iter().any(|&b| b != 0)
    };
    let edges =
        if everywhere(coder, inside) { (0u32..).take(3 * made.triangles.len()).collect() } else { made.open.clone() };
    let mut seen = vec![0u8; mesh.positions.len()];
    for edge in edges {
        let ends = ends_of(made, edge);
        let [a, b] = ends.map(|v| seen.get(v as usize).copied().unwrap_or(0));
        let known = mesh.borders.get(edge as usize / 3).is_some_and(|bits| bits >> (edge % 3) & 1 == 1);
        let bit = bit(coder, usize::from(3 * a + b), known);
        set(&mut mesh.borders, edge, bit);
        for v in ends {
            if let Some(seen) = seen.get_mut(v as usize) {
                *seen = if bit { 2 } else { (*seen).max(1) };
            }
        }
    }
}

fn set(borders: &mut [u8], edge: u32, bit: bool) {
    if let Some(bits) = borders.get_mut(edge as usize / 3) {
        *bits = *bits & !(1 << (edge % 3)) | u8::from(bit) << (edge % 3);
    }
}

/// The vertices of an edge: three times the triangle plus the corner where it begins.
pub(super) fn ends_of(made: &Connectivity, edge: u32) -> [u32; 2] {
    let [a, b, c] = made.triangles.get(edge as usize / 3).map_or([0; 3], |t| t.corners);
    match edge % 3 {
        0 => [a, b],
        1 => [b, c],
        _ => [c, a],
    }
}

/// How good a vertex' predicted normal can be: bit 0 is set beside a patch that is not of the finest level, which one bit per patch records,
/// bit 1 where the chunk sees only one side.
fn kinds(coarse: &[bool], made: &Connectivity, vertices: usize) -> Vec<u8> {
    let mut kinds = vec![0; vertices];
    let mut add = |v: u32, kind: u8| {
        if let Some(k) = kinds.get_mut(v as usize) {
            *k |= kind;
        }
    };
    for t in made.triangles.iter().filter(|t| coarse.get(t.patch as usize) == Some(&true)) {
        for v in t.corners {
            add(v, 1);
        }
    }
    for &edge in &made.open {
        for v in ends_of(made, edge) {
            add(v, 2);
        }
    }
    kinds
}

/// Sort the triangles by patch, keeping their order within each; none if a patch has another number of them than it should.
pub(super) fn by_patch(mesh: &mut Mesh, placed: &[Placed], patches: &[PatchRange]) -> Option<()> {
    let mut next: Vec<u32> = patches.iter().map(|p| p.first).collect();
    let mut triangles = vec![[0; 3]; placed.len()];
    let mut borders = vec![0; placed.len()];
    for (t, &bits) in placed.iter().zip(&mesh.borders) {
        let at = next.get_mut(t.patch as usize)?;
        *triangles.get_mut(*at as usize)? = t.corners;
        *borders.get_mut(*at as usize)? = bits;
        *at += 1;
    }
    let full = patches.iter().zip(&next).all(|(p, &end)| p.first.checked_add(p.count) == Some(end));
    (mesh.triangles, mesh.borders) = (triangles, borders);
    full.then_some(())
}

//! The bytes of a chunk. FORMAT section 5.

use super::{Attributes, Chunk, Declared, PatchRange};
use crate::PackError;
use crate::bytes::{Cursor, push_varint};
use kilwa_geometry::Mesh;
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, IndexEncoding, VertexEncoding};

/// Encode a chunk that is in storage order.
pub(super) fn encode(chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    let mesh = &chunk.mesh;
    let mut workspace = Workspace::default();
    let mut out = vec![0];
    push_varint(&mut out, u32::try_from(chunk.patches.len()).unwrap_or(u32::MAX));
    for patch in &chunk.patches {
        push_varint(&mut out, patch.count);
        push_varint(&mut out, patch.diamond.wrapping_add(1));
    }
    let indices = if mesh.triangles.is_empty() {
        Vec::new()
    } else {
        codec::encode_index_buffer(mesh.triangles.as_flattened(), IndexEncoding::DEFAULT, &mut workspace)
            .map_err(refused)?
    };
    push_section(&mut out, &indices);
    // The codec may have rotated corners: the border bits follow.
    let stored = decode_indices(&indices, mesh.triangles.len(), &mut workspace)?;
    let mut borders = Vec::new();
    let mut last = 0;
    for (t, ((now, before), bits)) in (0u32..).zip(stored.iter().zip(&mesh.triangles).zip(&mesh.borders)) {
        if *bits != 0 {
            push_varint(&mut borders, t - last);
            borders.push(rotate_bits(*now, *before, *bits));
            last = t;
        }
    }
    push_section(&mut out, &borders);
    let minimum = mesh.bounds().min;
    if !mesh.positions.is_empty() {
        for x in minimum {
            out.extend(x.to_le_bytes());
        }
    }
    let stride = stride(attributes);
    let mut vertices = Vec::with_capacity(mesh.positions.len() * stride);
    for (v, p) in mesh.positions.iter().enumerate() {
        for (x, low) in p.iter().zip(minimum) {
            vertices.extend((x - low).to_le_bytes());
        }
        if let Some([r, g, b]) = mesh.colors.get(v).copied() {
            vertices.extend([g, r.wrapping_sub(g), b.wrapping_sub(g), 0]);
        }
        for x in mesh.normals.get(v).copied().unwrap_or_default() {
            vertices.extend(x.to_le_bytes());
        }
        for channel in &mesh.scalars {
            vertices.extend(channel.get(v).copied().unwrap_or_default().to_le_bytes());
        }
    }
    if !mesh.positions.is_empty() {
        let coded = codec::encode_vertex_buffer(
            &vertices,
            mesh.positions.len(),
            stride,
            VertexEncoding::DEFAULT,
            &mut workspace,
        )
        .map_err(refused)?;
        push_section(&mut out, &coded);
    }
    Ok(out)
}

/// Decode; the caller checks the result.
pub(super) fn decode(bytes: &[u8], declared: Declared, attributes: Attributes) -> Result<Chunk, PackError> {
    let mut c = Cursor::new(bytes, "chunk");
    if c.u8()? != 0 {
        return Err(c.invalid("its codec is unknown"));
    }
    let mut workspace = Workspace::default();
    let mut patches = Vec::new();
    let mut first = 0u32;
    for _ in 0..c.varint()? {
        let (count, diamond) = (c.varint()?, c.varint()?.wrapping_sub(1));
        patches.push(PatchRange { first, count, diamond });
        first = first.saturating_add(count);
    }
    let triangles = declared.triangles as usize;
    let mut mesh = Mesh { triangles: decode_indices(section(&mut c)?, triangles, &mut workspace)?, ..Mesh::default() };
    mesh.borders = vec![0; triangles];
    let mut b = Cursor::new(section(&mut c)?, "chunk borders");
    let mut at = 0u32;
    while b.remaining() > 0 {
        at = at.saturating_add(b.varint()?);
        let bits = b.u8()?;
        *mesh.borders.get_mut(at as usize).ok_or_else(|| b.invalid("a border of no triangle"))? = bits;
    }
    if declared.vertices > 0 {
        decode_vertices(&mut c, declared.vertices as usize, attributes, &mut workspace, &mut mesh)?;
    } else {
        mesh.scalars = vec![Vec::new(); usize::from(attributes.scalars)];
    }
    c.end()?;
    Ok(Chunk { mesh, patches })
}

fn decode_vertices(
    c: &mut Cursor<'_>,
    count: usize,
    attributes: Attributes,
    workspace: &mut Workspace,
    mesh: &mut Mesh,
) -> Result<(), PackError> {
    let minimum = [c.i32()?, c.i32()?, c.i32()?];
    let stride = stride(attributes);
    let coded = section(c)?;
    let bytes = codec::decode_vertex_buffer(count, stride, coded, workspace).map_err(refused)?;
    mesh.scalars = vec![Vec::with_capacity(count); usize::from(attributes.scalars)];
    for vertex in bytes.chunks_exact(stride) {
        let mut v = Cursor::new(vertex, "chunk vertices");
        let mut position = [0; 3];
        for (x, low) in position.iter_mut().zip(minimum) {
            *x = v.i32()?.wrapping_add(low);
        }
        mesh.positions.push(position);
        if attributes.colors {
            let [g, rg, bg, _] = v.array()?;
            mesh.colors.push([rg.wrapping_add(g), g, bg.wrapping_add(g)]);
        }
        mesh.normals.push([i16::from_le_bytes(v.array()?), i16::from_le_bytes(v.array()?)]);
        for channel in &mut mesh.scalars {
            channel.push(v.f32()?);
        }
    }
    Ok(())
}

fn stride(attributes: Attributes) -> usize {
    16 + 4 * usize::from(attributes.colors) + 4 * usize::from(attributes.scalars)
}

fn decode_indices(coded: &[u8], triangles: usize, workspace: &mut Workspace) -> Result<Vec<[u32; 3]>, PackError> {
    if triangles == 0 {
        return Ok(Vec::new());
    }
    // One code byte per triangle at least: what is not there is not allocated for.
    if coded.len() < triangles {
        return Err(PackError::invalid("chunk indices", format!("{} bytes for {triangles} triangles", coded.len())));
    }
    let bytes = codec::decode_index_buffer(triangles * 3, 4, coded, workspace).map_err(refused)?;
    let (words, _) = bytes.as_chunks::<4>();
    let indices: Vec<u32> = words.iter().map(|w| u32::from_le_bytes(*w)).collect();
    Ok(indices.as_chunks::<3>().0.to_vec())
}

/// Border bits of a triangle whose corners were rotated from `before` to `now`.
fn rotate_bits(now: [u32; 3], before: [u32; 3], bits: u8) -> u8 {
    let [a, b, c] = before;
    if now == before {
        bits
    } else if now == [b, c, a] {
        (bits >> 1 | bits << 2) & 7
    } else {
        (bits << 1 | bits >> 2) & 7
    }
}

fn push_section(out: &mut Vec<u8>, bytes: &[u8]) {
    push_varint(out, u32::try_from(bytes.len()).unwrap_or(u32::MAX));
    out.extend(bytes);
}

fn section<'a>(c: &mut Cursor<'a>) -> Result<&'a [u8], PackError> {
    let length = c.varint()?;
    c.take(length as usize)
}

#[expect(clippy::needless_pass_by_value, reason = "shaped for map_err")]
fn refused(e: meshoptimizer_rs::Error) -> PackError {
    PackError::invalid("chunk", e.to_string())
}

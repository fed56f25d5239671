//! The bytes of a chunk. FORMAT section 5.
//!
//! `codec | patch table | borders | indices | raw bits | residual streams`. Vertices are numbered by first use, so that
//! the triangles say what each vertex can be predicted from; positions, colours, normals and scalars are stored as
//! entropy-coded residuals of those predictions.

use super::residual::{Reader, Writer};
use super::{Attributes, Chunk, Declared, MAX_PER_BYTE, PatchRange, predict, rans};
use crate::PackError;
use crate::bytes::{Cursor, push_varint};
use kilwa_geometry::Mesh;
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, IndexEncoding};

/// Bits per octahedral coordinate that the encoder tries, fewest first; 16 always fits.
const NORMAL_BITS: [u8; 4] = [8, 10, 12, 16];
/// Number of the codec described here.
const CODEC: u8 = 0;

/// Codec and patch table, then what [`encode_body`] made, then padding.
pub(super) fn with_patches(patches: &[PatchRange], body: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + patches.len() * 8 + body.len());
    out.push(CODEC);
    push_varint(&mut out, u32::try_from(patches.len()).unwrap_or(u32::MAX));
    for patch in patches {
        push_varint(&mut out, patch.count);
        push_varint(&mut out, patch.diamond.wrapping_add(1));
    }
    out.extend_from_slice(body);
    // A decoder allocates for no more than so many triangles per byte: an absurdly regular chunk is padded.
    let triangles: u64 = patches.iter().map(|p| u64::from(p.count)).sum();
    let least = usize::try_from(triangles.div_ceil(MAX_PER_BYTE as u64)).unwrap_or(0);
    out.resize(out.len().max(least), 0);
    out
}

/// Everything of a chunk that is in storage order but the patch table and padding.
pub(super) fn encode_body(chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    let mut workspace = Workspace::default();
    let mut out = Vec::new();
    let coded = encode_indices(&chunk.mesh.triangles, &mut workspace)?;
    // The codec may rotate corners: border bits and predictions follow what a reader will see.
    let triangles = decode_indices(&coded, chunk.mesh.triangles.len(), &mut workspace)?;
    push_section(&mut out, &borders(&chunk.mesh, &triangles));
    push_indices(&coded, triangles.len(), &mut out);
    let mesh = Mesh { triangles, ..chunk.mesh.clone() };
    let mut w = Writer::default();
    encode_vertices(&mesh, attributes, &mut w);
    let streams = std::mem::take(&mut w.streams);
    push_section(&mut out, &w.into_bits());
    out.extend(streams);
    Ok(out)
}

/// Decode; the caller checks the result.
pub(super) fn decode(bytes: &[u8], declared: Declared, attributes: Attributes) -> Result<Chunk, PackError> {
    let mut c = Cursor::new(bytes, "chunk");
    let patches = read_patches(&mut c)?;
    let triangles = declared.triangles as usize;
    let border_bytes = section(&mut c)?;
    let mut workspace = Workspace::default();
    let mut mesh = Mesh { triangles: read_indices(&mut c, triangles, &mut workspace)?, ..Mesh::default() };
    if mesh.triangles.as_flattened().iter().any(|&v| v >= declared.vertices) {
        return Err(c.invalid(&format!("a triangle names a vertex outside of {}", declared.vertices)));
    }
    mesh.borders = read_borders(border_bytes, triangles)?;
    decode_vertices(&mut c, declared.vertices as usize, attributes, &mut mesh)?;
    let padding = c.take(c.remaining())?;
    if padding.iter().any(|&b| b != 0) || (!padding.is_empty() && bytes.len() > triangles.div_ceil(MAX_PER_BYTE)) {
        return Err(c.invalid("bytes are left over at its end"));
    }
    Ok(Chunk { mesh, patches })
}

/// Only the patch table at the beginning of a chunk.
pub(super) fn read_patches(c: &mut Cursor<'_>) -> Result<Vec<PatchRange>, PackError> {
    if c.u8()? != CODEC {
        return Err(c.invalid("its codec is unknown: install a newer kilwa"));
    }
    let mut patches = Vec::new();
    let mut first = 0u32;
    for _ in 0..c.varint()? {
        let (count, diamond) = (c.varint()?, c.varint()?.wrapping_sub(1));
        patches.push(PatchRange { first, count, diamond });
        first = first.saturating_add(count);
    }
    Ok(patches)
}

fn encode_indices(triangles: &[[u32; 3]], workspace: &mut Workspace) -> Result<Vec<u8>, PackError> {
    if triangles.is_empty() {
        return Ok(Vec::new());
    }
    codec::encode_index_buffer(triangles.as_flattened(), IndexEncoding::DEFAULT, workspace).map_err(refused)
}

fn decode_indices(coded: &[u8], triangles: usize, workspace: &mut Workspace) -> Result<Vec<[u32; 3]>, PackError> {
    if triangles == 0 {
        return Ok(Vec::new());
    }
    let bytes = codec::decode_index_buffer(triangles * 3, 4, coded, workspace).map_err(refused)?;
    let (words, _) = bytes.as_chunks::<4>();
    let indices: Vec<u32> = words.iter().map(|w| u32::from_le_bytes(*w)).collect();
    Ok(indices.as_chunks::<3>().0.to_vec())
}

/// The index stream has one code per triangle after its first byte, and then other data: two entropy-coded streams.
fn push_indices(coded: &[u8], triangles: usize, out: &mut Vec<u8>) {
    let (codes, data) = coded.split_at_checked(1 + triangles).unwrap_or((coded, &[]));
    push_varint(out, u32::try_from(data.len()).unwrap_or(u32::MAX));
    if triangles > 0 {
        rans::encode(codes, out);
        rans::encode(data, out);
    }
}

fn read_indices(c: &mut Cursor<'_>, triangles: usize, workspace: &mut Workspace) -> Result<Vec<[u32; 3]>, PackError> {
    let length = c.varint()? as usize;
    if triangles == 0 {
        return Ok(Vec::new());
    }
    // meshoptimizer writes at most one byte and 5 for each of three corners, and 16 bytes of table.
    if length > triangles.saturating_mul(16).saturating_add(16) {
        return Err(c.invalid("its index data is too long"));
    }
    let mut coded = rans::decode(c, 1 + triangles)?;
    coded.extend(rans::decode(c, length)?);
    decode_indices(&coded, triangles, workspace)
}

/// The triangles with border bits: distance from the triangle before, bits.
fn borders(mesh: &Mesh, stored: &[[u32; 3]]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut last = 0;
    for (t, ((now, before), bits)) in (0u32..).zip(stored.iter().zip(&mesh.triangles).zip(&mesh.borders)) {
        if *bits != 0 {
            push_varint(&mut out, (t - last) << 3 | u32::from(rotate_bits(*now, *before, *bits)));
            last = t;
        }
    }
    out
}

fn read_borders(bytes: &[u8], triangles: usize) -> Result<Vec<u8>, PackError> {
    let mut borders = vec![0; triangles];
    let mut c = Cursor::new(bytes, "chunk");
    let mut at = 0u32;
    while c.remaining() > 0 {
        let value = c.varint()?;
        at = at.saturating_add(value >> 3);
        *borders.get_mut(at as usize).ok_or_else(|| c.invalid("a border of no triangle"))? = (value & 7) as u8;
    }
    Ok(borders)
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

fn encode_vertices(mesh: &Mesh, attributes: Attributes, w: &mut Writer) {
    let count = mesh.positions.len();
    let neighbours = predict::neighbours(&mesh.triangles, count);
    let axis = |p: [i32; 3], k: usize| p.get(k).copied().unwrap_or(0);
    for k in 0..3 {
        for (p, n) in mesh.positions.iter().zip(&neighbours) {
            w.push(axis(*p, k).wrapping_sub(axis(n.position(&mesh.positions), k)));
        }
        w.finish_stream();
    }
    if attributes.colors {
        let residuals: Vec<[i32; 3]> = mesh
            .colors
            .iter()
            .zip(&neighbours)
            .map(|(color, n)| {
                let ([r, g, b], [pr, pg, pb]) = (color.map(i32::from), n.color(&mesh.colors));
                [g - pg, (r - pr) - (g - pg), (b - pb) - (g - pg)].map(wrap_byte)
            })
            .collect();
        for k in 0..3 {
            for r in &residuals {
                w.push(axis(*r, k));
            }
            w.finish_stream();
        }
    }
    encode_normals(mesh, w);
    for channel in &mesh.scalars {
        let ordered: Vec<i32> = channel.iter().map(|x| ordered_bits(*x)).collect();
        for (x, n) in ordered.iter().zip(&neighbours) {
            w.push(x.wrapping_sub(n.scalar(&ordered)));
        }
        w.finish_stream();
    }
}

fn decode_vertices(c: &mut Cursor<'_>, count: usize, attributes: Attributes, mesh: &mut Mesh) -> Result<(), PackError> {
    let mut r = Reader::new(section(c)?);
    let neighbours = predict::neighbours(&mesh.triangles, count);
    let [xs, ys, zs] = [r.stream(c, count)?, r.stream(c, count)?, r.stream(c, count)?];
    mesh.positions.reserve_exact(count);
    for (((x, y), z), n) in xs.into_iter().zip(ys).zip(zs).zip(&neighbours) {
        let [px, py, pz] = n.position(&mesh.positions);
        mesh.positions.push([px.wrapping_add(x), py.wrapping_add(y), pz.wrapping_add(z)]);
    }
    if attributes.colors {
        let [gs, rgs, bgs] = [r.stream(c, count)?, r.stream(c, count)?, r.stream(c, count)?];
        mesh.colors.reserve_exact(count);
        for (((g, rg), bg), n) in gs.into_iter().zip(rgs).zip(bgs).zip(&neighbours) {
            let [pr, pg, pb] = n.color(&mesh.colors);
            let red = pr.wrapping_add(g).wrapping_add(rg);
            let blue = pb.wrapping_add(g).wrapping_add(bg);
            mesh.colors.push([red, pg.wrapping_add(g), blue].map(|x| (x & 0xff) as u8));
        }
    }
    decode_normals(c, &mut r, mesh)?;
    for _ in 0..attributes.scalars {
        let mut known: Vec<i32> = Vec::with_capacity(count);
        for (residual, n) in r.stream(c, count)?.into_iter().zip(&neighbours) {
            known.push(n.scalar(&known).wrapping_add(residual));
        }
        mesh.scalars.push(known.into_iter().map(from_ordered_bits).collect());
    }
    r.end(c)
}

fn encode_normals(mesh: &Mesh, w: &mut Writer) {
    if mesh.normals.is_empty() {
        return;
    }
    let exact = |bits: u8| mesh.normals.as_flattened().iter().all(|&x| unquantize(quantize(x, bits), bits) == Some(x));
    let bits = NORMAL_BITS.into_iter().find(|&bits| exact(bits)).unwrap_or(16);
    w.streams.push(bits);
    let predicted = predict::normals(mesh);
    for k in 0..2 {
        for (n, p) in mesh.normals.iter().zip(&predicted) {
            let level = |n: &[i16; 2]| quantize(n.get(k).copied().unwrap_or(0), bits);
            w.push(level(n) - level(p));
        }
        w.finish_stream();
    }
}

fn decode_normals(c: &mut Cursor<'_>, r: &mut Reader<'_>, mesh: &mut Mesh) -> Result<(), PackError> {
    let count = mesh.positions.len();
    if count == 0 {
        return Ok(());
    }
    let bits = c.u8()?;
    if !(2..=16).contains(&bits) {
        return Err(c.invalid("normals have 2 to 16 bits"));
    }
    let [us, vs] = [r.stream(c, count)?, r.stream(c, count)?];
    mesh.normals.reserve_exact(count);
    for ((u, v), [pu, pv]) in us.into_iter().zip(vs).zip(predict::normals(mesh)) {
        let value = |residual: i32, p: i16| unquantize(quantize(p, bits).wrapping_add(residual), bits);
        match (value(u, pu), value(v, pv)) {
            (Some(u), Some(v)) => mesh.normals.push([u, v]),
            _ => return Err(c.invalid("a normal is out of range")),
        }
    }
    Ok(())
}

/// An octahedral coordinate as a level of `bits` bits, `-(2^(bits-1) - 1) ..= 2^(bits-1) - 1`; at 16 bits itself.
fn quantize(x: i16, bits: u8) -> i32 {
    let x = i32::from(x);
    if bits >= 16 {
        return x;
    }
    let levels = (1 << (bits - 1)) - 1;
    (2 * x.abs() * levels + 32767) / 65534 * x.signum()
}

/// The coordinate that a level stands for, or none when it is out of range.
fn unquantize(level: i32, bits: u8) -> Option<i16> {
    if bits >= 16 {
        return i16::try_from(level).ok();
    }
    let levels = (1 << (bits - 1)) - 1;
    if !(-levels..=levels).contains(&level) {
        return None;
    }
    i16::try_from((65534 * level.abs() + levels) / (2 * levels) * level.signum()).ok()
}

/// Colour residuals wrap round at 256: the shortest way.
fn wrap_byte(x: i32) -> i32 {
    (x & 0xff ^ 0x80) - 0x80
}

/// The bits of a float as an integer in the order of the numbers, so that near values have near integers. Lossless.
fn ordered_bits(x: f32) -> i32 {
    let bits = x.to_bits().cast_signed();
    if bits < 0 { !bits ^ i32::MIN } else { bits }
}

fn from_ordered_bits(x: i32) -> f32 {
    f32::from_bits(if x < 0 { !(x ^ i32::MIN) } else { x }.cast_unsigned())
}

fn push_section(out: &mut Vec<u8>, bytes: &[u8]) {
    push_varint(out, u32::try_from(bytes.len()).unwrap_or(u32::MAX));
    out.extend(bytes);
}

fn section<'a>(c: &mut Cursor<'a>) -> Result<&'a [u8], PackError> {
    let length = c.varint()?;
    c.take(length as usize)
}

fn refused(e: meshoptimizer_rs::Error) -> PackError {
    PackError::invalid("chunk", e.to_string())
}

//! Codec 2: static tables and interleaved states where codec 1 has one adaptive bit after another. FORMAT sections 5.12 to
//! 5.19. What lies beside the entropy coder is shared with codec 1: the cut-border machine, links, weights, tints, grains.

mod fit;
mod lanes;
pub(super) mod model;
mod normals;
mod ops;
mod prior;
pub(super) mod rans;
mod tables;
mod values;
mod widths;

use self::model::{Bit, Wide};
use self::normals::{Normals, SeenNormals};
use self::ops::Models;
use self::rans::{Coder, Decoder, DryRun, Encoder, PARTS, Part, Stored};
use self::values::{Fitted, SeenValues, Values};
use super::attributes::{self, Tint};
use super::border::{Connectivity, Limits, Link, Machine, Source, Unknown};
use super::order::Unused;
use super::payload::{borders_with, by_patch, limits, links};
use super::predict::Weights;
use super::{Attributes, Chunk, Declared, PatchRange};
use crate::bytes::Cursor;
use crate::{NO_DIAMOND, PackError};
use kilwa_geometry::{LatticePoint, Mesh};

/// Number of this codec.
pub(super) const CODEC: u8 = 2;

/// The body of a chunk, and how many bits each part takes.
pub(super) fn encode_body(chunk: &Chunk, attributes: Attributes) -> Result<(Vec<u8>, Encoded), PackError> {
    if chunk.mesh.triangles.is_empty() {
        return Ok((Vec::new(), Encoded(Encoder::default())));
    }
    let mut source = Unused::new(chunk);
    let limits = limits(&chunk.mesh.positions, &chunk.mesh.triangles, &chunk.patches)?;
    let (mut made, encoder) = machine(Encoder::default(), &mut source, limits)?;
    let mut mesh = source.reordered();
    let links = links(&mut made, &mesh);
    let fine: Vec<bool> = chunk.patches.iter().map(|p| p.diamond == NO_DIAMOND).collect();
    let mut parts = Parts { made: &made, mesh: &mut mesh, links: &links, fine: &fine, attributes };
    let encoder = parts.code(encoder)?;
    let counted = Encoded(encoder.clone());
    Ok((encoder.body(), counted))
}

/// What was coded, for reports.
pub(super) struct Encoded(Encoder);

impl Encoded {
    /// Bytes of each part.
    pub(super) fn bytes(&self) -> [usize; PARTS] {
        #[expect(clippy::cast_possible_truncation, reason = "less than a chunk's bytes")]
        self.0.bits().map(|bits| libm::round(bits / 8.0) as usize)
    }
}

/// Decode the body of a chunk with triangles; the caller checks the result.
pub(super) fn decode_body(
    body: &[u8],
    declared: Declared,
    attributes: Attributes,
    patches: &[PatchRange],
) -> Result<Mesh, PackError> {
    let c = Cursor::new(body, "chunk");
    let mut parts = Cursor::new(body, "chunk");
    let length = parts.varint()? as usize;
    let words = parts.take(length)?;
    let raw = parts.take(parts.remaining())?;
    let stored = Stored::new(words, raw).ok_or_else(|| c.invalid("its coded part is cut off"))?;
    let (vertices, triangles) = (declared.vertices as usize, declared.triangles as usize);
    let sizes = Limits { vertices: declared.vertices, ..limits(&[(); 0], &[(); 0], patches)? };
    let sizes = Limits { triangles: declared.triangles, ..sizes };
    let (mut made, coder) = machine(Decoder::new(&stored), &mut Unknown, sizes)?;
    if coder.is_past_end() {
        coder.end(&c)?;
    }
    let mut mesh = Mesh {
        positions: vec![LatticePoint::ZERO; vertices],
        colors: vec![[0; 3]; if attributes.colors { vertices } else { 0 }],
        normals: vec![[0; 2]; vertices],
        borders: vec![0; triangles],
        ..Mesh::default()
    };
    let links = links(&mut made, &mesh);
    let coarse = vec![false; patches.len()];
    let coder = Parts { made: &made, mesh: &mut mesh, links: &links, fine: &coarse, attributes }.code(coder)?;
    by_patch(&mut mesh, &made.triangles, patches).ok_or_else(|| c.invalid("its patches have other triangles"))?;
    coder.end(&c)?;
    Ok(mesh)
}

#[inline(never)]
fn machine<C: Coder, S: Source>(coder: C, source: &mut S, limits: Limits) -> Result<(Connectivity, C), PackError> {
    let impossible = |_| PackError::invalid("chunk", "its triangles are coded in a way that none can be");
    let (made, models) = Machine::new(Models::new(coder), source, limits).run().map_err(impossible)?;
    Ok((made, models.coder))
}

/// The parts that are coded after the connectivity; triangles are in the order of the machine.
struct Parts<'a> {
    made: &'a Connectivity,
    mesh: &'a mut Mesh,
    links: &'a [Link],
    fine: &'a [bool],
    attributes: Attributes,
}

impl Parts<'_> {
    fn code<C: Coder>(&mut self, mut coder: C) -> Result<C, PackError> {
        coder.part(Part::Borders);
        let mut models = [Bit::unknown(2); 9];
        let everywhere = |coder: &mut C, yes| coder.raw32(1, u32::from(yes)) == 1;
        let bit =
            |coder: &mut C, context: usize, yes| models.get_mut(context).is_some_and(|model| model.is(coder, 0, yes));
        borders_with(&mut coder, C::ENCODES, (everywhere, bit), self.made, self.mesh);
        coder.part(Part::Positions);
        let (mut coder, grains) = self.values(coder);
        coder.part(Part::Normals);
        // What follows a part that ran out of bytes is meaningless: nothing is allocated for it.
        coder.check()?;
        self.normals(&mut coder, &grains)?;
        coder.part(Part::Scalars);
        coder.check()?;
        self.scalars(&mut coder)?;
        Ok(coder)
    }

    fn values<C: Coder>(&mut self, mut coder: C) -> (C, Vec<u8>) {
        let Mesh { positions, colors, .. } = &mut *self.mesh;
        let positions: &mut [[i32; 3]] = bytemuck::cast_slice_mut(positions);
        let has_colors = self.attributes.colors;
        let (mut fitted, mut grains, mut color_grains) = (Fitted::default(), None, None);
        let mut seen = SeenValues::default();
        if C::ENCODES {
            fitted.positions = Weights::best(positions, self.links);
            grains = attributes::grains(positions.iter().copied());
            if has_colors {
                fitted.colors = Weights::best(colors, self.links);
                fitted.tint = Tint::best(self.links, colors, fitted.colors);
                color_grains = attributes::grains(colors.iter().map(|c| c.map(i32::from)));
            }
            let wanted = [grains.as_deref(), color_grains.as_deref()];
            let any = wanted.map(|w| w.is_some());
            Values { links: self.links, positions, colors, wanted, any, fitted }.code(DryRun, &mut seen);
            seen.fit(&mut fitted);
        }
        let mut flag = |any: bool| coder.raw32(1, u32::from(any)) == 1;
        let any = [flag(grains.is_some()), has_colors && flag(color_grains.is_some())];
        let fitted = fitted.code(&mut coder, has_colors, any[1]);
        let wanted = [grains.as_deref(), color_grains.as_deref()];
        let mut values = Values { links: self.links, positions, colors, wanted, any, fitted };
        values.code(coder, &mut seen)
    }

    fn normals<C: Coder>(&mut self, coder: &mut C, grains: &[u8]) -> Result<(), PackError> {
        let bad = |why| PackError::invalid("chunk", why);
        let coarse: Vec<bool> = self.fine.iter().map(|&fine| coder.raw32(1, u32::from(!fine)) == 1).collect();
        let bits = if C::ENCODES { attributes::normal_bits(&self.mesh.normals) } else { 2 };
        let bits = u8::try_from(coder.raw32(4, u32::from(bits) - 1) + 1).unwrap_or(0);
        if bits < 2 {
            return Err(bad("normals have 2 to 16 bits"));
        }
        let wanted = if C::ENCODES { attributes::grains(attributes::levels(&self.mesh.normals, bits)) } else { None };
        let predicted = normals::predicted(self.mesh, self.made, &coarse);
        let mut normals = Normals {
            bits,
            predicted: &predicted,
            grains,
            wanted: wanted.as_deref(),
            fitted: normals::Fitted::default(),
        };
        let out_of_range = |_| bad("a normal is out of range");
        let mut seen = SeenNormals::default();
        if C::ENCODES {
            normals.fitted = SeenNormals::all();
            normals.code(&mut DryRun, &mut self.mesh.normals.clone(), &mut seen).map_err(out_of_range)?;
            normals.fitted = seen.fit();
        }
        normals.fitted = normals.fitted.code(coder);
        normals.code(coder, &mut self.mesh.normals, &mut seen).map_err(out_of_range)
    }

    fn scalars<C: Coder>(&mut self, coder: &mut C) -> Result<(), PackError> {
        self.mesh.scalars.resize(self.attributes.scalars.into(), Vec::new());
        for channel in &mut self.mesh.scalars {
            coder.check()?;
            channel.resize(self.links.len(), 0.0);
            let mut ordered: Vec<i32> = channel.iter().map(|x| attributes::ordered_bits(*x)).collect();
            let mut model = Wide::new();
            attributes::scalars_with(&mut |x| model.code(coder, 0, x), self.links, &mut ordered);
            *channel = ordered.into_iter().map(attributes::from_ordered_bits).collect();
        }
        Ok(())
    }
}

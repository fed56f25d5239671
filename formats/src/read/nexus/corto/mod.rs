//! Decodes one node of a mesh compressed with Corto (F. Ponchio, M. Dellepiane: "Multiresolution and fast decompression for
//! optimal web-based rendering", Graphical Models 88, 2016; github.com/cnr-isti-vclab/corto): version 1, triangles.
//!
//! A stream has a header that lists its attributes, groups of triangles, the connectivity (`topology`), and each attribute as
//! integer differences (`values`, `normals`): entropy-coded bit lengths (`tunstall`) and a bit stream (`bits`). The attributes
//! `position`, `color`, `normal` and `uv` are kept; others are skipped without being decoded.
//!
//! Errors: [`Fault`] with the offset in the file. Memory is bounded by the counts that the caller expects.

mod bits;
mod normals;
mod topology;
mod tunstall;
mod values;

use super::bytes::{Cursor, Fault};
use super::node::NodeMesh;
use glam::{DVec2, DVec3};
use normals::{Stored, Surface};
use topology::Topology;
use tunstall::Entropy;
use values::Coding;

const MAGIC: u32 = 0x787a_6300;
const VERSION: u32 = 1;
const NORMAL_CODEC: u32 = 2;
const COLOR_CODEC: u32 = 3;

/// An attribute as declared in the header.
struct Attribute {
    name: Vec<u8>,
    codec: u32,
    /// Quantisation step.
    step: f32,
    coding: Coding,
}

/// The attributes that are kept, as stored.
#[derive(Default)]
struct Kept {
    positions: Option<(Vec<i32>, f64, Coding)>,
    coordinates: Option<(Vec<i32>, f64, Coding)>,
    colors: Option<(Vec<i32>, [i32; 4], Coding)>,
    normals: Option<Stored>,
}

/// Decode the stream at the beginning of `from`, which must have the given numbers of vertices and triangles.
pub(super) fn decode(from: &mut Cursor<'_>, vertices: u32, triangles: u32) -> Result<NodeMesh, Fault> {
    let attributes = header(from, vertices, triangles)?;
    let ends = groups(from, triangles)?;
    let entropy = attributes.1;
    let topology = Topology::decode(from, entropy, vertices, &ends)?;
    let mut kept = Kept::default();
    for attribute in &attributes.0 {
        kept.read(from, attribute, vertices as usize)?;
    }
    kept.piece(from, topology)
}

fn damaged(found: impl Into<String>, expected: &str, at: u64) -> Fault {
    Fault { at, found: found.into(), expected: format!("{expected}; the file is damaged: copy it again") }
}

/// A string: its length, then its bytes, which end with a zero.
fn text(from: &mut Cursor<'_>) -> Result<Vec<u8>, Fault> {
    let length = from.u16("the length of a string")?;
    let text = from.take(usize::from(length), "a string")?;
    Ok(text.strip_suffix(&[0]).unwrap_or(text).to_vec())
}

fn header(from: &mut Cursor<'_>, vertices: u32, triangles: u32) -> Result<(Vec<Attribute>, Entropy), Fault> {
    let at = from.offset();
    let magic = from.u32("the beginning of a Corto stream")?;
    if magic != MAGIC {
        return Err(damaged(format!("{magic:#010x}"), "the beginning of a Corto stream", at));
    }
    let version = from.u32("the version of Corto")?;
    if version != VERSION {
        return Err(Fault { at, found: format!("Corto version {version}"), expected: format!("version {VERSION}") });
    }
    let entropy = match from.u8("the entropy code")? {
        0 => Entropy::Plain,
        1 => Entropy::Tunstall,
        other => {
            let expected = "0 (none) or 1 (Tunstall)".to_owned();
            return Err(Fault { at, found: format!("entropy code {other}"), expected });
        }
    };
    for _ in 0..2 * u64::from(from.u32("the number of properties")?) {
        text(from)?;
    }
    let mut attributes = Vec::new();
    for _ in 0..from.u32("the number of attributes")? {
        let name = text(from)?;
        let codec = from.u32("the codec of an attribute")?;
        let step = from.f32("the step of an attribute")?;
        let components = usize::from(from.u8("the components of an attribute")?);
        from.u8("the type of an attribute")?;
        let strategy = from.u8("the strategy of an attribute")?;
        attributes.push(Attribute { name, codec, step, coding: Coding { entropy, strategy, components } });
    }
    let at = from.offset();
    let there = [from.u32("the number of vertices")?, from.u32("the number of triangles")?];
    if there != [vertices, triangles] {
        let found = format!("{} vertices and {} triangles", there[0], there[1]);
        return Err(damaged(found, &format!("{vertices} and {triangles}, as in the index of the file"), at));
    }
    Ok((attributes, entropy))
}

/// The end of each group of triangles.
fn groups(from: &mut Cursor<'_>, triangles: u32) -> Result<Vec<u32>, Fault> {
    let mut ends = Vec::new();
    for _ in 0..from.u32("the number of groups")? {
        let at = from.offset();
        let end = from.u32("the end of a group")?;
        if end < ends.last().copied().unwrap_or(0) || end > triangles {
            return Err(damaged(format!("a group that ends at {end}"), "one in ascending order", at));
        }
        ends.push(end);
        for _ in 0..2 * u16::from(from.u8("the number of properties")?) {
            text(from)?;
        }
    }
    if ends.last() != Some(&triangles) {
        let found = format!("groups that end at {}", ends.last().copied().unwrap_or(0));
        return Err(damaged(found, &format!("all {triangles} triangles in groups"), from.offset()));
    }
    Ok(ends)
}

impl Kept {
    fn read(&mut self, from: &mut Cursor<'_>, attribute: &Attribute, count: usize) -> Result<(), Fault> {
        let Attribute { name, codec, step, coding } = attribute;
        let at = from.offset();
        let has = |expected: &[usize]| {
            if expected.contains(&coding.components) && step.is_finite() {
                return Ok(());
            }
            let found =
                format!("{} components in steps of {step} for {}", coding.components, String::from_utf8_lossy(name));
            Err(damaged(found, &format!("one of {expected:?} components in finite steps"), at))
        };
        let step = f64::from(*step);
        match (name.as_slice(), *codec) {
            (b"normal", NORMAL_CODEC) => {
                has(&[3])?;
                self.normals = Some(Stored::read(from, *coding, attribute.step, count)?);
            }
            (b"color", COLOR_CODEC) => {
                has(&[3, 4])?;
                let mut steps = [1; 4];
                for step in &mut steps[..coding.components] {
                    *step = i32::from(from.u8("the step of a colour")?);
                }
                self.colors = Some((coding.read(from, count)?, steps, *coding));
            }
            (_, NORMAL_CODEC) => {
                from.u8("the prediction of normals")?;
                // Always one list of bit lengths.
                Coding { components: 1, ..*coding }.skip(from)?;
            }
            (_, COLOR_CODEC) => {
                from.take(coding.components, "the steps of a colour")?;
                coding.skip(from)?;
            }
            (b"position", _) => {
                has(&[3])?;
                self.positions = Some((coding.read(from, count)?, step, *coding));
            }
            (b"uv", _) => {
                has(&[2])?;
                self.coordinates = Some((coding.read(from, count)?, step, *coding));
            }
            _ => coding.skip(from)?,
        }
        Ok(())
    }

    fn piece(self, from: &Cursor<'_>, topology: Topology) -> Result<NodeMesh, Fault> {
        let Some((mut positions, step, coding)) = self.positions else {
            return Err(damaged("no positions", "an attribute \"position\"", from.offset()));
        };
        let Topology { faces, predictions } = topology;
        coding.undo_prediction(&mut positions, &predictions);
        let normals = match self.normals {
            Some(stored) => {
                stored.normals(&Surface { positions: &positions, faces: &faces, predictions: &predictions })?
            }
            None => Vec::new(),
        };
        let colors = self.colors.map_or_else(Vec::new, |(mut values, steps, coding)| {
            coding.undo_prediction(&mut values, &predictions);
            values.chunks_exact(coding.components).map(|v| color([v[0], v[1], v[2]], steps)).collect()
        });
        let coordinates = self.coordinates.map_or_else(Vec::new, |(mut values, step, coding)| {
            coding.undo_prediction(&mut values, &predictions);
            values.chunks_exact(2).map(|v| DVec2::new(f64::from(v[0]), f64::from(v[1])) * step).collect()
        });
        let point = |v: &[i32]| DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])) * step;
        let positions = positions.chunks_exact(3).map(point).collect();
        Ok(NodeMesh { positions, normals, colors, coordinates, triangles: faces })
    }
}

/// Red, green and blue from green and the differences of the others from it, in wrapping byte arithmetic.
fn color([green, blue, red]: [i32; 3], steps: [i32; 4]) -> [u8; 3] {
    let byte = |value: i32, step: i32| value.wrapping_mul(step) as u8;
    [byte(red.wrapping_add(green), steps[0]), byte(green, steps[1]), byte(blue.wrapping_add(green), steps[2])]
}

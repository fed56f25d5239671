//! The reader of PLY, the Stanford polygon format (Greg Turk, "The PLY Polygon File Format", 1994): text and binary of
//! both byte orders, any scalar types, any order of elements and properties, polygons and triangle strips.
//!
//! Stages: `header` (what the file says it holds) → `plan` (which properties are kept, and as what) → `elements`
//! (rows, through `ascii` or `binary`) → `vertices` and `faces` (what is kept) → `finish` (wedges, repairs).
//!
//! What is kept: positions; colours as 8-bit sRGB (`red green blue`, `diffuse_red …`, `r g b`); normals; `alpha` where
//! it is not opaque throughout (0 to 1); `confidence`, `quality`, `intensity`, `value` and `scalar_*` under their
//! names. Numbers in text are read as doubles whatever type the header gives them, so that nothing written is lost (some
//! programs declare `float` and write real-world coordinates in full). All else is dropped and listed in the findings. Vertices and faces are counted from 0, as PLY indices are.
//!
//! Repaired and counted: polygons are triangulated with all their surface; faces of fewer than three corners and
//! triangles that name a vertex twice are dropped; vertices without a finite position are dropped with their triangles;
//! colours of faces go to the vertices, which are split where faces of different colours meet.
//! Refused with line or byte: a damaged or cut file, an index that names no vertex, a count that the file cannot hold.

mod ascii;
mod binary;
mod colors;
mod elements;
mod faces;
mod finish;
mod header;
mod plan;
mod scalar;
mod source;
mod triangulate;
mod vertices;

#[cfg(test)]
mod fuzz_tests;
#[cfg(test)]
mod tests;

use super::{Input, MeshSink, OnProgress, Place, ReadError, VertexBlock};
use crate::raw::{Findings, RawMesh};
use ascii::Ascii;
use binary::Binary;
use elements::Rows;
use faces::Faces;
use header::{Encoding, Header};
use plan::{ElementPlan, Plan};
use source::Source;
use std::io::Read;
use std::path::Path;
use vertices::Vertices;

/// Whether a file that starts with these bytes is a PLY.
pub fn is_ply(start: &[u8]) -> bool {
    start.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
}

/// Deliver the PLY.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, cut, without triangles or larger than its limits.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let Input { path, total, mut source, progress } = input;
    let mesh = read_mesh(&mut source, total, path, progress)?;
    sink.findings().merge(mesh.findings);
    let (names, scalars): (Vec<String>, Vec<Vec<f32>>) = mesh.scalars.into_iter().unzip();
    sink.channels(&names)?;
    let (positions, colors, normals) = (&mesh.positions, &mesh.colors, &mesh.normals);
    sink.vertices(&VertexBlock { positions, colors, normals, scalars: &scalars })?;
    let triangles: Vec<[u64; 3]> = mesh.triangles.iter().map(|t| t.map(u64::from)).collect();
    sink.triangles(&triangles, &[])
}

fn read_mesh(
    source: &mut dyn Read,
    total: u64,
    path: &Path,
    progress: &mut OnProgress<'_>,
) -> Result<RawMesh, ReadError> {
    let mut source = Source::new(source, total, path, progress);
    let header = Header::read(&mut source)?;
    let plan = Plan::new(&header, path)?;
    header.check_fits(&source)?;

    let mut findings = Findings::default();
    plan.report(&header, &mut findings);
    let mut vertices = Vertices::new(&plan, path)?;
    let mut faces = Faces::new(&plan, path, source.remaining())?;
    match header.encoding {
        Encoding::Ascii => {
            let mut rows = Ascii::new(&mut source, header.lines);
            read_elements(&header, &plan, &mut rows, &mut vertices, &mut faces, &mut findings)?;
        }
        Encoding::Binary(order) => {
            let mut rows = Binary::new(&mut source, order);
            read_elements(&header, &plan, &mut rows, &mut vertices, &mut faces, &mut findings)?;
        }
    }
    source.done();
    finish::finish(&plan, vertices, faces, findings, path)
}

fn read_elements(
    header: &Header,
    plan: &Plan,
    rows: &mut impl Rows,
    vertices: &mut Vertices,
    faces: &mut Faces,
    findings: &mut Findings,
) -> Result<(), ReadError> {
    for (element, what) in header.elements.iter().zip(&plan.elements) {
        match what {
            ElementPlan::Vertices(fields) => {
                elements::vertices(rows, element, fields, plan.columns.len(), vertices, findings)?;
                faces.vertices_are_read(vertices.positions(), findings);
            }
            ElementPlan::Faces(fields) => {
                elements::faces(rows, element, fields, faces, vertices.positions(), findings)?;
            }
            ElementPlan::Strips(fields) => elements::strips(rows, element, fields, faces, findings)?,
            ElementPlan::Skip(fields) => elements::skip(rows, element, fields, findings)?,
        }
    }
    rows.finish(findings)
}

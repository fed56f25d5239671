//! The reader of PLY, the Stanford polygon format (Greg Turk, "The PLY Polygon File Format", 1994): text and binary of
//! both byte orders, any scalar types, any order of elements and properties, polygons and triangle strips.
//!
//! Stages: `header` (what the file says it holds) → `plan` (which properties are kept, and as what) → `elements`
//! (rows, through `ascii` or `binary`) → `vertices` and [`super::faces`] (handed on to the sink).
//!
//! Nothing is held that grows with the mesh. Files that need it are read twice in part: where faces stand before the
//! vertices these are passed over and come after them; if the range of colours or of `alpha` is known only from the
//! largest value, the vertices (or faces) are looked through first.
//!
//! What is kept: positions; colours as 8-bit sRGB (`red green blue`, `diffuse_red …`, `r g b`); normals; `alpha` where
//! it is not opaque throughout (0 to 1); `confidence`, `quality`, `intensity`, `value`, Kilwa's own channels (`stations`, `registration`, `filled`, `source`, `photos`) and `scalar_*` under their
//! names. Numbers in text are read as doubles whatever type the header gives them, so that nothing written is lost (some
//! programs declare `float` and write real-world coordinates in full). All else is dropped and listed in the diagnostics. Vertices and faces are counted from 0, as PLY indices are.
//!
//! Repaired and counted: polygons are triangulated with all their surface; faces of fewer than three corners and
//! triangles that name a vertex twice are dropped. Colours of faces are handed on as colours of their triangles.
//! Refused with line or byte: a damaged or cut file, an index that names no vertex, a count that the file cannot hold.

mod ascii;
mod binary;
mod colors;
mod elements;
mod header;
mod plan;
pub mod points;
mod scalar;
mod vertices;

#[cfg(test)]
mod fuzz_tests;
#[cfg(test)]
mod tests;

use super::faces::Faces;
use super::source::Source;
use super::{Input, MeshSink, Place, ReadError, VertexSink};
use crate::Diagnostics;
use ascii::Ascii;
use binary::Binary;
use colors::{Scale, needs_scan};
use elements::{Cursor, Rows, Target};
use header::{Element, Encoding, Header};
use plan::{ElementPlan, Field, Keep, Plan};

use vertices::{Scan, Vertices, largest};

/// Whether a file that starts with these bytes is a PLY.
pub fn is_ply(start: &[u8]) -> bool {
    start.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_none_or(u8::is_ascii_whitespace))
}

/// Deliver the PLY.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, cut, without triangles or larger than its limits.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let Input { path, total, source, progress, .. } = input;
    let mut source = Source::new(source, total, path, progress);
    let header = Header::read(&mut source)?;
    let plan = Plan::new(&header, path)?;
    header.check_fits(&source)?;
    let mut diagnostics = Diagnostics::default();
    plan.report(&header, &mut diagnostics);
    let delivered = match header.encoding {
        Encoding::Ascii => {
            let mut rows = Ascii::new(&mut source, header.lines);
            read_elements(&header, &plan, &mut rows, sink, &mut diagnostics)?
        }
        Encoding::Binary(order) => {
            let mut rows = Binary::new(&mut source, order);
            read_elements(&header, &plan, &mut rows, sink, &mut diagnostics)?
        }
    };
    source.done();
    if delivered == 0 {
        return Err(ReadError::no_face_left(path, plan.faces, &diagnostics));
    }
    sink.diagnostics().merge(diagnostics);
    Ok(())
}

/// Read all elements, the vertices before those that name them; the number of triangles.
fn read_elements(
    header: &Header,
    plan: &Plan,
    rows: &mut impl Rows,
    sink: &mut dyn MeshSink,
    diagnostics: &mut Diagnostics,
) -> Result<u64, ReadError> {
    let all = || header.elements.iter().zip(&plan.elements);
    let mut to = Target { faces: Faces::new("face"), sink, vertices: plan.vertices, scale: None };
    let mut early: Vec<(usize, Cursor)> = Vec::new();
    let mut vertices_are_read = false;
    for (number, (element, what)) in all().enumerate() {
        match what {
            ElementPlan::Vertices(fields) => {
                read_vertices(rows, element, fields, plan, to.sink, diagnostics)?;
                vertices_are_read = true;
                let here = rows.place();
                for (number, place) in std::mem::take(&mut early) {
                    rows.go_to(place)?;
                    if let Some((element, what)) = all().nth(number) {
                        read_faces(rows, element, what, plan, &mut to, diagnostics)?;
                    }
                }
                rows.go_to(here)?;
            }
            ElementPlan::Skip(fields) => elements::skip(rows, element, fields, diagnostics)?,
            ElementPlan::Faces(fields) | ElementPlan::Strips(fields) if !vertices_are_read => {
                early.push((number, rows.place()));
                let passed: Vec<Field> = fields.iter().map(|f| Field { keep: Keep::Nothing, ..f.clone() }).collect();
                elements::skip(rows, element, &passed, &mut Diagnostics::default())?;
            }
            ElementPlan::Faces(_) | ElementPlan::Strips(_) => {
                read_faces(rows, element, what, plan, &mut to, diagnostics)?;
            }
        }
    }
    rows.finish(diagnostics)?;
    Ok(to.faces.delivered())
}

fn read_vertices(
    rows: &mut impl Rows,
    element: &Element,
    fields: &[Field],
    plan: &Plan,
    sink: &mut dyn VertexSink,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    let width = plan.columns.len();
    let mut scan = Scan::default();
    if Scan::is_needed(plan) {
        let start = rows.place();
        let looked_at = Scan::fields(fields, &plan.columns);
        elements::columns(rows, element, &looked_at, width, &mut Diagnostics::default(), &mut |values, _| {
            scan.absorb(values, &plan.columns);
            Ok(!scan.is_settled(&plan.columns))
        })?;
        rows.go_to(start)?;
    }
    let mut vertices = Vertices::new(plan, scan, sink, diagnostics)?;
    elements::columns(rows, element, fields, width, diagnostics, &mut |values, diagnostics| {
        vertices.absorb(values, sink, diagnostics).map(|()| true)
    })
}

fn read_faces(
    rows: &mut impl Rows,
    element: &Element,
    what: &ElementPlan,
    plan: &Plan,
    to: &mut Target<'_>,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    match what {
        ElementPlan::Faces(fields) => {
            to.scale = match plan.face_colors {
                Some(kind) => {
                    let mut max = 0.0;
                    if needs_scan(kind) {
                        let start = rows.place();
                        elements::columns(rows, element, fields, 3, &mut Diagnostics::default(), &mut |values, _| {
                            max = largest(max, values.iter().flatten().map(|&v| v as f32));
                            Ok(true)
                        })?;
                        rows.go_to(start)?;
                    }
                    Some(Scale::new(kind, max, diagnostics))
                }
                None => None,
            };
            elements::faces(rows, element, fields, to, diagnostics)
        }
        ElementPlan::Strips(fields) => {
            to.scale = None;
            elements::strips(rows, element, fields, to, diagnostics)
        }
        ElementPlan::Vertices(_) | ElementPlan::Skip(_) => Ok(()),
    }
}

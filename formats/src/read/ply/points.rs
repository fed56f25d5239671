//! PLY files of points: clouds, and range grids as scanners write them (`element range_grid` with a list of no or one vertex a cell, row by row, and
//! `obj_info num_cols`, `obj_info num_rows`; Stanford 3D Scanning Repository).

use super::ascii::Ascii;
use super::binary::Binary;
use super::elements::{self, Row, Rows};
use super::header::{Encoding, Header};
use super::plan::{ElementPlan, Field, Plan};
use super::{Place, ReadError, is_ply, read_vertices};
use crate::Diagnostics;
use crate::read::sink::VertexSink;
use crate::read::source::Source;
use crate::read::{OnProgress, open};
use kilwa_pack::plural::counted;
use std::path::Path;

/// Receives points: vertices, and the cells of a range grid.
pub trait PointSink: VertexSink {
    /// Called first: whether the file has a range grid.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn expect(&mut self, has_grid: bool) -> Result<(), ReadError>;

    /// The file has a range grid, whose cells come after the vertices. Not called for clouds.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn grid(&mut self, columns: u32, rows: u32) -> Result<(), ReadError>;

    /// The vertex of the next cell, row by row; `None` for an empty one.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn cell(&mut self, vertex: Option<u64>) -> Result<(), ReadError>;
}

/// Deliver the points of the PLY at `path`.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, cut, a mesh, or without points.
pub fn read_points(path: &Path, sink: &mut dyn PointSink, progress: &mut OnProgress<'_>) -> Result<(), ReadError> {
    let (mut file, total) = open(path)?;
    let mut on_progress = |done, all| progress(done, all);
    let mut source = Source::new(&mut file, total, path, &mut on_progress);
    let (header, plan, size) = begin(&mut source, path)?;
    let mut diagnostics = Diagnostics::default();
    plan.report(&header, &mut diagnostics);
    sink.expect(size.is_some())?;
    match header.encoding {
        Encoding::Ascii => {
            let mut rows = Ascii::new(&mut source, header.lines);
            deliver(&header, &plan, size, &mut rows, sink, &mut diagnostics)?;
        }
        Encoding::Binary(order) => {
            let mut rows = Binary::new(&mut source, order);
            deliver(&header, &plan, size, &mut rows, sink, &mut diagnostics)?;
        }
    }
    source.done();
    sink.diagnostics().merge(diagnostics);
    Ok(())
}

/// Whether a file of points has a range grid, from its header alone.
///
/// # Errors
/// Those of [`read_points`] that the header shows.
pub fn has_grid(path: &Path) -> Result<bool, ReadError> {
    let (mut file, total) = open(path)?;
    let mut on_progress = |_, _| {};
    let mut source = Source::new(&mut file, total, path, &mut on_progress);
    Ok(begin(&mut source, path)?.2.is_some())
}

/// The header, what is read of each element, and the size of the grid.
fn begin(source: &mut Source<'_>, path: &Path) -> Result<(Header, Plan, Option<[u32; 2]>), ReadError> {
    if !(source.ensure(4)? && is_ply(source.available())) {
        return Err(source.malformed(Place::Line(1), "something else", "ply"));
    }
    let header = Header::read(source)?;
    let plan = Plan::of_points(&header, path)?;
    header.check_fits(source)?;
    let size = size(&header, source)?;
    Ok((header, plan, size))
}

/// Columns and rows of the grid, where there is one.
fn size(header: &Header, source: &Source<'_>) -> Result<Option<[u32; 2]>, ReadError> {
    let Some(element) = header.elements.iter().find(|e| e.name == GRID) else { return Ok(None) };
    let sides = header.grid_size.map(|side| side.and_then(|n| u32::try_from(n).ok()).filter(|n| *n > 0));
    match sides {
        [Some(columns), Some(rows)] if u64::from(columns) * u64::from(rows) == element.count => {
            Ok(Some([columns, rows]))
        }
        _ => {
            let shown = header.grid_size.map(|side| side.map_or_else(|| "nothing".to_owned(), |n| n.to_string()));
            Err(source.malformed(
                Place::Line(element.line),
                format!(
                    "a range grid of {} with num_cols {} and num_rows {}",
                    counted(element.count, "cell", "cells"),
                    shown[0],
                    shown[1]
                ),
                "\"obj_info num_cols\" and \"obj_info num_rows\" whose product is the number of cells",
            ))
        }
    }
}

/// The element of a range grid.
pub(super) const GRID: &str = "range_grid";

fn deliver(
    header: &Header,
    plan: &Plan,
    size: Option<[u32; 2]>,
    rows: &mut impl Rows,
    sink: &mut dyn PointSink,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    for (element, what) in header.elements.iter().zip(&plan.elements) {
        match (what, size) {
            (ElementPlan::Vertices(fields), _) => {
                read_vertices(rows, element, fields, plan, sink, diagnostics)?;
            }
            (ElementPlan::Faces(fields), Some([columns, lines])) => {
                sink.grid(columns, lines)?;
                cells(rows, element, fields, plan.vertices, sink, diagnostics)?;
            }
            (ElementPlan::Faces(fields) | ElementPlan::Strips(fields) | ElementPlan::Skip(fields), _) => {
                elements::skip(rows, element, fields, diagnostics)?;
            }
        }
    }
    rows.finish(diagnostics)
}

fn cells(
    rows: &mut impl Rows,
    element: &super::header::Element,
    fields: &[Field],
    vertices: u64,
    sink: &mut dyn PointSink,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    let mut corners = Vec::new();
    for number in 0..element.count {
        let row = Row { element, number };
        rows.begin(row, diagnostics)?;
        elements::face(rows, row, fields, vertices, &mut corners)?;
        rows.end(row, diagnostics)?;
        match corners[..] {
            [] => sink.cell(None)?,
            [vertex] => sink.cell(Some(vertex))?,
            _ => {
                let found = format!("a cell of {} vertices", corners.len());
                let fallback = &fields[0];
                return Err(rows.fault(
                    row,
                    fields.iter().find(|f| f.keep == super::Keep::Indices).unwrap_or(fallback),
                    found,
                    "none or one".to_owned(),
                ));
            }
        }
    }
    Ok(())
}

//! Walks the rows of an element and hands on what the plan keeps; text and binary differ only in their [`Rows`].
//!
//! Vertices travel in blocks of columns, so that nothing is allocated per row; corners of a face go to one reused list.

use super::ReadError;
use super::colors::Scale;
use super::header::{Element, Kind};
use super::plan::{Field, Keep};
use super::scalar::Scalar;
use crate::Diagnostics;
use crate::read::faces::{Faces, MAX_CORNERS};
use crate::read::sink::MeshSink;
use glam::DVec3;
use kilwa_pack::plural::counted;

/// Vertices handed on at a time.
pub(super) const BLOCK: usize = 4096;

/// Kept scalars of a few rows, one list per column.
pub(super) type Columns = Vec<Vec<f64>>;

/// Where a row stands, for messages.
#[derive(Clone, Copy)]
pub(super) struct Row<'h> {
    pub(super) element: &'h Element,
    pub(super) number: u64,
}

/// A place between two elements: offset in bytes, and line where the file is text.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cursor {
    pub(super) offset: u64,
    pub(super) line: u64,
}

/// A cursor over the rows of a file. Every error names the place.
pub(super) trait Rows {
    /// Where the cursor is, between two elements.
    fn place(&self) -> Cursor;
    /// Go back, or on, to such a place.
    fn go_to(&mut self, cursor: Cursor) -> Result<(), ReadError>;
    /// Go to the beginning of a row.
    fn begin(&mut self, row: Row<'_>, diagnostics: &mut Diagnostics) -> Result<(), ReadError>;
    /// The next value of the row as a number.
    fn number(&mut self, row: Row<'_>, field: &Field, kind: Scalar) -> Result<f64, ReadError>;
    /// The next value of the row as an integer.
    fn integer(&mut self, row: Row<'_>, field: &Field, kind: Scalar) -> Result<i64, ReadError>;
    /// Pass over the next `n` values of the row.
    fn pass(&mut self, row: Row<'_>, field: &Field, kind: Scalar, n: u64) -> Result<(), ReadError>;
    /// Leave the row.
    fn end(&mut self, row: Row<'_>, diagnostics: &mut Diagnostics) -> Result<(), ReadError>;
    /// Whether `n` more values of this type can be in the file at all.
    fn can_hold(&self, kind: Scalar, n: u64) -> bool;
    /// An error about the value just read.
    fn fault(&self, row: Row<'_>, field: &Field, found: String, expected: String) -> ReadError;
    /// Append up to [`BLOCK`] rows (at most `left`) to the columns in one go and say how many; 0 where the rows must be
    /// read one by one.
    fn block(&mut self, row: Row<'_>, fields: &[Field], left: u64, columns: &mut Columns) -> Result<usize, ReadError>;
    /// Append triangles to `out` as long as rows (at most `left`, at most `room`) are triangles of vertices below
    /// `vertices`, in one go, and say how many; 0 where the next row must be read by itself.
    fn triangles(
        &mut self,
        fields: &[Field],
        left: u64,
        room: usize,
        vertices: u64,
        out: &mut Vec<[u64; 3]>,
    ) -> Result<usize, ReadError>;
    /// Pass over all rows of an element in one go; `false` where they must be passed one by one.
    fn pass_all(&mut self, row: Row<'_>, fields: &[Field]) -> Result<bool, ReadError>;
    /// After the last element: report what follows it.
    fn finish(&mut self, diagnostics: &mut Diagnostics) -> Result<(), ReadError>;
}

/// Read the kept scalars of all rows of an element, a block at a time; `visit` says whether to continue.
pub(super) fn columns(
    rows: &mut impl Rows,
    element: &Element,
    fields: &[Field],
    width: usize,
    diagnostics: &mut Diagnostics,
    visit: &mut dyn FnMut(&Columns, &mut Diagnostics) -> Result<bool, ReadError>,
) -> Result<(), ReadError> {
    let mut columns: Columns = vec![Vec::with_capacity(BLOCK); width];
    let mut number = 0;
    while number < element.count {
        let row = Row { element, number };
        let left = element.count - number;
        let mut got = rows.block(row, fields, left, &mut columns)?;
        if got == 0 {
            while got < BLOCK && (got as u64) < left {
                let row = Row { element, number: number + got as u64 };
                rows.begin(row, diagnostics)?;
                scalars(rows, row, fields, &mut columns)?;
                rows.end(row, diagnostics)?;
                got += 1;
            }
        }
        if !visit(&columns, diagnostics)? {
            return Ok(());
        }
        columns.iter_mut().for_each(Vec::clear);
        number += got as u64;
    }
    Ok(())
}

/// The kept scalars of one row; lists are passed over.
fn scalars(rows: &mut impl Rows, row: Row<'_>, fields: &[Field], columns: &mut Columns) -> Result<(), ReadError> {
    for field in fields {
        match (field.kind, field.keep) {
            (Kind::Scalar(kind), Keep::Column(at)) => columns[at].push(rows.number(row, field, kind)?),
            (Kind::Scalar(kind), _) => rows.pass(row, field, kind, 1)?,
            (Kind::List { count, item }, _) => {
                let n = length(rows, row, field, count, item)?;
                rows.pass(row, field, item, n)?;
            }
        }
    }
    Ok(())
}

/// Where the faces of a file go.
pub(super) struct Target<'s> {
    pub(super) faces: Faces,
    pub(super) sink: &'s mut dyn MeshSink,
    /// Vertices of the file; indices are below.
    pub(super) vertices: u64,
    /// How colours of faces are read, where these become the colours of the mesh.
    pub(super) scale: Option<Scale>,
}

/// Read the rows of the face element.
pub(super) fn faces(
    rows: &mut impl Rows,
    element: &Element,
    fields: &[Field],
    to: &mut Target<'_>,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    let mut corners: Vec<u64> = Vec::new();
    let mut number = 0;
    while number < element.count {
        if to.scale.is_none() {
            let (out, room) = to.faces.sound_triangles();
            let got = rows.triangles(fields, element.count - number, room, to.vertices, out)?;
            if got > 0 {
                number += got as u64;
                to.faces.flush_if_full(to.sink, diagnostics)?;
                continue;
            }
        }
        let row = Row { element, number };
        rows.begin(row, diagnostics)?;
        let color = face(rows, row, fields, to.vertices, &mut corners)?;
        rows.end(row, diagnostics)?;
        let color = to.scale.map(|scale| scale.color(color, diagnostics));
        to.faces.face(&corners, color, number, diagnostics);
        to.faces.flush_if_full(to.sink, diagnostics)?;
        number += 1;
    }
    to.faces.flush(to.sink, diagnostics)
}

/// The corners and the colour of one face.
pub(super) fn face(
    rows: &mut impl Rows,
    row: Row<'_>,
    fields: &[Field],
    vertices: u64,
    corners: &mut Vec<u64>,
) -> Result<DVec3, ReadError> {
    let mut color = DVec3::ZERO;
    for field in fields {
        match (field.kind, field.keep) {
            (Kind::List { count, item }, Keep::Indices) => {
                let n = length(rows, row, field, count, item)?;
                if n > MAX_CORNERS as u64 {
                    return Err(rows.fault(
                        row,
                        field,
                        format!("a face of {n} corners"),
                        format!("at most {MAX_CORNERS}; split it in the program that made it"),
                    ));
                }
                corners.clear();
                for _ in 0..n {
                    let index = rows.integer(row, field, item)?;
                    match u64::try_from(index).ok().filter(|&i| i < vertices) {
                        Some(i) => corners.push(i),
                        None => return Err(no_such_vertex(rows, row, field, index, vertices)),
                    }
                }
            }
            (Kind::List { count, item }, _) => {
                let n = length(rows, row, field, count, item)?;
                rows.pass(row, field, item, n)?;
            }
            (Kind::Scalar(kind), Keep::Column(at)) => color[at] = rows.number(row, field, kind)?,
            (Kind::Scalar(kind), _) => rows.pass(row, field, kind, 1)?,
        }
    }
    Ok(color)
}

/// Read the rows of the `tristrips` element: each a list of vertex indices in which a negative one begins a new strip.
pub(super) fn strips(
    rows: &mut impl Rows,
    element: &Element,
    fields: &[Field],
    to: &mut Target<'_>,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    for number in 0..element.count {
        let row = Row { element, number };
        rows.begin(row, diagnostics)?;
        for field in fields {
            match (field.kind, field.keep) {
                (Kind::List { count, item }, Keep::Indices) => {
                    let n = length(rows, row, field, count, item)?;
                    let mut strip = to.faces.strip();
                    for _ in 0..n {
                        let index = rows.integer(row, field, item)?;
                        match u64::try_from(index).ok().filter(|&i| i < to.vertices) {
                            Some(i) => strip.corner(i, to.sink, diagnostics)?,
                            None if restarts(index, item) => strip.restart(),
                            None => return Err(no_such_vertex(rows, row, field, index, to.vertices)),
                        }
                    }
                }
                (Kind::List { count, item }, _) => {
                    let n = length(rows, row, field, count, item)?;
                    rows.pass(row, field, item, n)?;
                }
                (Kind::Scalar(kind), _) => rows.pass(row, field, kind, 1)?,
            }
        }
        rows.end(row, diagnostics)?;
    }
    to.faces.flush(to.sink, diagnostics)
}

/// -1, or all bits set where the type has no sign.
fn restarts(index: i64, item: Scalar) -> bool {
    match item {
        Scalar::U8 => index == i64::from(u8::MAX),
        Scalar::U16 => index == i64::from(u16::MAX),
        Scalar::U32 => index == i64::from(u32::MAX),
        _ => index == -1,
    }
}

/// Pass over an element that is not kept.
pub(super) fn skip(
    rows: &mut impl Rows,
    element: &Element,
    fields: &[Field],
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    // Rows without properties take no bytes and no lines.
    if fields.is_empty() || rows.pass_all(Row { element, number: 0 }, fields)? {
        return Ok(());
    }
    let mut none = Columns::new();
    for number in 0..element.count {
        let row = Row { element, number };
        rows.begin(row, diagnostics)?;
        scalars(rows, row, fields, &mut none)?;
        rows.end(row, diagnostics)?;
    }
    Ok(())
}

/// The length of a list, checked against what the file can still hold.
fn length(rows: &mut impl Rows, row: Row<'_>, field: &Field, count: Scalar, item: Scalar) -> Result<u64, ReadError> {
    let n = rows.integer(row, field, count)?;
    match u64::try_from(n) {
        // What follows gives a better message for a truncated short list.
        Ok(n) if n <= MAX_CORNERS as u64 || rows.can_hold(item, n) => Ok(n),
        Ok(n) => Err(rows.fault(
            row,
            field,
            format!("a list of {}", counted(n, "value", "values")),
            "no more than the rest of the file can hold; the file is truncated or damaged".to_owned(),
        )),
        Err(_) => Err(rows.fault(row, field, format!("a list of {n} values"), "0 or more".to_owned())),
    }
}

fn no_such_vertex(rows: &impl Rows, row: Row<'_>, field: &Field, index: i64, vertices: u64) -> ReadError {
    rows.fault(
        row,
        field,
        format!("vertex index {index}"),
        format!("0 to {}; the file is damaged, export it again", vertices.saturating_sub(1)),
    )
}

//! Rows of binary files of both byte orders.

use super::elements::{BLOCK, Columns, Cursor, Row, Rows};
use super::header::Kind;
use super::plan::{Field, Keep};
use super::scalar::{Order, Scalar};
use super::{Place, ReadError};
use crate::Diagnostics;
use crate::read::source::{BUFFER, Source};

pub(super) struct Binary<'s, 'a> {
    source: &'s mut Source<'a>,
    order: Order,
    /// Offset of the value read last.
    at: u64,
}

impl<'s, 'a> Binary<'s, 'a> {
    pub(super) fn new(source: &'s mut Source<'a>, order: Order) -> Self {
        let at = source.offset();
        Self { source, order, at }
    }

    /// The bytes of one value.
    #[inline]
    fn value(&mut self, row: Row<'_>, field: &Field, kind: Scalar) -> Result<&[u8], ReadError> {
        if self.source.ensure(kind.size())? {
            self.at = self.source.offset();
            Ok(self.source.take(kind.size()))
        } else {
            Err(self.cut(row, Some(field)))
        }
    }

    fn cut(&self, row: Row<'_>, field: Option<&Field>) -> ReadError {
        let end = self.source.offset() + self.source.available().len() as u64;
        let Row { element, number } = row;
        let within = field.map(|f| format!(" (property {})", f.name)).unwrap_or_default();
        self.source.malformed(
            Place::Byte(end),
            format!("the end of the file in {} {number} of {}{within}", element.name, element.count),
            "the rest of it; the file is truncated: copy or export it again",
        )
    }
}

/// Bytes of a row whose properties are all scalars.
fn fixed_row(fields: &[Field]) -> Option<usize> {
    let size = |f: &Field| match f.kind {
        Kind::Scalar(kind) => Some(kind.size()),
        Kind::List { .. } => None,
    };
    fields.iter().map(size).sum::<Option<usize>>().filter(|&n| n > 0 && n <= BUFFER)
}

/// Bytes of a row that is a list of corners of 4 bytes each, its length a byte, and nothing else that is kept: the row
/// of nearly every scan, where it is a triangle.
fn triangle_row(fields: &[Field]) -> Option<usize> {
    let [list, rest @ ..] = fields else { return None };
    let Kind::List { count: Scalar::U8, item: Scalar::I32 | Scalar::U32 } = list.kind else { return None };
    let nothing_kept = list.keep == Keep::Indices && rest.iter().all(|f| f.keep == Keep::Nothing);
    let rest = if rest.is_empty() { Some(0) } else { fixed_row(rest) };
    rest.filter(|_| nothing_kept).map(|rest| 13 + rest)
}

/// Append the triangles of the rows, up to the first row that is none or names no vertex; how many.
fn sound_triangles<const BIG: bool>(rows: &[u8], stride: usize, vertices: u64, out: &mut Vec<[u64; 3]>) -> usize {
    let before = out.len();
    for row in rows.chunks_exact(stride) {
        let &[3, a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3, ..] = row else { break };
        let number =
            |bytes: [u8; 4]| u64::from(if BIG { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) });
        let [a, b, c] = [[a0, a1, a2, a3], [b0, b1, b2, b3], [c0, c1, c2, c3]].map(number);
        if a >= vertices || b >= vertices || c >= vertices || a == b || b == c || c == a {
            break;
        }
        out.push([a, b, c]);
    }
    out.len() - before
}

impl Rows for Binary<'_, '_> {
    fn place(&self) -> Cursor {
        Cursor { offset: self.source.offset(), line: 0 }
    }

    fn go_to(&mut self, cursor: Cursor) -> Result<(), ReadError> {
        self.at = cursor.offset;
        self.source.go_to(cursor.offset)
    }

    fn triangles(
        &mut self,
        fields: &[Field],
        left: u64,
        room: usize,
        vertices: u64,
        out: &mut Vec<[u64; 3]>,
    ) -> Result<usize, ReadError> {
        let Some(stride) = triangle_row(fields) else { return Ok(0) };
        if !self.source.ensure(stride)? {
            return Ok(0);
        }
        let there = (self.source.available().len() / stride).min(room);
        let n = usize::try_from(left).map_or(there, |left| there.min(left));
        let rows = &self.source.available()[..n * stride];
        // A signed index is never 2^31 or more; as an unsigned number a negative one is, and is refused by itself.
        let signed = matches!(fields.first().map(|f| f.kind), Some(Kind::List { item: Scalar::I32, .. }));
        let vertices = if signed { vertices.min(1 << 31) } else { vertices };
        let got = match self.order {
            Order::Little => sound_triangles::<false>(rows, stride, vertices, out),
            Order::Big => sound_triangles::<true>(rows, stride, vertices, out),
        };
        self.source.take(got * stride);
        Ok(got)
    }

    fn begin(&mut self, _: Row<'_>, _: &mut Diagnostics) -> Result<(), ReadError> {
        Ok(())
    }

    fn number(&mut self, row: Row<'_>, field: &Field, kind: Scalar) -> Result<f64, ReadError> {
        let order = self.order;
        Ok(kind.number(self.value(row, field, kind)?, order))
    }

    #[inline]
    fn integer(&mut self, row: Row<'_>, field: &Field, kind: Scalar) -> Result<i64, ReadError> {
        let order = self.order;
        Ok(kind.integer(self.value(row, field, kind)?, order))
    }

    fn pass(&mut self, row: Row<'_>, field: &Field, kind: Scalar, n: u64) -> Result<(), ReadError> {
        let bytes = n.saturating_mul(kind.size() as u64);
        if self.source.skip(bytes)? { Ok(()) } else { Err(self.cut(row, Some(field))) }
    }

    fn end(&mut self, _: Row<'_>, _: &mut Diagnostics) -> Result<(), ReadError> {
        Ok(())
    }

    fn can_hold(&self, kind: Scalar, n: u64) -> bool {
        n <= self.source.remaining() / kind.size() as u64
    }

    fn fault(&self, row: Row<'_>, field: &Field, found: String, expected: String) -> ReadError {
        let found = format!("{found} in {} {} (property {})", row.element.name, row.number, field.name);
        self.source.malformed(Place::Byte(self.at), found, expected)
    }

    fn block(&mut self, row: Row<'_>, fields: &[Field], left: u64, columns: &mut Columns) -> Result<usize, ReadError> {
        let Some(stride) = fixed_row(fields) else { return Ok(0) };
        if !self.source.ensure(stride)? {
            return Err(self.cut(row, None));
        }
        let there = (self.source.available().len() / stride).min(BLOCK);
        let n = usize::try_from(left).map_or(there, |left| there.min(left));
        let order = self.order;
        let bytes = self.source.take(n * stride);
        let mut at = 0;
        for field in fields {
            if let Kind::Scalar(kind) = field.kind {
                if let Keep::Column(column) = field.keep {
                    kind.column(bytes, stride, at, order, &mut columns[column]);
                }
                at += kind.size();
            }
        }
        Ok(n)
    }

    fn pass_all(&mut self, row: Row<'_>, fields: &[Field]) -> Result<bool, ReadError> {
        let Some(stride) = fixed_row(fields) else { return Ok(false) };
        if self.source.skip(row.element.count.saturating_mul(stride as u64))? {
            Ok(true)
        } else {
            Err(self.cut(Row { element: row.element, number: row.element.count.saturating_sub(1) }, None))
        }
    }

    fn finish(&mut self, diagnostics: &mut Diagnostics) -> Result<(), ReadError> {
        let start = self.source.offset();
        self.source.skip(u64::MAX)?;
        let extra = self.source.offset() - start;
        if extra > 0 {
            diagnostics.add("bytes after the last element ignored", || format!("from byte {start}"));
            diagnostics.add_many("bytes after the last element ignored", extra - 1);
        }
        Ok(())
    }
}

//! Rows of binary files of both byte orders.

use super::elements::{BLOCK, Columns, Row, Rows};
use super::header::Kind;
use super::plan::{Field, Keep};
use super::scalar::{Order, Scalar};
use super::source::{BUFFER, Source};
use super::{Place, ReadError};
use crate::raw::Findings;

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
            "the rest of it; the file is cut: copy or export it again",
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

impl Rows for Binary<'_, '_> {
    fn begin(&mut self, _: Row<'_>, _: &mut Findings) -> Result<(), ReadError> {
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

    fn end(&mut self, _: Row<'_>, _: &mut Findings) -> Result<(), ReadError> {
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

    fn finish(&mut self, findings: &mut Findings) -> Result<(), ReadError> {
        let start = self.source.offset();
        self.source.skip(u64::MAX)?;
        let extra = self.source.offset() - start;
        if extra > 0 {
            findings.add("bytes after the last element ignored", || format!("from byte {start}"));
            findings.add_many("bytes after the last element ignored", extra - 1);
        }
        Ok(())
    }
}

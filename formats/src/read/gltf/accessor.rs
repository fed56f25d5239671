//! Accessors: typed elements in buffer views, read in blocks; sparse ones with their exceptions in place.

use super::super::ReadError;
use super::Context;
use super::buffers::{Buffers, ViewBytes};
use super::schema::{Root, Sparse};
use kilwa_pack::plural::counted;

/// Most zeros that an accessor without a view may represent, however small the file.
const FREE_ZEROS: u64 = 1 << 16;

/// The type of a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    pub(super) fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Of a type that indices have.
    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }

    /// The value at the beginning of `bytes`.
    #[inline]
    fn value(self, bytes: &[u8]) -> f64 {
        match (self, bytes) {
            (Self::I8, [a, ..]) => f64::from(a.cast_signed()),
            (Self::U8, [a, ..]) => f64::from(*a),
            (Self::I16, [a, b, ..]) => f64::from(i16::from_le_bytes([*a, *b])),
            (Self::U16, [a, b, ..]) => f64::from(u16::from_le_bytes([*a, *b])),
            (Self::U32, [a, b, c, d, ..]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
            (Self::F32, [a, b, c, d, ..]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => f64::NAN,
        }
    }

    /// A normalised integer as a number of 0 to 1 or -1 to 1 (specification, section 3.6.2.2).
    pub(super) fn normalise(self, value: f64) -> f64 {
        match self {
            Self::I8 => (value / 127.0).max(-1.0),
            Self::U8 => value / 255.0,
            Self::I16 => (value / 32767.0).max(-1.0),
            Self::U16 => value / 65535.0,
            Self::U32 | Self::F32 => value,
        }
    }
}

/// Elements that can be read.
pub(super) struct Accessor {
    /// Its number in the file.
    pub(super) index: usize,
    pub(super) count: u64,
    /// Components of an element.
    pub(super) width: usize,
    pub(super) component: Component,
    pub(super) normalized: bool,
    /// The bytes, the offset of the first element, and the bytes from one to the next.
    bytes: Option<(ViewBytes, u64, u64)>,
    /// Exceptions: element and where its values begin in the list.
    exceptions: Vec<(u64, usize)>,
    values: Vec<f64>,
    buffer: Vec<u8>,
}

impl Accessor {
    /// Accessor `index`, checked.
    pub(super) fn open(
        root: &Root,
        buffers: &mut Buffers<'_>,
        index: usize,
        context: &Context<'_>,
    ) -> Result<Self, ReadError> {
        let part = || format!("accessors[{index}]");
        let Some(from) = root.accessors.get(index) else {
            let found = format!("no such accessor (there are {})", root.accessors.len());
            return Err(context.part(part(), found, "an accessor of this file"));
        };
        let Some(component) = Component::of(from.component_type) else {
            let found = format!("the component type {}", from.component_type);
            return Err(context.part(part(), found, "5120, 5121, 5122, 5123, 5125 or 5126"));
        };
        let width = match from.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => {
                let found = format!("the type \"{other}\"");
                return Err(context.part(part(), found, "SCALAR, VEC2, VEC3 or VEC4 for a part of a surface"));
            }
        };
        let size = component.bytes() * width as u64;
        let bytes = match from.buffer_view {
            Some(number) => {
                let view = buffers.view(root, number, context)?;
                let stride = root.views.get(number).and_then(|v| v.byte_stride).unwrap_or(size);
                let layout = Layout { offset: from.byte_offset, stride, size, count: from.count };
                layout.check(&view, number, &part(), context)?;
                Some((view, from.byte_offset, stride))
            }
            None if from.count > buffers.total().max(FREE_ZEROS) => {
                let found = format!("{} elements without a buffer view", from.count);
                return Err(context.part(part(), found, "no more than the file has bytes"));
            }
            None => None,
        };
        let mut accessor = Self {
            index,
            count: from.count,
            width,
            component,
            normalized: from.normalized,
            bytes,
            exceptions: Vec::new(),
            values: Vec::new(),
            buffer: Vec::new(),
        };
        if let Some(sparse) = &from.sparse {
            accessor.read_sparse(root, buffers, sparse, context)?;
        }
        Ok(accessor)
    }

    fn read_sparse(
        &mut self,
        root: &Root,
        buffers: &mut Buffers<'_>,
        sparse: &Sparse,
        context: &Context<'_>,
    ) -> Result<(), ReadError> {
        let part = format!("accessors[{}].sparse", self.index);
        let at = &sparse.indices;
        let Some(kind) = Component::of(at.component_type).filter(|c| c.is_index()) else {
            let found = format!("the component type {} of indices", at.component_type);
            return Err(context.part(part, found, "5121, 5123 or 5125"));
        };
        let mut packed = |view: usize, offset: u64, size: u64| {
            let bytes = buffers.view(root, view, context)?;
            let layout = Layout { offset, stride: size, size, count: sparse.count };
            layout.check(&bytes, view, &part, context)?;
            let mut into = Vec::new();
            buffers.read(&bytes, offset, (sparse.count * size) as usize, &mut into, context)?;
            Ok::<_, ReadError>(into)
        };
        let indices = packed(at.buffer_view, at.byte_offset, kind.bytes())?;
        let size = self.component.bytes() * self.width as u64;
        let values = packed(sparse.values.buffer_view, sparse.values.byte_offset, size)?;
        self.values = values.chunks_exact(self.component.bytes() as usize).map(|b| self.component.value(b)).collect();
        let numbers = indices.chunks_exact(kind.bytes() as usize).map(|b| kind.value(b) as u64);
        self.exceptions = numbers.zip((0..).step_by(self.width)).collect();
        self.exceptions.sort_by_key(|(element, _)| *element);
        if let Some((element, _)) = self.exceptions.last().filter(|(element, _)| *element >= self.count) {
            let found = format!("a value for element {element}");
            return Err(context.part(part, found, &format!("elements below {}", self.count)));
        }
        Ok(())
    }

    /// `count` elements from element `first` on, as they are stored, in place of what `into` has.
    pub(super) fn block(
        &mut self,
        buffers: &mut Buffers<'_>,
        first: u64,
        count: usize,
        into: &mut Vec<f64>,
        context: &Context<'_>,
    ) -> Result<(), ReadError> {
        into.clear();
        into.resize(count * self.width, 0.0);
        if count == 0 {
            return Ok(());
        }
        let (component, width) = (self.component, self.width);
        let size = component.bytes() as usize;
        if let Some((view, offset, stride)) = &self.bytes {
            let length = (count as u64 - 1) * stride + (size * width) as u64;
            buffers.read(view, offset + first * stride, length as usize, &mut self.buffer, context)?;
            for (element, bytes) in into.chunks_exact_mut(width).zip(self.buffer.chunks(*stride as usize)) {
                for (value, bytes) in element.iter_mut().zip(bytes.chunks_exact(size)) {
                    *value = component.value(bytes);
                }
            }
        }
        let from = self.exceptions.partition_point(|(element, _)| *element < first);
        for &(element, at) in self.exceptions[from..].iter().take_while(|(e, _)| *e - first < count as u64) {
            let to = (element - first) as usize * width;
            into[to..to + width].copy_from_slice(&self.values[at..at + width]);
        }
        Ok(())
    }

    /// Refuse what cannot be indices.
    pub(super) fn check_indices(&self, context: &Context<'_>) -> Result<(), ReadError> {
        if self.component.is_index() && self.width == 1 {
            return Ok(());
        }
        let found =
            format!("indices of {} of the type {:?}", counted(self.width, "component", "components"), self.component);
        Err(context.part(format!("accessors[{}]", self.index), found, "SCALAR indices of unsigned integers"))
    }
}

/// Elements in a view.
struct Layout {
    offset: u64,
    stride: u64,
    size: u64,
    count: u64,
}

impl Layout {
    /// Refuse elements that do not lie in the view, or in each other.
    fn check(&self, view: &ViewBytes, number: usize, part: &str, context: &Context<'_>) -> Result<(), ReadError> {
        if self.stride < self.size {
            let found = format!(
                "elements of {} every {} in bufferViews[{number}]",
                counted(self.size, "byte", "bytes"),
                counted(self.stride, "byte", "bytes")
            );
            return Err(context.part(part.to_owned(), found, "elements that do not overlap"));
        }
        let spaces = self.count.saturating_sub(1);
        let end = spaces.checked_mul(self.stride).and_then(|n| n.checked_add(self.size)?.checked_add(self.offset));
        if self.count > 0 && end.is_none_or(|end| end > view.len()) {
            let found = format!(
                "{} of {} every {} from byte {} of bufferViews[{number}], which has {}",
                counted(self.count, "element", "elements"),
                counted(self.size, "byte", "bytes"),
                counted(self.stride, "byte", "bytes"),
                self.offset,
                view.len()
            );
            return Err(context.part(part.to_owned(), found, "elements that are there; copy or export the file again"));
        }
        Ok(())
    }
}

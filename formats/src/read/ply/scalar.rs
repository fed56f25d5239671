//! The eight scalar types of PLY under all their names, and how they are read from bytes of either order.

/// The order of the bytes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Little,
    Big,
}

/// A scalar type of PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// All names a header may use, for error messages.
pub(super) const NAMES: &str = "char, uchar, short, ushort, int, uint, float, double, int8, uint8, int16, uint16, int32, uint32, float32 or float64";

impl Scalar {
    /// The type a header calls `name`: the names of 1994 and those with the number of bits.
    pub(super) fn parse(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// The short name used in messages.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::I8 => "char",
            Self::U8 => "uchar",
            Self::I16 => "short",
            Self::U16 => "ushort",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::F32 => "float",
            Self::F64 => "double",
        }
    }

    /// Bytes in a binary file.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) const fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The value of an integer type whose [`size`](Self::size) bytes start `bytes`; a float is truncated.
    #[inline]
    pub(super) fn integer(self, bytes: &[u8], order: Order) -> i64 {
        match self {
            Self::I8 => i64::from(i8::from_le_bytes(array(bytes, order))),
            Self::U8 => i64::from(u8::from_le_bytes(array(bytes, order))),
            Self::I16 => i64::from(i16::from_le_bytes(array(bytes, order))),
            Self::U16 => i64::from(u16::from_le_bytes(array(bytes, order))),
            Self::I32 => i64::from(i32::from_le_bytes(array(bytes, order))),
            Self::U32 => i64::from(u32::from_le_bytes(array(bytes, order))),
            Self::F32 => f32::from_le_bytes(array(bytes, order)) as i64,
            Self::F64 => f64::from_le_bytes(array(bytes, order)) as i64,
        }
    }

    /// The value whose [`size`](Self::size) bytes start `bytes`.
    pub(super) fn number(self, bytes: &[u8], order: Order) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_le_bytes(array(bytes, order))),
            Self::F64 => f64::from_le_bytes(array(bytes, order)),
            _ => self.integer(bytes, order) as f64,
        }
    }

    /// Append to `out` the value at byte `at` of each row of `rows`, which is made of rows of `stride` bytes.
    pub(super) fn column(self, rows: &[u8], stride: usize, at: usize, order: Order, out: &mut Vec<f64>) {
        let cells = rows.chunks_exact(stride).map(|row| &row[at..]);
        match self {
            Self::I8 => out.extend(cells.map(|c| f64::from(i8::from_le_bytes(array(c, order))))),
            Self::U8 => out.extend(cells.map(|c| f64::from(c[0]))),
            Self::I16 => out.extend(cells.map(|c| f64::from(i16::from_le_bytes(array(c, order))))),
            Self::U16 => out.extend(cells.map(|c| f64::from(u16::from_le_bytes(array(c, order))))),
            Self::I32 => out.extend(cells.map(|c| f64::from(i32::from_le_bytes(array(c, order))))),
            Self::U32 => out.extend(cells.map(|c| f64::from(u32::from_le_bytes(array(c, order))))),
            Self::F32 => out.extend(cells.map(|c| f64::from(f32::from_le_bytes(array(c, order))))),
            Self::F64 => out.extend(cells.map(|c| f64::from_le_bytes(array(c, order)))),
        }
    }
}

/// The first `N` bytes, turned to little-endian.
#[inline]
fn array<const N: usize>(bytes: &[u8], order: Order) -> [u8; N] {
    let mut b = [0; N];
    b.copy_from_slice(&bytes[..N]);
    if order == Order::Big {
        b.reverse();
    }
    b
}

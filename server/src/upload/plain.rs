//! Checks that pictures and previews contain only what `kilwa publish` puts into them, for versions announced as having no location.
//!
//! A poster must have, byte for byte, the head that its encoder writes, and as many coded blocks as its size needs, with each number coded as the encoder
//! does it; JPEG is lossy, so it cannot be compared by encoding it again. A drawing must be, byte for byte, what its encoder writes from its pixels. A preview
//! must have the JSON that follows from its numbers, and its triangles must use every vertex. Anything painted into the pixels is not detected.

use super::files::glb_json;
use flate2::{Crc, Decompress, FlushDecompress, Status};
use glam::DVec3;
use kilwa_archive::drawing;
use kilwa_archive::layout::{POSTER, THUMBNAILS};
use kilwa_pack::Metadata;
use serde_json::{Value, json};

/// Everything in a poster before its coded pixels: 4:4:4, quality 88, the tables of annex K of the JPEG standard.
const HEAD: &[u8; 623] = include_bytes!("poster-head.bin");
/// Where height and width are in it.
const SIZE_AT: std::ops::Range<usize> = 25..29;
/// Width and height of the poster.
const POSTER_SIZE: [u32; 2] = [1200, 630];
/// Pixels for each metre of a drawing: 150 dpi.
const PER_METRE: u32 = 0x1712;
/// The same in the form that PNG uses.
const RESOLUTION: &[u8; 9] = b"\0\0\x17\x12\0\0\x17\x12\x01";
/// Largest side of a drawing, pixels: A4 has 1,754.
const SIDE_MAX: u32 = 2_000;

const FOREIGN: &str = "contains something besides its pixels, or is damaged";

/// A JPEG as `kilwa publish` writes the poster or thumbnail of this name.
pub(super) fn check_jpeg(path: &str, bytes: &[u8]) -> Result<(), String> {
    let [width, height] = POSTER_SIZE;
    let width_of = THUMBNAILS.iter().find(|(name, _)| *name == path).map(|(_, width)| *width);
    let (w, h) = match width_of {
        Some(w) => (w, (w * height).div_ceil(width)),
        None if path == POSTER => (width, height),
        None => return Err("is not a poster".to_owned()),
    };
    let mut head = *HEAD;
    if let Some(size) = head.get_mut(SIZE_AT) {
        size.copy_from_slice(&(h << 16 | w).to_be_bytes());
    }
    let coded = bytes.strip_prefix(&head).and_then(|rest| rest.strip_suffix(b"\xff\xd9"));
    let coded = coded.ok_or_else(|| format!("{FOREIGN}: its head is not that of a poster of {w} x {h} pixels"))?;
    blocks(coded, w.div_ceil(8) * h.div_ceil(8)).ok_or_else(|| format!("{FOREIGN}: its coded pixels"))
}

/// Reads every block of so many units of three, to the last bit.
fn blocks(coded: &[u8], units: u32) -> Option<()> {
    let tables = tables();
    let mut bits = Bits { coded, at: 0, word: 0, left: 0 };
    for _ in 0..units {
        for component in [0, 1, 1] {
            let (dc, ac) = (tables.get(2 * component)?, tables.get(2 * component + 1)?);
            let size = dc.symbol(&mut bits)?;
            bits.take(u32::from(size))?;
            // The code for sixteen zeros is used only if another number follows.
            let (mut k, mut has_open_zeros) = (1, false);
            while k < 64 {
                let symbol = ac.symbol(&mut bits)?;
                let (run, size) = (symbol >> 4, symbol & 15);
                match (run, size) {
                    (0, 0) => break,
                    (15, 0) => (k, has_open_zeros) = (k + 16, true),
                    (_, 0) => return None,
                    _ => {
                        (k, has_open_zeros) = (k + u32::from(run) + 1, false);
                        bits.take(u32::from(size))?;
                    }
                }
                if k > 64 {
                    return None;
                }
            }
            if has_open_zeros {
                return None;
            }
        }
    }
    bits.is_done().then_some(())
}

/// Bits of coded pixels, a zero behind each byte of ones taken out.
struct Bits<'a> {
    coded: &'a [u8],
    at: usize,
    word: u8,
    left: u32,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u32> {
        if self.left == 0 {
            self.word = *self.coded.get(self.at)?;
            self.at += 1;
            if self.word == 0xff {
                self.coded.get(self.at).filter(|b| **b == 0)?;
                self.at += 1;
            }
            self.left = 8;
        }
        self.left -= 1;
        Some(u32::from(self.word >> self.left & 1))
    }

    fn take(&mut self, count: u32) -> Option<()> {
        (0..count).try_for_each(|_| self.bit().map(|_| ()))
    }

    /// Whether nothing but ones to the end of the byte is left.
    fn is_done(&mut self) -> bool {
        let ones = (1u32 << self.left) - 1;
        self.at == self.coded.len() && u32::from(self.word) & ones == ones
    }
}

/// A Huffman table: for each length of a code the first one and its values.
#[derive(Default)]
struct Table<'a> {
    lengths: Vec<(u32, &'a [u8])>,
}

impl Table<'_> {
    fn symbol(&self, bits: &mut Bits<'_>) -> Option<u8> {
        let mut code = 0;
        for (first, values) in &self.lengths {
            code = code << 1 | bits.bit()?;
            if let Some(value) = code.checked_sub(*first).and_then(|at| values.get(at as usize)) {
                return Some(*value);
            }
        }
        None
    }
}

/// The four tables of [`HEAD`]: light and colour, the first number of a block and the others.
fn tables() -> Vec<Table<'static>> {
    let (mut all, mut at) = (Vec::new(), 2);
    while let (Some(marker), Some(length)) = (HEAD.get(at + 1), HEAD.get(at + 2..at + 4)) {
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        let data = HEAD.get(at + 4..at + 2 + length).unwrap_or_default();
        if *marker == 0xc4 {
            let counts = data.get(1..17).unwrap_or_default();
            let (mut first, mut values, mut table) = (0, data.get(17..).unwrap_or_default(), Table::default());
            for count in counts {
                let (these, others) = values.split_at(usize::from(*count).min(values.len()));
                table.lengths.push((first, these));
                (first, values) = ((first + u32::from(*count)) << 1, others);
            }
            all.push(table);
        }
        at += 2 + length;
    }
    all
}

/// Check a PNG as `kilwa publish` writes drawings: three bytes per pixel, a resolution, one stream of pixels, nothing else, and the same bytes when it is
/// encoded again.
pub(super) fn check_png(bytes: &[u8]) -> Result<(), String> {
    let foreign = |what: &str| format!("{FOREIGN}: {what}");
    let mut rest = bytes.get(8..).unwrap_or_default();
    let (mut kinds, mut stream, mut size) = (Vec::new(), Vec::new(), [0; 2]);
    while !rest.is_empty() {
        let Some((kind, data, behind)) = chunk(rest) else { return Err(foreign("its chunks cannot be read")) };
        let is_known = match kind {
            b"IHDR" if kinds.is_empty() => {
                let side = |at: usize| Some(u32::from_be_bytes(data.get(at..at + 4)?.try_into().ok()?));
                size = [side(0), side(4)].map(Option::unwrap_or_default);
                data.get(8..) == Some(&[8, 2, 0, 0, 0]) && size.iter().all(|s| (1..=SIDE_MAX).contains(s))
            }
            b"pHYs" if kinds == [b"IHDR"] => data == RESOLUTION,
            b"IDAT" if kinds.contains(&b"pHYs") => true,
            b"IEND" if kinds.last() == Some(&b"IDAT") => data.is_empty() && behind.is_empty(),
            _ => false,
        };
        if !is_known {
            return Err(foreign(&format!("chunk {}", String::from_utf8_lossy(kind).escape_default())));
        }
        if kind == b"IDAT" {
            stream.extend_from_slice(data);
        }
        kinds.push(kind);
        rest = behind;
    }
    if kinds.last() != Some(&b"IEND") {
        return Err(foreign("it has no end"));
    }
    if !fills(&stream, size) {
        return Err(foreign("the number of its pixels does not match its size"));
    }
    if drawing::is_as_written(bytes, size, PER_METRE) {
        Ok(())
    } else {
        Err(foreign("its pixels are not compressed as this version of kilwa publish compresses them"))
    }
}

/// Kind and data of the chunk that bytes begin with, and what follows it.
fn chunk(bytes: &[u8]) -> Option<(&[u8; 4], &[u8], &[u8])> {
    let length = u32::from_be_bytes(bytes.get(..4)?.try_into().ok()?) as usize;
    let end = length.checked_add(8)?;
    let (kind, data) = (bytes.get(4..8)?.try_into().ok()?, bytes.get(8..end)?);
    let mut crc = Crc::new();
    crc.update(bytes.get(4..end)?);
    (bytes.get(end..end + 4)? == crc.sum().to_be_bytes()).then_some((kind, data, bytes.get(end + 4..)?))
}

/// Whether a compressed stream ends with its last byte, and holds as many rows of pixels as there are.
fn fills(stream: &[u8], [width, height]: [u32; 2]) -> bool {
    let row = 1 + 3 * u64::from(width);
    let whole = row * u64::from(height);
    let (mut unpacker, mut out) = (Decompress::new(true), vec![0; 1 << 16]);
    loop {
        let (taken, given) = (unpacker.total_in(), unpacker.total_out());
        let input = stream.get(taken as usize..).unwrap_or_default();
        let Ok(status) = unpacker.decompress(input, &mut out, FlushDecompress::None) else { return false };
        let made = (unpacker.total_out() - given) as usize;
        // Each row begins with the number of its filter.
        let first = ((row - given % row) % row) as usize;
        let is_sound = out.get(..made).unwrap_or_default().iter().skip(first).step_by(row as usize).all(|f| *f <= 4);
        if !is_sound || unpacker.total_out() > whole {
            return false;
        }
        if status == Status::StreamEnd {
            return unpacker.total_out() == whole && unpacker.total_in() == stream.len() as u64;
        }
        if made == 0 && unpacker.total_in() == taken {
            return false;
        }
    }
}

/// A preview as `kilwa publish` writes it of a pack: the same JSON to the byte, around numbers of the model.
pub(super) fn check_preview(bytes: &[u8], of_pack: &Metadata) -> Result<(), String> {
    let value = glb_json(bytes)?;
    let length = bytes.get(12..16).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    let written = bytes.get(20..20 + length).unwrap_or_default();
    let foreign = || "is not in the form in which this version of kilwa publish writes previews".to_owned();
    let declared = DeclaredPreview::of(&value).ok_or_else(foreign)?;
    if written != declared.json(of_pack).ok_or_else(foreign)? {
        return Err(foreign());
    }
    let diagonal = of_pack.bounds_max.distance(of_pack.bounds_min);
    // glam's midpoint adds first, which overflows where this does not.
    let middle = [0, 1, 2].map(|k| f64::midpoint(of_pack.bounds_min[k], of_pack.bounds_max[k]));
    let off = (declared.place - DVec3::from(middle)).abs();
    if off.cmpgt(DVec3::splat(diagonal / 100.0 + 1e-3)).any() {
        return Err("states a position outside the pack".to_owned());
    }
    if !(0.0..=diagonal).contains(&declared.error)
        || [declared.min, declared.max].iter().any(|v| v.abs().cmpgt(DVec3::splat(diagonal)).any())
    {
        return Err("has coordinates larger than the model".to_owned());
    }
    let binary = bytes.get(28 + length..).unwrap_or_default();
    if declared.holds(binary) {
        Ok(())
    } else {
        Err("does not have the vertices or triangles that it declares".to_owned())
    }
}

/// What differs from preview to preview.
struct DeclaredPreview {
    vertices: u64,
    corners: u64,
    has_colors: bool,
    min: DVec3,
    max: DVec3,
    place: DVec3,
    error: f64,
}

impl DeclaredPreview {
    fn of(value: &Value) -> Option<Self> {
        let count = |at: &str| value.pointer(at)?.as_u64().filter(|n| u32::try_from(*n).is_ok());
        let three = |at: &str| {
            let numbers: Option<Vec<f64>> = value.pointer(at)?.as_array()?.iter().map(Value::as_f64).collect();
            numbers?.try_into().ok().map(DVec3::from_array)
        };
        Some(Self {
            vertices: count("/accessors/0/count")?,
            corners: count("/accessors/2/count")?,
            has_colors: value.pointer("/accessors/3").is_some(),
            min: three("/accessors/0/min")?,
            max: three("/accessors/0/max")?,
            place: three("/extras/world_from_local_m")?,
            error: value.pointer("/extras/certified_error_m")?.as_f64()?,
        })
    }

    fn stride(&self) -> u64 {
        if self.has_colors { 32 } else { 24 }
    }

    /// The JSON, as `extract::glb` writes it. None where a number is not one of its vertices, which are floats.
    fn json(&self, of_pack: &Metadata) -> Option<Vec<u8>> {
        let float = |v: f64| (f64::from(v as f32) == v).then_some(v as f32);
        let floats = |v: DVec3| v.to_array().into_iter().map(float).collect::<Option<Vec<f32>>>();
        let (vertex_bytes, index_bytes) = (self.vertices * self.stride(), self.corners * 4);
        let mut attributes = json!({"POSITION": 0, "NORMAL": 1});
        let mut accessors = vec![
            json!({"bufferView": 0, "componentType": 5126, "count": self.vertices, "type": "VEC3",
                "min": floats(self.min)?, "max": floats(self.max)?}),
            json!({"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": self.vertices, "type": "VEC3"}),
            json!({"bufferView": 1, "componentType": 5125, "count": self.corners, "type": "SCALAR"}),
        ];
        if self.has_colors {
            attributes["COLOR_0"] = json!(3);
            accessors.push(json!({"bufferView": 0, "byteOffset": 24, "componentType": 5123,
                "normalized": true, "count": self.vertices, "type": "VEC4"}));
        }
        let file = json!({
            "asset": {"version": "2.0", "generator": format!("kilwa {}", env!("CARGO_PKG_VERSION"))},
            "extras": {"certified_error_m": self.error, "crs": of_pack.crs, "world_from_local_m": self.place},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": of_pack.title, "mesh": 0, "matrix":
                [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -0.0, 1.0]}],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
            "accessors": accessors,
            "bufferViews": [
                {"buffer": 0, "byteLength": vertex_bytes, "byteStride": self.stride(), "target": 34962},
                {"buffer": 0, "byteOffset": vertex_bytes, "byteLength": index_bytes, "target": 34963},
            ],
            "buffers": [{"byteLength": vertex_bytes + index_bytes}],
        });
        let mut json = file.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        Some(json)
    }

    /// Whether these are the vertices, with the declared bounds, and the triangles.
    fn holds(&self, binary: &[u8]) -> bool {
        let (stride, vertex_bytes) = (self.stride() as usize, self.vertices * self.stride());
        if !self.corners.is_multiple_of(3) || binary.len() as u64 != vertex_bytes + self.corners * 4 {
            return false;
        }
        let (vertices, corners) = binary.split_at(vertex_bytes as usize);
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for vertex in vertices.chunks_exact(stride) {
            let (floats, color) = vertex.split_at(24);
            let mut numbers = [0.0; 6];
            for (number, bytes) in numbers.iter_mut().zip(floats.chunks_exact(4)) {
                *number = bytes.try_into().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)));
            }
            let (position, normal) = (DVec3::from_slice(&numbers), DVec3::from_slice(&numbers[3..]));
            let is_normal = normal.length_squared() <= 1.01;
            if !is_normal || !position.is_finite() || !(color.is_empty() || color.ends_with(&[0xff; 2])) {
                return false;
            }
            (min, max) = (min.min(position), max.max(position));
        }
        // Vertices are numbered in the order in which the triangles first use them, so that none can carry anything else.
        let mut used = 0;
        let is_next = |b: &[u8]| {
            let vertex = b.try_into().map_or(u64::MAX, |b| u64::from(u32::from_le_bytes(b)));
            let is_known = vertex <= used;
            used += u64::from(vertex == used);
            is_known
        };
        (min, max) == (self.min, self.max) && corners.chunks_exact(4).all(is_next) && used == self.vertices
    }
}

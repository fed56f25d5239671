//! The sink of a build: what readers deliver goes to scratch files, one per attribute, whatever the size of the mesh.
//!
//! Input: blocks of vertices and triangles of one input after the other. Files (numbers little-endian, one row per
//! vertex or triangle): `positions` 3×f64, `colors` r g b given?, `normals` octahedral 2×i16,
//! `scalar-N` f32, `triangles` 3×u32 (the low 32 bits of numbers over all inputs), `triangles-high` 3×u8 (bits 32 to 39),
//! `triangle-colors` r g b given?. There is no file for an attribute that no input has, or for high bits that are all 0.
//! [`Spooled`] lists what is there.
//!
//! Inputs are joined here: channels by name (0 where an input lacks one), a neutral grey where only some vertices have
//! colours, normals only where every vertex has one. Fails where a triangle names a vertex that its input does not have,
//! where there are more vertices than 40 bits number, and where the scratch disk does.

use super::column::Column;
use super::surface::ColoredBy;
use super::tally::Tally;
use crate::scratch::{Scratch, ScratchError, Sum};
use glam::{DVec3, Vec3};
use kilwa_formats::ReadError;
use kilwa_formats::read::sink::{MeshSink, NO_POSITION, TWICE, VertexBlock, VertexSink};
use kilwa_formats::{Diagnostics, Pictures, RawMesh};
use kilwa_geometry::normal;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub(super) const POSITIONS: &str = "positions";
pub(super) const COLORS: &str = "colors";
pub(super) const NORMALS: &str = "normals";
pub(super) const TRIANGLES: &str = "triangles";
pub(super) const TRIANGLES_HIGH: &str = "triangles-high";
pub(super) const TRIANGLE_COLORS: &str = "triangle-colors";

/// Max vertices of a build: their numbers have 40 bits, enough for 2 · 10^12 triangles.
const MAX_VERTICES: u64 = (1 << 40) - 1;
/// Vertices in a block of the cache for [`MeshSink::positions`].
const CACHE_BLOCK: u64 = 1 << 12;
/// Blocks in that cache: 6 MiB.
const CACHE_BLOCKS: usize = 64;
/// Vertices looked at together when a channel becomes grey.
const ROWS: usize = 1 << 16;
/// Classes of the histogram of intensities.
const CLASSES: usize = 1 << 16;

const GREY: &str = "vertices without colour beside coloured ones, shown grey";
const NO_SCALAR: &str = "vertices without a scalar that other files have, set to 0";
const NO_NORMAL: &str = "normals dropped and computed anew, because other files have none";
const FACE_COLOR: &str = "triangles whose colour was given to their vertices";
const OPAQUE: &str = "vertices whose alpha of 1 was not kept";
const FROM_INTENSITY: &str = "vertices coloured grey from their intensity";

/// Where the colours of vertices come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) enum ColorSource {
    /// The model has none.
    None,
    /// The file of colours, or the triangles.
    Given,
    /// A scalar: file, and the values that become black and white.
    Scalar { file: String, black: f32, white: f32 },
}

/// A scalar channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) file: String,
    /// Smallest and largest finite value, 0 if there is none.
    pub(super) min: f32,
    pub(super) max: f32,
}

/// What the scratch files hold once all inputs are read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(clippy::struct_excessive_bools, reason = "each says whether there is a file")]
pub struct Spooled {
    /// Vertices of all inputs.
    pub vertices: u64,
    /// Triangles of all inputs.
    pub triangles: u64,
    /// Smallest and largest coordinates of finite vertices, metres; absent if there is none.
    pub(super) bounds: Option<[DVec3; 2]>,
    pub(super) color: ColorSource,
    pub(super) vertex_colors: bool,
    pub(super) triangle_colors: bool,
    /// Whether there is a file of the high bits of vertex numbers.
    pub(super) has_high_bits: bool,
    /// Smallest and largest vertex number that a triangle names; absent without triangles.
    pub(super) vertex_range: Option<[u64; 2]>,
    pub(super) normals: bool,
    pub(super) channels: Vec<Channel>,
    pub(super) tally: Tally,
    /// Pictures that colours were taken from.
    pub(super) pictures: Pictures,
    /// Checksums of the files.
    pub(super) sums: BTreeMap<String, Sum>,
}

impl Spooled {
    /// Where the colours of the vertices come from.
    pub(super) fn colored_by(&self) -> ColoredBy {
        match &self.color {
            ColorSource::None => ColoredBy::Nothing,
            ColorSource::Scalar { file, .. } => {
                let channel = self.channels.iter().find(|c| c.file == *file);
                ColoredBy::Channel(channel.map_or_else(String::new, |c| c.name.clone()))
            }
            ColorSource::Given if self.pictures.count > 0 => ColoredBy::Pictures(self.pictures),
            ColorSource::Given if self.vertex_colors => ColoredBy::Vertices,
            ColorSource::Given => ColoredBy::Triangles,
        }
    }

    /// Names of the files.
    pub(super) fn files(&self) -> Vec<&str> {
        let fixed = [POSITIONS, COLORS, NORMALS, TRIANGLES, TRIANGLES_HIGH, TRIANGLE_COLORS];
        fixed.into_iter().chain(self.channels.iter().map(|c| c.file.as_str())).collect()
    }
}

/// One input while it is delivered.
#[derive(Debug)]
struct Current {
    path: PathBuf,
    first_vertex: u64,
    first_triangle: u64,
    /// Triangles delivered, those dropped included.
    delivered: u64,
    /// Which of [`Spool::channels`] each declared channel is.
    channels: Vec<usize>,
    coloured: u64,
    with_normal: u64,
    coloured_triangles: u64,
    /// The largest vertex number, and which triangle names it.
    largest: Option<(u64, u64)>,
}

#[derive(Debug)]
struct Scalar {
    name: String,
    column: Column,
    min: f32,
    max: f32,
    not_finite: bool,
}

impl Scalar {
    fn see(&mut self, v: f32) {
        if v.is_finite() {
            self.min = self.min.min(v);
            self.max = self.max.max(v);
        } else {
            self.not_finite = true;
        }
    }
}

/// The sink over scratch files. [`Spool::input`] begins an input, [`Spool::finish`] ends the last.
#[derive(Debug)]
pub struct Spool {
    scratch: Scratch,
    positions: Column,
    colors: Option<Column>,
    normals: Option<Column>,
    scalars: Vec<Scalar>,
    triangles: Column,
    triangles_high: Option<Column>,
    vertex_range: Option<[u64; 2]>,
    triangle_colors: Option<Column>,
    bounds: [DVec3; 2],
    current: Current,
    /// Names that each input declared, in its order.
    declared: Vec<Vec<String>>,
    /// Vertices without colour in inputs that have no coloured triangles.
    uncoloured: u64,
    with_normal: u64,
    /// Diagnostics of the current input.
    diagnostics: Diagnostics,
    tally: Tally,
    pictures: Pictures,
    cache: Vec<(u64, Vec<DVec3>)>,
}

impl Spool {
    /// An empty spool in `scratch`, for inputs whose first is at `path`.
    ///
    /// # Errors
    /// [`ScratchError`] where files cannot be made.
    pub fn create(scratch: &Scratch, path: &Path) -> Result<Self, ScratchError> {
        Ok(Self {
            positions: Column::create(scratch, POSITIONS, 24)?,
            colors: None,
            normals: None,
            scalars: Vec::new(),
            triangles: Column::create(scratch, TRIANGLES, 12)?,
            triangles_high: None,
            vertex_range: None,
            triangle_colors: None,
            bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY],
            current: Current::new(path, 0, 0),
            declared: Vec::new(),
            uncoloured: 0,
            with_normal: 0,
            diagnostics: Diagnostics::default(),
            tally: Tally::default(),
            pictures: Pictures::default(),
            cache: Vec::new(),
            scratch: scratch.clone(),
        })
    }

    /// What follows is the input at `path`.
    ///
    /// # Errors
    /// Where the input before names vertices that it does not have.
    pub fn input(&mut self, path: &Path) -> Result<(), ReadError> {
        if self.current.delivered > 0 || self.vertex_count() > 0 {
            self.end_input()?;
        }
        self.current = Current::new(path, self.positions.rows(), self.triangles.rows());
        Ok(())
    }

    /// Triangles kept so far, of all inputs.
    pub fn triangle_count(&self) -> u64 {
        self.triangles.rows()
    }

    fn end_input(&mut self) -> Result<(), ReadError> {
        let rows = self.positions.rows();
        let here = rows - self.current.first_vertex;
        if let Some((vertex, triangle)) = self.current.largest
            && vertex >= here
        {
            let file = self.current.path.clone();
            return Err(ReadError::Index { file, triangle, vertex, vertices: here });
        }
        let c = &self.current;
        if c.coloured_triangles < self.triangles.rows() - c.first_triangle || c.coloured > 0 {
            self.uncoloured += here - c.coloured;
        }
        self.with_normal += c.with_normal;
        let declared: Vec<usize> = c.channels.clone();
        self.declared.push(declared.iter().map(|&i| self.scalars[i].name.clone()).collect());
        // Channels of other inputs are 0 here.
        for (_, scalar) in self.scalars.iter_mut().enumerate().filter(|(i, _)| !declared.contains(i)) {
            if here > 0 {
                scalar.see(0.0);
            }
            scalar.column.fill(0f32.to_le_bytes(), rows)?;
            self.tally.add_many(NO_SCALAR, here);
        }
        self.tally.add_many(FACE_COLOR, c.coloured_triangles);
        let diagnostics = std::mem::take(&mut self.diagnostics);
        self.pictures.add(diagnostics.pictures);
        self.tally.take(&diagnostics);
        Ok(())
    }

    /// Complete the files.
    ///
    /// # Errors
    /// As [`Spool::input`]; [`ReadError::Sink`].
    pub fn finish(mut self) -> Result<Spooled, ReadError> {
        self.end_input()?;
        let (vertices, triangles) = (self.positions.rows(), self.triangles.rows());
        let mut sums = BTreeMap::new();
        let vertex_colors = self.colors.is_some();
        if let Some(mut colors) = self.colors.take() {
            colors.fill([0; 4], vertices)?;
            sums.insert(COLORS.to_owned(), colors.finish()?);
        }
        let triangle_colors = self.triangle_colors.is_some();
        if let Some(mut colors) = self.triangle_colors.take() {
            colors.fill([0; 4], triangles)?;
            sums.insert(TRIANGLE_COLORS.to_owned(), colors.finish()?);
        }
        if vertex_colors || triangle_colors {
            self.tally.add_many(GREY, self.uncoloured);
        }
        let normals = self.normals.is_some() && self.with_normal == vertices;
        if let Some(column) = self.normals.take() {
            let sum = column.finish()?;
            if normals {
                sums.insert(NORMALS.to_owned(), sum);
            } else {
                self.scratch.remove(NORMALS)?;
                self.tally.add_many(NO_NORMAL, self.with_normal);
            }
        }
        let has_high_bits = self.triangles_high.is_some();
        if let Some(mut high) = self.triangles_high.take() {
            high.fill([0; 3], triangles)?;
            sums.insert(TRIANGLES_HIGH.to_owned(), high.finish()?);
        }
        sums.insert(POSITIONS.to_owned(), self.positions.finish()?);
        sums.insert(TRIANGLES.to_owned(), self.triangles.finish()?);
        let mut tally = std::mem::take(&mut self.tally);
        let scalars = std::mem::take(&mut self.scalars);
        let channels = finish_channels(&self.scratch, scalars, &self.declared, &mut tally, &mut sums)?;
        let color = if vertex_colors || triangle_colors {
            ColorSource::Given
        } else {
            grey(&self.scratch, &channels, vertices, &mut tally)?
        };
        let bounds = (self.bounds[0].x <= self.bounds[1].x).then_some(self.bounds);
        Ok(Spooled {
            vertices,
            triangles,
            bounds,
            color,
            vertex_colors,
            triangle_colors,
            has_high_bits,
            vertex_range: self.vertex_range,
            normals,
            channels,
            tally,
            pictures: self.pictures,
            sums,
        })
    }

    /// Deliver a mesh that is in memory as the current input.
    ///
    /// # Errors
    /// [`ReadError::Sink`], [`ReadError::TooLarge`].
    pub fn add(&mut self, mesh: &RawMesh) -> Result<(), ReadError> {
        let names: Vec<String> = mesh.scalars.iter().map(|(name, _)| name.clone()).collect();
        self.channels(&names)?;
        let scalars: Vec<Vec<f32>> = mesh.scalars.iter().map(|(_, values)| values.clone()).collect();
        let (colors, normals) = (&mesh.colors, &mesh.normals);
        self.vertices(&VertexBlock { positions: &mesh.positions, colors, normals, scalars: &scalars })?;
        for block in mesh.triangles.chunks(ROWS) {
            let has_high_bits: Vec<[u64; 3]> = block.iter().map(|t| t.map(u64::from)).collect();
            self.triangles(&has_high_bits, &[])?;
        }
        self.diagnostics.merge(mesh.diagnostics.clone());
        Ok(())
    }
}

impl Current {
    fn new(path: &Path, first_vertex: u64, first_triangle: u64) -> Self {
        Self {
            path: path.to_owned(),
            first_vertex,
            first_triangle,
            delivered: 0,
            channels: Vec::new(),
            coloured: 0,
            with_normal: 0,
            coloured_triangles: 0,
            largest: None,
        }
    }
}

/// Close the channels, drop an alpha that says nothing, and order them so that the order of the inputs does not matter.
fn finish_channels(
    scratch: &Scratch,
    scalars: Vec<Scalar>,
    declared: &[Vec<String>],
    tally: &mut Tally,
    sums: &mut BTreeMap<String, Sum>,
) -> Result<Vec<Channel>, ScratchError> {
    let mut channels = Vec::new();
    for (i, s) in scalars.into_iter().enumerate() {
        let file = channel_file(i);
        let rows = s.column.rows();
        let sum = s.column.finish()?;
        let opaque = s.name.eq_ignore_ascii_case("alpha") && s.min == 1.0 && s.max == 1.0 && !s.not_finite;
        if opaque {
            scratch.remove(&file)?;
            tally.add_many(OPAQUE, rows);
            continue;
        }
        sums.insert(file.clone(), sum);
        let (min, max) = if s.min <= s.max { (s.min, s.max) } else { (0.0, 0.0) };
        channels.push(Channel { name: s.name, file, min, max });
    }
    if declared.windows(2).any(|w| w[0] != w[1]) {
        channels.sort_by(|a, b| a.name.cmp(&b.name));
    }
    Ok(channels)
}

fn channel_file(i: usize) -> String {
    format!("scalar-{i}")
}

/// Where a mesh without colours has an intensity: the values between its 1st and 99th percentile become greys.
fn grey(scratch: &Scratch, channels: &[Channel], rows: u64, tally: &mut Tally) -> Result<ColorSource, ScratchError> {
    let is_intensity = |c: &&Channel| {
        let name = c.name.to_ascii_lowercase();
        name == "intensity" || name == "scalar_intensity"
    };
    let Some(channel) = channels.iter().find(is_intensity).filter(|c| c.min < c.max) else {
        return Ok(ColorSource::None);
    };
    let file = scratch.existing(&channel.file)?;
    let (low, scale) =
        (f64::from(channel.min), (CLASSES - 1) as f64 / (f64::from(channel.max) - f64::from(channel.min)));
    let mut counts = vec![0u64; CLASSES];
    let mut bytes = vec![0u8; ROWS * 4];
    for first in (0..rows).step_by(ROWS) {
        let n = (rows - first).min(ROWS as u64) as usize;
        file.read_into(first * 4, &mut bytes[..4 * n])?;
        for row in bytes[..4 * n].as_chunks::<4>().0 {
            let v = f32::from_le_bytes(*row);
            if v.is_finite() {
                counts[((f64::from(v) - low) * scale) as usize] += 1;
            }
        }
    }
    let total: u64 = counts.iter().sum();
    let at = |share: f64| {
        let mut left = (total.saturating_sub(1) as f64 * share) as u64;
        let class = counts.iter().position(|&n| {
            let here = left < n;
            left = left.saturating_sub(n);
            here
        });
        (low + class.unwrap_or(0) as f64 / scale) as f32
    };
    let (black, white) = (at(0.01), at(0.99));
    let (black, white) = if black < white { (black, white) } else { (channel.min, channel.max) };
    tally.add_many(FROM_INTENSITY, rows);
    Ok(ColorSource::Scalar { file: channel.file.clone(), black, white })
}

impl VertexSink for Spool {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        let first = self.current.first_vertex;
        for name in names {
            let known = self.scalars.iter().position(|s| s.name == *name);
            let index = if let Some(i) = known {
                i
            } else {
                let i = self.scalars.len();
                let mut column = Column::create(&self.scratch, &channel_file(i), 4)?;
                column.fill(0f32.to_le_bytes(), first)?;
                let (min, max) = if first > 0 { (0.0, 0.0) } else { (f32::INFINITY, f32::NEG_INFINITY) };
                self.tally.add_many(NO_SCALAR, first);
                self.scalars.push(Scalar { name: name.clone(), column, min, max, not_finite: false });
                i
            };
            self.current.channels.push(index);
        }
        Ok(())
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        let (before, n) = (self.positions.rows(), block.positions.len() as u64);
        if before + n > MAX_VERTICES {
            let what = format!("with it there are more than {MAX_VERTICES} vertices: build parts of the site");
            return Err(ReadError::TooLarge { file: self.current.path.clone(), what });
        }
        let [min, max] = &mut self.bounds;
        let number = before - self.current.first_vertex;
        for (i, p) in block.positions.iter().enumerate() {
            if p.is_finite() {
                (*min, *max) = (min.min(*p), max.max(*p));
            } else {
                let place = || format!("vertex {} ({} {} {})", number + i as u64, p.x, p.y, p.z);
                self.diagnostics.add(NO_POSITION, place);
            }
        }
        self.positions.push(block.positions.iter().map(row_of_position))?;
        if !block.colors.is_empty() {
            if self.colors.is_none() {
                self.colors = Some(Column::create(&self.scratch, COLORS, 4)?);
            }
            self.current.coloured += n;
        }
        if let Some(column) = &mut self.colors {
            column.fill([0; 4], before)?;
            column.push(block.colors.iter().map(|[r, g, b]| [*r, *g, *b, 1]))?;
        }
        if !block.normals.is_empty() {
            if self.normals.is_none() {
                self.normals = Some(Column::create(&self.scratch, NORMALS, 4)?);
            }
            self.current.with_normal += n;
        }
        if let Some(column) = &mut self.normals {
            column.fill([0; 4], before)?;
            column.push(block.normals.iter().map(row_of_normal))?;
        }
        for (i, values) in self.current.channels.iter().zip(block.scalars) {
            let scalar = &mut self.scalars[*i];
            for v in values {
                scalar.see(*v);
            }
            scalar.column.push(values.iter().map(|v| v.to_le_bytes()))?;
        }
        for i in &self.current.channels {
            let scalar = &mut self.scalars[*i];
            scalar.not_finite |= scalar.column.rows() < before + n;
            scalar.column.fill(f32::NAN.to_le_bytes(), before + n)?;
        }
        Ok(())
    }

    fn vertex_count(&self) -> u64 {
        self.positions.rows() - self.current.first_vertex
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}

impl MeshSink for Spool {
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        let before = self.triangles.rows();
        if !colors.is_empty() && self.triangle_colors.is_none() {
            self.triangle_colors = Some(Column::create(&self.scratch, TRIANGLE_COLORS, 4)?);
        }
        if let Some(column) = &mut self.triangle_colors {
            column.fill([0; 4], before)?;
        }
        let c = &mut self.current;
        for (i, t) in triangles.iter().enumerate() {
            c.delivered += 1;
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                self.diagnostics.add(TWICE, || format!("triangle of the vertices {}, {} and {}", t[0], t[1], t[2]));
                continue;
            }
            let largest = t[0].max(t[1]).max(t[2]);
            if c.largest.is_none_or(|l| largest > l.0) {
                c.largest = Some((largest, c.delivered - 1));
                if largest > MAX_VERTICES {
                    let (file, vertices) = (c.path.clone(), self.positions.rows() - c.first_vertex);
                    return Err(ReadError::Index { file, triangle: c.delivered - 1, vertex: largest, vertices });
                }
            }
            let numbers = t.map(|v| c.first_vertex + v);
            let [min, max] = [numbers.iter().min(), numbers.iter().max()].map(|v| v.copied().unwrap_or_default());
            self.vertex_range = Some(self.vertex_range.map_or([min, max], |[a, b]| [a.min(min), b.max(max)]));
            if max > u64::from(u32::MAX) && self.triangles_high.is_none() {
                self.triangles_high = Some(Column::create(&self.scratch, TRIANGLES_HIGH, 3)?);
            }
            if let Some(high) = &mut self.triangles_high {
                high.fill([0; 3], self.triangles.rows())?;
                high.push(std::iter::once(numbers.map(|v| (v >> 32) as u8)))?;
            }
            let mut row = [0; 12];
            for (bytes, v) in row.as_chunks_mut::<4>().0.iter_mut().zip(numbers) {
                *bytes = (v as u32).to_le_bytes();
            }
            self.triangles.push(std::iter::once(row))?;
            if let (Some(column), Some([r, g, b])) = (&mut self.triangle_colors, colors.get(i)) {
                column.push(std::iter::once([*r, *g, *b, 1]))?;
                c.coloured_triangles += 1;
            }
        }
        Ok(())
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        let rows = self.positions.rows();
        self.cache.resize_with(CACHE_BLOCKS, || (u64::MAX, Vec::new()));
        for v in of {
            let row = self.current.first_vertex.saturating_add(*v);
            if row >= rows {
                into.push(DVec3::NAN);
                continue;
            }
            let block = row / CACHE_BLOCK;
            let slot = &mut self.cache[block as usize % CACHE_BLOCKS];
            let within = (row % CACHE_BLOCK) as usize;
            if slot.0 != block || slot.1.len() <= within {
                let first = block * CACHE_BLOCK;
                let mut bytes = vec![0; (rows - first).min(CACHE_BLOCK) as usize * 24];
                self.positions.read(first, &mut bytes)?;
                *slot = (block, bytes.as_chunks::<24>().0.iter().map(position_of_row).collect());
            }
            into.push(slot.1[within]);
        }
        Ok(())
    }
}

fn row_of_position(p: &DVec3) -> [u8; 24] {
    let mut row = [0; 24];
    for (bytes, x) in row.as_chunks_mut::<8>().0.iter_mut().zip(p.to_array()) {
        *bytes = x.to_le_bytes();
    }
    row
}

/// The position in a row of the file.
pub(super) fn position_of_row(row: &[u8; 24]) -> DVec3 {
    let words = row.as_chunks::<8>().0;
    DVec3::new(f64::from_le_bytes(words[0]), f64::from_le_bytes(words[1]), f64::from_le_bytes(words[2]))
}

fn row_of_normal(n: &Vec3) -> [u8; 4] {
    let [a, b] = normal::encode(n.as_dvec3()).map(i16::to_le_bytes);
    [a[0], a[1], b[0], b[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::Provenance;
    use crate::build::progress::Silent;
    use crate::build::work::{Stop, Work};
    use crate::ingest::surface::Ingested;
    use crate::ingest::{IngestOptions, ingest, is_file_of_ingest};
    use kilwa_simplify::Precision;

    /// The leaves of a mesh whose vertices come after `unused` others that no triangle names.
    fn ingested(mesh: &RawMesh, unused: u64) -> Vec<Vec<u8>> {
        let (scratch, stop) = (Scratch::temporary().unwrap(), Stop::default());
        let mut spool = Spool::create(&scratch, Path::new("mesh")).unwrap();
        spool.positions.skip_to(unused).unwrap();
        spool.input(Path::new("mesh")).unwrap();
        spool.add(mesh).unwrap();
        let spooled = spool.finish().unwrap();
        assert_eq!(spooled.vertices, unused + mesh.positions.len() as u64);
        assert_eq!(spooled.has_high_bits, spooled.vertices > 1 << 32);
        // The journal removes any other file once the inputs have been read.
        assert!(spooled.files().into_iter().all(is_file_of_ingest));
        let there: Vec<&str> = spooled.files().into_iter().filter(|f| scratch.length(f).is_some()).collect();
        assert!(there.len() == spooled.sums.len() && there.iter().all(|f| spooled.sums.contains_key(*f)), "{there:?}");
        let options = IngestOptions {
            leaf_triangles: 100,
            step: None,
            crop: None,
            min_confidence: None,
            drop_islands_below: None,
            precision: Precision { color_bits: 8, normal_bits: 10 },
        };
        let work = Work { scratch: &scratch, memory: 1 << 30, threads: 2, stop: &stop, progress: &Silent };
        let Ingested { leaves, tree, .. } = ingest(&work, Some(spooled), &options, Provenance::default()).unwrap();
        assert!(leaves.len() > 20);
        let patch = |t: u32| leaves.read_encoded(t).unwrap().map_or_else(Vec::new, |(_, bytes)| bytes);
        tree.leaves().map(patch).collect()
    }

    #[test]
    fn numbers_of_vertices_around_and_beyond_32_bits_give_the_same_surface() {
        let side = 60u32;
        let at = |i: u32| DVec3::new((i % side).into(), (i / side).into(), (f64::from(i) * 0.1).sin());
        let corner = |i: u32| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]];
        let mesh = RawMesh {
            positions: (0..side * side).map(at).collect(),
            triangles: (0..side * (side - 1)).filter(|i| i % side < side - 1).flat_map(corner).collect(),
            ..RawMesh::default()
        };
        let expected = ingested(&mesh, 0);
        // Some triangles with numbers below 2^32, some on both sides of it, some beyond.
        for unused in [7, (1 << 32) - 1000, (1 << 32) + 3] {
            assert!(ingested(&mesh, unused) == expected, "{unused} unused vertices");
        }
    }
}

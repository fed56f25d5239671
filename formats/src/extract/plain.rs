//! Writing a mesh that comes from no pack, vertex by vertex, in the formats of extraction.

use super::format::{Encoder, Format, Target};
use super::output::Scratch;
use super::stream::Counts;
use super::{ExtractError, Output};
use glam::DVec3;
use kilwa_files::atomic::Pending;
use kilwa_geometry::{Aabb, Lattice, Mesh, normal};
use std::io::Write;
use std::path::Path;

/// What must be known of a mesh before its first vertex.
#[derive(Debug, Clone)]
pub struct About {
    /// Its title.
    pub title: String,
    /// What the mesh is, in one line for the head of the file.
    pub note: String,
    /// Coordinate reference system, where known.
    pub crs: Option<String>,
    /// Whether vertices have colours.
    pub colors: bool,
    /// Names of the scalars of vertices.
    pub scalars: Vec<String>,
    /// A box that holds every vertex, metres.
    pub bounds: [DVec3; 2],
}

/// A vertex, in metres.
#[derive(Debug, Clone, Copy)]
pub struct PlainVertex<'a> {
    /// Where.
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// sRGB; not looked at if the mesh has no colours.
    pub color: [u8; 3],
    /// One value for each scalar.
    pub scalars: &'a [f32],
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    /// Length of the file.
    pub bytes: u64,
    /// Vertices in it.
    pub vertices: u64,
    /// Triangles in it.
    pub triangles: u64,
}

/// A mesh that is being written: two scratch files grow, and [`MeshWriter::finish`] makes the file of them.
///
/// Positions are rounded to a lattice of 2^-20 m (a micrometre), coarser only for meshes more than a kilometre wide.
pub struct MeshWriter<'o> {
    output: &'o Output,
    encoder: Box<dyn Encoder>,
    scratch: Scratch,
    lattice: Lattice,
    one: Mesh,
    counts: Counts,
    positions: Vec<kilwa_geometry::LatticePoint>,
    bytes: Vec<u8>,
}

/// The finest lattice, and the width of a mesh in steps.
const FINEST_LOG2: i32 = -20;
const WIDTH_LOG2: i32 = 30;

impl<'o> MeshWriter<'o> {
    /// Begin a mesh.
    ///
    /// # Errors
    /// If a scratch file cannot be made, or the format cannot represent the coordinates.
    pub fn begin(format: Format, about: &About, output: &'o Output) -> Result<Self, ExtractError> {
        let [min, max] = about.bounds;
        let origin = min.floor();
        let width = (max - origin).max_element().max(1e-6);
        let mut step_log2 = FINEST_LOG2;
        while width > 2f64.powi(WIDTH_LOG2 + step_log2) {
            step_log2 += 1;
        }
        let lattice = Lattice { origin, step_log2 };
        let point = |p: DVec3| ((p - origin) / lattice.step()).round().as_ivec3();
        let bounds = Aabb { min: point(min), max: point(max) };
        let target = Target::plain(about, lattice, bounds, format)?;
        let one = Mesh {
            positions: vec![bounds.min],
            colors: if about.colors { vec![[0; 3]] } else { Vec::new() },
            normals: vec![normal::encode(DVec3::Z)],
            scalars: vec![vec![0.0]; about.scalars.len()],
            ..Mesh::default()
        };
        let encoder = format.encoder(&target);
        let scratch = output.scratch()?;
        let (positions, bytes) = (Vec::new(), Vec::new());
        Ok(Self { output, encoder, scratch, lattice, one, counts: Counts::default(), positions, bytes })
    }

    /// Add a vertex; its number.
    ///
    /// # Errors
    /// If there are too many for the format, or the disk is full.
    pub fn vertex(&mut self, vertex: &PlainVertex<'_>) -> Result<u32, ExtractError> {
        let limit = self.encoder.max_vertices();
        let number = u32::try_from(self.positions.len()).ok().filter(|n| *n < limit);
        let number = number.ok_or(ExtractError::TooManyVertices { limit })?;
        let position = ((vertex.position - self.lattice.origin) / self.lattice.step()).round().as_ivec3();
        self.positions.push(position);
        if !self.encoder.shares_vertices() {
            return Ok(number);
        }
        self.one.positions[0] = position;
        self.one.normals[0] = normal::encode(vertex.normal);
        if let Some(color) = self.one.colors.first_mut() {
            *color = vertex.color;
        }
        for (channel, value) in self.one.scalars.iter_mut().zip(vertex.scalars) {
            channel[0] = *value;
        }
        self.bytes.clear();
        self.encoder.vertex(&mut self.bytes, &self.one, 0);
        self.scratch.vertices.write_all(&self.bytes).map_err(ExtractError::Scratch)?;
        self.counts.vertices += 1;
        Ok(number)
    }

    /// Add a triangle of vertices that were added before.
    ///
    /// # Errors
    /// If the disk is full.
    pub fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ExtractError> {
        let points = corners.map(|k| self.positions.get(k as usize).copied().unwrap_or_default());
        // Corners that the lattice makes one point are no triangle.
        if points[0] == points[1] || points[1] == points[2] || points[2] == points[0] {
            return Ok(());
        }
        self.bytes.clear();
        self.encoder.triangle(&mut self.bytes, corners, points);
        self.scratch.triangles.write_all(&self.bytes).map_err(ExtractError::Scratch)?;
        self.counts.triangles += 1;
        Ok(())
    }

    /// How many triangles it has.
    pub fn triangles(&self) -> u64 {
        self.counts.triangles
    }

    /// Write the file.
    ///
    /// # Errors
    /// [`ExtractError::Empty`] for a mesh without triangles; what the system says.
    pub fn finish(self) -> Result<Written, ExtractError> {
        let (output, counts) = (self.output, self.counted()?);
        let Self { encoder, mut scratch, .. } = self;
        let bytes = output.write(|out| encoder.assemble(out, &mut scratch, counts))?;
        Ok(Written { bytes, vertices: counts.vertices, triangles: counts.triangles })
    }

    /// Write the file that will be at `path`, in the folder of the output, but do not give it its name yet, so that several files can be named together.
    ///
    /// # Errors
    /// As for [`Self::finish`].
    pub fn finish_as(self, path: &Path) -> Result<(Written, Pending), ExtractError> {
        let (output, counts) = (self.output, self.counted()?);
        let Self { encoder, mut scratch, .. } = self;
        let (bytes, pending) = output.write_pending(path, |out| encoder.assemble(out, &mut scratch, counts))?;
        Ok((Written { bytes, vertices: counts.vertices, triangles: counts.triangles }, pending))
    }

    /// What the file will have.
    fn counted(&self) -> Result<Counts, ExtractError> {
        let mut counts = self.counts;
        if counts.triangles == 0 {
            return Err(ExtractError::Empty);
        }
        if !self.encoder.shares_vertices() {
            counts.vertices = 3 * counts.triangles;
        }
        Ok(counts)
    }
}

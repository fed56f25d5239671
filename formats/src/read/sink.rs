//! Where readers deliver to. A reader never holds the mesh: it hands on blocks of vertices and of triangles in the order
//! of the file, and the sink keeps them (in memory: [`super::MemorySink`]; in scratch files: the builder).
//!
//! Vertices are numbered from 0 within one input, in the order of delivery; triangles name these numbers. A triangle may
//! name vertices that come later. What cannot be kept is dropped and counted by the reader in [`VertexSink::diagnostics`]; what needs all
//! vertices (indices out of range, positions that are not finite) the sink checks.

use super::ReadError;
use crate::Diagnostics;
use glam::{DVec3, Vec3};

/// Diagnostic: a triangle names a vertex twice. Reader or sink.
pub const TWICE: &str = "triangles that name a vertex twice dropped";
/// Diagnostic: a vertex that is not finite. Sink.
pub const NO_POSITION: &str = "vertices without a finite position dropped";
/// Diagnostic: a triangle at such a vertex. Sink; the reader for polygons that it does not cut for that reason.
pub const NOT_FINITE: &str = "triangles dropped because a corner has no finite position";
/// Diagnostic: a vertex that no triangle names. Sink, once per input.
pub const UNUSED: &str = "vertices that no triangle uses";

/// A block of vertices. Every attribute that is present has one entry per position; an input may give an attribute for
/// some blocks and not for others.
#[derive(Debug, Clone, Copy, Default)]
pub struct VertexBlock<'a> {
    /// Positions in the file's own units and axes. Not finite: the vertex keeps its number, its triangles are dropped.
    pub positions: &'a [DVec3],
    /// sRGB colours, 8 bits a channel, or empty.
    pub colors: &'a [[u8; 3]],
    /// Normals as given, not normalised, or empty.
    pub normals: &'a [Vec3],
    /// Scalars, one list for each channel declared by [`VertexSink::channels`].
    pub scalars: &'a [Vec<f32>],
}

/// Receives the vertices of one input.
pub trait VertexSink {
    /// Declare the scalar channels of this input by name; at most once, before the first vertex.
    ///
    /// # Errors
    /// [`ReadError`] where there are more than the format holds.
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError>;

    /// Append vertices.
    ///
    /// # Errors
    /// [`ReadError`] where they cannot be kept, for example because the scratch disk is full.
    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError>;

    /// Vertices delivered so far.
    fn vertex_count(&self) -> u64;

    /// Where the reader counts what it drops and repairs.
    fn diagnostics(&mut self) -> &mut Diagnostics;
}

/// Receives one input.
pub trait MeshSink: VertexSink {
    /// Append triangles by vertex numbers. `colors` is empty, or one colour per triangle that its three corners have
    /// instead of the colours of their vertices (a vertex where colours differ becomes several wedges).
    ///
    /// # Errors
    /// As [`VertexSink::vertices`].
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError>;

    /// Positions of vertices delivered before, for triangulating polygons: one per number, in order.
    ///
    /// # Errors
    /// As [`VertexSink::vertices`]; a number that was not delivered is the reader's mistake and gives NaN.
    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError>;
}

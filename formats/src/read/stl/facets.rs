//! Facets on their way to the sink, in blocks of constant size.

use super::super::{MeshSink, ReadError, VertexBlock};
use glam::DVec3;

/// Facets in a block.
const BLOCK: usize = 1 << 14;
/// Diagnostic: the given normal points away from the side from which the corners run counter-clockwise.
pub(super) const CONTRADICTS: &str = "facets whose normal contradicts the order of their corners; the order counts";

/// Collects facets and hands them on.
pub(super) struct Facets<'a> {
    sink: &'a mut dyn MeshSink,
    positions: Vec<DVec3>,
    /// Empty, or one per facet of the block.
    colors: Vec<[u8; 3]>,
    delivered: u64,
}

impl<'a> Facets<'a> {
    pub(super) fn new(sink: &'a mut dyn MeshSink) -> Self {
        Self { sink, positions: Vec::with_capacity(3 * BLOCK), colors: Vec::new(), delivered: 0 }
    }

    /// Facets handed on or in hand.
    pub(super) fn delivered(&self) -> u64 {
        self.delivered
    }

    /// The diagnostics of the sink.
    pub(super) fn diagnostics(&mut self) -> &mut crate::Diagnostics {
        self.sink.diagnostics()
    }

    /// Add a facet. A block has facets with a colour or without one, never both.
    pub(super) fn add(&mut self, corners: [DVec3; 3], color: Option<[u8; 3]>) -> Result<(), ReadError> {
        let mixed = !self.positions.is_empty() && self.colors.is_empty() == color.is_some();
        if mixed || self.positions.len() >= 3 * BLOCK {
            self.flush()?;
        }
        self.positions.extend(corners);
        self.colors.extend(color);
        self.delivered += 1;
        Ok(())
    }

    /// Count a facet whose given normal contradicts its corners: turned by more than 120 degrees, so that the rounding
    /// of slivers does not count.
    pub(super) fn check_normal(&mut self, normal: DVec3, corners: &[DVec3; 3], place: impl FnOnce() -> String) {
        let [a, b, c] = *corners;
        let made = (b - a).cross(c - a);
        let lengths = libm::sqrt(normal.length_squared() * made.length_squared());
        if lengths > 0.0 && normal.dot(made) < -0.5 * lengths {
            self.diagnostics().add(CONTRADICTS, place);
        }
    }

    /// Hand on what is in hand.
    pub(super) fn flush(&mut self) -> Result<(), ReadError> {
        if self.positions.is_empty() {
            return Ok(());
        }
        let first = self.sink.vertex_count();
        self.sink.vertices(&VertexBlock { positions: &self.positions, ..VertexBlock::default() })?;
        let count = self.positions.len() as u64 / 3;
        let triangles: Vec<[u64; 3]> = (0..count).map(|i| [0, 1, 2].map(|k| first + 3 * i + k)).collect();
        self.sink.triangles(&triangles, &self.colors)?;
        self.positions.clear();
        self.colors.clear();
        Ok(())
    }
}

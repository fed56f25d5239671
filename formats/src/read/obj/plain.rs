//! Vertices and faces of an OBJ as they stand, where corners have nothing of their own: vertex numbers are those of the
//! file, and nothing is held but the blocks in the making.

use super::material::Material;
use super::statements::Corner;
use super::{Body, MeshSink, ReadError};
use crate::Diagnostics;
use crate::read::faces::{FaceColor, Faces};
use crate::read::sink::VertexBlock;
use glam::{DVec2, DVec3};

/// Vertices handed on at a time.
const BLOCK: usize = 4096;

pub(super) struct Plain<'s> {
    sink: &'s mut dyn MeshSink,
    diagnostics: Diagnostics,
    /// Whether vertices have colours; then those of materials are not looked at.
    has_colors: bool,
    positions: Vec<DVec3>,
    /// Empty, or one for each position.
    colors: Vec<[u8; 3]>,
    faces: Faces,
    material: FaceColor,
    ring: Vec<u64>,
}

impl<'s> Plain<'s> {
    pub(super) fn new(has_colors: bool, sink: &'s mut dyn MeshSink, diagnostics: Diagnostics) -> Self {
        Self {
            sink,
            diagnostics,
            has_colors,
            positions: Vec::with_capacity(BLOCK),
            colors: Vec::new(),
            faces: Faces::new("line"),
            material: None,
            ring: Vec::new(),
        }
    }

    fn flush_vertices(&mut self) -> Result<(), ReadError> {
        if !self.positions.is_empty() {
            let (positions, colors) = (&self.positions, &self.colors);
            self.sink.vertices(&VertexBlock { positions, colors, ..VertexBlock::default() })?;
            self.positions.clear();
            self.colors.clear();
        }
        Ok(())
    }

    fn flush_faces(&mut self) -> Result<(), ReadError> {
        self.flush_vertices()?;
        self.faces.flush(self.sink, &mut self.diagnostics)
    }
}

impl Body for Plain<'_> {
    #[inline]
    fn vertex(&mut self, position: DVec3, color: Option<[u8; 3]>) -> Result<(), ReadError> {
        // A block has colours throughout or not at all.
        let changes = color.is_some() == self.colors.is_empty() && !self.positions.is_empty();
        if changes || self.positions.len() >= BLOCK {
            self.flush_vertices()?;
        }
        self.positions.push(position);
        self.colors.extend(color);
        Ok(())
    }

    fn uv(&mut self, _: DVec2) -> Result<(), ReadError> {
        Ok(())
    }

    fn normal(&mut self, _: DVec3) -> Result<(), ReadError> {
        Ok(())
    }

    fn material(&mut self, material: &Material) -> Result<(), ReadError> {
        let color = material.color.filter(|_| !self.has_colors);
        if color.is_some() != self.material.is_some() {
            self.flush_faces()?;
        }
        self.material = color;
        Ok(())
    }

    #[inline]
    fn face(&mut self, corners: &[Corner], line: u64) -> Result<(), ReadError> {
        self.ring.clear();
        self.ring.extend(corners.iter().map(|c| c.vertex));
        self.faces.face(&self.ring, self.material, line, &mut self.diagnostics);
        if self.faces.is_full() { self.flush_faces() } else { Ok(()) }
    }

    fn may_look_ahead(&self, corners: usize) -> bool {
        corners <= 3
    }

    fn needs_corners(&self) -> bool {
        false
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }

    fn finish(mut self) -> Result<(u64, Diagnostics), ReadError> {
        self.flush_faces()?;
        Ok((self.faces.delivered(), self.diagnostics))
    }
}

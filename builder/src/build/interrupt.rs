//! A sink that refuses further blocks once a stop was asked for.

use crate::build::work::Stop;
use glam::DVec3;
use kilwa_formats::Diagnostics;
use kilwa_formats::read::{MeshSink, ReadError, VertexBlock, VertexSink};
use std::path::Path;

/// Hands on to another sink until a stop is asked for.
pub struct Interruptible<'a> {
    sink: &'a mut dyn MeshSink,
    stop: &'a Stop,
    path: &'a Path,
}

impl<'a> Interruptible<'a> {
    /// Hands on to `sink`; `path` is the input in hand.
    pub fn new(sink: &'a mut dyn MeshSink, stop: &'a Stop, path: &'a Path) -> Self {
        Self { sink, stop, path }
    }

    fn check(&self) -> Result<(), ReadError> {
        if self.stop.asked() {
            let source = std::io::ErrorKind::Interrupted.into();
            return Err(ReadError::Io { file: self.path.to_owned(), offset: 0, source });
        }
        Ok(())
    }
}

impl VertexSink for Interruptible<'_> {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        self.sink.channels(names)
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        self.check()?;
        self.sink.vertices(block)
    }

    fn vertex_count(&self) -> u64 {
        self.sink.vertex_count()
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        self.sink.diagnostics()
    }
}

impl MeshSink for Interruptible<'_> {
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        self.check()?;
        self.sink.triangles(triangles, colors)
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        self.sink.positions(of, into)
    }
}
